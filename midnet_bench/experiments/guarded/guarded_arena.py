"""``GuardedArena``: one trial in motion, from MIDNet frame to MIDNet frame, and its network."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Generic, NamedTuple, TypeVar
from weakref import proxy

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.agent_settings import PATROLS
from midnet_bench.agents.mobile_robot import GoalSource, Guard, MobileRobot
from midnet_bench.agents.patrol import Patrol, TeamPatrol, patrol_points, safe_distance
from midnet_bench.arena.free_space import GOAL_CLEARANCE_M, FreeSpace, free_space
from midnet_bench.arena.layout import Layout, place
from midnet_bench.campaign.trial import Row
from midnet_bench.detectors.detector_node import DetectorNode
from midnet_bench.elementary import cos, sin
from midnet_bench.experiments.guarded.evaders import Evaders
from midnet_bench.experiments.guarded.ground_truth import GroundTruthOverride, ScanCallback
from midnet_bench.experiments.guarded.inputs import EXACT, prior_map_from
from midnet_bench.experiments.guarded.parameters import FRAME_HZ, OVERRIDING, GuardParameters
from midnet_bench.experiments.robot_trial import RobotTrial
from midnet_bench.geometry import Point, Pose2D, Scan, wrap_angle
from midnet_bench.grid import OccupancyGrid
from midnet_bench.localization.scan_to_map import ScanToMap
from midnet_bench.localization.ukf import PlanarUkf
from midnet_bench.midnet.pipeline import Frame, Observation
from midnet_bench.navigation.navigation_settings import CostmapSettings, NavigatorSettings
from midnet_bench.navigation.navigator import Navigator
from midnet_bench.rng import standard_exponential, stream
from midnet_bench.scoring.frame_counts import (
    Covers,
    FrameCounts,
    FrameMatch,
    TruePositives,
    TruthObject,
    count_frame,
    match_frame,
)
from midnet_bench.scoring.metric import MetricFrame
from midnet_bench.simulation.world_settings import NetworkSettings

Robot = TypeVar("Robot", bound=MobileRobot)
Payload = TypeVar("Payload")


@dataclass(frozen=True)
class ObservedFrame(Frame):
    """A frame of a simulated trial, with what MIDNet went by."""

    observations: Sequence[Observation] = field(default=(), compare=False, repr=False)
    """each guard's pose, costmap and last scan"""


@dataclass(frozen=True)
class ScoredFrame:
    """One frame beside the truth of its instant."""

    number: int  # counted from 1
    midnet: ObservedFrame
    truths: list[TruthObject]
    in_range: list[bool]  # for each truth, whether missing it counts
    tp_boxes: TruePositives = "every"

    @cached_property
    def match(self) -> FrameMatch:
        """Which box is paired with which intruder."""
        return match_frame(self.midnet.detections, self.truths)

    @cached_property
    def counts(self) -> FrameCounts:
        """Its counts, as section V.A has them and one to one."""
        return count_frame(self.midnet.detections, self.truths, self.in_range, self.tp_boxes, self.match)

    @property
    def observations(self) -> Sequence[Observation]:
        """Of each guard what MIDNet received: its pose, its costmap and its last scan."""
        return self.midnet.observations


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
        self._override_of: dict[DetectorNode, GroundTruthOverride] = {}
        self._overrides = self._override(nodes, tests)
        own = [node.costmaps for node in nodes if node not in self._override_of]
        for guard in self.guards:
            # nodes may share a costmap, which takes each scan once
            guard.detection_costmaps = list(dict.fromkeys(costmaps[guard.index] for costmaps in own))
        self._evaders: Evaders | None = None
        if self.arena.has_behaviours:
            self._evaders = Evaders(self.layout, self.intruders, self.goal_space(), self.crowd, seed)
        self.tick_callbacks: list[Callable[[Sequence[MobileRobot]], None]] = []
        """called after each tick with the robots that were due in it"""
        self.frame_callbacks: list[Callable[[ObservedFrame], None]] = []
        """called with each frame of ``detector``, before any robot uses it"""
        self.guards_alive = list(self.guards)  # those that have not died
        network = parameters.network
        self._network = NetworkModel(network, self.guards, seed) if network.is_used else None

    @property
    def prior(self) -> OccupancyGrid:
        """The binary grid that MIDNet subtracts, uint8, 0 occupied."""
        return self.detector.prior

    def next_frame(self, explain: bool = False) -> ObservedFrame:
        """MIDNet's detections 0.2 s later."""
        self.advance()
        return self.detected(self.detector, explain)

    def detected(self, node: DetectorNode, explain: bool = False) -> ObservedFrame:
        """The detections of one of this trial's detectors now; take each instant once, in order."""
        observations = self.observations(node)
        frame = node.detect(observations, self.fleet.time_s, explain)
        observed = ObservedFrame(frame.detections, frame.robots, frame.explanation, observations)
        if node is self.detector:
            for callback in self.frame_callbacks:
                callback(observed)
        return observed

    def advance(self) -> None:
        """Let 0.2 s pass, a frame."""
        dying = self.guards[: self.parameters.dying_guards]
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
            has_to_die = self.fleet.time_s >= self.parameters.dying_after_s - 1e-9
            for guard in dying if has_to_die else ():
                if guard in self.guards_alive:
                    self.guards_alive.remove(guard)
                    self.fleet.stop(guard)
        for override in self._overrides:
            override.before_frame(self.guards_alive, self.fleet.time_s)

    def metric_frame(self, frame: ScoredFrame) -> MetricFrame:
        """What metrics take of the newest frame."""
        guards = [guard.index for guard in self.guards_alive]
        return MetricFrame(
            self.fleet.time_s,
            np.array(frame.midnet.detections, dtype=np.float64).reshape(-1, 4),
            tuple(frame.truths),
            tuple(frame.in_range),
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
        return [pose[:2] for pose in self._sensor_poses()]

    def fields_of_view(self) -> list[Covers]:
        """Of each guard's LiDAR as it truly is; none if they see all round."""
        lidar = self.robot.lidar
        return [] if lidar.is_full_turn else [partial(lidar.covers, pose) for pose in self._sensor_poses()]

    def _sensor_poses(self) -> list[Pose2D]:
        poses, mount = self.world.poses(), self.robot.lidar.mount
        return [Pose2D(*poses[guard.index].tolist()).compose(mount) for guard in self.guards]

    def next_patrol_point(self, robot: MobileRobot) -> Point:
        """Where MIDNet sends a guard that has nothing to do (section V.B)."""
        team = [guard.state for guard in self.guards]
        return self.patrol.next_point(robot.index, team, self.fleet.time_s)

    def _placed(self, mobile_intruders: int | None) -> Layout:
        """Where everything starts."""
        return place(self.arena, self.seed, self.parameters.robots, mobile_intruders, self.robot.body_reach_m)

    def _on_scan(self, callback: ScanCallback) -> None:
        """Let ``callback`` have each scan of a guard, once the guard has it."""
        lidars = self.lidars

        def scanned(robots: Sequence[MobileRobot], ranges_m: npt.NDArray[np.float64]) -> None:
            true = lidars.newest
            assert true is not None
            for row, robot in enumerate(robots):
                if isinstance(robot, Guard):
                    assert robot.scan is not None
                    callback(robot, robot.scan, true.of(row))

        self.fleet.scan_callbacks.append(scanned)

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
        """The detector's node of each test; those that see the same share what they can."""
        maps = {False: self.prior_map}
        if any(test.oracle == "map" for test in tests):
            maps[True] = prior_map_from(EXACT, self.parameters.arena, self.parameters.resolution_m)
        nodes, alike = [], dict[tuple[CostmapSettings, str], DetectorNode]()
        for test in tests:
            seen = (test.local_costmap, test.oracle if test.oracle in ("map", *OVERRIDING) else "")
            prior_map = maps[test.oracle == "map"]
            nodes.append(DetectorNode(test, prior_map, self.parameters.robots, alike.get(seen)))
            alike.setdefault(seen, nodes[-1])
        return nodes

    def _override(
        self, nodes: Sequence[DetectorNode], tests: Sequence[GuardParameters]
    ) -> list[GroundTruthOverride]:
        """Let the referee take scans in where an oracle overrides them; nodes that share scans share it."""
        made: dict[int, GroundTruthOverride] = {}
        for node, test in zip(nodes, tests, strict=True):
            if test.oracle in OVERRIDING:
                if id(node.scans) not in made:
                    made[id(node.scans)] = GroundTruthOverride(node, test.oracle, proxy(self), self.seed)
                    self._on_scan(made[id(node.scans)].scanned)
                self._override_of[node] = made[id(node.scans)]
        return [*made.values()]

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
        scan_to_map = ScanToMap(self.prior_map) if parameters.localization == "ukf+map" else None
        trial = proxy(self)

        def made(
            kind: type[Robot], name: str, start: Pose2D, settings: NavigatorSettings, source: GoalSource
        ) -> Robot:
            index = len(self.guards) + len(self.intruders)
            ukf = None if pose_filter is None else PlanarUkf(start, pose_filter)
            navigator = Navigator(self.prior_map, settings)
            return kind(index, name, start, navigator, ukf, source, timeout_s, scan_to_map)

        for name, start in _named("guard", self.layout.robots):
            start = self._believed_start(name, start)
            settings = parameters.guard_navigator
            guard = made(Guard, name, start, settings, lambda robot: trial.next_patrol_point(robot))
            self.guards.append(guard)
        for name, start in _named("intruder", self.layout.intruders):
            settings = parameters.intruder_navigator
            self.intruders.append(made(MobileRobot, name, start, settings, lambda robot: None))


def _named(role: str, starts: Sequence[Pose2D]) -> list[tuple[str, Pose2D]]:
    return [(f"{role} {number}", start) for number, start in enumerate(starts, 1)]


class Message(NamedTuple, Generic[Payload]):
    """What one sender said at one instant."""

    stamp_s: float  # when it was sent
    payload: Payload


class LossyNetwork(Generic[Payload]):
    """Carries the messages of n senders to one receiver, which goes by each sender's newest.

    Each message is lost with a probability, independently of the others, or arrives after a constant delay
    and an exponential one. Messages may overtake each other. A sender's generator gives two numbers for each
    message whatever the settings are: settings are compared on the same draws.
    """

    def __init__(self, settings: NetworkSettings, rngs: Sequence[np.random.Generator]) -> None:
        """Nothing is under way; one generator for each sender."""
        self._settings = settings
        self._rngs = rngs
        self._under_way: list[list[tuple[float, Message[Payload]]]] = [[] for _ in rngs]
        self._newest: list[Message[Payload] | None] = [None for _ in rngs]

    def send(self, sender: int, payload: Payload, time_s: float) -> None:
        """Put a message of sender number ``sender`` on its way, stamped ``time_s``."""
        rng, settings = self._rngs[sender], self._settings
        is_lost = rng.random() < settings.loss
        arrives_s = time_s + settings.delay_s + settings.jitter_s * standard_exponential(rng)
        if not is_lost:
            self._under_way[sender].append((arrives_s, Message(time_s, payload)))

    def latest(self, sender: int, time_s: float) -> Message[Payload] | None:
        """Of that sender's messages which have arrived by ``time_s``, the one with the latest stamp.

        None if none has. Time may not run backwards from call to call.
        """
        messages, newest = self._under_way[sender], self._newest[sender]
        for arrives_s, message in messages:
            if arrives_s <= time_s + 1e-9 and (newest is None or message.stamp_s > newest.stamp_s):
                newest = message
        self._under_way[sender] = [one for one in messages if one[0] > time_s + 1e-9]
        self._newest[sender] = newest
        return newest


class Report(NamedTuple):
    """One message of a guard."""

    pose: Pose2D
    costmaps: list[OccupancyGrid]  # as published, in the order of the guard's own
    scan: Scan | None

    @classmethod
    def of(cls, guard: Guard) -> "Report":
        """What a guard sends now."""
        return cls(guard.pose, [costmap.published() for costmap in guard.detection_costmaps], guard.scan)


class NetworkModel:
    """A guard reports after each control cycle and scan; MIDNet goes by the latest report that has arrived.

    MIDNet's own messages take no time and are never lost.
    """

    def __init__(self, settings: NetworkSettings, guards: Sequence[Guard], seed: int) -> None:
        """MIDNet knows the poses that the guards assume at the start, and no costmap."""
        self._timeout_s = settings.timeout_s
        self._guards = guards
        rngs = [stream(seed, "network", guard.name) for guard in guards]
        self._network: LossyNetwork[Report] = LossyNetwork(settings, rngs)
        self._blind = [
            Report(pose, [costmap.with_data(np.zeros_like(costmap.data)) for costmap in costmaps], None)
            for pose, costmaps, _ in map(Report.of, guards)
        ]

    def send(self, robots: Sequence[MobileRobot], time_s: float) -> None:
        """Let those of ``robots`` report that are guards; guard i of the team is robot i of the fleet."""
        for robot in robots:
            if isinstance(robot, Guard):
                self._network.send(robot.index, Report.of(robot), time_s)

    def received(self, node: DetectorNode, time_s: float) -> list[Observation]:
        """What a detector knows of each guard, in the team's order.

        A guard without a report is where it started; one whose last report is older than the time-out is
        where that has it. The costmaps of both are empty.
        """
        found = []
        for guard, blind, costmap in zip(self._guards, self._blind, node.costmaps, strict=True):
            pose, sight = blind.pose, blind
            message = self._network.latest(guard.index, time_s)
            if message is not None:
                pose = message.payload.pose
                if self._timeout_s is None or time_s - message.stamp_s <= self._timeout_s + 1e-9:
                    sight = message.payload
            which = guard.detection_costmaps.index(costmap)
            found.append(Observation(pose, sight.costmaps[which], sight.scan))
        return found
