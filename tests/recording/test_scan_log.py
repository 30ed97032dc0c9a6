"""``map --from-log`` on recordings of each kind, and the commands that a bag without a map needs."""

from dataclasses import replace

import numpy as np
import pytest

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.mapping.log_mapping import map_scans
from midnet_bench.recording.scan_log import scan_log_of
from tests.cli.command import midnet_bench, one_line_of_complaint
from tests.recording import recordings as made
from tests.recording.recordings import Drive
from tests.recording.test_recording_place import by_odometry

DRIVE = Drive(seconds=20.0, rate_hz=5.0)


def bag_of(folder, container):
    if container == "csv":  # which does not say where the laser sits
        at_base = replace(DRIVE, mount=Pose2D(0.0, 0.0, 0.0))
        return made.write_scan_table(folder / "drive.csv", at_base, with_poses=True)
    said = [*made.scan_messages(DRIVE), *by_odometry(DRIVE, "tf")]
    return made.write_bag(folder, said, container=container)


@pytest.mark.slow
@pytest.mark.parametrize("container", ["ros1", "csv"])
def test_a_recording_of_each_kind_is_mapped(tmp_path, container):
    notes = []
    log = scan_log_of(bag_of(tmp_path, container), notes.append)
    assert len(log) == len(DRIVE.scans)
    assert any("poses" in line for line in notes)
    result = map_scans(log)
    times_s = [DRIVE.scans[number - 1][0] for number in result.integrated]
    true = [DRIVE.track(time_s).relative_to(DRIVE.track(times_s[0])) for time_s in times_s]
    found = [result.trajectory.pose(k).relative_to(result.trajectory.pose(0)) for k in range(len(true))]
    assert max(a.distance_to(b) for a, b in zip(found, true, strict=True)) < 0.08
    assert np.count_nonzero(result.grid.data == 100) > 300
    assert result.warnings == log.warnings


@pytest.mark.slow
def test_the_commands_of_a_bag_without_a_map_are_named_and_work(tmp_path):
    bag = bag_of(tmp_path, "mcap")
    listed = midnet_bench("replay", bag.name, folder=tmp_path)
    assert "--start found" in listed.stderr
    mapped = midnet_bench("map", "--from-log", bag.name, "--no-clip", "-o", "made", folder=tmp_path)
    assert mapped.returncode == 0, mapped.stderr
    done = midnet_bench("replay", bag.name, "--map", "made/map.yaml", "--start", "found", folder=tmp_path)
    assert "began at start" in done.stderr, done.stderr


def test_several_robots_are_refused(tmp_path):
    said = [*made.scan_messages(DRIVE), *by_odometry(DRIVE, "tf")]
    other = replace(DRIVE, seed=2)
    bag = made.write_bag(tmp_path, [*said, *made.scan_messages(other, "/rear/scan", "rear")])
    with pytest.raises(InputError, match=r"one|rear"):
        scan_log_of(bag, lambda line: None)
    assert "bag.mcap" in one_line_of_complaint(midnet_bench("map", "--from-log", bag, folder=tmp_path))
