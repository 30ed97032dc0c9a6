"""People and things that move by themselves: their gait, their paths, what beams and robots meet of them."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest

from midnet_bench.arena.arena import Arena, OtherIntruders, checked_arena, load_arena
from midnet_bench.arena.layout import Layout, OtherIntruder, place
from midnet_bench.geometry import Command, Pose2D
from midnet_bench.simulation.crowd import FEET_APART_M, LEG_DIAMETER_M, Crowd, step_length_m
from midnet_bench.simulation.engine import Beams
from tests.simulation.scenes import ENGINES, WORLDS

STEP_S = 1.0 / 30.0
NOBODY = np.empty((0, 3))
EMPTY = load_arena("empty")
BIG = {**EMPTY.model_dump(), "plane_m": [44.0, 44.0], "enclosure_m": [40.0, 40.0]}
BIG["walls"] = [[[-20, -20], [20, -20], [20, 20], [-20, 20], [-20, -20]]]


def layout_of(*others: tuple[dict[str, object], Pose2D], arena: Arena = EMPTY, robots: int = 0) -> Layout:
    standing = tuple(OtherIntruder(OtherIntruders.model_validate(group), pose) for group, pose in others)
    layout = place(arena, 1, max(robots, 1))
    return replace(layout, robots=layout.robots[:robots], others=standing)


@pytest.mark.slow
@pytest.mark.parametrize("speed_mps", [0.8, 1.4, 2.0])
def test_a_person_walks_by_the_walk_ratio_one_leg_standing_at_a_time(speed_mps: float) -> None:
    big = checked_arena(BIG, "big")
    crowd = Crowd(
        layout_of(({"kind": "person", "speed_mps": speed_mps}, Pose2D(-10, 0, 0)), arena=big), STEP_S
    )
    (person,) = crowd.members
    person.go_to((10.025, 0.025))  # the middle of a cell, for a straight end
    feet, places = [], []
    while person.goal is not None:
        crowd.step(NOBODY)
        feet.append([(solid.pose.x, solid.pose.y) for solid in person.solids()])
        places.append(person.pose.x)
    feet, places = np.array(feet), np.array(places)
    assert len(feet) * STEP_S == pytest.approx(20.0 / speed_mps, rel=0.1)
    cruise = (places > -6.0) & (places < 6.0)
    moves = np.linalg.norm(np.diff(feet[cruise], axis=0), axis=2)
    assert (moves.min(axis=1) < 0.15 * speed_mps * STEP_S).mean() > 0.9  # but where the legs change roles
    assert moves.max() < 4.0 * speed_mps * STEP_S
    gaps = feet[cruise, 0, 0] - feet[cruise, 1, 0]
    assert np.abs(gaps).max() == pytest.approx(step_length_m(speed_mps), rel=0.05)
    steps = (np.diff(np.sign(gaps)) != 0).sum()
    cadence = steps / (cruise.sum() * STEP_S)
    assert cadence * step_length_m(speed_mps) == pytest.approx(speed_mps, rel=0.07)
    assert step_length_m(speed_mps) / (60.0 * cadence) == pytest.approx(0.0065, rel=0.07)
    sideways = feet[cruise, 0, 1] - feet[cruise, 1, 1]
    assert sideways == pytest.approx(FEET_APART_M, abs=0.02)
    assert person.pose.x == pytest.approx(10.025, abs=0.011)
    box = person.extent()  # side by side again, and one box for both legs
    assert (box.y_max - box.y_min, box.x_max - box.x_min) == pytest.approx(
        (FEET_APART_M + LEG_DIAMETER_M, LEG_DIAMETER_M), abs=0.01
    )


@pytest.mark.parametrize(("seed", "steps"), [(1, 120), pytest.param(2, 400, marks=pytest.mark.slow)])
def test_nobody_walks_through_a_wall_or_through_each_other(seed: int, steps: int) -> None:
    values = {**EMPTY.model_dump(), "stationary_intruders": {"count": 3}}
    values["walls"] = [*values["walls"], [[0.9, 3], [0.9, 0.9]], [[-3, -1], [-1, -1]]]
    values["other_intruders"] = [
        {"kind": "person", "count": 3, "speed_mps": 2.0},
        {"kind": "box", "size_m": [0.5, 0.2]},
        {"kind": "cylinder"},
    ]
    layout = place(checked_arena(values, "rooms"), seed, 1)
    crowd = Crowd(layout, STEP_S)
    rng = np.random.default_rng(seed)
    gap_m, apart_m, walked_m = math.inf, math.inf, 0.0
    for _ in range(steps):
        for member in crowd.members:
            if member.goal is None:
                member.go_to(member.free.draw(rng))
        before = [member.place for member in crowd.members]
        crowd.step(NOBODY)
        walked_m += sum(math.dist(a, member.place) for a, member in zip(before, crowd.members, strict=True))
        outlines = np.vstack([solid.outline for member in crowd.members for solid in member.solids()])
        gap_m = min(gap_m, *(float(wall.distance_to(outlines).min()) for wall in layout.solids))
        for member in crowd.members:
            for other in crowd.members:
                if other is not member:
                    apart_m = min(apart_m, math.dist(member.place, other.place))
    assert walked_m > steps / 30.0
    assert gap_m > 0.0
    assert apart_m > 0.2


def test_a_person_stops_before_a_robot_and_goes_on_when_it_has_left() -> None:
    crowd = Crowd(layout_of(({"kind": "person", "speed_mps": 2.0}, Pose2D(-2, 0, 0))), STEP_S)
    (person,) = crowd.members
    robot = np.array([[0.5, 0.05, 0.13]])
    legs = []
    for _ in range(90):
        if person.goal is None:
            person.go_to((2.0, 0.0))
        crowd.step(robot)
        legs += [math.dist((solid.pose.x, solid.pose.y), robot[0, :2]) for solid in person.solids()]
    assert person.speed_mps == 0.0
    assert person.pose.x > -0.6
    assert min(legs) > 0.13 + LEG_DIAMETER_M / 2.0
    for _ in range(120):
        if person.goal is None and person.pose.x < 1.9:
            person.go_to((2.0, 0.0))
        crowd.step(np.array([[-2.0, 2.0, 0.13]]))
    assert person.pose.x == pytest.approx(2.0, abs=0.02)


@pytest.mark.slow
def test_a_hundred_people_walk_in_a_tenth_of_real_time() -> None:
    """They take a hundredth of it; looking at each other in plain Python they took a third."""
    values = {**BIG, "plane_m": [22.0, 22.0], "enclosure_m": [20.0, 20.0]}
    values["walls"] = [[[-10, -10], [10, -10], [10, 10], [-10, 10], [-10, -10]]]
    values["other_intruders"] = [{"kind": "person", "count": 100}]
    crowd = Crowd(place(checked_arena(values, "square"), 1, 1), STEP_S)
    crowd.step(NOBODY)
    rng = np.random.default_rng(1)
    for person in crowd.members:
        person.go_to(person.free.draw(rng))
    before = time.process_time()
    for _ in range(60):
        crowd.step(NOBODY)
        assert len(crowd.solids()) == 200
    taken_s = time.process_time() - before
    assert sum(person.speed_mps > 0.0 for person in crowd.members) > 50
    assert taken_s < 0.2


def test_beams_meet_legs_and_boxes_where_they_are() -> None:
    crowd = Crowd(
        layout_of(
            ({"kind": "person"}, Pose2D(2.0, 0.0, 0.0)),
            ({"kind": "box", "size_m": [0.6, 0.2]}, Pose2D(0.0, 2.0, math.pi / 2)),
            ({"kind": "cylinder", "size_m": [0.4, 0.4]}, Pose2D(-2.0, 0.0, 1.0)),
        ),
        STEP_S,
    )
    ways = np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [math.cos(0.0625), math.sin(0.0625)]], dtype=float)
    beams = Beams(np.zeros((1, 2)), ways[None])
    ranges = np.full((1, 5), np.inf)
    crowd.shorten(ranges, beams, 3.5)
    # between the legs, the box's short side, the cylinder, nothing, and the left leg
    assert ranges[0, 0] == np.inf
    assert ranges[0, 1] == pytest.approx(1.7)
    assert ranges[0, 2] == pytest.approx(1.8)
    assert ranges[0, 3] == np.inf
    assert ranges[0, 4] == pytest.approx(math.hypot(2.0, 0.125) - LEG_DIAMETER_M / 2.0, abs=1e-3)
    nearer = np.full((1, 5), 0.5)
    crowd.shorten(nearer, beams, 3.5)
    assert (nearer == 0.5).all()
    far = np.full((1, 5), np.inf)
    crowd.shorten(far, beams, 1.0)
    assert (far == np.inf).all()


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("kind", ["person", "box", "cylinder"])
def test_a_robot_runs_into_them_and_not_through_them(engine: str, kind: str) -> None:
    layout = layout_of(({"kind": kind}, Pose2D(0.8, 0.125, 0.0)), robots=1)
    world = WORLDS[engine](layout)
    (member,) = world.crowd.members
    for _ in range(240):
        world.drive(0, Command(0.22, 0.0))
        world.step()
        contour = world.pose(0).transform(np.array(world.robot.body))
        assert min(float(solid.distance_to(contour).min()) for solid in member.solids()) > -0.01
    assert world.pose(0).x < 0.85
    assert world.pose(0).x > 0.4
    assert world.collisions()[0] >= 1
    for _ in range(60):
        world.drive(0, Command(-0.22, 0.0))
        world.step()
    assert world.pose(0).x < 0.5  # it is free to leave
    world.close()


def track(engine: str, layout: Layout, seconds: float) -> tuple[float, float, float]:
    """Where the one robot ends that drives ahead all the time; nothing else moves for it."""
    world = WORLDS[engine](layout)
    there = world.crowd.solids()
    for _ in range(round(seconds / STEP_S)):
        world.drive(0, Command(0.2, 0.0))
        world.step()
    assert world.crowd.solids() == there
    assert world.collisions()[0] == 1
    pose = world.pose(0)
    world.close()
    return pose.x, pose.y, pose.yaw


@pytest.mark.slow
@pytest.mark.parametrize("aside_m", [0.1, 0.13])
@pytest.mark.parametrize("kind", ["person", "cylinder"])
def test_a_robot_slides_off_a_leg_as_off_a_stationary_intruder(kind: str, aside_m: float) -> None:
    """Within 5 mm and 0.06 rad, and 45 mm and 0.55 rad of PyBullet. A robot that is held does not turn."""
    shape = {} if kind == "person" else {"size_m": [LEG_DIAMETER_M, LEG_DIAMETER_M]}
    middle_m = aside_m + (FEET_APART_M / 2.0 if kind == "person" else 0.0)
    others = layout_of(({"kind": kind, **shape}, Pose2D(0.6, middle_m, 0.0)), robots=1)
    legs = Crowd(others, STEP_S).solids()
    still = replace(others, stationary=legs, others=())
    ends = [track(engine, layout, 8.0) for engine in ("fast", "bullet") for layout in (others, still)]
    assert np.ptp(ends, axis=0)[:2].max() < 0.045
    assert np.ptp(ends, axis=0)[2] < 0.55
    assert (np.abs(np.subtract(ends[0], ends[1])) < (0.005, 0.005, 0.06)).all()
    assert min(yaw for _, _, yaw in ends) > 1.2
