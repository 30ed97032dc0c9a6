"""The ``midnet`` node of the paper on rospy: all of ROS 1 that it takes. The rest is in ``live.py``.

rosbags unpacks and packs the messages, so rospy alone has to be there, and none of ROS's message packages.
"""

import contextlib
import importlib
import queue
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from midnet_bench.errors import InputError
from midnet_bench.grid import OccupancyGrid
from midnet_bench.recording.files.bags import in_words
from midnet_bench.recording.files.ros_messages import Message
from midnet_bench.recording.files.writer import Types
from midnet_bench.recording.live import LiveNode, LiveOptions

DEBIANS = "/usr/lib/python3/dist-packages"
"""where Debian puts Python packages for all its Pythons"""
PUBLISHED = "/midnet/detections"
LOOK_EVERY_S = 0.5
QUEUED = 10_000
"""messages that wait to be taken, at most"""
KIND = "visualization_msgs/msg/MarkerArray"


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
        f"ros1-node: {missing}; install Debian's python3-rospy and use Debian's Python (docs/ros.md)"
    )


def spin(options: LiveOptions, prior_map: OccupancyGrid | None, remappings: Sequence[str] = ()) -> None:
    """Subscribe, and publish the detections of each frame until the node is shut down.

    Args:
        options: robots, poses and detector options.
        prior_map: int8; None: the first message on ``/map``.
        remappings: ``FROM:=TO``, as ROS has them on its command lines.

    Raises:
        InputError: there is no rospy, no master answers, or the detector's options cannot be.
    """
    rospy, types = rospy_module(), Types(1)
    if not importlib.import_module("rosgraph").is_master_online():
        raise InputError("ros1-node: no master answers at ROS_MASTER_URI; start roscore")
    rospy.init_node("midnet", argv=["midnet", *remappings])
    publisher = rospy.Publisher(PUBLISHED, _packed(rospy, types), queue_size=100)
    node, reported = LiveNode(options, prior_map), ""
    # every connection has a thread of its own; a full queue lets it read no more
    heard: queue.Queue[tuple[str, Any, float]] = queue.Queue(QUEUED)
    listened = options.topics(prior_map is None)
    for topic in listened:
        rospy.Subscriber(topic, rospy.AnyMsg, partial(_put, heard, topic))
    rospy.loginfo("midnet listens to " + ", ".join(listened))
    while not rospy.is_shutdown():
        with contextlib.suppress(queue.Empty):
            topic, raw, arrived_s = heard.get(timeout=LOOK_EVERY_S)
            try:
                raw_bytes = _bytes_of(raw, topic, listened[topic])
                message = types.store.deserialize_ros1(raw_bytes, listened[topic])
            except Exception as error:  # whatever rosbags raises of damaged bytes: they cost themselves
                node.leave_out("messages cannot be read", f"{topic}: {in_words(error)}", arrived_s)
            else:
                for detected in node.hear(topic, message, arrived_s):
                    publisher.publish(_as_raw(rospy, types, detected.message))
        for line in node.warnings:
            rospy.logwarn(line)
        node.warnings.clear()
        if heard.empty() and node.waits_for != reported:
            reported = node.waits_for
            rospy.loginfo(f"midnet waits for {reported}" if reported else "midnet detects")


def _put(heard: "queue.Queue[tuple[str, Any, float]]", topic: str, raw: Any) -> None:
    heard.put((topic, raw, time.monotonic()))


def _bytes_of(raw: Any, topic: str, kind: str) -> bytes:
    """Of a message of any type. Raises InputError: it is of another type than ``kind``."""
    given, wanted = raw._connection_header["type"], kind.replace("/msg/", "/")
    if given != wanted:
        raise InputError(f"{topic}: it has {given}; {wanted} is needed")
    return bytes(raw._buff)


def _packed(rospy: Any, types: Types) -> Any:
    """The class of what is published, whose instances hold bytes that are packed already."""
    definition, digest = types.store.generate_msgdef(KIND)
    named = {"_type": KIND.replace("/msg/", "/"), "_md5sum": digest, "_full_text": definition}
    return type("MarkerArray", (rospy.AnyMsg,), named)


def _as_raw(rospy: Any, types: Types, message: Message) -> Any:
    raw = rospy.AnyMsg()
    raw._buff = bytes(types.store.serialize_ros1(types.made(*message), message.kind))
    return raw
