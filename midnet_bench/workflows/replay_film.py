"""``film``: a recording drawn as trials are drawn, poses and scans beside MIDNet's boxes."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from midnet_bench.drawing.scene import Detection, Floats, FloorPlan, Robot, Scene, Setup, Truth
from midnet_bench.drawing.trial_video import trial_video
from midnet_bench.geometry import Box
from midnet_bench.grid import OccupancyGrid
from midnet_bench.recording.recording_settings import ReplaySettings
from midnet_bench.recording.replay import Replay, ReplayFrame
from midnet_bench.recording.scores import FrameScore, Score
from midnet_bench.robots.model import Outline
from midnet_bench.scoring.frame_counts import ratios

LEAST_WALL_CELLS = 3
"""an outline of fewer cells is left out of the picture of the place"""
LABEL_M = 0.3
"""side of the square that stands for a label, of which only the middle is known"""
SPEED = 1.0


@contextmanager
def film(
    title: str,
    preset: str,
    replay: Replay,
    prior_map: OccupancyGrid,
    settings: ReplaySettings,
    frames_hz: float,
    labels: int,
    folder: Path,
    driven: Box | None = None,
) -> Iterator[Callable[[ReplayFrame, FrameScore | None, Score], None]]:
    """What appends a frame to ``trial.mp4`` and ``storyboard.png`` in a folder; they are there in the end.

    Args:
        title: of the recording.
        preset: of the detector that is drawn.
        replay: that the frames are of.
        prior_map: int8, 100 occupied, map frame.
        settings: of that detector.
        frames_hz: frames a second of the recording.
        labels: how many objects are labelled.
        folder: where to.
        driven: the box of all the robots' positions, map frame, metres, to which pictures are cropped.

    Raises:
        InputError: the place cannot be written.
        MidnetBenchError: there is no room, or ffmpeg fails.
    """
    node = replay.nodes[preset]
    # of a recorded robot no more than its footprint is known
    model = replace(settings.robot_model, body=boxed(settings.robot_model.footprint))
    seen_m = max(settings.range_m, settings.costmap.size_m / 2.0)
    setup = Setup(
        plan=plan_of(title, prior_map, None if driven is None else driven.shrunk(-seen_m)),
        prior_map=prior_map,
        prior=node.prior,
        guards=len(replay.robots),
        mobile_intruders=0,
        usable_range_m=settings.range_m,
        local_size_m=settings.costmap.size_m,
        frame_hz=frames_hz,
        other_intruders=labels,
    )
    with trial_video(setup, folder, SPEED) as append:

        def take(frame: ReplayFrame, frame_score: FrameScore | None, score: Score) -> None:
            made, observations = frame.outputs[preset]
            explanation = node.midnet.update(
                observations, explain=True, allies=frame.fresh_allies
            ).explanation
            robots = [
                Robot(one.robot + 1, True, one.estimate.pose, one.estimate.pose, None, None, model)
                for one in frame.observed
            ]
            false, second = set[int](), set[int]()
            for place, k in enumerate(frame_score.scored if frame_score else ()):
                if frame_score is not None and frame_score.match.truth_of[place] is None:
                    (second if frame_score.match.touched[place] else false).add(k)
            detections = [
                Detection(box, frame.observed[robot].robot + 1, k in false, k in second)
                for k, (box, robot) in enumerate(zip(made.detections, made.robots, strict=True))
            ]
            truths, others = [], []
            for k, label in enumerate(frame_score.labels if frame_score else ()):
                outline = _square(label.x, label.y)
                found = frame_score is not None and frame_score.match.detection_of[k] is not None
                truths.append(Truth([outline], found, frame_score is not None and frame_score.in_range[k]))
                others.append([outline])
            counts = score.counts
            append(
                Scene(
                    time_s=(frame.time_ns - take_first(frame)) / 1e9,
                    frame=frame.number + 1,
                    robots=robots,
                    detections=detections,
                    truths=truths,
                    explanation=explanation,
                    others=others,
                    is_labelled=frame_score is not None,
                    scans=[one.returns for one in frame.observed],
                    so_far=ratios(counts.tp, counts.fp, counts.fn) if score.labelled else None,
                )
            )

        began: list[int] = []

        def take_first(frame: ReplayFrame) -> int:
            began.append(frame.time_ns) if not began else None
            return began[0]

        yield take


def boxed(outline: Outline) -> Outline:
    """The box around an outline, counter-clockwise, metres."""
    (x0, y0), (x1, y1) = np.min(outline, axis=0).tolist(), np.max(outline, axis=0).tolist()
    return ((x0, y0), (x1, y0), (x1, y1), (x0, y1))


def plan_of(title: str, prior_map: OccupancyGrid, shown: Box | None = None) -> FloorPlan:
    """The outlines of a map's walls, its free and unknown cells, and the rectangle of what it knows.

    Args:
        title: of the recording.
        prior_map: int8, 100 occupied, 0 free, -1 unknown.
        shown: what of it pictures show, map frame, metres; all of it unless given.
    """
    solid = (prior_map.data == 100).astype(np.uint8)
    contours, _ = cv2.findContours(solid, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    cell_m = prior_map.resolution
    walls: list[Floats] = []
    for contour in contours:
        _, _, width, height = cv2.boundingRect(contour)
        if max(width, height) >= LEAST_WALL_CELLS and len(contour) > 1:
            walls.append(np.array(prior_map.origin) + (contour[:, 0].astype(np.float64) + 0.5) * cell_m)
    rows, columns = np.nonzero(prior_map.data >= 0)
    if not len(rows):
        rows, columns = np.nonzero(np.ones_like(prior_map.data))
    x0, y0 = prior_map.origin
    enclosure = Box(
        x0 + float(columns.min()) * cell_m,
        y0 + float(rows.min()) * cell_m,
        x0 + float(columns.max() + 1) * cell_m,
        y0 + float(rows.max() + 1) * cell_m,
    )
    if shown is not None:
        (x1, y1, x2, y2), (left, low, right, high) = shown, enclosure
        shown = Box(max(x1, left), max(y1, low), min(x2, right), min(y2, high))
        if shown.x_min >= shown.x_max or shown.y_min >= shown.y_max:  # a drive off the map
            shown = None
    return FloorPlan(title, enclosure, walls, [], ground=prior_map, shown=shown)


def _square(x: float, y: float) -> Floats:
    half = LABEL_M / 2.0
    return np.array([(x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)])
