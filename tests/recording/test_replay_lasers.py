"""Several lasers on one robot, by topics and by frames of one topic; two publishers on a topic."""

import math
from dataclasses import replace

import pytest

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from tests.cli.command import midnet_bench
from tests.recording import recordings as made
from tests.recording.recordings import Drive, lidar_of, replayed

pytestmark = pytest.mark.usefixtures("no_search")

FRONT = Drive(
    seconds=3.0,
    movers={"red": made.on_the_way(6.0), "blue": made.on_the_way(-6.0)},
    lidar=lidar_of(136, math.radians(270.0)),
    mount=Pose2D(0.2, 0.05, 0.0),
)
REAR = replace(FRONT, mount=Pose2D(-0.2, -0.05, math.pi), seed=2)
MOUNTS = {"front": FRONT, "rear": REAR}


def scans(topics):
    return [
        said
        for (frame, drive), topic in zip(MOUNTS.items(), topics, strict=True)
        for said in made.scan_messages(drive, topic, frame)
    ]


def tf():
    mount = made.Said("/tf_static", made.ns_of(0.0), made.mount_message(REAR, "rear"), is_kept=True)
    return [mount, *made.tf_messages(FRONT, frame="front")]


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lasers")
    labels = made.write_labels(folder / "truth.csv", FRONT.labels())
    return {"map": str(made.write_map(folder)), "truth": str(labels)}


def mount_of(drive):
    return [*drive.mount[:2], math.degrees(drive.mount.yaw)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("by", "topics"), [("tf", ("/scan", "/scan")), ("setup", ("/front_scan", "/rear_scan"))]
)
def test_two_lasers_are_one_robot(tmp_path, keys, topics, by):
    streams = list(topics) if topics[0] != topics[1] else ["/scan@front", "/scan@rear"]
    more = {}
    if by == "setup":
        mounts = {name: mount_of(drive) for name, drive in zip(streams, MOUNTS.values(), strict=True)}
        more = {"scan": streams, "mount": mounts, "pose": "/pose"}
    poses = tf() if by == "tf" else made.pose_messages(FRONT)
    bag = made.write_bag(tmp_path, [*scans(topics), *poses])
    both = replayed(bag, tmp_path, tmp_path / "both", **keys, **more)
    assert not both.replayed.faults
    assert both.score()["recall"] == 1.0
    assert {row["robot"] for row in both.boxes} == {"0"}
    assert "ally_left" not in both.causes()
    # each alone sees less
    alone = {**more, "scan": streams[0]}
    if by == "setup":
        alone["mount"] = mount_of(FRONT)
    one = replayed(bag, tmp_path, tmp_path / "one", **keys, **alone)
    assert one.score()["in_range"] < both.score()["in_range"]
    listed = midnet_bench("replay", bag, folder=tmp_path)
    assert ("2 lasers" in listed.stderr) == (topics[0] == topics[1])


def test_one_mount_for_two_lasers_is_refused(tmp_path, keys):
    bag = made.write_bag(tmp_path, [*scans(("/front_scan", "/rear_scan")), *tf()])
    with pytest.raises(InputError, match=r"^mount: .*/front_scan"):
        replayed(bag, tmp_path, **keys, mount=[0.2, 0.0, 0.0])
    with pytest.raises(InputError, match=r"^scan: no topic '/rear_skan'"):
        replayed(bag, tmp_path, **keys, scan=["/front_scan", "/rear_skan"])


@pytest.mark.slow
@pytest.mark.parametrize("option", [{"start": "found"}, {"localize": True}])
def test_lasers_of_one_robot_are_placed_and_corrected_as_one(tmp_path, keys, option):
    poses = tf()
    if "start" in option:  # odometry alone
        poses = [
            said for said in poses if said.message.fields["transforms"][0]["header"]["frame_id"] != "map"
        ]
    bag = made.write_bag(tmp_path, [*scans(("/front_scan", "/rear_scan")), *poses])
    placed = replayed(bag, tmp_path, **keys, **option)
    assert placed.score()["recall"] > 0.98
    assert sum("began at" in line for line in placed.notes) == ("start" in option)


def test_another_publisher_on_the_topic_is_told_and_can_be_left_out(tmp_path, keys):
    """A simulator publishes scans of its own frame and clock on the robot's topic."""
    other = [
        made.stamped(said, 1000 + k)._replace(record_ns=said.record_ns + 7_000_000)
        for k, said in enumerate(made.scan_messages(FRONT, "/scan", "simulated"))
    ]
    bag = made.write_bag(tmp_path, [*made.scan_messages(FRONT, "/scan", "front"), *other, *tf()])
    result = replayed(bag, tmp_path, **keys)
    (line,) = [line for line in result.notes if "2 lasers" in line]
    assert "clocks are" in line
    assert "scan: /scan@" in line
    assert result.score()["recall"] == 1.0
    assert {row["robot"] for row in result.boxes} == {"0"}
    same_frame = [made.stamped(said, frame="front") for said in other]
    bag = made.write_bag(
        tmp_path, [*made.scan_messages(FRONT, "/scan", "front"), *same_frame, *tf()], name="b"
    )
    assert "clock: record" in midnet_bench("replay", bag, folder=tmp_path).stderr
