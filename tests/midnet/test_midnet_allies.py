"""Algorithm 2, on boxes of whole cells."""

import itertools
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.geometry import Box, Pose2D
from midnet_bench.midnet.fusion import AllyRemove, ally_squares, iou
from tests.midnet.teams import AllyRemoval, Detection, of, remove_ally_detections, rows

FAR = Pose2D(50.0, 50.0, 0.0)


@st.composite
def cell_boxes(draw: st.DrawFn, side: int = 12) -> Box:
    x1, y1 = draw(st.integers(0, side - 1)), draw(st.integers(0, side - 1))
    return Box(x1, y1, draw(st.integers(x1 + 1, side)), draw(st.integers(y1 + 1, side)))


def test_ally_box_is_the_square_about_the_robot_however_it_is_turned() -> None:
    squares = ally_squares([Pose2D(1.0, -2.0, 0.7), FAR], 0.5)
    assert squares.tolist() == [[0.75, -2.25, 1.25, -1.75], [49.75, 49.75, 50.25, 50.25]]


def test_ally_is_removed_from_the_list_of_the_one_that_sees_it() -> None:
    ally, intruder = Box(0.9, 0.9, 1.1, 1.1), Box(3.0, 3.0, 3.4, 3.4)
    poses = [Pose2D(-1.0, 0.0, 0.0), Pose2D(1.0, 1.0, 0.0)]
    result = remove_ally_detections(poses, [of(0, ally, intruder), of(1, intruder)], 0.21, 0.1)
    assert result == ([of(0, intruder), of(1, intruder)], [(Detection(ally, 0), 1)])


def test_robot_does_not_remove_its_own_detections_for_its_own_pose() -> None:
    here = [of(0, Box(-0.1, -0.1, 0.1, 0.1))]
    assert remove_ally_detections([Pose2D(0, 0, 0)], here, 0.21, 0.1).kept == here


@pytest.mark.parametrize(("remove", "kept"), [("first", (1, 2)), ("best", (0, 2)), ("all", (2,))])
def test_one_box_per_ally_and_observer_goes_and_the_options_take_others(
    remove: AllyRemove, kept: tuple[int, ...]
) -> None:
    # the ally's square is (0, 0)-(1, 1): a poor match first, the best second, and one below t
    seen = of(0, Box(0.5, 0.0, 1.5, 1.0), Box(0.0, 0.0, 1.0, 0.9), Box(0.9, 0.9, 1.9, 1.9))
    result = remove_ally_detections([FAR, Pose2D(0.5, 0.5, 0.0)], [seen, []], 1.0, 0.1, remove)
    assert result.kept[0] == [seen[k] for k in kept]


@pytest.mark.parametrize(("t", "left"), [(0.5, 0), (0.51, 1)])
def test_iou_of_exactly_t_is_the_ally(t: float, left: int) -> None:
    half = of(0, Box(0.0, 0.0, 1.0, 0.5))
    result = remove_ally_detections([FAR, Pose2D(0.5, 0.5, 0.0)], [half, []], 1.0, t)
    assert len(result.kept[0]) == left


def exact_iou(a: tuple[Fraction, ...], b: tuple[Fraction, ...]) -> Fraction:
    """Eq. 7 without rounding."""
    width, height = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
    both = max(width, Fraction(0)) * max(height, Fraction(0))
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (a, b)]
    return both / (sum(areas) - both)


@pytest.mark.parametrize("remove", ["first", "best", "all"])
def test_exact_ties_are_removed_wherever_they_lie_on_the_map(remove: AllyRemove) -> None:
    cell, side = Fraction(1, 20), 3
    thresholds = {Fraction(*t): 0 for t in ((1, 20), (1, 10), (1, 9), (1, 8), (1, 5), (1, 4), (1, 3), (1, 2))}
    places = [(0, 0), (83, 7), (-61, -120)]
    for width, height, dx, dy in itertools.product(range(1, 7), range(1, 7), range(-6, 3), range(-6, 3)):
        for column, row in places:
            square = [(column + c) * cell for c in (0, side)] + [(row + c) * cell for c in (0, side)]
            ally = (square[0], square[2], square[1], square[3])
            x, y = (column + dx) * cell, (row + dy) * cell
            box = (x, y, x + width * cell, y + height * cell)
            t = exact_iou(ally, box)
            if t not in thresholds:
                continue
            thresholds[t] += 1
            pose = Pose2D(float((ally[0] + ally[2]) / 2), float((ally[1] + ally[3]) / 2), 0.0)
            seen = of(0, Box(*map(float, box)))
            result = remove_ally_detections([FAR, pose], [seen, []], float(side * cell), float(t), remove)
            assert result.kept[0] == [], (box, t)
            more = remove_ally_detections(
                [FAR, pose], [seen, []], float(side * cell), float(t) * 1.001, remove
            )
            assert more.kept[0] == seen
    assert min(thresholds.values()) >= 3, thresholds


def test_the_first_of_the_best_goes_where_their_cells_tie() -> None:
    # 2 of 6 cells in common, below and above the ally; metres round the second one up by an ulp or two
    for row in range(-40, 40):
        low, lower, upper, high = ((row + c) * 0.05 for c in (-1, 1, 1, 3))
        seen = of(0, Box(0.0, low, 0.1, lower), Box(0.0, upper, 0.1, high))
        pose = Pose2D(0.05, (row + 1) * 0.05, 0.0)
        result = remove_ally_detections([FAR, pose], [seen, []], 0.1, 0.1, "best")
        assert result.removed == [(seen[0], 1)], row


def as_the_paper_writes_it(
    poses: list[Pose2D], lists: list[list[Detection]], di: float, t: float, remove: AllyRemove
) -> AllyRemoval:
    """Algorithm 2 word for word, on lists that it changes; the paper's own is ``first``."""
    removed = []
    for i, pose in enumerate(poses):
        b = Box(pose.x - di / 2, pose.y - di / 2, pose.x + di / 2, pose.y + di / 2)
        for j, own in enumerate(lists):
            matches = [k for k in own if i != j and b.iou(k.box) >= t]
            if remove == "best":
                matches.sort(key=lambda k: -b.iou(k.box))
            for k in matches if remove == "all" else matches[:1]:
                own.remove(k)
                removed.append((k, i))
    return AllyRemoval(lists, removed)


POSES = st.builds(Pose2D, st.integers(0, 12), st.integers(0, 12), st.just(0.0))
TEAMS = st.lists(st.tuples(POSES, st.lists(cell_boxes(), max_size=4, unique=True)), min_size=1, max_size=6)
REMOVES = st.sampled_from(["first", "best", "all"])


def detections(team: list[tuple[Pose2D, list[Box]]]) -> list[list[Detection]]:
    return [of(robot, *found) for robot, (_, found) in enumerate(team)]


@pytest.mark.slow
@given(TEAMS, REMOVES)
def test_it_is_algorithm_2(team: list[tuple[Pose2D, list[Box]]], remove: AllyRemove) -> None:
    poses = [pose for pose, _ in team]
    result = remove_ally_detections(poses, detections(team), 3.0, 0.2, remove)
    assert result == as_the_paper_writes_it(poses, detections(team), 3.0, 0.2, remove)


@pytest.mark.slow
@given(TEAMS, POSES, st.integers(0, 4), REMOVES)
def test_another_ally_never_adds_a_detection_to_any_robots_list(
    team: list[tuple[Pose2D, list[Box]]], ally: Pose2D, index: int, remove: AllyRemove
) -> None:
    without = remove_ally_detections([pose for pose, _ in team], detections(team), 3.0, 0.2, remove).kept
    index = min(index, len(team))
    larger = [*team[:index], (ally, []), *team[index:]]
    kept = remove_ally_detections([pose for pose, _ in larger], detections(larger), 3.0, 0.2, remove).kept
    del kept[index]
    for fewer, more in zip(kept, without, strict=True):
        assert {one.box for one in fewer} <= {one.box for one in more}


@given(st.lists(cell_boxes(), min_size=2, max_size=6))
def test_iou_of_arrays_is_eq_7_of_boxes(boxes: list[Box]) -> None:
    array = rows(of(0, *boxes)) * 0.05
    scaled = [Box(*row) for row in array.tolist()]
    for i, box in enumerate(scaled):
        assert [iou(array[i], other) for other in array] == [box.iou(other) for other in scaled]
