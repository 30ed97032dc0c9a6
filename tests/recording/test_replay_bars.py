"""How well the preset ``real`` does on recordings of other lasers, robots and people, with known poses."""

import math
from dataclasses import replace

import pytest

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from tests.recording import recordings as made
from tests.recording.recordings import Drive, played, replayed

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("no_search")]
MOUNT = made.MOUNT_DEG
LASERS = {
    "180 half circle": made.lidar_of(181, math.pi, 30.0),
    "270 degrees": made.lidar_of(541, math.radians(270.0), 30.0),
    "1000 full circle": made.lidar_of(1000, math.tau, 30.0),
}
REST = Pose2D(4.2, 3.0, 0.3)
ROBOTS = {"robot": made.on_the_way(6.0, 0.12)}
WALK = made.walking((4.8, 3.6), (5.4, 2.6), 0.3, 0.24)
WALKERS = {
    "thin": made.walking((4.7, 3.0), (5.2, 2.0), 0.8, 0.10),
    "stout": made.walking((4.6, 3.6), (5.0, 4.6), 1.1, 0.15),
}


ENDS = ("180 half circle", "1000 full circle")  # the fewest beams and the most


def check(score, least, recall, wrong=("fp", "duplicates")):
    assert score["in_range"] > least
    assert score["recall"] >= recall, score
    assert sum(score[kind] for kind in wrong) / score["frames"] < 0.2, score


@pytest.mark.parametrize("laser", LASERS)
def test_robots_are_found_by_one_that_drives(laser, tmp_path):
    drive = Drive(seconds=6.0, lidar=LASERS[laser], movers=ROBOTS)
    check(played(tmp_path, drive, labels=drive.labels()).score(), 40, 0.95)


@pytest.mark.parametrize("laser", ENDS)
@pytest.mark.parametrize(
    ("movers", "recall", "wrong"),
    # of two legs, one is a duplicate
    [({"robot": WALK}, 0.95, ("fp", "duplicates")), (WALKERS, 0.85, ("fp",))],
    ids=["robot", "people"],
)
def test_robots_and_people_are_found_by_one_at_rest(movers, recall, wrong, laser, tmp_path):
    drive = Drive(seconds=7.0, lidar=LASERS[laser], pose=lambda time_s: REST, movers=movers)
    check(played(tmp_path, drive, labels=drive.labels()).score(), 60, recall, wrong)


@pytest.mark.parametrize("laser", ENDS)
@pytest.mark.parametrize("options", [{}, {"obstacle_range_m": 10.0}])
def test_nobody_in_a_mapped_building(options, laser, tmp_path):
    drive = Drive(seconds=6.0, lidar=LASERS[laser], noise_m=0.02)
    found = played(tmp_path, drive, settings=options)
    assert found.score()["boxes_per_frame"] < 0.2, found.causes()


def test_a_background_of_the_first_seconds_and_of_another_recording(tmp_path):
    late = {"robot": robot_late}
    drive = Drive(seconds=11.0, lidar=LASERS["270 degrees"], pose=lambda time_s: REST, movers=late)
    empty = replace(drive, movers={}, seconds=5.0, seed=2)
    bag = made.write_bag(tmp_path, made.scan_messages(drive))
    other = made.write_scan_table(tmp_path / "other.csv", empty)
    truth = str(made.write_labels(tmp_path / "truth.csv", [one for one in drive.labels() if one[0] >= 50]))
    at = f"at:{REST.x},{REST.y},{math.degrees(REST.yaw)}"
    with pytest.raises(InputError, match="is the recording itself"):
        replayed(bag, tmp_path, background=str(bag), pose=at, mount=MOUNT)
    for background in ("first-5", str(other)):
        found = replayed(bag, tmp_path, background=background, pose=at, mount=MOUNT, truth=truth)
        check(found.score(), 40, 0.95)


def robot_late(time_s):
    """Nobody for five seconds; then a robot that walks to and fro."""
    return WALK(time_s - 5.0) if time_s >= 5.2 else [made.Disc(100.0, 100.0, 0.1)]
