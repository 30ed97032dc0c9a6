"""``TeamDetector``: a detector, Algorithm 2 and a fusion, in this order; ``TeamFusion``: the last two."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from midnet_bench.errors import MidnetBenchError
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.detection import BoxArray
from midnet_bench.midnet.pipeline import Ally, Frame, MIDNet, Observation
from midnet_bench.rivals.detector import Detector
from midnet_bench.rivals.fusion import Fusion
from midnet_bench.rivals.seams import DETECTORS, FUSIONS
from midnet_bench.seams import ExtensionPoint


class TeamFusion:
    """Algorithm 2, and then the chosen fusion."""

    def __init__(self, midnet: MIDNet, fusion: str) -> None:
        """For one trial; ``fusion``: a pinned value of ``FUSIONS``. Raises PluginError: it cannot be made."""
        self._midnet, self._name = midnet, fusion
        self._fusion: Any = None if FUSIONS.is_made_here(fusion) else FUSIONS.make(fusion)

    @property
    def is_the_papers(self) -> bool:
        """Whether Algorithms 3 and 4 do it, which remember nothing."""
        return self._fusion is None

    def fuse(
        self,
        found: Sequence[BoxArray],
        poses: Sequence[Pose2D],
        time_s: float,
        allies: Sequence[Ally] = (),
    ) -> tuple[BoxArray, list[int]]:
        """The team's boxes, and for each the robot with the box that is nearest to it; frames come in order.

        Args:
            found: for each robot, at least one, (n, 4) boxes, map frame, metres, its allies among them.
            poses: each robot's latest.
            time_s: of the frame.
            allies: others to be removed.

        Raises:
            PluginError: the fusion failed, or gave what are no boxes.
        """
        team = self._midnet.team_of(found, poses, allies)
        if self._fusion is None:
            return team.detections, team.found_by.tolist()
        every = np.concatenate(found)[team.kept]
        lists = [every[team.starts[i] : team.starts[i + 1]] for i in range(len(found))]
        boxes = fused(self._fusion, self._name, lists, time_s)
        robots = np.repeat(np.arange(len(lists)), [len(own) for own in lists])
        if not len(every):
            return boxes, [0] * len(boxes)
        from scipy.spatial import KDTree  # a quarter of a second, which no trial of the paper's fusion needs

        _, nearest = KDTree(_centres(every)).query(_centres(boxes))
        return boxes, robots[nearest].tolist()


class TeamDetector:
    """What a team detects, by the chosen detector and fusion; MIDNet does the rest.

    Whatever comes from outside is checked here, so that what is wrong with it is said by its name.
    """

    def __init__(self, midnet: MIDNet, detector: "AskedOnce | None", fusion: str) -> None:
        """For one trial.

        Args:
            midnet: which takes out allies, and detects or fuses unless others do.
            detector: another one than MIDNet's own.
            fusion: a pinned value of ``FUSIONS``.

        Raises:
            PluginError: the fusion cannot be made.
        """
        self.midnet = midnet
        self._detector = detector
        self._fusion = TeamFusion(midnet, fusion)

    @property
    def is_the_papers(self) -> bool:
        """Whether section IV is done as it is written, and no frame depends on an earlier one."""
        return self._detector is None and self._fusion.is_the_papers

    def update(
        self,
        observations: Sequence[Observation],
        time_s: float,
        explain: bool = False,
        allies: Sequence[Ally] = (),
    ) -> Frame:
        """The team's detections at this instant; frames must come in order, each once.

        ``explain`` keeps what MIDNet's own detector did; others explain nothing. ``allies`` have no costmap.

        Raises:
            PluginError: the detector or the fusion failed, or gave what are no boxes.
        """
        if self.is_the_papers or not observations:
            return self.midnet.update(observations, explain, allies)
        poses = [observation.pose for observation in observations]
        explanation = None
        if self._detector is None:
            found = self.midnet.found_by_each(observations)
            if explain:
                explanation = self.midnet.update(observations, explain, allies).explanation
        else:
            found = self._detector.found(observations, time_s)
        boxes, found_by = self._fusion.fuse(found, poses, time_s, allies)
        return Frame([Box._make(row) for row in boxes.tolist()], found_by, explanation)


class AskedOnce:
    """A detector for one trial, or for several that see the same: it is called once for each frame."""

    def __init__(self, name: str, prior_map: OccupancyGrid, range_m: float) -> None:
        """Nothing is made before the first frame, so that what fails then costs only trials that ask.

        Args:
            name: a pinned value of ``DETECTORS`` that names another one than MIDNet's own.
            prior_map: int8, 100 occupied, map frame.
            range_m: up to which an intruder has to be found.
        """
        self._name, self._arguments = name, (prior_map, range_m)
        self._detector: Any = None
        self._time_s = math.nan
        self._found: list[BoxArray] | MidnetBenchError = []

    def found(self, observations: Sequence[Observation], time_s: float) -> list[BoxArray]:
        """For each robot (n, 4) boxes, map frame, metres; frames must come in order.

        Raises:
            PluginError: it cannot be made, it failed, or it gave what are no boxes.
        """
        if time_s != self._time_s:
            self._time_s = time_s
            try:
                if self._detector is None:
                    self._detector = DETECTORS.make(self._name, *self._arguments)
                self._found = detected(self._detector, self._name, observations)
            except MidnetBenchError as error:
                self._found = error
        if isinstance(self._found, MidnetBenchError):
            raise self._found
        return self._found


def detected(detector: Detector, name: str, observations: Sequence[Observation]) -> list[BoxArray]:
    """For each robot (n, 4) boxes, map frame, metres, by ``detector``, which ``DETECTORS`` knows as ``name``.

    Raises:
        PluginError: it failed, or gave what are no boxes of each robot.
    """
    with DETECTORS.calling(name):
        found = list(detector.detect(observations))
    if len(found) != len(observations):
        raise DETECTORS.refused(
            name,
            f"detect gave {len(found)} lists of boxes for {len(observations)} robots; "
            "give one for each, empty where there is nothing",
        )
    return [checked_boxes(own, DETECTORS, name) for own in found]


def fused(fusion: Fusion, name: str, lists: Sequence[BoxArray], time_s: float) -> BoxArray:
    """(n, 4) boxes of the team, map frame, metres, by ``fusion``, which ``FUSIONS`` knows as ``name``.

    Raises:
        PluginError: it failed, or gave what are no boxes.
    """
    with FUSIONS.calling(name):
        boxes = fusion.fuse(lists, time_s)
    return checked_boxes(boxes, FUSIONS, name)


def _centres(boxes: BoxArray) -> BoxArray:
    return (boxes[:, :2] + boxes[:, 2:]) / 2.0


def checked_boxes(given: object, seam: ExtensionPoint, name: str) -> BoxArray:
    """``given`` by code of ``seam`` as (n, 4) float64. Raises PluginError if they are no boxes."""
    said = f"{seam.method} gave"
    try:
        boxes = np.array(given, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise seam.refused(name, f"{said} no numbers: {' '.join(str(error).split())}") from error
    if boxes.size == 0:
        return np.empty((0, 4))
    if boxes.ndim != 2 or boxes.shape[1] != 4:
        raise seam.refused(name, f"{said} an array of shape {boxes.shape}; boxes have the shape (n, 4)")
    if not np.isfinite(boxes).all():
        wrong = boxes[~np.isfinite(boxes).all(axis=1)][0]
        raise seam.refused(name, f"{said} a box that is not finite: {wrong}")
    empty = (boxes[:, :2] >= boxes[:, 2:]).any(axis=1)
    if empty.any():
        needed = "x_min < x_max and y_min < y_max are needed"
        raise seam.refused(name, f"{said} a box without area: {boxes[empty][0]}; {needed}")
    return boxes
