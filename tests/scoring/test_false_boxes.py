"""Every cause of a false box in a scene by hand; of what a box is that is of several things."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import pytest

from midnet_bench.geometry import Box
from midnet_bench.scoring.diagnosis import NOTHING, WALL, Cause, GuardView, Marks, ally, false_box_cause
from midnet_bench.scoring.error_causes import FALSE_CAUSES, UNEXPLAINED
from midnet_bench.scoring.frame_counts import TruthObject
from tests.scoring.guard_views import assert_is, guard_view, intruder, returns

HERE, FAR = intruder(1.0, 0.0), intruder(-1.0, 0.0)
SEEN = (0.975, 0.025)
BRICKS = Box(1.0, -1.0, 2.0, 1.0)  # what the inflated prior map covers of a wall
FACE = (1.225, 0.025)  # on the wall: none of its cells is seen
BRICKED: dict[str, Any] = {"walls": [BRICKS], "truth": FAR}


class Scene(NamedTuple):
    """A box that the only guard found, and what has to be said of it."""

    expected: Cause
    view: GuardView
    truths: Sequence[TruthObject] = (HERE,)


def scene(expected: Cause, *scans: Marks, truth: TruthObject = HERE, **view: Any) -> Scene:
    return Scene(expected, guard_view(*scans, truths=[truth], **view), [truth])


SCENES = {
    "intruder_trail": scene(
        Cause("intruder_trail", 0, "intruder 1", 2.0, 1.975),
        returns(0, (0.975, 0.0), age_s=2.0, is_newest=False),
        truth=FAR,
    ),
    "stale": scene(
        Cause("stale", 0, "intruder 1", 0.1, 0.3),
        returns(0, (0.975, -0.275)),
        centers_at_scan=[(1.0, -0.3)],
    ),
    "misplaced_by_pose": scene(
        Cause("misplaced_by_pose", 0, "intruder 1", 0.1, 0.3), returns(0, SEEN, pose=(0.0, 0.3))
    ),
    "misplaced_by_crop": scene(
        Cause("misplaced_by_crop", 0, "intruder 1", 0.1, 0.2), returns(0, SEEN), shift_cells=(0, 4)
    ),
    "misplaced_by_noise": scene(
        Cause("misplaced_by_noise", 0, "intruder 1", 0.1, 0.3), returns(0, SEEN, noise=(-0.3, 0.0))
    ),
    "deflated": scene(
        Cause("deflated", 0, "intruder 1", 0.1, 0.1), returns(0, SEEN, pose=(0.0, 0.05)), deflated_m=0.1
    ),
    "rim": scene(Cause("rim", 0, "intruder 1", 0.1), returns(0, SEEN), walls=[Box(0.9, -0.2, 1.2, 0.2)]),
    "ally_trail": scene(
        Cause("ally_trail", 0, "guard 2", 3.0),
        returns(ally(1), (0.5, 0.5), age_s=3.0, is_newest=False),
        returns(ally(1), (0.5, 0.5), age_s=5.0, is_newest=False),
    ),
    "ally_left": scene(Cause("ally_left", 0, "guard 3", 0.1), returns(ally(2), (0.5, 0.5))),
    "wall_by_pose": scene(
        Cause("wall_by_pose", 0, "a wall", 0.1, 0.4), returns(WALL, FACE, pose=(-0.4, 0.0)), **BRICKED
    ),
    "wall_by_crop": scene(
        Cause("wall_by_crop", 0, "a wall", 0.1, 0.4), returns(WALL, FACE), shift_cells=(-8, 0), **BRICKED
    ),
    "wall_by_noise": scene(
        Cause("wall_by_noise", 0, "a wall", 0.1, 0.4), returns(WALL, FACE, noise=(-0.4, 0.0)), **BRICKED
    ),
    "wall_by_map": scene(
        Cause("wall_by_map", 0, "a wall", 0.1), returns(WALL, (0.5, 0.5), pose=(0.1, 0.0), noise=(0.0, 0.1))
    ),
    "fragment": scene(Cause("fragment", 0, "intruder 1"), returns(0, SEEN)),
    UNEXPLAINED: scene(Cause(UNEXPLAINED, 0, "", 0.1), returns(NOTHING, (0.5, 0.5))),
}


def explained(view: GuardView, truths: Sequence[TruthObject] = (HERE,)) -> Cause:
    (box,) = view.found
    return false_box_cause(box, view.guard, truths, [view])


@pytest.mark.parametrize("name", FALSE_CAUSES)
def test_each_cause_in_a_scene_that_has_it_alone(name: str) -> None:
    expected, view, truths = SCENES[name]
    assert expected.name == name
    assert_is(explained(view, truths), expected)


def test_what_most_cells_of_a_box_are_nearest_to_counts() -> None:
    guard, wall = (0.475, 0.475), (0.675, 0.475)
    more_guard = guard_view(
        returns(ally(1), guard, (0.425, 0.475)), returns(WALL, (0.575, 0.475)), truths=[HERE]
    )
    more_wall = guard_view(returns(ally(1), guard), returns(WALL, wall, (0.625, 0.475)), truths=[HERE])
    assert explained(more_guard).name == "ally_left"
    assert explained(more_wall).name == "wall_by_map"


def test_an_ally_with_one_new_return_is_left_in_and_is_as_old_as_that() -> None:
    view = guard_view(
        returns(ally(1), (0.475, 0.475), age_s=0.5, is_newest=False),
        returns(ally(1), (0.525, 0.475), age_s=0.1),
        truths=[HERE],
    )
    assert_is(explained(view), Cause("ally_left", 0, "guard 2", 0.1))


def test_old_marks_close_to_an_intruder_that_is_still_there_are_no_trail() -> None:
    view = guard_view(
        returns(0, SEEN, age_s=0.4, is_newest=False, pose=(0.0, 0.3)),
        truths=[HERE],
    )
    assert explained(view).name == "misplaced_by_pose"


@pytest.mark.parametrize(
    ("pose_m", "crop_cells", "expected"),
    [
        (-0.15, -2, Cause("wall_by_pose", 0, "a wall", 0.1, 0.15)),
        (-0.08, -3, Cause("wall_by_crop", 0, "a wall", 0.1, 0.15)),
        # each is enough to put it off, so that both must go
        (-0.40, -9, Cause("wall_by_crop", 0, "a wall", 0.1, 0.45)),
    ],
)
def test_the_largest_error_without_which_a_wall_had_been_covered_counts(
    pose_m: float, crop_cells: int, expected: Cause
) -> None:
    view = guard_view(
        returns(WALL, (1.275, 0.025), pose=(pose_m, 0.0)),
        truths=[FAR],
        walls=[BRICKS],
        shift_cells=(crop_cells, 0),
    )
    assert_is(explained(view, [FAR]), expected)


def test_a_wall_that_the_prior_map_does_not_have_is_one_whatever_the_pose() -> None:
    view = guard_view(returns(WALL, (0.5, 0.5), pose=(0.3, 0.0)), truths=[HERE], walls=[BRICKS])
    assert explained(view).name == "wall_by_map"


def test_a_wall_that_its_window_puts_off_the_prior_map_makes_no_box() -> None:
    assert not guard_view(returns(WALL, (2.225, 0.0)), truths=[HERE]).found


def test_a_box_that_a_fusion_made_is_of_those_that_it_touches() -> None:
    truths = [HERE]
    first = guard_view(returns(ally(1), (0.475, 0.475)), truths=truths)
    second = guard_view(returns(WALL, (0.525, 0.475), (0.575, 0.475)), truths=truths, guard=1)
    mean = Box(0.375, 0.35, 0.65, 0.6)
    assert mean not in (*first.found, *second.found)
    assert_is(false_box_cause(mean, 0, truths, [first, second]), Cause("wall_by_map", 1, "a wall", 0.1))


def test_a_box_that_no_guard_found_is_unexplained() -> None:
    empty, other = (
        guard_view(truths=[HERE], centers_at_scan=()),
        guard_view(returns(0, SEEN), truths=[HERE], guard=1),
    )
    box = Box(-1.5, -1.5, -1.2, -1.2)
    assert_is(false_box_cause(box, 0, [HERE], [empty, other]), Cause(UNEXPLAINED, 0))
    assert_is(false_box_cause(box, 0, [], [empty]), Cause(UNEXPLAINED, 0))


@pytest.mark.parametrize(
    ("source", "is_newest", "expected"),
    [
        (ally(1), True, Cause("ally_left", 0, "guard 2", 0.1)),
        (ally(1), False, Cause("ally_trail", 0, "guard 2", 0.1)),
        (0, False, Cause("intruder_trail", 0, "intruder 1", 0.1, 2.0)),
        # which error put it there its returns alone do not say
        (0, True, Cause(UNEXPLAINED, 0, "intruder 1", 0.1)),
        (WALL, True, Cause(UNEXPLAINED, 0, "a wall", 0.1)),
    ],
)
def test_of_another_detectors_boxes_allies_and_trails_are_told(
    source: int, is_newest: bool, expected: Cause
) -> None:
    view = guard_view(returns(source, (1.0, 0.0), is_newest=is_newest), truths=[FAR], detects=False)
    assert_is(false_box_cause(Box.square(1.0, 0.0, 0.2), 0, [FAR], [view]), expected)
    # a box where it met nothing
    assert_is(false_box_cause(Box.square(0.0, 1.0, 0.2), 0, [FAR], [view]), Cause(UNEXPLAINED, 0))


def test_a_box_of_another_detector_on_an_intruder_is_a_fragment() -> None:
    view = guard_view(returns(0, SEEN), truths=[HERE], detects=False)
    assert_is(
        false_box_cause(Box.square(1.0, 0.0, 0.2), 0, [HERE], [view]), Cause("fragment", 0, "intruder 1")
    )


def test_a_box_on_two_intruders_is_a_fragment_of_the_first() -> None:
    both = [HERE, intruder(1.2, 0.0, name="intruder 2")]
    view = guard_view(returns(0, SEEN, (1.175, 0.025)), truths=both)
    assert_is(false_box_cause(Box(0.9, -0.1, 1.3, 0.1), 0, both, [view]), Cause("fragment", 0, "intruder 1"))
