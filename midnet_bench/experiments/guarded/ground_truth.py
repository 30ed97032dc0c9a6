"""``GroundTruthOverride``: a detector sees what no guard could, so that one cause of its errors is gone.

Guards localise, drive and patrol by their sensors as before. Under an oracle of ``OVERRIDING`` the referee,
which has the ground truth, takes the scans into the costmaps of a detector's node. It changes nothing in the
simulated world, and its noise has separate random streams.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from midnet_bench.agents.mobile_robot import Guard, MobileRobot
from midnet_bench.detectors.detector_node import DetectorNode
from midnet_bench.experiments.guarded.parameters import Oracle
from midnet_bench.experiments.robot_trial import RobotTrial
from midnet_bench.geometry import Box, Floats, Indices, LidarGeometry, Pose2D, Scan, Solid
from midnet_bench.midnet.pipeline import Frame
from midnet_bench.rng import stream
from midnet_bench.scoring.frame_counts import TruthObject, touches
from midnet_bench.simulation.crowd import ranges_to
from midnet_bench.simulation.engine import Beams
from midnet_bench.simulation.fast.outlines import cast_on_outlines, outlines_of
from midnet_bench.simulation.sensors import NOTHING, SOLID, NoiseFreeScan

ScanCallback = Callable[[Guard, Scan, NoiseFreeScan], None]
"""Called with a scan that was taken into a guard's costmap, and what its beams truly met (m = 1)."""


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


class GroundTruthOverride:
    """Takes the guards' scans into the costmaps of a node, as the guards themselves would but for an oracle.

    - ``pose``: the estimated pose of a guard is its true one then, at a scan and at a frame. A pose
      stays as old as it is: a newer one would crop the prior map farther from where the costmap lies.
    - ``delay``: one more scan at each frame's instant, and poses of then. A guard errs about its pose
      as at its last control cycle: how it has truly moved since is added.
    - ``allies``: a beam that met a guard is void, so that it neither marks nor clears.
    - ``noise``: the true ranges. What drops out, or stands too near to be measured, stays as it was.
    - ``occlusion``, ``sight``: a beam that meets an intruder also returns what stands behind it: other
      intruders, each once, up to the first wall or guard. The first return is the scan's own. All returns are
      taken at once, as of one scan: first the beams clear their ways, then every return is marked.
    """

    def __init__(self, node: DetectorNode, oracle: Oracle, trial: RobotTrial, seed: int) -> None:
        """For a trial that has not begun, of whose world guard i is robot i."""
        self._node, self._oracle, self._trial = node, oracle, trial
        robots = trial.fleet.robots
        self._guards = [robot for robot in robots if isinstance(robot, Guard)]
        self._intruders = [robot for robot in robots if not isinstance(robot, Guard)]
        self.callbacks: list[ScanCallback] = []  # called with each scan that was taken
        self._localised_at = [self._true_pose(guard) for guard in self._guards]
        """where each guard truly was when it last localised, map frame"""
        self._newest_poses = [guard.pose for guard in self._guards]
        """at the newest frame, where that is not the instant of a control cycle"""
        purpose = "oracle lidar" if oracle == "delay" else "oracle echoes"
        self._noise = trial.lidars.noise([stream(seed, purpose, guard.name) for guard in self._guards])
        self._dropouts = [stream(seed, "oracle dropout", guard.name) for guard in self._guards]
        self._walls = outlines_of(trial.world.layout.arena.wall_solids())[:]
        self._lidars: dict[int, MultiEchoLidar] = {}  # by number of echoes: each keeps its directions

    def scanned(self, guard: Guard, scan: Scan, true: NoiseFreeScan) -> None:
        """Take what a guard has just scanned; ``true``: what its beams met."""
        ranges_m, met_m, bodies = scan.ranges_m, true.ranges_m[0], true.bodies[0]
        if self._oracle == "pose":
            scan = scan._replace(pose=self._true_pose(guard))
        elif self._oracle == "allies":
            is_ally = (bodies >= 0) & (bodies < len(self._guards))
            scan = scan._replace(ranges_m=np.where(is_ally, np.nan, ranges_m))
        elif self._oracle == "noise":
            is_measured = np.isfinite(ranges_m) & (ranges_m >= scan.lidar.range_min_m)
            scan = scan._replace(ranges_m=np.where(is_measured, met_m, ranges_m))
        elif self._oracle in ("occlusion", "sight"):
            scan, true = self._with_echoes(guard, scan, true)
        self._take(guard, scan, true)

    def stepped(self, due: Sequence[MobileRobot]) -> None:
        """Note that a tick is over, at which the robots ``due`` have localised."""
        for robot in due:
            if isinstance(robot, Guard):
                self._localised_at[robot.index] = self._true_pose(robot)

    def before_frame(self, alive: Sequence[Guard], time_s: float) -> None:
        """Do what has to be done at a frame's instant; ``alive``: the guards that have not died."""
        if self._oracle != "delay":
            return
        self._newest_poses = [guard.pose for guard in self._guards]
        if not alive:
            return
        lidars, lidar = self._trial.lidars, self._trial.world.robot.lidar
        rows = [guard.index for guard in alive]
        ranges_m = lidars.scan(rows, self._noise, self._dropouts)
        true = lidars.newest
        assert true is not None
        for row, guard in enumerate(alive):
            moved = self._true_pose(guard).relative_to(self._localised_at[guard.index])
            pose = self._newest_poses[guard.index] = guard.pose.compose(moved)
            self._take(guard, Scan(ranges_m[row], lidar, pose, time_s), true.of(row))

    def poses(self) -> list[Pose2D]:
        """Of each guard at a frame's instant, map frame: for Eq. 4 and Algorithm 2."""
        if self._oracle == "pose":
            return list(self._localised_at)
        return self._newest_poses if self._oracle == "delay" else [guard.pose for guard in self._guards]

    def _true_pose(self, robot: MobileRobot) -> Pose2D:
        return self._trial.world.pose(robot.index)

    def _take(self, guard: Guard, scan: Scan, true: NoiseFreeScan) -> None:
        self._node.observe(guard.index, scan.pose, scan.ranges_m, scan.lidar, scan.stamp_s)
        for callback in self.callbacks:
            callback(guard, scan, true)

    def _with_echoes(self, guard: Guard, scan: Scan, true: NoiseFreeScan) -> tuple[Scan, NoiseFreeScan]:
        """The scan with what stands behind intruders, measured as the guard's LiDAR does."""
        behind_m, bodies = self._behind(guard, true.beams)
        if not len(behind_m):
            return scan, true
        echoes, row = 1 + len(behind_m), np.array([guard.index])
        is_there = ~np.isnan(behind_m)
        known = np.where(is_there, behind_m, np.inf)
        measured = [self._trial.lidars.measured(echo[None], row, self._noise)[0] for echo in known]
        measured_m = np.where(is_there, np.array(measured), np.nan)
        # a beam that drops out has no echo at all
        measured_m[:, np.isposinf(scan.ranges_m) & is_there[0]] = np.inf
        if echoes not in self._lidars:
            fields = {name: getattr(scan.lidar, name) for name in LidarGeometry.__dataclass_fields__}
            fields["beams"] = echoes * scan.lidar.beams
            self._lidars[echoes] = MultiEchoLidar(**fields, echoes=echoes)
        ranges_m = np.concatenate((scan.ranges_m, measured_m.reshape(-1)))
        return scan._replace(ranges_m=ranges_m, lidar=self._lidars[echoes]), NoiseFreeScan(
            Beams(true.beams.axes, np.tile(true.beams.directions, (1, echoes, 1))),
            np.concatenate((true.ranges_m, behind_m.reshape(1, -1)), axis=1),
            np.concatenate((true.bodies, bodies.reshape(1, -1)), axis=1),
        )

    def _behind(self, guard: Guard, beams: Beams) -> tuple[Floats, Indices]:
        """What each beam meets behind the first intruder, a row for each echo.

        (echoes, beams) metres, NaN where there is nothing more; and which robot, as ``NoiseFreeScan`` has it.
        """
        world = self._trial.world
        intruders: list[tuple[int, Sequence[Solid]]] = [
            *((SOLID, (solid,)) for solid in world.layout.stationary),
            *((one.index, (self._disc(one),)) for one in self._intruders if world.active[one.index]),
            *((SOLID, member.solids()) for member in self._trial.crowd.members),
        ]
        opaque_m, opaque = self._opaque(guard, beams)
        limit_m = np.minimum(opaque_m, world.robot.lidar.range_max_m)
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

    def _opaque(self, guard: Guard, beams: Beams) -> tuple[Floats, Indices]:
        """(beams,) metres to the first wall or other guard, inf for none, and which of both it is."""
        range_m = self._trial.world.robot.lidar.range_max_m
        met_m = cast_on_outlines(*beams, self._walls, 0.0, range_m)[0]
        bodies = np.full(len(met_m), SOLID)
        for ally in self._guards:
            if ally is not guard:
                ally_m = ranges_to(self._disc(ally), beams)[0]
                bodies[ally_m < met_m] = ally.index
                met_m = np.minimum(met_m, ally_m)
        met_m[met_m >= range_m] = np.inf
        return met_m, bodies

    def _disc(self, robot: MobileRobot) -> Solid:
        """What beams meet of a robot now."""
        outline = self._trial.lidars.outline(robot.index)
        side_m = outline.x_max - outline.x_min
        return Solid("cylinder", Pose2D(*outline.center, 0.0), side_m, side_m, 1.0)


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
