"""The network between the guards and MIDNet: messages that come late, or never."""

from collections.abc import Sequence
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from midnet_bench.agents.mobile_robot import Guard, MobileRobot
from midnet_bench.detectors.detector_node import DetectorNode
from midnet_bench.geometry import Pose2D, Scan
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.pipeline import Observation
from midnet_bench.rng import standard_exponential, stream
from midnet_bench.simulation.world_settings import NetworkSettings

Payload = TypeVar("Payload")


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
    """A guard reports after each of its control cycles; MIDNet goes by the latest report that has arrived.

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
