"""``DetectorNode``: from a map, poses and scans to the team's boxes; no simulator, arena or agent."""

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from midnet_bench.errors import InputError, MidnetBenchError
from midnet_bench.geometry import Box, Floats, LidarGeometry, Pose2D, Scan
from midnet_bench.grid import OCCUPIED_FROM, OccupancyGrid, cells_to_unset, values_at
from midnet_bench.midnet.detection import BoxArray, binary_map
from midnet_bench.midnet.midnet_settings import PriorMapSettings
from midnet_bench.midnet.pipeline import Ally, Frame, MIDNet, MIDNetSettings, Observation
from midnet_bench.navigation.costmap import RollingCostmap, static_costs
from midnet_bench.navigation.navigation_settings import CostmapSettings
from midnet_bench.plugins import DETECTORS, FUSIONS, ExtensionPoint

Number = TypeVar("Number", bound=np.generic)


class DetectorSettings(Protocol):
    """All that lies between a map, poses and scans and MIDNet's boxes; an experiment's parameters have it."""

    @property
    def prior_costmap(self) -> CostmapSettings:
        """The global costmap of the prior map."""

    @property
    def prior(self) -> PriorMapSettings:
        """The threshold on it."""

    @property
    def local_costmap(self) -> CostmapSettings:
        """Each robot's local costmap."""

    @property
    def midnet_settings(self) -> MIDNetSettings:
        """MIDNet itself."""

    @property
    def detector(self) -> str:
        """The detector, a value of ``DETECTORS``."""

    @property
    def fusion(self) -> str:
        """The fusion, a value of ``FUSIONS``."""


class WallEvidence:
    """The margin about a wall grows where the wall returns about are off, by pose, map or range."""

    MARGIN_M = 0.08  # about a wall whose returns lie on it: a cell and a half of 5 cm
    PER_MEDIAN = 1.5
    """added to the margin for each metre by which half of the wall returns about are off their walls"""
    ABOUT_RAD = math.radians(45.0)  # to either side, the angle of so many beams: the wall returns about
    SAMPLES = 45  # of them to either side, evenly taken, at most
    WALL_M = 0.4  # a return farther from any wall is no wall's
    DEPTH_M = 0.15  # beyond the margin, from which on a return says no more
    WIDTH_M = 0.03  # from which on the distance to the next beam says no more: far beams are few, not sure
    STEPS = 1024
    """shares are rounded down to whole parts of so many, so that any order of adding them gives the same"""

    def __init__(self, prior_map: OccupancyGrid, area_m2: float) -> None:
        """``area_m2``: from which on a return counts as one: its width times its depth beyond the margin."""
        self._map, self._area_m2 = prior_map, area_m2
        self._to_wall_m = cells_to_unset(prior_map.data < OCCUPIED_FROM) * np.float32(prior_map.resolution)

    def shares(self, scan: Scan) -> Floats:
        """(n,) of 0 to 1, one for each of ``scan.returns(inf)``."""
        beams, points = scan.returns(math.inf)
        turn_rad = max(abs(scan.lidar.angle_increment_rad), 1e-9)
        off_m = values_at(self._to_wall_m, self._map, points, 0.0).astype(np.float64)
        margin_m = np.zeros(len(beams))
        walls = np.flatnonzero(off_m < self.WALL_M)
        if len(walls):
            half = min(round(self.ABOUT_RAD / turn_rad), (len(walls) - 1) // 2)
            steps = np.arange(-half, half + 1, max(1, half // self.SAMPLES))
            about = off_m[walls[(np.arange(len(walls))[:, None] + steps) % len(walls)]]
            middle = len(steps) // 2
            margin_m[walls] = self.MARGIN_M + self.PER_MEDIAN * np.partition(about, middle, axis=1)[:, middle]
        widths_m = np.minimum(scan.ranges_m[beams] * turn_rad, self.WIDTH_M)
        areas_m2 = widths_m * np.clip(off_m - margin_m, 0.0, self.DEPTH_M)
        return np.asarray(np.floor(np.minimum(areas_m2 / self._area_m2, 1.0) * self.STEPS) / self.STEPS)


class TeamFusion:
    """Algorithm 2, and then the chosen fusion."""

    def __init__(self, midnet: MIDNet, fusion: str) -> None:
        """For one trial; ``fusion``: a pinned value of ``FUSIONS``, made when it is first used."""
        self._midnet, self._name = midnet, fusion
        self.is_the_papers = FUSIONS.is_made_here(fusion)  # Algorithms 3 and 4, which remember nothing

    @cached_property
    def _fusion(self) -> Any:
        return FUSIONS.make(self._name)

    def fuse(
        self, found: Sequence[BoxArray], poses: Sequence[Pose2D], time_s: float, allies: Sequence[Ally] = ()
    ) -> tuple[BoxArray, list[int]]:
        """The team's boxes, and for each the robot with the box that is nearest to it; frames come in order.

        ``found`` has (n, 4) boxes of each robot, at least one, map frame, metres, its allies among them.
        Raises PluginError: the fusion cannot be made, failed, or gave what are no boxes.
        """
        team = self._midnet.team_of(found, poses, allies)
        if self.is_the_papers:
            return team.detections, team.found_by.tolist()
        every = np.concatenate(found)[team.kept]
        boxes = fused(self._fusion, self._name, np.split(every, team.starts[1 : len(found)]), time_s)
        if not len(every):
            return boxes, [0] * len(boxes)
        from scipy.spatial import KDTree  # a quarter of a second, which no trial of the paper's fusion needs

        robots = np.repeat(np.arange(len(found)), np.diff(team.starts)[: len(found)])
        _, nearest = KDTree((every[:, :2] + every[:, 2:]) / 2.0).query((boxes[:, :2] + boxes[:, 2:]) / 2.0)
        return boxes, robots[nearest].tolist()


class _CachedDetector:
    """A detector for one trial, or for several that see the same: called once for each frame, in order."""

    def __init__(self, name: str, *arguments: Any) -> None:
        """``name``: a pinned value of ``DETECTORS``, made when it is first called."""
        self._name, self._arguments = name, arguments
        self._detector: Any = None
        self._time_s = math.nan
        self._found: list[BoxArray] | MidnetBenchError = []

    def found(self, observations: Sequence[Observation], time_s: float) -> list[BoxArray]:
        """As :func:`detected`, which raises, too."""
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


class DetectorNode:
    """The prior map that is subtracted, a local costmap for each robot, and MIDNet over them."""

    def __init__(
        self,
        settings: DetectorSettings,
        prior_map: OccupancyGrid,
        robots: int,
        like: "DetectorNode | None" = None,
    ) -> None:
        """For a team of ``robots``; ``prior_map``: int8, 100 occupied, map frame.

        ``like``: a node that sees the same by the same local costmaps, to share them, scans and detectors.
        """
        self.prior = binary_prior(prior_map, settings)
        midnet, costmap = settings.midnet_settings, settings.local_costmap
        area_m2 = midnet.return_area_m2
        self.midnet = MIDNet(
            self.prior, midnet, WallEvidence(prior_map, area_m2).shares if area_m2 > 0.0 else None
        )
        if like is None:
            self.costmaps = [RollingCostmap(costmap, prior_map.origin) for _ in range(robots)]  # map frame
            self.scans: list[Scan | None] = [None] * robots  # the last that :meth:`observe` took
            self._detectors: dict[str, _CachedDetector] = {}
        else:
            self.costmaps, self.scans, self._detectors = like.costmaps, like.scans, like._detectors
        self._detector: _CachedDetector | None = None
        if not DETECTORS.is_made_here(settings.detector):
            fixed = prior_map.with_data(_fixed(prior_map.data))
            made = _CachedDetector(settings.detector, fixed, costmap.obstacle_range_m)
            self._detector = self._detectors.setdefault(settings.detector, made)
        self._fusion = TeamFusion(self.midnet, settings.fusion)
        self.is_the_papers = self._detector is None and self._fusion.is_the_papers
        """whether section IV is done as it is written, and no frame depends on an earlier one"""

    def observe(
        self, robot: int, pose: Pose2D, ranges_m: Floats, lidar: LidarGeometry, time_s: float
    ) -> None:
        """Take one scan into a robot's costmap: (beams,) metres, and its pose then, map frame.

        A guard that was given its costmap does this by itself, and has its last scan. Geometry may change
        from scan to scan.

        Raises:
            InputError: no such robot, a pose or a geometry that is not finite, as many ranges as there are no
                beams, or a time that is not finite.
        """
        if not 0 <= robot < len(self.costmaps):
            raise InputError(f"scan: robot {robot}: there are {len(self.costmaps)}, counted from 0")
        # compiled loops would read beyond an array, or never come back
        if ranges_m.shape != (lidar.beams,):
            shape = " x ".join(map(str, ranges_m.shape))
            raise InputError(
                f"scan: {shape} ranges of a LiDAR of {lidar.beams} beams; give one for each beam"
            )
        numbers = (*pose, time_s, lidar.angle_min_rad, lidar.angle_increment_rad, *lidar.mount)
        limits = (lidar.range_min_m, lidar.range_max_m)
        if not all(map(math.isfinite, numbers)) or any(map(math.isnan, limits)):
            raise InputError(f"scan: {pose} at {time_s} s by {lidar}: all of them must be finite numbers")
        self.scans[robot] = Scan(ranges_m, lidar, pose, time_s)
        self.costmaps[robot].update(pose, ranges_m, lidar, time_s)

    def detect(
        self,
        observations: Sequence[Observation],
        time_s: float,
        explain: bool = False,
        allies: Sequence[Ally] = (),
    ) -> Frame:
        """The team's detections at this instant; frames must come in order, each once.

        ``allies`` are taken out as robots are, by pose and size; they have no costmap. ``explain`` keeps what
        MIDNet's own detector did. Another detector cannot write into what it receives: others receive it too.
        Raises PluginError: the detector or the fusion cannot be made, failed, or gave what are no boxes.
        """
        if self.is_the_papers or not observations:
            return self.midnet.update(observations, explain, allies)
        explanation = None
        if self._detector is None:
            found = self.midnet.found_by_each(observations)
            if explain:
                explanation = self.midnet.update(observations, explain, allies).explanation
        else:
            seen = [_read_only(observation) for observation in observations]
            found = self._detector.found(seen, time_s)
        poses = [observation.pose for observation in observations]
        boxes, found_by = self._fusion.fuse(found, poses, time_s, allies)
        return Frame([Box._make(row) for row in boxes.tolist()], found_by, explanation)

    def detect_in_opposite_order(self, observations: Sequence[Observation]) -> list[Box] | None:
        """The boxes that MIDNet would give of these if the last robot came first (item 35).

        None where another detector or fusion is at work: it may keep a state, and must not be called twice.
        """
        return self.midnet.update(observations[::-1]).detections if self.is_the_papers else None

    def observations(
        self, poses: Sequence[Pose2D], scans: Sequence[Scan | None] | None = None
    ) -> list[Observation]:
        """Each robot's latest pose, its costmap, and its last scan: ``scans``, else those observed here."""
        each = zip(poses, self.costmaps, self.scans if scans is None else scans, strict=True)
        return [Observation(pose, costmap.published(), scan) for pose, costmap, scan in each]


def _read_only(observation: Observation) -> Observation:
    costmap = observation.costmap.with_data(_fixed(observation.costmap.data))
    scan = observation.scan and observation.scan._replace(ranges_m=_fixed(observation.scan.ranges_m))
    return Observation(observation.pose, costmap, scan)


def _fixed(array: npt.NDArray[Number]) -> npt.NDArray[Number]:
    view = array.view()
    view.flags.writeable = False
    return view


def binary_prior(prior_map: OccupancyGrid, settings: DetectorSettings) -> OccupancyGrid:
    """The grid that MIDNet subtracts, uint8, 0 occupied: global costmap, then Eq. 1 (section II.A)."""
    costs = static_costs(prior_map, settings.prior_costmap)
    return costs.with_data(binary_map(costs.data, settings.prior.thresh, settings.prior.unknown))


def detected(detector: Any, name: str, observations: Sequence[Observation]) -> list[BoxArray]:
    """For each robot (n, 4) boxes, map frame, metres, by ``detector``, which ``DETECTORS`` knows as ``name``.

    Raises PluginError: it failed, or gave what are no boxes of each robot.
    """
    with DETECTORS.calling(name):
        found = list(detector.detect(observations))
    if len(found) != len(observations):
        raise DETECTORS.refused(
            name,
            f"detect gave {len(found)} lists of boxes for {len(observations)} robots; "
            "give one for each, empty where there is nothing",
        )
    return [_checked_boxes(own, DETECTORS, name) for own in found]


def fused(fusion: Any, name: str, lists: Sequence[BoxArray], time_s: float) -> BoxArray:
    """(n, 4) boxes of the team, map frame, metres, by ``fusion``, which ``FUSIONS`` knows as ``name``.

    Raises PluginError: it failed, or gave what are no boxes.
    """
    with FUSIONS.calling(name):
        boxes = fusion.fuse(lists, time_s)
    return _checked_boxes(boxes, FUSIONS, name)


def _checked_boxes(given: object, plugin: ExtensionPoint, name: str) -> BoxArray:
    """``given`` by code of ``plugin`` as (n, 4) float64. Raises PluginError if they are no boxes."""
    gave = f"{plugin.method} gave"
    try:
        boxes = np.array(given, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise plugin.refused(name, f"{gave} no numbers: {' '.join(str(error).split())}") from error
    if boxes.size == 0:
        return np.empty((0, 4))
    if boxes.ndim != 2 or boxes.shape[1] != 4:
        raise plugin.refused(name, f"{gave} an array of shape {boxes.shape}; boxes have the shape (n, 4)")
    finite, solid = np.isfinite(boxes).all(axis=1), (boxes[:, :2] < boxes[:, 2:]).all(axis=1)
    if not finite.all():
        raise plugin.refused(name, f"{gave} a box that is not finite: {boxes[~finite][0]}")
    if not solid.all():
        needed = "x_min < x_max and y_min < y_max are needed"
        raise plugin.refused(name, f"{gave} a box without area: {boxes[~solid][0]}; {needed}")
    return boxes
