"""LiDARs by name: what their data sheets say, on any robot, and what a trial's settings make of it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.robots.lidars import LIDARS
from midnet_bench.robots.model import ROBOTS
from midnet_bench.robots.turtlebot3 import BURGER, LDS_01, WAFFLE

SHEETS = {  # beams, field of view in degrees, range in metres, scans a second: the makers' round numbers
    "lds_01": (360, 360, 3.5, 5.0),
    "rplidar_a1": (360, 360, 12.0, 5.5),
    "ld06": (455, 360, 12.0, 10.0),
    "ld19": (455, 360, 12.0, 10.0),
    "urg_04lx": (682, 240, 4.095, 10.0),
    "utm_30lx": (1081, 270, 30.0, 40.0),
    "tim571": (811, 270, 25.0, 15.0),
}
OWN = """
from midnet_bench.geometry import LidarGeometry, Pose2D
from midnet_bench.robots.turtlebot3 import BURGER
from dataclasses import replace
ROBOT = replace(BURGER, lidar=replace(BURGER.lidar, range_max_m=2.0), urdf=None)
"""


@pytest.mark.parametrize("name", LIDARS)
def test_a_named_lidar_is_that_of_its_data_sheet(name: str) -> None:
    model = ROBOTS.make(f"burger(lidar={name})")
    beams, view_deg, range_m, hz = SHEETS[name]
    lidar = model.lidar
    assert (lidar.beams, lidar.range_max_m, model.lidar_hz) == (beams, range_m, hz)
    swept_deg = math.degrees(lidar.angle_increment_rad) * (beams - (not lidar.is_full_turn) * 1)
    assert swept_deg == pytest.approx(view_deg, abs=0.6)
    if not lidar.is_full_turn:  # the beam ahead is in the middle
        assert np.abs(lidar.angles_rad).min() == pytest.approx(0.0, abs=1e-9)
        assert lidar.angles_rad[0] == pytest.approx(-lidar.angles_rad[-1], abs=0.01)
    assert ":" in LIDARS[name].source


def test_it_stands_where_the_robot_s_own_stood_and_changes_nothing_else() -> None:
    for robot, name in ((BURGER, "burger"), (WAFFLE, "waffle")):
        model = ROBOTS.make(f"{name}(lidar=utm_30lx)")
        assert model.lidar.mount == robot.lidar.mount
        assert replace(model, lidar=robot.lidar, lidar_hz=robot.lidar_hz) == robot
    assert ROBOTS.make("burger(lidar=lds_01)") == BURGER
    assert ROBOTS.pinned("burger( lidar = ld19 )") == "burger(lidar=ld19)"


def test_numbers_stand_beside_it() -> None:
    for order in ("lidar_hz=8, lidar=ld19", "lidar=ld19, lidar_hz=8"):
        model = ROBOTS.make(f"burger({order})")
        assert (model.lidar.beams, model.lidar_hz) == (455, 8.0)


@pytest.mark.parametrize(
    ("value", "says"),
    [
        (
            "burger(lidar=rplidar_a11)",
            "lidar: 'rplidar_a11' is none that has a name; did you mean 'rplidar_a1'?",
        ),
        ("burger(lidar=12)", "lidar: '12' is none that has a name"),
        ("burger(lidar=true)", "lidar: 'True' is none that has a name"),
        ("burger(lidars=ld19)", "no option 'lidars'; did you mean 'lidar'?"),
        ("burger(lidar_hz=0)", "lidar_hz"),
        ("burger(lidar_hz=fast)", "lidar_hz: a number is needed"),
    ],
)
def test_a_lidar_that_is_not_there_is_one_line(value: str, says: str) -> None:
    with pytest.raises(InputError) as caught:
        ROBOTS.make(ROBOTS.pinned(value))
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def costmap_of(robot: str, **more: object) -> tuple[float, float, float]:
    costmap = DetectionParameters.of(robot=robot, **more).costmap
    return costmap.obstacle_range_m, costmap.raytrace_range_m, costmap.size_m


def test_ranges_and_window_follow_the_lidar_unless_they_are_set() -> None:
    for robot in ("burger", "waffle", "burger(lidar=lds_01)"):
        assert costmap_of(robot) == (2.5, 3.5, 3.5)
    for robot in ("burger", "waffle"):
        assert costmap_of(f"{robot}(lidar=rplidar_a1)") == (12.0, 12.0, 24.0)
    assert costmap_of("burger(lidar=urg_04lx)") == (4.095, 4.095, 8.19)
    assert costmap_of("burger(lidar=ld19)", obstacle_range_m=5.0, local_size_m=10.0) == (5.0, 12.0, 10.0)
    assert costmap_of("burger(lidar=ld19)", preset="best")[2] == 24.0
    assert costmap_of("burger", preset="best")[2] == 6.0
    assert LabyrinthParameters.of(robot="burger(lidar=utm_30lx)").costmap.size_m == 60.0


def test_a_lidar_of_a_user_s_own_counts_too(tmp_path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(OWN)
    assert costmap_of("mine.py:ROBOT") == (2.0, 2.0, 4.0)
    assert costmap_of("mine.py:ROBOT(lidar=tim571)") == (25.0, 25.0, 50.0)


def test_only_the_lidar_differs_between_burgers() -> None:
    usual, other = (DetectionParameters.of(robot=name) for name in ("burger", "burger(lidar=ld19)"))
    assert (other.navigator, other.intruder_speed_mps) == (usual.navigator, usual.intruder_speed_mps)
    assert other.midnet == usual.midnet
    rates = {name: value for name, value in other.flat_values().items() if value != usual.flat_values()[name]}
    assert {*rates} == {"robot", "lidar_hz", "obstacle_range_m", "raytrace_range_m", "local_size_m"}
    mapped = MappingParameters.of(robot="burger(lidar=ld19)")
    assert mapped.navigator == MappingParameters.of().navigator
    assert mapped.simulation.lidar.hz == 10.0


def test_the_burger_s_rate_is_a_whole_number_in_results_as_ever() -> None:
    assert repr(DetectionParameters.of().flat_values()["lidar_hz"]) == "5"
    assert repr(DetectionParameters.of(robot="waffle").flat_values()["lidar_hz"]) == "5"
    assert repr(DetectionParameters.of(robot="burger(lidar=rplidar_a1)").flat_values()["lidar_hz"]) == "5.5"


def remarks(**values: object) -> list[str]:
    return DetectionParameters.of(**values).remarks


def test_what_a_lidar_is_used_for_is_told_where_it_is_less_than_it_could() -> None:
    assert remarks() == remarks(robot="waffle") == remarks(robot="burger(lidar=rplidar_a1)") == []
    assert remarks(local_size_m=2.5) == []  # the paper's own readings
    assert remarks(robot="burger(lidar=rplidar_a1)", obstacle_range_m=2.5) == [
        "a LiDAR of 12 m is used to 2.5 m (obstacle_range_m)"
    ]
    assert remarks(robot="burger(lidar=rplidar_a1)", local_size_m=3.5) == [
        "local_size_m=3.5: the local costmap ends 1.75 m from its robot, and intruders are in range up to "
        "12 m"
    ]
    (line,) = remarks(obstacle_range_m=12.0)
    assert line == "obstacle_range_m=12: the LiDAR ends at 3.5 m, and its use too"
    assert DetectionParameters.of(obstacle_range_m=12.0).usable_range_m == LDS_01.range_max_m
    (line,) = remarks(robot="burger(lidar=utm_30lx)")
    assert line.startswith("a LiDAR of 40 Hz scans once a physics step, 30 times a second; step_hz=40 lets")
    assert remarks(robot="burger(lidar=utm_30lx)", step_hz=40) == []
    assert MappingParameters.of(lidar_hz=50).remarks


@pytest.mark.parametrize(
    "values",
    [
        {"obstacle_range_m": 101.0},
        {"obstacle_range_m": 0.0},
        {"raytrace_range_m": 100.5},
        {"local_size_m": 251.0},
        {"lidar_hz": 0},
        {"lidar_hz": 0.4},
        {"lidar_hz": 1001},
        {"lidar_hz": True},
        {"lidar_hz": "fast"},
    ],
)
def test_what_no_lidar_has_is_refused_by_its_key(values: dict[str, object]) -> None:
    with pytest.raises(InputError, match=next(iter(values))):
        DetectionParameters.of(**values)


def test_a_hundred_metres_are_taken() -> None:
    assert costmap_of("burger", obstacle_range_m=100, raytrace_range_m=100, local_size_m=200) == (
        *(100.0, 100.0),
        200.0,
    )
