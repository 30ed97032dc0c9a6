"""One drive in every container and with every source of poses gives the same boxes."""

from dataclasses import replace

import pytest

from midnet_bench.geometry import Pose2D
from tests.cli.command import midnet_bench
from tests.recording import recordings as made
from tests.recording.recorded_drives import CELL_M
from tests.recording.recordings import Drive, apart_m, played, replayed

pytestmark = pytest.mark.usefixtures("no_search")

DRIVE = Drive(seconds=2.0, movers={"red": made.on_the_way(6.0), "blue": made.standing(2.6, 2.6)})
MOUNT = made.MOUNT_DEG


@pytest.fixture(scope="module")
def map_file(tmp_path_factory):
    return str(made.write_map(tmp_path_factory.mktemp("map")))


@pytest.fixture(scope="module")
def expected(tmp_path_factory, map_file):
    """The boxes of the drive as a table of scans with poses."""
    folder = tmp_path_factory.mktemp("expected")
    table = made.write_scan_table(folder / "drive.csv", DRIVE, with_poses=True)
    found = replayed(table, folder, map=map_file, mount=MOUNT)
    assert len(found.boxes) > 15
    return found


@pytest.mark.slow
@pytest.mark.parametrize("container", ["ros1", "ros1-bz2", "ros1-lz4", "ros2", "mcap"])
def test_every_container(container, tmp_path, expected):
    assert played(tmp_path, DRIVE, container=container).plain_boxes == expected.plain_boxes


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["odometry", "covariance", "tum", "separate csv", "map topic", "tf"])
def test_every_source_of_poses(kind, tmp_path, map_file, expected):
    keys = {}
    if kind in ("odometry", "covariance"):
        keys["poses"] = made.pose_messages(DRIVE, kind)
    elif kind == "tf":
        keys = {"poses": made.tf_messages(DRIVE), "mount": {}, "container": "ros1"}
    elif kind == "map topic":
        keys = {"more": [made.map_message()], "map": "/map"}
    elif kind == "tum":
        keys = {"poses": [], "pose": str(made.write_tum(tmp_path / "poses.tum", DRIVE.poses()))}
    if kind == "separate csv":
        table = made.write_scan_table(tmp_path / "scans.csv", DRIVE)
        poses = made.write_pose_table(tmp_path / "poses.csv", DRIVE.poses())
        found = replayed(table, tmp_path, map=map_file, mount=MOUNT, pose=str(poses))
    else:
        found = played(tmp_path, DRIVE, **keys)
    # an odometry that drifts is not quite between its neighbours
    assert apart_m(found, expected) < (CELL_M * 1.01 if kind == "tf" else 1e-9)


@pytest.mark.slow
def test_a_laser_upside_down_is_mirrored(tmp_path):
    turned = replace(DRIVE, upside_down=True)
    by_tf = played(tmp_path, turned, poses=made.tf_messages(turned), mount={}, labels=turned.labels())
    assert any("mirrored" in line for line in by_tf.notes)
    by_flag = played(tmp_path, turned, mirrored=True)
    assert apart_m(by_tf, by_flag) < CELL_M * 1.01
    assert (by_tf.score()["recall"], by_tf.score()["precision"]) == (1.0, 1.0)


@pytest.mark.slow
def test_several_robots_in_one_bag_and_in_several_are_the_same(tmp_path, map_file):
    other = replace(DRIVE, pose=lambda time_s, track=DRIVE.track: track(time_s).compose(BACK))
    messages = [
        [
            *made.scan_messages(drive, f"/{name}/scan", f"{name}_laser"),
            *made.pose_messages(drive, topic=f"/{name}/pose"),
        ]
        for name, drive in (("back", other), ("front", DRIVE))
    ]
    mounts = {"mount": {"front": MOUNT, "back": MOUNT}}
    together = made.write_bag(tmp_path, messages[0] + messages[1])
    one = replayed(together, tmp_path, map=map_file, **mounts)
    each = [
        made.write_bag(tmp_path, said, "ros1", name)
        for said, name in zip(messages, ("back", "front"), strict=True)
    ]
    several = replayed(each, tmp_path, map=map_file, **mounts)

    def without_order(result):
        return sorted(
            (float(row["t"]), *(row[k] for k in ("x_min_m", "y_min_m", "x_max_m", "y_max_m")))
            for row in result.boxes
        )

    assert len(one.boxes) > 30
    assert without_order(one) == without_order(several)
    # the first bag's clock is 100 s late
    late_ns = 100 * made.NS
    late = [
        made.stamped(said, said.message.fields["header"]["stamp"] + late_ns)._replace(
            record_ns=said.record_ns + late_ns
        )
        for said in messages[0]
    ]
    each[0] = made.write_bag(tmp_path, late, "ros1", "later")
    mounts = {"front": MOUNT, "later": MOUNT}
    several = replayed(each, tmp_path, map=map_file, mount=mounts, offset_s={"later": -100})
    assert without_order(one) == without_order(several)


BACK = Pose2D(-0.4, 0.0, 0.0)


def test_a_geometry_that_changes_in_mid_bag_is_noted_and_read(tmp_path):
    second = made.scan_messages(replace(DRIVE, lidar=made.lidar_of(240)))
    scans = made.scan_messages(replace(DRIVE, seconds=1.5))
    scans += [one for one in second if one.record_ns >= made.ns_of(1.5)]
    found = played(tmp_path, DRIVE, scans=scans, labels=DRIVE.labels())
    assert any("180 to 240 beams" in line for line in found.notes)
    assert found.score()["recall"] == 1.0
    assert found.replayed.faults == []


@pytest.mark.slow
def test_a_part_has_the_boxes_of_the_whole_at_its_scans(tmp_path, map_file):
    bag = made.write_bag(tmp_path, [*made.scan_messages(DRIVE), *made.tf_messages(DRIVE)])
    labels = made.write_labels(tmp_path / "truth.csv", DRIVE.labels(), by="scan_index")
    whole, part = (
        replayed(bag, tmp_path, map=map_file, truth=str(labels), **limits)
        for limits in ({}, {"from_s": 0.95, "to_s": 1.65})
    )
    # the first scan comes at 0.5 s, ten a second: labels by scan_index hold
    scans = set(map(str, range(5, 12)))
    wanted = [{**row, "frame": ""} for row in whole.boxes if row["scan_index"] in scans]
    assert [{**row, "frame": ""} for row in part.boxes] == wanted
    assert part.score()["recall"] == 1.0
    assert {row["scan_index"] for row in part.boxes} == scans


@pytest.mark.slow
@pytest.mark.parametrize("topic", ["/move_base_simple/goal", "/initialpose", "/truth/red/pose"])
def test_a_goal_is_never_proposed_as_a_pose(tmp_path, topic):
    goal = made.track_messages([(1.0, Pose2D(1.0, 1.0, 0.0))], topic=topic)
    bag = made.write_bag(tmp_path, [*made.scan_messages(DRIVE), *goal])
    listed = midnet_bench("replay", bag, folder=tmp_path).stderr
    assert f"--pose {topic}" not in listed
    assert "at:X,Y,YAW" in listed
    driven = made.pose_messages(DRIVE, "odometry", "/odom")
    for said in driven:
        said.message.fields["header"]["frame_id"] = "odom"
    bag = made.write_bag(tmp_path, [*made.scan_messages(DRIVE), *goal, *driven])
    listed = midnet_bench("replay", bag, folder=tmp_path).stderr
    assert "--pose /odom --start found" in listed
