"""``film``: a recording drawn as trials are drawn, poses and scans beside MIDNet's boxes."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from midnet_bench.drawing.films import trial_video
from midnet_bench.drawing.scene import Detection, FloorPlan, Robot, Scene, Setup, Truth
from midnet_bench.errors import InputError
from midnet_bench.geometry import Box, Floats
from midnet_bench.grid import OccupancyGrid
from midnet_bench.recording.inputs import ReplayInputs
from midnet_bench.recording.replay import Replay, ReplayFrame
from midnet_bench.recording.scores import FrameScore, Score
from midnet_bench.robots.model import Outline
from midnet_bench.scoring.frame_counts import ratios

LEAST_WALL_CELLS = 3  # an outline of fewer cells is left out of the picture of the place
LABEL_M = 0.3  # side of the square that stands for a label, of which only the middle is known
SPEED = 1.0


@contextmanager
def film(
    preset: str, replay: Replay, inputs: ReplayInputs, labels: int, folder: Path
) -> Iterator[Callable[[ReplayFrame, FrameScore | None, Score], None]]:
    """What appends a frame to ``trial.mp4`` and ``storyboard.png`` in a folder; they are there in the end.

    So many ``labels`` are known; pictures are cropped to where the robots drive, unless poses are corrected.

    Raises:
        InputError: the place cannot be written.
        MidnetBenchError: there is no room, or ffmpeg fails.
    """
    node, prior_map, settings = replay.nodes[preset], replay.prior_map, replay.settings[preset]
    title = f"{inputs.recorded.names[0]}, preset {preset}"
    # of a recorded robot no more than its footprint is known
    model = replace(settings.robot_model, body=boxed(settings.robot_model.footprint))
    route = None
    if not inputs.setup.localize:  # corrected poses are known on the way alone
        route = driven(Replay(inputs.recorded, inputs.robots, prior_map, {}, inputs.setup))
    seen_m = max(settings.range_m, settings.costmap.size_m / 2.0)
    setup = Setup(
        plan=plan_of(title, prior_map, None if route is None else route.shrunk(-seen_m)),
        prior_map=prior_map,
        prior=node.prior,
        guards=len(replay.robots),
        mobile_intruders=0,
        usable_range_m=settings.range_m,
        local_size_m=settings.costmap.size_m,
        frame_hz=_frames_hz(inputs),
        other_intruders=labels,
    )
    first_ns: int | None = None
    with trial_video(setup, folder, SPEED) as append:

        def take(frame: ReplayFrame, frame_score: FrameScore | None, score: Score) -> None:
            nonlocal first_ns
            first_ns = frame.time_ns if first_ns is None else first_ns
            _, observations = frame.outputs[preset]
            made = node.midnet.update(observations, explain=True, allies=frame.fresh_allies)
            robots = [
                Robot(one.robot + 1, True, one.estimate.pose, one.estimate.pose, None, None, model)
                for one in frame.observed
            ]
            truths = _truths(frame_score) if frame_score else []
            counts = score.counts
            append(
                Scene(
                    time_s=(frame.time_ns - first_ns) / 1e9,
                    frame=frame.number + 1,
                    robots=robots,
                    detections=_detections(frame, preset, frame_score),
                    truths=truths,
                    explanation=made.explanation,
                    others=[truth.outlines for truth in truths],
                    is_labelled=frame_score is not None,
                    scans=[one.returns for one in frame.observed],
                    so_far=ratios(counts.tp, counts.fp, counts.fn) if score.labelled else None,
                )
            )

        yield take


def driven(replay: Replay) -> Box | None:
    """The box of all the positions of a replay's robots, map frame, metres; None if it has no frames.

    A fault in a recording ends it here and is reported by the replay that follows.
    """
    positions: list[tuple[float, float]] = []
    with suppress(InputError):
        for frame in replay.frames():
            positions += [(one.estimate.pose.x, one.estimate.pose.y) for one in frame.observed]
    if not positions:
        return None
    return Box(*np.min(positions, axis=0).tolist(), *np.max(positions, axis=0).tolist())


def _frames_hz(inputs: ReplayInputs) -> float:
    """Frames a second that the recording gives."""
    if inputs.setup.rate_hz is not None:
        return inputs.setup.rate_hz
    surveys = inputs.recorded.surveys
    scans = sum(surveys[one.source].streams[one.scan_topic].topic.messages for one in inputs.robots)
    return max(scans / max(max(one.duration_s for one in surveys), 0.1), 0.5)


def _detections(frame: ReplayFrame, preset: str, score: FrameScore | None) -> list[Detection]:
    made, false, second = frame.outputs[preset].frame, set[int](), set[int]()
    for place, k in enumerate(score.scored) if score else ():
        if score is not None and score.match.truth_of[place] is None:
            (second if score.match.touched[place] else false).add(k)
    return [
        Detection(box, frame.observed[robot].robot + 1, k in false, k in second)
        for k, (box, robot) in enumerate(zip(made.detections, made.robots, strict=True))
    ]


def _truths(score: FrameScore) -> list[Truth]:
    half = LABEL_M / 2.0
    corners = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    each = zip(score.labels, score.match.detection_of, score.in_range, strict=True)
    return [
        Truth([corners + np.array((label.x, label.y))], place is not None, is_in_range)
        for label, place, is_in_range in each
    ]


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
            walls.append(prior_map.origin + (contour[:, 0].astype(np.float64) + 0.5) * cell_m)
    known = prior_map.data >= 0
    rows, columns = np.nonzero(known if known.any() else ~known)
    corners = np.array([(columns.min(), rows.min()), (columns.max() + 1, rows.max() + 1)])
    enclosure = Box(*(prior_map.origin + corners * cell_m).ravel().tolist())
    if shown is not None:
        least, most = np.maximum(shown[:2], enclosure[:2]), np.minimum(shown[2:], enclosure[2:])
        # none of it of a drive off the map
        shown = Box(*least.tolist(), *most.tolist()) if (least < most).all() else None
    return FloorPlan(title, enclosure, walls, [], ground=prior_map, shown=shown)
