"""A program of ROS 2's network: plays messages to a node and keeps what the node publishes.

    python dds_player.py MESSAGES HEARD FRAMES

MESSAGES: a pickle of (topic, type, seconds since the first, CDR bytes, whether they are sound). Sound scans
go through a type that is written by hand here, as a driver's would be; all else as the bytes it is. HEARD: a
pickle of the bytes of each marker array that came back, and how many malformed messages were sent. It ends
when FRAMES have come, or none for a while.
"""

import os
import pickle
import sys
import time
from pathlib import Path

from cyclonedds.core import DDSException, Policy
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.types import float32, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from midnet_bench.recording.ros_node import KEPT, LOCAL, bytes_type

SPEED = 6.0
PATIENCE_S = 60.0
LAST_S = 4.0  # so long after the last message frames are waited for
SCAN, MARKERS = "sensor_msgs/msg/LaserScan", "visualization_msgs/msg/MarkerArray"
TIME = make_idl_struct("Time_", "builtin_interfaces.msg.dds_.Time_", {"sec": int32, "nanosec": uint32})
HEADER = make_idl_struct("Header_", "std_msgs.msg.dds_.Header_", {"stamp": TIME, "frame_id": str})
ANGLES = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time")
LISTS = {"ranges": sequence[float32], "intensities": sequence[float32]}
LASER_SCAN = make_idl_struct(
    "LaserScan_",
    "sensor_msgs.msg.dds_.LaserScan_",
    {"header": HEADER, **dict.fromkeys((*ANGLES, "range_min", "range_max"), float32), **LISTS},
)


def offered(kind: str, topic: str) -> Qos:
    """As ROS 2's drivers, map servers and state publishers offer them."""
    kept = [Policy.History.KeepLast(1000)]
    if kind == SCAN:
        return Qos(Policy.Reliability.BestEffort, *kept)
    latched = [Policy.Durability.TransientLocal] if topic in KEPT else []
    return Qos(Policy.Reliability.Reliable(1_000_000_000), *latched, *kept)


def main() -> None:
    source, sink, frames = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
    messages = pickle.loads(source.read_bytes())
    number = int(os.environ["ROS_DOMAIN_ID"])
    domain = Domain(number, LOCAL)  # noqa: F841 - it lives as long as its object
    driver, sender = DomainParticipant(number), DomainParticipant(number)
    writers: dict[tuple[str, bool], DataWriter] = {}
    for topic, kind in dict.fromkeys((topic, kind) for topic, kind, *_ in messages):
        for is_typed in (False, True) if kind == SCAN else (False,):
            where, what = (driver, LASER_SCAN) if is_typed else (sender, bytes_type(kind))
            at = Topic(where, f"rt{topic}", what)
            writers[topic, is_typed] = DataWriter(where, at, offered(kind, topic))
    heard = DataReader(
        sender,
        Topic(sender, "rt/midnet/detections", bytes_type(MARKERS)),
        Qos(Policy.Reliability.Reliable(1_000_000_000), Policy.History.KeepAll),
    )
    early = [one for one in messages if one[0] in KEPT and one[-1]]
    for topic, kind, _, packed, _ in early:
        writers[topic, False].write(bytes_type(kind).of(packed))
    end_s = time.monotonic() + PATIENCE_S
    while not (all(one.get_matched_subscriptions() for one in writers.values()) and matched(heard)):
        if time.monotonic() > end_s:
            sys.exit("the node does not listen")
        time.sleep(0.05)
    found: list[bytes] = []
    sent = 0
    began_s = time.monotonic()
    for topic, kind, at_s, packed, is_sound in messages:
        if is_sound and topic in KEPT:
            continue
        while time.monotonic() < began_s + at_s / SPEED:
            time.sleep(0.001)
        is_typed = is_sound and kind == SCAN
        message = LASER_SCAN.deserialize(packed) if is_typed else bytes_type(kind).of(packed)
        try:
            writers[topic, is_typed].write(message)
            sent += not is_sound
        except DDSException:  # DDS itself sends no bytes that are none of its type's
            assert not is_sound
        found += [sample.packed for sample in heard.take(100)]
    last_s = time.monotonic()
    while len(found) < frames and time.monotonic() < last_s + LAST_S:
        found += [sample.packed for sample in heard.take(100)]
        time.sleep(0.05)
    sink.write_bytes(pickle.dumps((found, sent)))


def matched(reader: DataReader) -> bool:
    return bool(reader.get_matched_publications())


if __name__ == "__main__":
    main()
