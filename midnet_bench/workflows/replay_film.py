"""``film``: a recording drawn as trials are drawn, what was believed beside what MIDNet made of it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from midnet_bench.drawing.scene import Detection, Floats, FloorPlan, Robot, Scene, Setup, Truth
from midnet_bench.drawing.trial_video import trial_video
from midnet_bench.geometry import Box
from midnet_bench.grid import OccupancyGrid
from midnet_bench.recording.replay import Replay, ReplayFrame
from midnet_bench.recording.scores import Judged, Score
from midnet_bench.recording.settings import ReplaySettings
from midnet_bench.scoring.frame_counts import ratios

LEAST_WALL_CELLS = 3
"""an outline of fewer cells is left out of the picture of the place"""
LABEL_M = 0.3
"""side of the square that stands for a label, of which only the middle is known"""
SPEED = 1.0


@contextmanager
def film(
    title: str,
    look: str,
    replay: Replay,
    prior_map: OccupancyGrid,
    settings: ReplaySettings,
    frames_hz: float,
    labels: int,
    folder: Path,
) -> Iterator[Callable[[ReplayFrame, Judged | None, Score], None]]:
    """What appends a frame to ``trial.mp4`` and ``storyboard.png`` in a folder; they are there in the end.

    Args:
        title: of the recording.
        look: which of the replay's detectors is drawn.
        replay: that the frames are of.
        prior_map: int8, 100 occupied, map frame.
        settings: of that detector.
        frames_hz: frames a second of the recording.
        labels: how many objects are labelled.
        folder: where to.

    Raises:
        InputError: the place cannot be written.
        MidnetBenchError: there is no room, or ffmpeg fails.
    """
    node = replay.nodes[look]
    model = settings.robot_model
    setup = Setup(
        plan=plan_of(title, prior_map),
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

        def take(frame: ReplayFrame, judged: Judged | None, score: Score) -> None:
            made, observations = frame.looks[look]
            explanation = node.midnet.update(observations, explain=True, allies=frame.told_allies).explanation
            robots = [
                Robot(one.robot + 1, True, one.told.pose, one.told.pose, None, None, model)
                for one in frame.seen
            ]
            match = judged.match if judged else None
            detections = [
                Detection(
                    box,
                    frame.seen[robot].robot + 1,
                    match is not None and not match.touched[k],
                    match is not None and bool(match.touched[k]) and match.truth_of[k] is None,
                )
                for k, (box, robot) in enumerate(zip(made.detections, made.robots, strict=True))
            ]
            truths, others = [], []
            for k, label in enumerate(judged.labels if judged else ()):
                outline = _square(label.x, label.y)
                found = judged is not None and judged.match.detection_of[k] is not None
                truths.append(Truth([outline], found, judged is not None and judged.in_range[k]))
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
                    so_far=ratios(counts.tp, counts.fp, counts.fn) if score.labelled else None,
                )
            )

        began: list[int] = []

        def take_first(frame: ReplayFrame) -> int:
            began.append(frame.time_ns) if not began else None
            return began[0]

        yield take


def plan_of(title: str, prior_map: OccupancyGrid) -> FloorPlan:
    """The outlines of a map's walls, and the rectangle of what it knows."""
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
    return FloorPlan(title, enclosure, walls, [])


def _square(x: float, y: float) -> Floats:
    half = LABEL_M / 2.0
    return np.array([(x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)])
