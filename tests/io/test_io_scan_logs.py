"""Recorded logs: CARMEN's messages and the plain table, and a clear line when one cannot be used."""

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.io.scan_logs import half_circle, read_scan_log

RANGES = ["1.5"] * 179 + ["2.5"]
FLASER = f"FLASER 180 {' '.join(RANGES)} 1.1 2 0.5 1 2 0.5 100.25 host 0.1"
RAW_HEAD = "RAWLASER1 0 -2.0 4.0 0.5 30.0 0.01 0"
ROBOT_HEAD = RAW_HEAD.replace("RAW", "ROBOT")
ODOM = "ODOM 0 0 0 0 0 0 1 host 1"
POSES = "1.2 2.0 0.0 1.0 2.0 0.0 0.1 0.2 0.3 0.4 0.5 1.1 host 1.15"
UNUSABLE = {
    ":2: odometry missing": [FLASER, " ".join(FLASER.split()[:184])],
    "odometry missing: no ODOM": [f"{RAW_HEAD} 3 1 2 3 0 1 host 1"],
    ":1: odometry missing: ODOM": ["ODOM 1", f"{RAW_HEAD} 3 1 2 3 0 1 host 1"],
    ":1: odometry missing: laser_x": [f"{ROBOT_HEAD} 3 1 2 3 0 1 2 0 1 host 1"],
    ":1: odometry missing: a line must read": ["10.5 180 " + " ".join(RANGES)],
    ":1: odometry: 'nan'": [FLASER.replace("1 2 0.5 100.25", "1 nan 0.5 100.25")],
    ": its scans have 90, 180 ranges, and no number of them more than half": [
        FLASER,
        "#",
        f"FLASER 90 {' '.join(RANGES[:90])} 1 2 0.5 1 2 0.5 9 host 0",
    ],
    ": its scans have 3, 4, 5, 6, ... ranges, and no number of them more than half; SLAM takes one": [
        f"{n} 0 0 0 {n} {'1 ' * n}" for n in (3, 3, 3, 4, 5, 6, 7)
    ],
    ":2: the odometry x 5e+08, y 0 lies more than 1e+08 m from its origin": [
        "1 0 0 0 3 1 2 3",
        "2 5e8 0 0 3 1 2 3",
    ],
    ":3: the odometry x 449300, y 5.41193e+06 lies more than 1000 m from the first one": [
        f"{k} {x} 5411932.5 0 3 1 2 3" for k, x in enumerate((448262.25, 449000, 449300))
    ],
    ":2: the laser's pose x 1200, y 0 lies more than 1000 m from the first one": [
        "FLASER 3 1 2 3 0 0 0 5e5 0 0 1 h 1",
        "FLASER 3 1 2 3 1200 0 0 5e5 0 0 2 h 2",
    ],
    ":1: 3 ranges are announced, but only 2": ["1 0 0 0 3 1 2"],
    ":1: 3 ranges are announced, but 1 more": ["1 0 0 0 3 1 2 3 4"],
    ":1: 180 ranges are announced": ["FLASER 180 1.5 1.5"],
    ":1: the number of ranges must be a whole number from 2 on, not 'x'": ["FLASER x 1.5 1.5"],
    ":1: range: 'oops'": ["1 0 0 0 3 1 oops 3"],
    ":1: stamp and odometry: 'x'": ["1 0 x 0 3 1 2 3"],
    ":2: the line ends before the number": [ODOM, RAW_HEAD],
    ":1: the line ends before the number": ["ROBOTLASER1 0 -2.0"],
    "line ends before the stamp": [ODOM, f"{RAW_HEAD} 3 1 2 3 0"],
    ":2: stamp: ": [ODOM, f"{RAW_HEAD} 3 1 2 3 \u00b2 7 8 1.1 host 1.1"],
    ":2: stamp: '999": [ODOM, f"{RAW_HEAD} 3 1 2 3 {'9' * 5000} 7 8 1.1 host 1.1"],
    ":1: laser pose: ": [f"{ROBOT_HEAD} 3 1 2 3 \u00b2 {POSES}"],
    ":3: the odometry x 1200, y 0 lies more than 1000 m from the first one, and no map can be that large; is "
    "it in metres?": [f"{k} {x} 0 0 3 1 2 3" for k, x in enumerate((0, 600, 1200, 1800))],
    ":1: the laser's pose has a heading of 1e+308 rad": ["FLASER 3 1 2 3 0 0 1e308 0 0 0 1 h 1"],
    ":1: the laser's pose x -1e+308, y 0 lies more": ["FLASER 3 1 2 3 -1e308 0 0 0 0 0 1 h 1"],
    ":1: the odometry has a heading of -1e+308 rad": ["FLASER 3 1 2 3 0 0 0 0 0 -1e308 1 h 1"],
    ":2: the odometry has a heading": ["1 0 0 90000 3 1 2 3", "2 0 0 1.1e5 3 1 2 3"],
    "between 0 and the sensor's 81.8 m": [f"{k} 0 0 0 3 81.8 81.8 81.8" for k in range(10)],
    "every range": ["1 0 0 0 3 nan nan inf", "2 0 0 0 3 nan nan nan"],
    "no range lies between 0 and the sensor's 81.8 m": [f"{k} 0 0 0 3 0 0 90" for k in range(2)],
}
"""what is said of a log -> its lines"""


def written(tmp_path: Path, *lines: str) -> Path:
    path = tmp_path / "some.log"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def error_of(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_scan_log(path)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    return message


def test_readings_that_are_all_alike_are_a_wall(tmp_path: Path) -> None:
    log = read_scan_log(written(tmp_path, *(f"{k} 0 0 0 3 3.0 3.0 3.0" for k in range(10))))
    assert log.geometry.range_max_m == 81.8
    assert log.scans[0].ranges_m.tolist() == [3.0] * 3


def test_flaser_gives_stamp_odometry_and_ranges(tmp_path: Path) -> None:
    other = f"FLASER 180 {' '.join(['2.5'] * 180)} 2.1 2 0.5 2 2 0.5 100.5 host 0.2"
    log = read_scan_log(written(tmp_path, "# a comment", "PARAM x 1", FLASER, "SYNC tag", "", other))
    first, second = log.scans
    assert (first.stamp_s, second.stamp_s) == (100.25, 100.5)
    assert first.odometry == Pose2D(1.0, 2.0, 0.5)
    assert first.ranges_m.tolist() == [1.5] * 179 + [2.5]
    assert second.ranges_m.tolist() == [2.5] * 180


def test_a_laser_fixed_to_the_robot_is_its_mount_and_a_corrected_pose_is_not(tmp_path: Path) -> None:
    ranges = " ".join(RANGES)
    at_mount = [
        f"FLASER 180 {ranges} 0.2 0 0 0 0 0 1.0 host 1",
        f"FLASER 180 {ranges} 3 1.2 {math.pi / 2} 3 1 {math.pi / 2} 2.0 host 2",
    ]
    mount = read_scan_log(written(tmp_path, *at_mount)).geometry.mount
    assert mount == pytest.approx((0.2, 0.0, 0.0))
    corrected = [at_mount[0], f"FLASER 180 {ranges} 3.4 1.2 1.5 3 1 1.6 2.0 host 2"]
    assert read_scan_log(written(tmp_path, *corrected)).geometry.mount == Pose2D(0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("beams", "step_deg", "last_deg"),
    [(180, 1.0, 89.0), (181, 1.0, 90.0), (360, 0.5, 89.5), (361, 0.5, 90.0)],
)
def test_beams_of_a_half_circle(beams: int, step_deg: float, last_deg: float) -> None:
    angles = np.degrees(half_circle(beams).angles_rad)
    assert angles[0] == -90.0
    assert np.diff(angles) == pytest.approx(step_deg)
    assert angles[-1] == pytest.approx(last_deg)


def test_rawlaser_takes_the_last_odometry_and_its_own_geometry(tmp_path: Path) -> None:
    log = read_scan_log(
        written(
            tmp_path,
            f"{RAW_HEAD} 3 9 9 9 0 0.5 host 0.5",  # before any odometry
            "ODOM 1 2 0.5 0 0 0 1.0 host 1.0",
            f"{RAW_HEAD} 3 1 2 3 2 17 18 1.1 host 1.1",
            "ODOM 4 5 0.6 0 0 0 1.2 host 1.2",
            "ODOM 7 8 0.7 0 0 0 1.3 host 1.3",
            f"{RAW_HEAD} 3 4 5 6 0 1.4 host 1.4",
        )
    )
    assert [scan.stamp_s for scan in log] == [1.1, 1.4]
    assert [scan.odometry for scan in log] == [Pose2D(1.0, 2.0, 0.5), Pose2D(7.0, 8.0, 0.7)]
    assert [scan.ranges_m.tolist() for scan in log] == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert log.geometry.angles_rad.tolist() == [-2.0, -1.5, -1.0]


@pytest.mark.parametrize("remissions", ["", "2 17 18 "])
def test_robotlaser_takes_the_robots_pose_and_the_lasers_mount(tmp_path: Path, remissions: str) -> None:
    scan = f"{ROBOT_HEAD} 3 1 2 3 {remissions}"
    log = read_scan_log(
        written(
            tmp_path,
            "ODOM 9 9 9 0 0 0 0.9 host 0.9",
            f"{scan}1.2 2.0 0.0 1.0 2.0 0.0 0.1 0.2 0.3 0.4 0.5 1.1 host 1.15",
            f"{scan}3.0 1.2 {math.pi / 2} 3.0 1.0 {math.pi / 2} 0.1 0.2 0.3 0.4 0.5 1.4 host 1.45",
        )
    )
    assert [scan.stamp_s for scan in log] == [1.1, 1.4]
    assert [scan.odometry for scan in log] == [Pose2D(1.0, 2.0, 0.0), Pose2D(3.0, 1.0, math.pi / 2)]
    assert [scan.ranges_m.tolist() for scan in log] == [[1.0, 2.0, 3.0]] * 2
    assert log.geometry.angles_rad.tolist() == [-2.0, -1.5, -1.0]
    assert log.geometry.mount == pytest.approx((0.2, 0.0, 0.0))


def test_the_table_is_read_gzipped_or_plain(tmp_path: Path) -> None:
    text = "# stamp x y theta n ranges\n10.5 1 2 0.5 3 1.0 2.0 3.0\n11.5 2 2 0.5 3 1.5 2.5 nan # end\n"
    plain, packed = tmp_path / "a.txt", tmp_path / "a.txt.gz"
    plain.write_text(text, encoding="utf-8")
    packed.write_bytes(gzip.compress(text.encode()))
    for path in (plain, packed):
        log = read_scan_log(path)
        assert [scan.stamp_s for scan in log] == [10.5, 11.5]
        assert log.scans[1].odometry == Pose2D(2.0, 2.0, 0.5)
        assert log.scans[0].ranges_m.tolist() == [1.0, 2.0, 3.0]
        assert log.invalid_ranges == 1
        assert log.geometry.range_max_m == 81.8


def test_readings_that_pile_up_at_the_largest_range_are_no_walls(tmp_path: Path) -> None:
    lines = [f"{k} 0 0 0 4 1.0 2.{k} 8.19 8.19" for k in range(10)]
    assert read_scan_log(written(tmp_path, *lines)).geometry.range_max_m == 8.19
    lines = [f"{k} 0 0 0 4 1.0 2.0 3.0 {4 + 0.1 * k}" for k in range(30)]
    assert read_scan_log(written(tmp_path, *lines)).geometry.range_max_m == 81.8


def test_an_empty_file_and_one_without_scans(tmp_path: Path) -> None:
    assert "empty" in error_of(written(tmp_path, "", "  "))
    assert "no laser scan" in error_of(written(tmp_path, "# nothing", "ODOM 0 0 0 0 0 0 1 host 1"))
    absent = tmp_path / "absent.log"
    assert error_of(absent) == f"{absent}: cannot be read: No such file or directory"
    garbage = tmp_path / "garbage.gz"
    garbage.write_bytes(b"\x1f\x8b\x08\x00 not really")
    assert "cannot be read" in error_of(garbage)


@pytest.mark.parametrize("said", UNUSABLE)
def test_a_log_that_cannot_be_used_is_one_line_with_its_place(said: str, tmp_path: Path) -> None:
    assert said in error_of(written(tmp_path, *UNUSABLE[said]))


@pytest.mark.parametrize("count", ["\u00b2", "\u0663", "9" * 5000, "-3", "1"])
def test_counts_that_are_none(tmp_path: Path, count: str) -> None:
    flaser = f"FLASER {count} {' '.join(RANGES)} 1.1 2 0.5 1 2 0.5 100.25 host 0.1"
    assert ":1: the number of ranges" in error_of(written(tmp_path, flaser))
    assert len(error_of(written(tmp_path, f"1 0 0 0 {count} 1 2 3"))) < 500
    assert ":2: " in error_of(written(tmp_path, ODOM, f"{RAW_HEAD} {count} 1 2 3 0 1 h 1"))


@pytest.mark.parametrize("kind", ["RAWLASER1", "ROBOTLASER1"])
def test_a_scanner_that_cannot_be(tmp_path: Path, kind: str) -> None:
    for numbers, said in (
        ("-2.0 4.0 0.0 30.0", "angle step: 0 rad"),
        ("-2.0 4.0 0.5 -30.0", "largest range: -30 m"),
        ("-2.0 4.0 0.5 0", "largest range: 0 m"),
        ("-2.0 4.0 0.5 80000", "range: 8000 m is further than 1000 m"),
        ("-2.0 4.0 1e300 30.0", "angle step: 3 beams 1e+300 rad apart go 3.18e+299 times round the circle"),
        ("-2.0 4.0 -9.4 30.0", "angle step: 3 beams -9.4 rad apart go 2.99 times round the circle"),
        ("-90 180 0.5 30.0", "start angle: -90 rad is beyond a full circle; is it in radians?"),
    ):
        scan = f"{kind} 0 {numbers} 0.01 0 3 1 2 8000 0 1 2 0 1 2 0 0.1 0.2 0.3 0.4 0.5 1.1 host 1.1"
        assert f":2: {said}" in error_of(written(tmp_path, ODOM, scan))


def test_a_scanner_that_looks_all_round_is_none_that_cannot_be(tmp_path: Path) -> None:
    head = f"RAWLASER1 0 {-math.pi} {2 * math.pi} {2 * math.pi / 360} 30.0 0.01 0 361"
    log = read_scan_log(written(tmp_path, "ODOM 0 0 0 0 0 0 1 h 1", f"{head} 3 {'2 ' * 360} 0 1.1 h 1.1"))
    assert log.geometry.beams == 361


def test_negative_ranges_say_nothing_and_are_counted(tmp_path: Path) -> None:
    log = read_scan_log(written(tmp_path, "1 0 0 0 4 1.5 -1 2.5 0", "2 0 0 0 4 1.5 -1 nan 90"))
    assert log.warnings == [
        f"{log.path}: 1 of 8 ranges are NaN or infinite and were left out",
        f"{log.path}: 2 of 8 ranges are negative and were left out",
    ]
    assert "no range lies between" in error_of(written(tmp_path, "1 0 0 0 3 -1 -1 -2"))


def test_a_laser_too_far_from_its_robot_is_no_mount(tmp_path: Path) -> None:
    log = read_scan_log(
        written(tmp_path, "FLASER 3 1 2 3 30 40 0 0 0 0 1 h 1", "FLASER 3 1 2 3 31 40 0 1 0 0 2 h 2")
    )
    assert log.geometry.mount == Pose2D(0.0, 0.0, 0.0)
    assert log.warnings == [
        f"{log.path}: the laser's poses lie 50 m from the robot's, which is no mount; "
        "the laser is taken to sit on the robot's base"
    ]


ODD = [
    f"{k} {0.1 * k} 0 0 {n} " + "1.5 2.5 " * (n // 2) + "2" * (n % 2)
    for k in range(20)
    for n in (90 + (k != 7),)
]
"""a log with one scan of 90 ranges among 19 of 91"""


def test_a_scan_with_a_beam_less_than_the_others_is_left_out_and_told(tmp_path: Path) -> None:
    log = read_scan_log(written(tmp_path, *ODD))
    assert (len(log), log.geometry.beams) == (19, 91)
    assert [scan.stamp_s for scan in log] == [k for k in range(20) if k != 7]
    assert log.warnings == [
        f"{log.path}: 1 of 20 scans have 90 ranges, not 91 as the others, and were left out"
    ]


def test_the_first_scan_may_be_the_odd_one_in_each_kind_of_log(tmp_path: Path) -> None:
    for odd, usual in (
        ("0 0 0 0 2 1 2", "1 0 0 0 3 1 2 3"),
        ("FLASER 4 1 2 3 1 0 0 0 0 0 0 1 h 1", "FLASER 3 1 2 3 0 0 0 0 0 0 1 h 1"),
        (f"{RAW_HEAD} 2 1 2 0 1 host 1", f"{RAW_HEAD} 3 1 2 3 0 1 host 1"),
        (f"{ROBOT_HEAD} 2 1 2 {POSES}", f"{ROBOT_HEAD} 3 1 2 3 {POSES}"),
    ):
        head = ODOM if odd.startswith("RAW") else "# a comment"
        log = read_scan_log(written(tmp_path, head, odd, usual, usual))
        assert (len(log), log.geometry.beams) == (2, 3)
        assert sum(log.left_out.values()) == 1


@pytest.mark.parametrize("start", [(0.0, 0.0), (448262.25, 5411932.5), (-9e7, 9e7)])
def test_a_log_is_measured_from_its_first_pose(tmp_path: Path, start: tuple[float, float]) -> None:
    x, y = start
    log = read_scan_log(written(tmp_path, *(f"{k} {x + 50.0 * k} {y} 0 3 1 2 3" for k in range(20))))
    assert [scan.odometry.x - x for scan in log] == [50.0 * k for k in range(20)]
