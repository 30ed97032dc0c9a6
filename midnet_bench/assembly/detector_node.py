"""``DetectorNode``: from a map, poses and scans to MIDNet's boxes; it needs no simulator, arena or agent."""

import math
from collections.abc import Hashable, Sequence
from functools import cached_property
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from midnet_bench.errors import InputError
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.messages import LidarGeometry, Scan
from midnet_bench.midnet.binary_map import PriorMapSettings, binary_map
from midnet_bench.midnet.pipeline import Ally, Frame, MIDNet, MIDNetSettings, Observation
from midnet_bench.navigation.costmap import RollingCostmap, static_costs
from midnet_bench.navigation.settings import CostmapSettings
from midnet_bench.rivals.seams import DETECTORS
from midnet_bench.rivals.team import AskedOnce, TeamDetector

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

        ``like``: a node that sees the same by the same local costmaps, to share them and its scans, and its
        detector if that is the same, too.
        """
        self.prior = binary_prior(prior_map, settings)
        self.midnet = MIDNet(self.prior, settings.midnet_settings)
        self._settings = settings
        local_costmap = settings.local_costmap
        self.costmaps: list[RollingCostmap] = (
            [RollingCostmap(local_costmap, prior_map.origin) for _ in range(robots)]
            if like is None
            else like.costmaps
        )
        """by robot, map frame"""
        self._detector: AskedOnce | None = None
        if like is not None and like._settings.detector == settings.detector:
            self._detector = like._detector
        elif not DETECTORS.is_made_here(settings.detector):
            fixed = prior_map.with_data(_fixed(prior_map.data))
            self._detector = AskedOnce(settings.detector, fixed, local_costmap.obstacle_range_m)
        self.scans: list[Scan | None] = [None] * robots if like is None else like.scans
        """by robot, the last one that :meth:`observe` took"""

    @cached_property
    def team(self) -> TeamDetector:
        """The detector and the fusion. Made when they are first asked: what fails costs no other node."""
        return TeamDetector(self.midnet, self._detector, self._settings.fusion)

    def observe(
        self,
        robot: int,
        pose: Pose2D,
        ranges_m: npt.NDArray[np.float64],
        lidar: LidarGeometry,
        time_s: float,
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
        _check(pose, ranges_m, lidar, time_s)
        self.scans[robot] = Scan(ranges_m, lidar, pose, time_s)
        self.costmaps[robot].update(pose, pose.compose(lidar.mount), ranges_m, lidar, time_s)

    def window(self, robot: int) -> Box:
        """Where a robot's local costmap lies, map frame, metres."""
        layer = self.costmaps[robot].layer
        return Box(*OccupancyGrid(layer.cells, layer.settings.resolution, layer.origin).extent)

    def detect(
        self,
        observations: Sequence[Observation],
        time_s: float,
        explain: bool = False,
        allies: Sequence[Ally] = (),
    ) -> Frame:
        """What the team detects now, of what each robot told; frames must come in order.

        ``allies`` are taken out as robots are, by pose and size, and tell nothing.

        Another detector than MIDNet cannot write into what it receives: others may receive it too.
        """
        if self._settings.detector != "midnet":
            observations = [_read_only(observation) for observation in observations]
        return self.team.update(observations, time_s, explain, allies)

    def detect_in_opposite_order(self, observations: Sequence[Observation]) -> list[Box] | None:
        """The boxes that MIDNet would give of these if the last robot came first (item 35).

        None where another detector or fusion is at work: it may keep a state, and must not be called twice.
        """
        return self.midnet.update(observations[::-1]).detections if self.team.is_the_papers else None

    def observations(
        self, poses: Sequence[Pose2D], scans: Sequence[Scan | None] | None = None
    ) -> list[Observation]:
        """Each robot's latest pose, its costmap, and its last scan: ``scans``, else those observed here."""
        each = zip(poses, self.costmaps, self.scans if scans is None else scans, strict=True)
        return [Observation(pose, costmap.published(), scan) for pose, costmap, scan in each]


class Sight(NamedTuple):
    """What one of several nodes over a team works by."""

    settings: DetectorSettings
    prior_map: OccupancyGrid
    fed: Hashable
    """nodes see the same if this, ``prior_map`` and their local costmaps' settings are the same"""


def detector_nodes(sights: Sequence[Sight], robots: int) -> list[DetectorNode]:
    """A node for each of ``sights`` over one team; what is the same in two of them is there once."""
    nodes: list[DetectorNode] = []
    alike: dict[Hashable, DetectorNode] = {}
    for settings, prior_map, fed in sights:
        seen = (settings.local_costmap, id(prior_map), fed)
        like = alike.get((seen, settings.detector), alike.get(seen))
        nodes.append(DetectorNode(settings, prior_map, robots, like))
        alike.setdefault(seen, nodes[-1])
        alike.setdefault((seen, settings.detector), nodes[-1])
    return nodes


def _check(pose: Pose2D, ranges_m: npt.NDArray[np.float64], lidar: LidarGeometry, time_s: float) -> None:
    """What compiled loops would read beyond an array of, or never come back from."""
    if not all(map(math.isfinite, (*pose, time_s))):
        raise InputError(f"scan: pose ({pose.x}, {pose.y}, {pose.yaw}) at {time_s} s: must be finite")
    if ranges_m.ndim != 1 or len(ranges_m) != lidar.beams:
        shape = " x ".join(map(str, ranges_m.shape))
        raise InputError(f"scan: {shape} ranges of a LiDAR of {lidar.beams} beams; give one for each beam")
    angles = (lidar.angle_min_rad, lidar.angle_increment_rad, *lidar.mount)
    limits = (lidar.range_min_m, lidar.range_max_m)
    if not all(map(math.isfinite, angles)) or any(map(math.isnan, limits)):
        raise InputError(f"scan: LiDAR {lidar}: its angles, mount and limits must be numbers")


def _read_only(told: Observation) -> Observation:
    costmap = told.costmap.with_data(_fixed(told.costmap.data))
    scan = told.scan and told.scan._replace(ranges_m=_fixed(told.scan.ranges_m))
    return Observation(told.pose, costmap, scan)


def _fixed(array: npt.NDArray[Number]) -> npt.NDArray[Number]:
    view = array.view()
    view.flags.writeable = False
    return view


def binary_prior(prior_map: OccupancyGrid, settings: DetectorSettings) -> OccupancyGrid:
    """The grid that MIDNet subtracts, uint8, 0 occupied: global costmap, then Eq. 1 (section II.A)."""
    costs = static_costs(prior_map, settings.prior_costmap)
    return costs.with_data(binary_map(costs.data, settings.prior.thresh, settings.prior.unknown))
