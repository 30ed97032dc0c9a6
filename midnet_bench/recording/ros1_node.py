"""What the node takes of ROS 1: rospy alone, and none of ROS's message packages."""

import importlib
import queue
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from midnet_bench.errors import InputError
from midnet_bench.recording.files.writer import Types
from midnet_bench.recording.ros_node import KIND, PUBLISHED, QUEUED

DEBIANS = "/usr/lib/python3/dist-packages"
"""where Debian puts Python packages for all its Pythons"""


def rospy_module() -> Any:
    """The module ``rospy``, from Debian's packages if this Python has none of its own. Raises InputError."""
    try:
        return importlib.import_module("rospy")
    except ImportError as error:
        missing = error
    if (Path(DEBIANS) / "rospy").is_dir() and DEBIANS not in sys.path:
        sys.path.append(DEBIANS)  # at the end: what this environment has itself comes before
        try:
            return importlib.import_module("rospy")
        except ImportError as error:
            missing = error
    raise InputError(
        f"node --ros 1: {missing}; install Debian's python3-rospy and use Debian's Python (docs/ros.md)"
    )


class Rospy:
    """A node of ROS 1."""

    def __init__(self, remappings: Sequence[str]) -> None:
        """Raises InputError: there is no rospy, or no master answers."""
        self._rospy, self.types = rospy_module(), Types(1)
        if not importlib.import_module("rosgraph").is_master_online():
            raise InputError("node --ros 1: no master answers at ROS_MASTER_URI; start roscore")
        self._rospy.init_node("midnet", argv=["midnet", *remappings])
        self._publisher = self._rospy.Publisher(PUBLISHED, self._packed(), queue_size=100)
        # every connection has a thread of its own; a full queue lets it read no more
        self._heard: queue.Queue[tuple[str, Any, float]] = queue.Queue(QUEUED)

    def listen(self, topics: Mapping[str, str]) -> None:
        """Messages of any type are let in: :meth:`unpacked` refuses one of another type."""
        for topic in topics:
            self._rospy.Subscriber(topic, self._rospy.AnyMsg, partial(self._put, topic))

    def _put(self, topic: str, raw: Any) -> None:
        self._heard.put((topic, raw, time.monotonic()))

    def hear(self, timeout_s: float) -> Iterator[tuple[str, Any, float]]:
        """At most one message."""
        try:
            yield self._heard.get(timeout=timeout_s)
        except queue.Empty:
            return

    def unpacked(self, raw: Any, topic: str, kind: str) -> Any:
        """Raises InputError: it is of another type than ``kind``."""
        given, wanted = raw._connection_header["type"], kind.replace("/msg/", "/")
        if given != wanted:
            raise InputError(f"{topic}: it has {given}; {wanted} is needed")
        return self.types.store.deserialize_ros1(bytes(raw._buff), kind)

    def publish(self, message: Any) -> None:
        """As bytes that are packed already."""
        raw = self._rospy.AnyMsg()
        raw._buff = bytes(self.types.store.serialize_ros1(message, KIND))
        self._publisher.publish(raw)

    def is_up(self) -> bool:
        """Until ROS shuts the node down, as Ctrl-C does."""
        return not self._rospy.is_shutdown()

    def say(self, line: str, is_warning: bool = False) -> None:
        """On /rosout and the terminal."""
        (self._rospy.logwarn if is_warning else self._rospy.loginfo)(line)

    def _packed(self) -> Any:
        """The class of what is published, whose instances hold bytes that are packed already."""
        definition, digest = self.types.store.generate_msgdef(KIND)
        named = {"_type": KIND.replace("/msg/", "/"), "_md5sum": digest, "_full_text": definition}
        return type("MarkerArray", (self._rospy.AnyMsg,), named)
