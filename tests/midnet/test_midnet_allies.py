import copy

import pytest
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.geometry import Box, Pose2D
from midnet_bench.midnet.fusion import ally_squares
from tests.midnet.plain_fusion import Detection
from tests.midnet.teams import remove_ally_detections

FAR = Pose2D(50.0, 50.0, 0.0)


@st.composite
def cell_boxes(draw: st.DrawFn, side: int = 12) -> Box:
    x1, y1 = draw(st.integers(0, side - 1)), draw(st.integers(0, side - 1))
    return Box(x1, y1, draw(st.integers(x1 + 1, side)), draw(st.integers(y1 + 1, side)))


def detections(*lists: list[Box]) -> list[list[Detection]]:
    return [[Detection(box, robot) for box in boxes] for robot, boxes in enumerate(lists)]


def test_ally_box_is_the_square_about_the_robot_however_it_is_turned() -> None:
    squares = ally_squares([Pose2D(1.0, -2.0, 0.7), FAR], 0.5)
    assert squares.tolist() == [[0.75, -2.25, 1.25, -1.75], [49.75, 49.75, 50.25, 50.25]]


def test_ally_is_removed_from_the_list_of_the_one_who_sees_it() -> None:
    ally, intruder = Box(0.9, 0.9, 1.1, 1.1), Box(3.0, 3.0, 3.4, 3.4)
    poses = [Pose2D(-1.0, 0.0, 0.0), Pose2D(1.0, 1.0, 0.0)]
    result = remove_ally_detections(poses, detections([ally, intruder], [intruder]), 0.21, 0.1)
    assert result.kept == detections([intruder], [intruder])
    (removed,) = result.removed
    assert removed.detection == Detection(ally, 0)
    assert removed.ally == 1
    assert removed.iou == pytest.approx(0.04 / 0.0441)


def test_robot_does_not_remove_its_own_detections_for_its_own_pose() -> None:
    here = Box(-0.1, -0.1, 0.1, 0.1)
    assert remove_ally_detections([Pose2D(0, 0, 0)], detections([here]), 0.21, 0.1).kept == detections([here])


def test_one_box_per_ally_and_observer_goes_and_the_options_take_others() -> None:
    # the ally's square is (0, 0)-(1, 1): a poor match first, the best second, and one below t
    poor, best, below = Box(0.5, 0.0, 1.5, 1.0), Box(0.0, 0.0, 1.0, 0.9), Box(0.9, 0.9, 1.9, 1.9)
    poses = [FAR, Pose2D(0.5, 0.5, 0.0)]
    seen = detections([poor, best, below], [])

    def kept(remove: str) -> list[Box]:
        return [one.box for one in remove_ally_detections(poses, seen, 1.0, 0.1, remove).kept[0]]

    assert kept("first") == [best, below]
    assert kept("best") == [poor, below]
    assert kept("all") == [below]


def test_iou_of_exactly_t_is_the_ally() -> None:
    half = Box(0.0, 0.0, 1.0, 0.5)
    poses = [FAR, Pose2D(0.5, 0.5, 0.0)]
    assert remove_ally_detections(poses, detections([half], []), 1.0, 0.5).kept[0] == []
    assert remove_ally_detections(poses, detections([half], []), 1.0, 0.51).kept[0] != []


def as_the_paper_writes_it(poses: list[Pose2D], d: list[list[Box]], di: float, t: float) -> list[list[Box]]:
    """Algorithm 2 word for word, on lists that it changes."""
    robots = list(range(len(poses)))
    for i in robots:
        others = list(robots)
        others.remove(i)
        b = Box(poses[i].x - di / 2, poses[i].y - di / 2, poses[i].x + di / 2, poses[i].y + di / 2)
        for j in others:
            for k in d[j]:
                if b.iou(k) >= t:
                    d[j].remove(k)
                    break
    return d


POSES = st.builds(Pose2D, st.integers(0, 12), st.integers(0, 12), st.just(0.0))
TEAMS = st.lists(st.tuples(POSES, st.lists(cell_boxes(), max_size=4, unique=True)), min_size=1, max_size=4)


@given(TEAMS)
def test_first_is_algorithm_2_and_the_inputs_stay_as_they_are(team: list[tuple[Pose2D, list[Box]]]) -> None:
    poses, boxes = [pose for pose, _ in team], [found for _, found in team]
    seen = detections(*boxes)
    before = copy.deepcopy(seen)
    result = remove_ally_detections(poses, seen, 3.0, 0.2)
    assert [[one.box for one in own] for own in result.kept] == as_the_paper_writes_it(poses, boxes, 3.0, 0.2)
    assert seen == before


@given(TEAMS, POSES, st.integers(0, 4), st.sampled_from(["first", "best", "all"]))
def test_another_ally_never_adds_a_detection_to_any_robots_list(
    team: list[tuple[Pose2D, list[Box]]], ally: Pose2D, index: int, remove: str
) -> None:
    poses, seen = [pose for pose, _ in team], detections(*(found for _, found in team))
    without = remove_ally_detections(poses, seen, 3.0, 0.2, remove).kept
    index = min(index, len(poses))
    poses.insert(index, ally)
    seen.insert(index, [])
    with_ally = remove_ally_detections(poses, seen, 3.0, 0.2, remove).kept
    del with_ally[index]
    for fewer, more in zip(with_ally, without, strict=True):
        assert set(fewer) <= set(more)


@given(TEAMS, st.sampled_from(["first", "best", "all"]))
def test_each_box_is_kept_or_removed_once_and_removed_boxes_reach_t(
    team: list[tuple[Pose2D, list[Box]]], remove: str
) -> None:
    poses, seen = [pose for pose, _ in team], detections(*(found for _, found in team))
    result = remove_ally_detections(poses, seen, 3.0, 0.2, remove)
    together = [one for own in result.kept for one in own] + [gone.detection for gone in result.removed]
    assert sorted(together) == sorted(one for own in seen for one in own)
    for gone in result.removed:
        assert gone.ally != gone.detection.robot
        assert gone.iou >= 0.2
