"""``GroundTruthOverrides``: a detector sees what no guard could, so that one cause of its errors is gone.

Guards localise, drive and patrol by their sensors as before. Under an oracle of ``OVERRIDING`` the referee,
which has the ground truth, takes the scans into the costmaps of a detector's node. It changes nothing in the
simulated world, and its noise has separate random streams.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.mobile_robot import Guard, MobileRobot
from midnet_bench.detectors.detector_node import DetectorNode
from midnet_bench.experiments.guarded.parameters import Oracle
from midnet_bench.geometry import Box, LidarGeometry, Pose2D, Scan, Solid
from midnet_bench.midnet.pipeline import Frame
from midnet_bench.rng import stream
from midnet_bench.scoring.diagnosis import touches
from midnet_bench.scoring.frame_counts import TruthObject
from midnet_bench.simulation.crowd import Crowd, ranges_to
from midnet_bench.simulation.engine import Beams
from midnet_bench.simulation.fast.outlines import outlines_of
from midnet_bench.simulation.fast.rays import cast_on_outlines
from midnet_bench.simulation.sensors import NOTHING, SOLID, LidarSensors, NoiseFreeScan
from midnet_bench.simulation.world import World

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
ScanCallback = Callable[[Guard, Scan, NoiseFreeScan], None]
"""Called with a scan that was taken into a guard's costmap, and what its beams truly met (m = 1)."""


class Trial(NamedTuple):
    """What the referee knows of a trial."""

    seed: int
    world: World
    lidars: LidarSensors
    crowd: Crowd
    guards: Sequence[Guard]
    """guard i is robot i of the world"""
    intruders: Sequence[MobileRobot]

    def true_pose(self, robot: MobileRobot) -> Pose2D:
        """Of now, map frame."""
        return self.world.pose(robot.index)


class GroundTruthOverride:
    """Takes the guards' scans into the costmaps of a node, as the guards themselves would."""

    def __init__(self, node: DetectorNode, trial: Trial) -> None:
        """For a trial that has not begun."""
        self.node = node
        self.trial = trial
        self.callbacks: list[ScanCallback] = []
        """called with each scan that was taken"""
        self.localised_at = [trial.true_pose(guard) for guard in trial.guards]
        """where each guard truly was when it last localised, map frame"""

    def scanned(self, guard: Guard, scan: Scan, true: NoiseFreeScan) -> None:
        """Take what a guard has just scanned; ``true``: what its beams met."""
        self.take(guard, scan, true)

    def take(self, guard: Guard, scan: Scan, true: NoiseFreeScan) -> None:
        """Let a scan into the guard's costmap."""
        self.node.observe(guard.index, scan.pose, scan.ranges_m, scan.lidar, scan.stamp_s)
        for callback in self.callbacks:
            callback(guard, scan, true)

    def stepped(self, due: Sequence[MobileRobot]) -> None:
        """Note that a tick is over, at which the robots ``due`` have localised."""
        for robot in due:
            if isinstance(robot, Guard):
                self.localised_at[robot.index] = self.trial.true_pose(robot)

    def before_frame(self, alive: Sequence[Guard], time_s: float) -> None:
        """Do what has to be done at a frame's instant; ``alive``: the guards that have not died."""

    def poses(self) -> list[Pose2D]:
        """Of each guard at a frame's instant, map frame: for Eq. 4 and Algorithm 2."""
        return [guard.pose for guard in self.trial.guards]


class TruePoses(GroundTruthOverride):
    """``pose``: the estimated pose of a guard is its true one at that instant, of a scan and of a frame.

    A pose stays as old as it is: a newer one would crop the prior map farther from where the costmap lies.
    """

    def scanned(self, guard: Guard, scan: Scan, true: NoiseFreeScan) -> None:
        """See :class:`GroundTruthOverride`."""
        self.take(guard, scan._replace(pose=self.trial.true_pose(guard)), true)

    def poses(self) -> list[Pose2D]:
        """See :class:`GroundTruthOverride`."""
        return list(self.localised_at)


class WithoutDelay(GroundTruthOverride):
    """``delay``: one more scan at each frame's instant, and poses of that instant.

    A guard errs about its pose as at its last control cycle: how it has truly moved since is added.
    """

    def __init__(self, node: DetectorNode, trial: Trial) -> None:
        """See :class:`GroundTruthOverride`."""
        super().__init__(node, trial)
        names = [guard.name for guard in trial.guards]
        self._noise = trial.lidars.noise([stream(trial.seed, "oracle lidar", name) for name in names])
        self._dropouts = [stream(trial.seed, "oracle dropout", name) for name in names]
        self._poses = super().poses()

    def before_frame(self, alive: Sequence[Guard], time_s: float) -> None:
        """See :class:`GroundTruthOverride`."""
        self._poses = super().poses()
        if not alive:
            return
        lidars, lidar = self.trial.lidars, self.trial.world.robot.lidar
        rows = [guard.index for guard in alive]
        ranges_m, _ = lidars.scan_and_bodies(rows, self._noise)
        lidars.drop_out(ranges_m, [self._dropouts[row] for row in rows])
        true = lidars.newest
        assert true is not None
        for row, guard in enumerate(alive):
            moved = self.trial.true_pose(guard).relative_to(self.localised_at[guard.index])
            pose = self._poses[guard.index] = guard.pose.compose(moved)
            self.take(guard, Scan(ranges_m[row], lidar, pose, time_s), true.of(row))

    def poses(self) -> list[Pose2D]:
        """See :class:`GroundTruthOverride`."""
        return self._poses


class WithoutAllies(GroundTruthOverride):
    """``allies``: a beam that met a guard is void, so that it neither marks nor clears."""

    def scanned(self, guard: Guard, scan: Scan, true: NoiseFreeScan) -> None:
        """See :class:`GroundTruthOverride`."""
        is_ally = (true.bodies[0] >= 0) & (true.bodies[0] < len(self.trial.guards))
        self.take(guard, scan._replace(ranges_m=np.where(is_ally, np.nan, scan.ranges_m)), true)


class WithoutNoise(GroundTruthOverride):
    """``noise``: the true ranges. What drops out, or stands too near to be measured, stays as it was."""

    def scanned(self, guard: Guard, scan: Scan, true: NoiseFreeScan) -> None:
        """See :class:`GroundTruthOverride`."""
        is_measured = np.isfinite(scan.ranges_m) & (scan.ranges_m >= scan.lidar.range_min_m)
        ranges_m = np.where(is_measured, true.ranges_m[0], scan.ranges_m)
        self.take(guard, scan._replace(ranges_m=ranges_m), true)


@dataclass(frozen=True)
class MultiEchoLidar(LidarGeometry):
    """A LiDAR whose every beam is there ``echoes`` times, as in sensor_msgs/MultiEchoLaserScan.

    All first echoes come first, then all second ones, and so on. ``beams`` counts them all.
    """

    echoes: int

    @property
    def angles_rad(self) -> Floats:
        """(beams,) direction of each beam in the sensor frame, radians."""
        return np.tile(super().angles_rad[: self.beams // self.echoes], self.echoes)


class TransparentIntruders(GroundTruthOverride):
    """``occlusion``: a beam that meets an intruder also returns what stands behind it.

    That is other intruders, each once, up to the first wall or guard. The first return is the scan's own. All
    returns are taken at once, as of one scan: first the beams clear their ways, then every return is marked.
    """

    def __init__(self, node: DetectorNode, trial: Trial) -> None:
        """See :class:`GroundTruthOverride`."""
        super().__init__(node, trial)
        self._noise = trial.lidars.noise(
            [stream(trial.seed, "oracle echoes", guard.name) for guard in trial.guards]
        )
        self._walls = outlines_of(trial.world.layout.arena.wall_solids())
        self._lidars: dict[int, MultiEchoLidar] = {}

    def scanned(self, guard: Guard, scan: Scan, true: NoiseFreeScan) -> None:
        """See :class:`GroundTruthOverride`."""
        behind_m, bodies = self._behind(guard, true.beams)
        if len(behind_m):
            echoes = 1 + len(behind_m)
            measured_m = self._measured(guard, behind_m)
            # a beam that drops out has no echo at all
            measured_m[:, np.isposinf(scan.ranges_m) & ~np.isnan(behind_m[0])] = np.inf
            ranges_m = np.concatenate((scan.ranges_m, measured_m.reshape(-1)))
            scan = scan._replace(ranges_m=ranges_m, lidar=self._multi_echo(scan.lidar, echoes))
            true = NoiseFreeScan(
                Beams(true.beams.axes, np.tile(true.beams.directions, (1, echoes, 1))),
                np.concatenate((true.ranges_m, behind_m.reshape(1, -1)), axis=1),
                np.concatenate((true.bodies, bodies.reshape(1, -1)), axis=1),
            )
        self.take(guard, scan, true)

    def _measured(self, guard: Guard, behind_m: Floats) -> Floats:
        """What the guard's LiDAR reports of (echoes, beams) ranges; NaN stays."""
        lidars, row = self.trial.lidars, np.array([guard.index])
        known = np.where(np.isnan(behind_m), np.inf, behind_m)
        measured = [lidars.measured(echo[None], row, self._noise)[0] for echo in known]
        return np.where(np.isnan(behind_m), np.nan, np.array(measured))

    def _behind(self, guard: Guard, beams: Beams) -> tuple[Floats, Ints]:
        """What each beam meets behind the first intruder, a row for each echo.

        (echoes, beams) metres, NaN where there is nothing more; and which robot, as ``NoiseFreeScan`` has it.
        """
        intruders = self._intruders()
        opaque_m, opaque = self._opaque(guard, beams)
        limit_m = np.minimum(opaque_m, self.trial.world.robot.lidar.range_max_m)
        met_m = np.full((len(intruders) + 1, len(limit_m)), np.inf)
        for row, (_, parts) in zip(met_m, intruders, strict=False):
            nearest_m = np.minimum.reduce([ranges_to(part, beams)[0] for part in parts])
            np.copyto(row, nearest_m, where=nearest_m < limit_m)
        hits = np.count_nonzero(np.isfinite(met_m), axis=0)
        met_m[-1] = opaque_m
        bodies = np.repeat([[*(body for body, _ in intruders), SOLID]], len(limit_m), axis=0).T
        bodies[-1] = opaque
        bodies[np.isinf(met_m)] = NOTHING
        behind = np.argsort(met_m, axis=0, kind="stable")[1 : 1 + int(hits.max())]
        ranges_m = np.take_along_axis(met_m, behind, axis=0)
        ranges_m[np.arange(1, 1 + len(behind))[:, None] > hits] = np.nan
        return ranges_m, np.take_along_axis(bodies, behind, axis=0)

    def _opaque(self, guard: Guard, beams: Beams) -> tuple[Floats, Ints]:
        """(beams,) metres to the first wall or other guard, inf for none, and which of both it is."""
        walls, range_m = self._walls, self.trial.world.robot.lidar.range_max_m
        met_m = cast_on_outlines(*beams, walls.corners, walls.first, walls.circles, 0.0, range_m)[0]
        bodies = np.full(len(met_m), SOLID)
        for ally in self.trial.guards:
            if ally is not guard:
                ally_m = ranges_to(self._disc(ally), beams)[0]
                bodies[ally_m < met_m] = ally.index
                met_m = np.minimum(met_m, ally_m)
        met_m[met_m >= range_m] = np.inf
        return met_m, bodies

    def _intruders(self) -> list[tuple[int, tuple[Solid, ...]]]:
        """For each intruder as it is now, which robot it is, else ``SOLID``, and what beams meet of it."""
        trial, is_there = self.trial, self.trial.world.active
        stationary = [(SOLID, (solid,)) for solid in trial.world.layout.stationary]
        mobile = [(one.index, (self._disc(one),)) for one in trial.intruders if is_there[one.index]]
        return [*stationary, *mobile, *((SOLID, member.solids()) for member in trial.crowd.members)]

    def _disc(self, robot: MobileRobot) -> Solid:
        """What beams meet of a robot now."""
        outline = self.trial.lidars.outline(robot.index)
        side_m = outline.x_max - outline.x_min
        return Solid("cylinder", Pose2D(*outline.center, 0.0), side_m, side_m, 1.0)

    def _multi_echo(self, lidar: LidarGeometry, echoes: int) -> MultiEchoLidar:
        """Made once for each number of echoes: it keeps its directions."""
        if echoes not in self._lidars:
            fields = {name: getattr(lidar, name) for name in LidarGeometry.__dataclass_fields__}
            self._lidars[echoes] = MultiEchoLidar(**{**fields, "beams": echoes * lidar.beams}, echoes=echoes)
        return self._lidars[echoes]


def fused_by_identity(frame: Frame, truths: Sequence[TruthObject]) -> Frame:
    """``fusion``: for each intruder one box about all boxes that touch it; others as fused.

    A box that touches two intruders has a part in both of theirs.
    """
    assert frame.explanation is not None
    kept = [(box, guard) for guard, view in enumerate(frame.explanation.views) for box in view.kept]
    boxes, guards = [], []
    for truth in truths:
        own = [(box, guard) for box, guard in kept if touches(box, truth.box)]
        if own:
            corners = np.array([box for box, _ in own])
            boxes.append(Box(*corners[:, :2].min(axis=0).tolist(), *corners[:, 2:].max(axis=0).tolist()))
            guards.append(max(own, key=lambda one: one[0].area)[1])
    for box, guard in zip(frame.detections, frame.robots, strict=True):
        if not any(touches(box, truth.box) for truth in truths):
            boxes.append(box)
            guards.append(guard)
    return replace(frame, detections=boxes, robots=guards)


OVERRIDES: Mapping[Oracle, type[GroundTruthOverride]] = {
    "pose": TruePoses,
    "delay": WithoutDelay,
    "allies": WithoutAllies,
    "occlusion": TransparentIntruders,
    "sight": TransparentIntruders,
    "noise": WithoutNoise,
}
"""of each oracle of ``OVERRIDING``"""


def overrides_of(
    nodes: Mapping[DetectorNode, Oracle], trial: Trial
) -> dict[DetectorNode, GroundTruthOverride]:
    """The override of each node that sees by an oracle of ``OVERRIDING``; those that share scans share one.

    For a trial that has not begun.
    """
    made: dict[int, GroundTruthOverride] = {}
    for node, oracle in nodes.items():
        if id(node.scans) not in made:
            made[id(node.scans)] = OVERRIDES[oracle](node, trial)
    return {node: made[id(node.scans)] for node in nodes}
