import math

import cv2
import numpy as np
import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.geometry import Box, Pose2D, wrap_angle
from midnet_bench.grid import OccupancyGrid
from midnet_bench.mapping import merge
from midnet_bench.mapping.merge import (
    Fit,
    by_features,
    by_known_starts,
    compose,
    confidence,
    match_maps,
    refusals,
)
from midnet_bench.rng import stream
from tests.mapping.drawn_buildings import (
    VALUES,
    Building,
    corridor,
    grid,
    hull,
    map_of,
    random_frame,
    rooms,
    viewpoints,
)

SAME = Pose2D(0.0, 0.0, 0.0)


def drawn(merged):
    letters = {value: letter for letter, value in VALUES.items()}
    return ["".join(letters[int(value)] for value in row) for row in merged.data[::-1]]


def two_views(building, rng, share, pose_error_m=0.0):
    """Maps of the left and of the right ``share`` of a building in frames of their own, and the truth."""
    frames = random_frame(rng), random_frame(rng)
    left = map_of(building, viewpoints(building, rng, 0.0, share), frames[0], rng, pose_error_m)
    right = map_of(building, viewpoints(building, rng, 1.0 - share, 1.0), frames[1], rng, pose_error_m)
    return left, right, frames[0].inverse().compose(frames[1])


def errors(placement, truth, placed_map):
    """(metres at the frame's origin or at the map's middle, the worse; degrees)."""
    x_min, y_min, x_max, y_max = placed_map.extent
    middle = Pose2D((x_min + x_max) / 2.0, (y_min + y_max) / 2.0, 0.0)
    off_m = max(placement.distance_to(truth), placement.compose(middle).distance_to(truth.compose(middle)))
    return off_m, math.degrees(abs(wrap_angle(placement.yaw - truth.yaw)))


@pytest.mark.slow
def test_views_of_one_building_are_merged_rightly_or_refused():
    merged = 0
    for seed in range(6):
        rng = stream(seed, "merge")
        building = (rooms, corridor)[seed % 2](rng)
        left, right, truth = two_views(building, rng, 0.75, pose_error_m=0.02)
        match = match_maps(left, right)
        assert (match.placement is None) == bool(match.refusal)
        if match.placement is not None:
            merged += 1
            off_m, off_deg = errors(match.placement, truth, right)
            assert off_m <= 0.1
            assert off_deg <= 2.0
    assert merged >= 4


def strangers(seed, draw):
    """Maps of two buildings, each in a frame of its own."""
    rng, maps = stream(seed, "strangers"), []
    for _ in range(2):
        building = draw(rng)
        maps.append(map_of(building, viewpoints(building, rng, 0.0, 1.0), random_frame(rng), rng))
    return maps


@pytest.mark.slow
def test_views_of_different_buildings_are_refused():
    for seed in range(5):
        match = match_maps(*strangers(seed, (rooms, corridor)[seed % 2]))
        assert match.placement is None
        assert match.refusal


@pytest.mark.slow
@pytest.mark.parametrize("gate", ["confidence", "agreement"])
def test_features_and_grids_each_refuse_different_buildings(gate, monkeypatch):
    maps = strangers(3, rooms)
    features_only = {"MIN_AGREEMENT": 1e-9, "MIN_OVERLAP": -1e9}
    opened = features_only if gate == "confidence" else {"MIN_CONFIDENCE": 0.0}
    for limit, value in {"MAX_SCALE_ERROR": 1e9, **opened}.items():
        monkeypatch.setattr(merge, limit, value)
    refusal = match_maps(*maps).refusal
    assert refusal.startswith(("confidence", "too few") if gate == "confidence" else ("agreement", "only"))


@pytest.mark.slow
def test_a_square_room_is_not_merged_with_itself_turned():
    room = Building(hull(6.0, 6.0), 6.0, 6.0)
    for seed in range(3):
        left, right, _ = two_views(room, stream(seed, "square"), 1.0)
        assert match_maps(left, right).placement is None


@pytest.mark.slow
def test_a_building_that_half_a_turn_leaves_as_it_is_is_ambiguous(monkeypatch):
    labyrinth = render_exact(load_arena("map2"))
    match = match_maps(labyrinth, labyrinth)
    assert match.placement is None
    assert match.refusal.startswith("ambiguous")
    assert match.confidence > 1.0
    monkeypatch.setattr(merge, "MAX_RIVAL", 1.1)
    believed = match_maps(labyrinth, labyrinth).placement
    assert abs(math.sin(believed.yaw)) < 0.01


@pytest.mark.slow
def test_one_thing_out_of_symmetry_settles_it():
    rng = stream(0, "pillars")
    pillars = [Box.square(1.5, 1.5, 0.6), Box.square(4.6, 1.2, 0.5), Box.square(1.8, 4.0, 0.8)]
    room = Building(hull(6.0, 6.0) + pillars, 6.0, 6.0)
    left, right, truth = two_views(room, rng, 1.0)
    match = match_maps(left, right)
    assert match.refusal == ""
    off_m, off_deg = errors(match.placement, truth, right)
    assert off_m <= 0.05
    assert off_deg <= 0.5


@pytest.mark.slow
def test_a_match_is_repeatable_and_its_inverse_the_same_placement():
    rng = stream(1, "twice")
    left, right, _ = two_views(rooms(rng), rng, 0.75)
    cv2.setRNGSeed(5)
    unused = cv2.randu(np.zeros(8), 0.0, 1.0)
    cv2.setRNGSeed(5)
    there = match_maps(left, right)
    # OpenCV's global generator is neither drawn from nor seeded anew
    assert cv2.randu(np.zeros(8), 0.0, 1.0).tolist() == unused.tolist()
    assert match_maps(left, right) == there
    back = match_maps(right, left)
    off_m, off_deg = errors(back.placement.inverse(), there.placement, right)
    assert off_m < 0.03
    assert off_deg < 0.2


@pytest.mark.slow
def test_maps_of_other_resolutions_are_merged_without_scale():
    rng = stream(2, "fine")
    building, frame = rooms(rng), random_frame(rng)
    coarse = map_of(building, viewpoints(building, rng, 0.0, 1.0), SAME, rng)
    fine = map_of(building, viewpoints(building, rng, 0.0, 1.0), frame, rng, resolution=0.04)
    match = match_maps(coarse, fine)
    assert match.refusal == ""
    assert errors(match.placement, frame, fine)[0] <= 0.1


@pytest.mark.slow
@pytest.mark.parametrize("empty", ["#\n", " \n", "?\n"])
def test_maps_with_nothing_to_match_are_refused(empty):
    blank = OccupancyGrid(np.full((60, 60), VALUES[empty[0]], dtype=np.int8), 0.05, (0.0, 0.0))
    rng = stream(4, "blank")
    building = rooms(rng)
    full = map_of(building, viewpoints(building, rng, 0.0, 1.0), SAME, rng)
    for pair in ((blank, full), (full, blank), (blank, blank)):
        assert match_maps(*pair).refusal


@pytest.mark.slow
def test_a_team_of_three_is_chained_and_a_stranger_left_out():
    rng = stream(0, "team")
    building, other = corridor(rng), rooms(rng)
    shares = ((0.0, 0.5), (0.2, 0.8), (0.5, 1.0))
    frames = [random_frame(rng) for _ in shares]
    maps = [
        map_of(building, viewpoints(building, rng, left, right), frame, rng)
        for (left, right), frame in zip(shares, frames, strict=True)
    ]
    maps.insert(1, map_of(other, viewpoints(other, rng, 0.0, 1.0), random_frame(rng), rng))
    frames.insert(1, None)
    merged, matches = by_features(maps, [SAME] * 4)
    assert all(matches[pair].refusal for pair in ((0, 1), (1, 2), (1, 3)))
    for first, second in ((0, 2), (2, 3)):
        truth = frames[first].inverse().compose(frames[second])
        off_m, off_deg = errors(matches[first, second].placement, truth, maps[second])
        assert off_m <= 0.15
        assert off_deg <= 2.0
    known_m2 = np.count_nonzero(merged.data >= 0) * 0.05**2
    assert known_m2 == pytest.approx(building.width_m * building.height_m, rel=0.12)


def test_compose_takes_the_largest_known_value():
    first = grid("? #\n?. ")
    second = grid("#??\n   ")
    assert drawn(compose([first, second], [SAME, SAME])) == ["# #", " . "]
    assert drawn(compose([second, first], [SAME, SAME])) == ["# #", " . "]


def test_compose_makes_room_and_leaves_the_rest_unknown():
    merged = compose([grid("#"), grid(" #", origin=(2.0, 1.0))], [SAME, SAME])
    assert drawn(merged) == ["?? #", "#???"]
    assert merged.origin == (0.0, 0.0)


def test_one_map_comes_back_unchanged():
    one = grid("? #\n?. ", resolution=0.05, origin=(-1.23, 4.56))
    merged = compose([one], [SAME])
    np.testing.assert_array_equal(merged.data, one.data)
    assert merged.origin == pytest.approx(one.origin)
    assert merged.resolution == one.resolution


def test_start_poses_are_metres_in_the_common_frame():
    # each robot starts at (0, 0) of its own map, half a metre from its corner, and sees a wall ahead
    ahead = OccupancyGrid(np.kron(grid("? #").data, np.ones((5, 5), dtype=np.int8)), 0.1, (-0.5, -0.25))
    merged = compose([ahead, ahead], [Pose2D(1.0, 0.0, 0.0), Pose2D(1.0, 2.0, math.pi / 2)])
    for x, y, value in ((1.25, 0.0, 0), (1.75, 0.0, 100), (1.0, 2.25, 0), (1.0, 2.75, 100), (1.75, 2.0, -1)):
        column, row = merged.cell_at(x, y)
        assert merged.data[row, column] == value


def test_evidence_is_all_that_is_shared_without_contradiction_and_none_at_the_least_agreement():
    assert Fit(2.0, 0.0).evidence_m == 2.0
    assert Fit(2.0, 0.1).evidence_m == pytest.approx(1.1)
    assert Fit(9.0, 1.0).evidence_m == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
def test_a_stricter_limit_refuses_what_the_default_accepts(monkeypatch):
    rng = stream(8, "strict")
    left, right, _ = two_views(rooms(rng), rng, 0.75)
    match = match_maps(left, right)
    assert match.placement is not None
    for limit, stricter, word in (
        ("MIN_CONFIDENCE", match.confidence + 0.1, "confidence"),
        ("MIN_OVERLAP", 5.0, "only"),
        ("MAX_RIVAL", 0.0, "ambiguous"),
        ("MAX_SCALE_ERROR", 0.0, "features want"),
    ):
        with monkeypatch.context() as limits:
            limits.setattr(merge, limit, stricter)
            assert match_maps(left, right).refusal.startswith(word)


def test_maps_in_one_frame_are_laid_over_each_other():
    merged = by_known_starts([grid("?# \n???"), grid("?  \n  ?")])
    assert merged.data.tolist() == grid("?# \n  ?").data.tolist()
    assert math.isnan(confidence({}))


@pytest.mark.slow
def test_maps_of_one_building_find_together_by_features_whatever_the_starts():
    rng = stream(3, "building")
    building = rooms(rng)
    shares = ((0.0, 0.8), (0.2, 1.0))
    maps = [map_of(building, viewpoints(building, rng, *share), SAME, rng) for share in shares]
    starts = [Pose2D(2.0, 3.0, 0.4), Pose2D(6.0, 4.0, -2.0)]
    merged, matches = by_features(maps, starts)
    assert refusals(matches) == []
    assert confidence(matches) >= 0.7
    # laid over each other by what they show, they agree with the maps laid over each other by their frame
    together = by_known_starts(maps)
    rows, columns = np.nonzero(merged.data == 100)
    walls = {together.cell_at(*merged.center_of(c, r)) for c, r in zip(columns, rows, strict=True)}
    thick = {
        (int(c) + i, int(r) + j)
        for r, c in np.argwhere(together.data == 100)
        for i in (-2, -1, 0, 1, 2)
        for j in (-2, -1, 0, 1, 2)
    }
    assert len(walls & thick) > 0.98 * len(walls)


def test_a_refused_merge_leaves_the_map_that_knows_most():
    square = np.full((60, 60), -1, dtype=np.int8)
    square[10:50, 10:50] = 100
    square[12:48, 12:48] = 0
    small = square.copy()
    small[:, 30:] = -1
    maps = [OccupancyGrid(data, 0.05, (0.0, 0.0)) for data in (small, square)]
    merged, matches = by_features(maps, [Pose2D(1.0, 1.0, 0.0), Pose2D(1.5, 1.0, 2.0)])
    assert merged.data.tobytes() == square.tobytes()
    (line,) = refusals(matches)
    assert line.startswith("the maps of robots 1 and 2 were not merged: ")
    assert confidence(matches) < 0.7
