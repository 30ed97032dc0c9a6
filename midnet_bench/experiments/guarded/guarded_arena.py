"""``GuardedArena``: one trial in motion, advanced from MIDNet frame to MIDNet frame."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.agent_settings import PATROLS
from midnet_bench.agents.mobile_robot import Guard, MobileRobot
from midnet_bench.agents.patrol import Patrol, TeamPatrol, patrol_points, safe_distance
from midnet_bench.arena.free_space import GOAL_CLEARANCE_M, FreeSpace, free_space
from midnet_bench.arena.layout import Layout, place
from midnet_bench.campaign.trial import Row
from midnet_bench.detectors.detector_node import DetectorNode, Sight, detector_nodes
from midnet_bench.elementary import cos, sin
from midnet_bench.experiments.guarded.evaders import Evaders
from midnet_bench.experiments.guarded.ground_truth import GroundTruthOverride, ScanCallback
from midnet_bench.experiments.guarded.inputs import EXACT, prior_map_from
from midnet_bench.experiments.guarded.parameters import FRAME_HZ, OVERRIDING, GuardParameters
from midnet_bench.experiments.guarded.uplink import NetworkModel
from midnet_bench.experiments.robot_trial import RobotTrial
from midnet_bench.geometry import Point, Pose2D, wrap_angle
from midnet_bench.grid import OccupancyGrid
from midnet_bench.localization.scan_to_map import ScanToMap
from midnet_bench.localization.ukf import PlanarUkf
from midnet_bench.midnet.pipeline import Frame, Observation
from midnet_bench.navigation.navigation_settings import NavigatorSettings
from midnet_bench.navigation.navigator import Navigator
from midnet_bench.rng import stream
from midnet_bench.scoring.frame_counts import TruthObject
from midnet_bench.scoring.metric import MetricFrame


@dataclass(frozen=True)
class ObservedFrame(Frame):
    """A frame of a simulated trial, with what MIDNet went by."""

    observations: Sequence[Observation] = field(default=(), compare=False, repr=False)
    """each guard's pose, costmap and last scan"""


class GuardedArena(RobotTrial):
    """A world with its guards, its mobile intruders, and MIDNet over them."""

    def __init__(
        self,
        parameters: GuardParameters,
        seed: int,
        mobile_intruders: int | None = None,
        variants: Sequence[GuardParameters] = (),
    ) -> None:
        """Place guards and intruders; time is 0. Intruders have no goals until ``next_goal`` is set on them.

        ``variants``: further parameters of the detector, each with a node of its own over the same run.
        """
        self.parameters = parameters
        self.seed = seed
        self.arena = parameters.guarded_place
        self.robot = parameters.simulation.robot_model
        self.layout = replace(self._placed(mobile_intruders), mobile_scale=parameters.mobile_scale)
        self.prior_map = prior_map_from(parameters.prior_map, parameters.arena, parameters.resolution_m)
        self.patrol = self._make_patrol()
        tests = (parameters, *variants)
        nodes = self._make_nodes(tests)
        self.detector, *self.variant_detectors = nodes
        self.guards: list[Guard] = []
        self.intruders: list[MobileRobot] = []
        self._make_robots()
        super().__init__(self.layout, [*self.guards, *self.intruders], parameters.robot_simulation, seed)
        self._scan_callbacks: list[ScanCallback] = []
        self._override_of: dict[DetectorNode, GroundTruthOverride] = {}
        self._override(nodes, tests)
        self._overrides = list(dict.fromkeys(self._override_of.values()))
        own = [node.costmaps for node in nodes if node not in self._override_of]
        for guard in self.guards:
            # nodes may share a costmap, which takes each scan once
            guard.detection_costmaps = list(dict.fromkeys(costmaps[guard.index] for costmaps in own))
        self._evaders: Evaders | None = None
        if self.arena.has_behaviours:
            self._evaders = Evaders(
                self.layout, self.intruders, self.goal_space(), self.crowd, seed, len(self.guards)
            )
        self.tick_callbacks: list[Callable[[Sequence[MobileRobot]], None]] = []
        """called after each tick with the robots that were due in it"""
        self.frame_callbacks: list[Callable[[Frame], None]] = []
        """called with each frame of ``detector``, before any robot uses it"""
        self.guards_alive = list(self.guards)
        """those that have not died"""
        self._dying = self.guards[: parameters.dying_guards]
        network = parameters.network
        self._network = NetworkModel(network, self.guards, seed) if network.is_used else None

    @property
    def prior(self) -> OccupancyGrid:
        """The binary grid that MIDNet subtracts, uint8, 0 occupied."""
        return self.detector.prior

    def next_frame(self, explain: bool = False) -> Frame:
        """MIDNet's detections 0.2 s later."""
        self.advance()
        return self.detected(self.detector, explain)

    def detected(self, node: DetectorNode, explain: bool = False) -> ObservedFrame:
        """The detections of one of this trial's detectors now; take each instant once, in order."""
        observations = self.observations(node)
        frame = node.detect(observations, self.fleet.time_s, explain)
        frame = ObservedFrame(frame.detections, frame.robots, frame.explanation, observations)
        if node is self.detector:
            for callback in self.frame_callbacks:
                callback(frame)
        return frame

    def advance(self) -> None:
        """Let 0.2 s pass, a frame."""
        for _ in range(self.step_hz // FRAME_HZ):
            if self._evaders is not None:
                self._evaders.update(self.world)
            due = self.fleet.step()
            for callback in self.tick_callbacks:
                callback(due)
            if self._network is not None:
                self._network.send(due, self.fleet.time_s)
            for override in self._overrides:
                override.stepped(due)
            if self._dying and self.fleet.time_s >= self.parameters.dying_after_s - 1e-9:
                self.guards_alive = self.guards[len(self._dying) :]
                while self._dying:
                    self.fleet.stop(self._dying.pop(0))
        for override in self._overrides:
            override.before_frame(self.guards_alive, self.fleet.time_s)

    def metric_frame(
        self, frame: Frame, truths: Sequence[TruthObject], in_range: Sequence[bool]
    ) -> MetricFrame:
        """The newest frame and the truth of it."""
        guards = [guard.index for guard in self.guards_alive]
        return MetricFrame(
            self.fleet.time_s,
            np.array(frame.detections, dtype=np.float64).reshape(-1, 4),
            tuple(truths),
            tuple(in_range),
            self.world.poses()[guards, :2],
            self.patrol.points,
        )

    def observations(self, node: DetectorNode) -> list[Observation]:
        """What one of this trial's detectors goes by now, of each guard."""
        override = self._override_of.get(node)
        if override is not None:
            return node.observations(override.poses())
        if self._network is not None:
            return self._network.received(node, self.fleet.time_s)
        return node.observations(self.guard_poses(), [guard.scan for guard in self.guards])

    def add_scan_callback(self, node: DetectorNode, callback: ScanCallback) -> None:
        """From now on ``callback`` gets each scan that is taken into a node's costmaps."""
        override = self._override_of.get(node)
        if override is None:
            self._on_scan(callback)
        else:
            override.callbacks.append(callback)

    def guard_poses(self) -> list[Pose2D]:
        """The estimated poses of the guards, map frame."""
        return [guard.pose for guard in self.guards]

    def goal_space(self) -> FreeSpace:
        """Where mobile intruders may be sent."""
        clearance_m = max(GOAL_CLEARANCE_M, self.robot.footprint_reach_m)
        return free_space(self.arena, clearance_m, self.layout.stationary)

    def rows_of_robots(self) -> list[Row]:
        """``robots.csv``: one row per guard and mobile intruder, what each did so far."""
        return [
            {"robot": robot.name, "role": "guard" if isinstance(robot, Guard) else "intruder", **row}
            for robot, row in zip(self.fleet.robots, super().rows_of_robots(), strict=True)
        ]

    def sensor_positions(self) -> list[Point]:
        """(x, y) of each guard's LiDAR as it truly is, map frame, metres."""
        poses = self.world.poses()
        mount = self.robot.lidar.mount
        return [Pose2D(*poses[guard.index].tolist()).compose(mount)[:2] for guard in self.guards]

    def next_patrol_point(self, robot: MobileRobot) -> Point:
        """Where MIDNet sends a guard that has nothing to do (section V.B)."""
        team = [guard.state for guard in self.guards]
        return self.patrol.next_point(robot.index, team, self.fleet.time_s)

    def _placed(self, mobile_intruders: int | None) -> Layout:
        """Where everything starts."""
        robots, reach_m = self.parameters.robots, self.robot.body_reach_m
        return place(self.arena, self.seed, robots, mobile_intruders, reach_m)

    def _on_scan(self, callback: ScanCallback) -> None:
        if not self._scan_callbacks:
            self.fleet.scan_callbacks.append(self._scanned)
        self._scan_callbacks.append(callback)

    def _scanned(self, robots: Sequence[MobileRobot], ranges_m: npt.NDArray[np.float64]) -> None:
        """Hand the scans of guards on."""
        true = self.lidars.newest
        assert true is not None
        for row, robot in enumerate(robots):
            if isinstance(robot, Guard):
                assert robot.scan is not None
                for callback in self._scan_callbacks:
                    callback(robot, robot.scan, true.of(row))

    def _believed_start(self, name: str, start: Pose2D) -> Pose2D:
        """The initial pose estimate of a guard."""
        off_m, off_deg = self.parameters.start_error_m, self.parameters.start_error_deg
        if not off_m and not off_deg:
            return start
        rng = stream(self.seed, "start error", name)
        direction_rad, side = rng.uniform(-math.pi, math.pi), rng.choice((-1.0, 1.0))
        return Pose2D(
            start.x + off_m * cos(direction_rad),
            start.y + off_m * sin(direction_rad),
            wrap_angle(start.yaw + float(side) * math.radians(off_deg)),
        )

    def _make_nodes(self, tests: Sequence[GuardParameters]) -> list[DetectorNode]:
        """The detector's node of each test."""
        exact = self.prior_map
        if any(test.oracle == "map" for test in tests):
            exact = prior_map_from(EXACT, self.parameters.arena, self.parameters.resolution_m)
        sights = [
            Sight(
                test,
                exact if test.oracle == "map" else self.prior_map,
                test.oracle if test.oracle in OVERRIDING else None,
            )
            for test in tests
        ]
        return detector_nodes(sights, self.parameters.robots)

    def _override(self, nodes: Sequence[DetectorNode], tests: Sequence[GuardParameters]) -> None:
        """Let the referee take scans in where an oracle overrides them; nodes that share scans share it."""
        made: dict[int, GroundTruthOverride] = {}
        for node, test in zip(nodes, tests, strict=True):
            if test.oracle not in OVERRIDING:
                continue
            if id(node.scans) not in made:
                override = GroundTruthOverride(node, test.oracle, self, self.seed)
                made[id(node.scans)] = override
                self._on_scan(override.scanned)
            self._override_of[node] = made[id(node.scans)]

    def _make_patrol(self) -> Patrol | TeamPatrol:
        parameters, patrol = self.parameters, self.parameters.patrol
        start, enclosure_m = self.layout.robots[0], self.arena.enclosure_m
        clearance_m, reach_m = patrol.clearance_m, self.robot.footprint_reach_m
        points = patrol_points(self.prior_map, (start.x, start.y), enclosure_m, clearance_m, reach_m)
        rng = stream(self.seed, "patrol")
        if not PATROLS.is_made_here(patrol.rule):
            return TeamPatrol(patrol.rule, points, parameters.robots, rng)
        z_m = safe_distance(math.hypot(*enclosure_m), parameters.robots, patrol.z_factor)
        return Patrol(points, z_m, rng)

    def _make_robots(self) -> None:
        """Make guards and intruders where the layout has them, guards first."""
        parameters = self.parameters
        pose_filter, timeout_s = parameters.pose_filter, parameters.goals.timeout_s
        scan_to_map = None
        if parameters.localization == "ukf+map":
            scan_to_map = ScanToMap(self.prior_map)

        def parts(start: Pose2D, settings: NavigatorSettings) -> tuple[Navigator, PlanarUkf | None]:
            ukf = None if pose_filter is None else PlanarUkf(start, pose_filter)
            return Navigator(self.prior_map, settings), ukf

        for i, start in enumerate(self.layout.robots):
            name = f"guard {i + 1}"
            start = self._believed_start(name, start)
            own = parts(start, parameters.guard_navigator)
            self.guards.append(Guard(i, name, start, *own, self.next_patrol_point, timeout_s, scan_to_map))
        for i, start in enumerate(self.layout.intruders):
            name, own = f"intruder {i + 1}", parts(start, parameters.intruder_navigator)
            index = len(self.guards) + i
            self.intruders.append(
                MobileRobot(index, name, start, *own, lambda robot: None, timeout_s, scan_to_map)
            )
