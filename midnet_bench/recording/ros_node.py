"""The ``midnet`` node of the paper, of either ROS: a middleware brings bytes, ``live.py`` makes frames.

rosbags unpacks and packs the messages of both.
"""

from collections.abc import Iterator, Mapping
from typing import Any, Protocol

from midnet_bench.grid import OccupancyGrid
from midnet_bench.recording.files.bags import in_words
from midnet_bench.recording.files.writer import Types
from midnet_bench.recording.live import LiveNode, LiveOptions

PUBLISHED = "/midnet/detections"
KIND = "visualization_msgs/msg/MarkerArray"
LOOK_EVERY_S = 0.5
QUEUED = 10_000
"""messages of a topic that wait to be taken, at most"""


class Middleware(Protocol):
    """How a node of one version of ROS hears and says bytes."""

    types: Types

    def listen(self, topics: Mapping[str, str]) -> None:
        """Subscribe to each topic of a type, such as ``sensor_msgs/msg/LaserScan``."""

    def hear(self, timeout_s: float) -> Iterator[tuple[str, Any, float]]:
        """Topic, message as it came, and when by ``time.monotonic``; none after a timeout."""

    def unpacked(self, raw: Any, topic: str, kind: str) -> Any:
        """A message of that type; any error that rosbags raises of bytes that are none."""

    def publish(self, message: Any) -> None:
        """On :data:`PUBLISHED`, of :data:`KIND`."""

    def is_up(self) -> bool:
        """Whether the node is to go on."""

    def say(self, line: str, is_warning: bool = False) -> None:
        """A line into the middleware's log."""


def spin(middleware: Middleware, options: LiveOptions, prior_map: OccupancyGrid | None) -> None:
    """Subscribe, and publish the detections of each frame until the node is shut down.

    Args:
        middleware: of ROS 1 or ROS 2.
        options: robots, poses and detector options.
        prior_map: int8; None: the first message on ``/map``.

    Raises:
        InputError: the detector's options cannot be.
    """
    node, reported = LiveNode(options, prior_map), ""
    listened = options.topics(prior_map is None)
    middleware.listen(listened)
    middleware.say("midnet listens to " + ", ".join(listened))
    while middleware.is_up():
        is_quiet = True
        for topic, raw, arrived_s in middleware.hear(LOOK_EVERY_S):
            is_quiet = False
            try:
                message = middleware.unpacked(raw, topic, listened[topic])
            except Exception as error:  # whatever rosbags raises of damaged bytes: they cost themselves
                node.leave_out("messages cannot be read", f"{topic}: {in_words(error)}", arrived_s)
                continue
            for detected in node.hear(topic, message, arrived_s):
                middleware.publish(middleware.types.made(*detected.message))
        for line in node.warnings:
            middleware.say(line, is_warning=True)
        node.warnings.clear()
        if is_quiet and node.waits_for != reported:
            reported = node.waits_for
            middleware.say(f"midnet waits for {reported}" if reported else "midnet detects")
