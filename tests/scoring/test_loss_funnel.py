"""Every stage of the loss funnel in a scene by hand, and which guard and which error decide."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import pytest

from midnet_bench.geometry import Box
from midnet_bench.scoring.diagnosis import NOTHING, WALL, Cause, GuardView, Marks, ally, miss_cause
from midnet_bench.scoring.error_causes import MISS_CAUSES, UNEXPLAINED
from midnet_bench.scoring.frame_counts import TruthObject
from tests.scoring.guard_views import assert_is, guard_view, intruder, returns

HERE = intruder(1.0, 0.0)
BEHIND = intruder(0.5, 0.0, name="stationary 1")
SEEN = (0.975, 0.025)
"""a place on ``HERE`` that a beam met; its cells make a box from (0.85, -0.1) to (1.1, 0.15)"""


class Scene(NamedTuple):
    """A miss of the first of the truths, and what has to be said of it."""

    expected: Cause
    views: Sequence[GuardView]
    truths: Sequence[TruthObject] = (HERE,)
    detections: Sequence[Box] = ()


def one(expected: Cause, *scans: Marks, **view: Any) -> Scene:
    """A scene of one guard, which has the intruder in range."""
    return Scene(expected, [guard_view(*scans, truths=[HERE], **view)])


MET = returns(0, SEEN)
ANY = Cause(UNEXPLAINED)  # where a test says itself what is expected
COVERING, LEAVING_A_RIM = Box(0.8, -0.2, 1.2, 0.2), Box(0.9, -0.2, 1.2, 0.2)
SCENES = {
    "occluded": Scene(
        Cause("occluded", 0, "stationary 1"),
        [guard_view(truths=[HERE, BEHIND], beams={-1.0: (0.45, 1), 0.0: (0.45, 1), 45.0: (2.0, WALL)})],
        [HERE, BEHIND],
    ),
    "occluded_outside_window": Scene(
        Cause("occluded_outside_window", 0, "stationary 1"),
        [guard_view(truths=[HERE, BEHIND], beams={0.0: (0.45, 1)}, window=Box.square(0.0, 0.0, 1.8))],
        [HERE, BEHIND],
    ),
    "occluded_by_wall": one(Cause("occluded_by_wall", 0, "a wall"), beams={0.0: (0.5, WALL)}),
    "occluded_by_guard": one(Cause("occluded_by_guard", 0, "guard 2"), beams={0.0: (0.5, ally(1))}),
    "between_beams": one(Cause("between_beams", 0), beams={-5.0: (0.5, WALL), 5.0: (0.5, WALL)}),
    "beyond_range": one(Cause("beyond_range", 0), MET, in_reach=False),
    "delay": one(Cause("delay", 0), beams={0.0: (0.95, 0)}),
    "outside_window": one(Cause("outside_window", 0, age_s=0.1), MET, window=Box.square(0.0, 0.0, 1.8)),
    "below_threshold": one(
        Cause("below_threshold", 0, age_s=0.1), MET, cleared=Box.square(1.0, 0.0, 0.2), beams={}
    ),
    "outside_prior": Scene(
        Cause("outside_prior", 0, age_s=0.1),
        [guard_view(returns(0, (2.225, 0.025)), truths=[intruder(2.25, 0.0)])],
        [intruder(2.25, 0.0)],
    ),
    "under_prior": one(Cause("under_prior", 0, age_s=0.1), MET, walls=[COVERING]),
    "too_small": one(Cause("too_small", 0, age_s=0.1), MET, min_area_cells=100),
    "deflated": one(
        Cause("deflated", 0, age_s=0.1, offset_m=0.1),
        returns(0, SEEN, pose=(0.0, 0.05)),
        deflated_m=0.1,
    ),
    "pose_error": one(
        Cause("pose_error", 0, age_s=0.1, offset_m=0.3), returns(0, SEEN, pose=(0.0, 0.3)), beams={}
    ),
    "crop_shift": one(Cause("crop_shift", 0, age_s=0.1, offset_m=0.2), MET, shift_cells=(0, 4)),
    "range_noise": one(Cause("range_noise", 0, age_s=0.1, offset_m=0.3), returns(0, SEEN, noise=(-0.3, 0.0))),
    "not_detected": one(Cause("not_detected", 0, age_s=0.1), MET, detects=False),
    "taken_for_ally": one(Cause("taken_for_ally", 0, "guard 3", 0.1), MET, taken={0: 2}),
    "dropped_by_fusion": one(Cause("dropped_by_fusion", 0, age_s=0.1), MET),
    "merged": Scene(
        Cause("merged"),
        [guard_view(MET, truths=[HERE])],
        [HERE, intruder(1.2, 0.0, name="intruder 2")],
        [Box(0.85, -0.1, 1.3, 0.15)],
    ),
    UNEXPLAINED: Scene(Cause(UNEXPLAINED), []),
}


def explained(scene: Scene) -> Cause:
    return miss_cause(0, scene.truths, scene.detections, scene.views)


@pytest.mark.parametrize("name", MISS_CAUSES)
def test_each_cause_in_a_scene_that_has_it_alone(name: str) -> None:
    scene = SCENES[name]
    assert scene.expected.name == name
    assert_is(explained(scene), scene.expected)


def test_a_miss_is_as_old_as_the_newest_of_its_returns() -> None:
    old = returns(0, (1.0, 0.0), age_s=0.7)
    assert_is(explained(one(ANY, returns(0, SEEN), old)), Cause("dropped_by_fusion", 0, age_s=0.1))


def test_what_most_beams_meet_before_it_hides_it() -> None:
    beams = {-1.0: (0.5, WALL), 0.0: (0.5, ally(1)), 1.0: (0.5, ally(1))}
    assert explained(one(ANY, beams=beams)).by == "guard 2"


def test_beams_that_go_on_behind_it_pass_between_its_legs() -> None:
    assert explained(one(ANY, beams={0.0: (3.0, WALL)})).name == "between_beams"
    assert explained(one(ANY, beams={0.0: (math.inf, NOTHING)})).name == "between_beams"


def test_what_stands_behind_the_sensor_hides_nothing() -> None:
    assert explained(one(ANY, beams={180.0: (0.5, WALL)})).name == "between_beams"


def test_an_intruder_about_the_sensor_is_not_hidden_by_what_is_beyond_it() -> None:
    around = intruder(0.0, 0.0, side_m=0.4)
    view = guard_view(truths=[around], beams={0.0: (1.0, WALL), 90.0: (1.0, WALL)})
    assert miss_cause(0, [around], [], [view]).name == "between_beams"


def test_what_is_in_sight_now_outside_the_window_is_not_late() -> None:
    scene = one(ANY, beams={0.0: (0.95, 0)}, window=Box.square(0.0, 0.0, 1.8))
    assert_is(explained(scene), Cause("outside_window", 0))


def test_an_intruder_that_has_moved_on_since_the_scan_is_late() -> None:
    now = intruder(1.0, 0.3)
    view = guard_view(MET, truths=[now], centers_at_scan=[(1.0, 0.0)])
    assert_is(miss_cause(0, [now], [], [view]), Cause("delay", 0, age_s=0.1, offset_m=0.3))


def test_a_rim_that_the_prior_map_leaves_beside_it_is_under_the_prior_map() -> None:
    scene = one(ANY, MET, walls=[LEAVING_A_RIM])
    (box,) = scene.views[0].found
    assert tuple(box) == pytest.approx((0.85, 0.0, 0.9, 0.05))
    assert_is(explained(scene), Cause("under_prior", 0, age_s=0.1))


def test_a_guard_without_a_scan_has_seen_nobody() -> None:
    no_scan = guard_view(truths=[HERE], beams={0.0: (0.95, 0)}, centers_at_scan=())
    assert_is(miss_cause(0, [HERE], [], [no_scan]), Cause("delay", 0))


@pytest.mark.parametrize(
    ("pose_m", "crop_cells", "expected"),
    [
        (0.13, 2, Cause("pose_error", 0, age_s=0.1, offset_m=0.13)),
        (0.10, 3, Cause("crop_shift", 0, age_s=0.1, offset_m=0.15)),
        # without the pose error alone it had been found; without the larger shift it had not
        (0.18, 4, Cause("crop_shift", 0, age_s=0.1, offset_m=0.2)),
        (0.30, 2, Cause("pose_error", 0, age_s=0.1, offset_m=0.3)),
        # neither is enough alone
        (0.25, 6, Cause("crop_shift", 0, age_s=0.1, offset_m=0.3)),
    ],
)
def test_the_largest_error_without_which_it_had_been_found_counts(
    pose_m: float, crop_cells: int, expected: Cause
) -> None:
    scene = one(expected, returns(0, SEEN, pose=(0.0, pose_m)), shift_cells=(0, crop_cells))
    assert_is(explained(scene), expected)


def test_a_box_that_lies_beside_it_is_no_matter_of_shrinking() -> None:
    scene = one(ANY, returns(0, SEEN, pose=(0.0, 0.3)), deflated_m=0.1)
    assert explained(scene).name == "pose_error"


def test_a_box_that_was_shrunk_off_the_cells_of_its_returns_is_not_too_small() -> None:
    """The prior map leaves two rims of one contour, and what is left of its box lies between them."""
    scene = one(ANY, MET, walls=[Box(0.9, -0.1, 1.1, 0.1)], deflated_m=0.1)
    assert explained(scene).name == "deflated"


def test_the_guard_that_got_it_farthest_decides() -> None:
    truths = [HERE]
    hidden = guard_view(truths=truths, beams={0.0: (0.5, WALL)})
    outside = guard_view(MET, truths=truths, guard=1, window=Box.square(0.0, 0.0, 1.8))
    covered = guard_view(MET, truths=truths, guard=2, walls=[COVERING])
    beside = guard_view(returns(0, SEEN, pose=(0.0, 0.3)), truths=truths, guard=3)
    removed = guard_view(MET, truths=truths, guard=4, taken={0: 0})
    ranked = [hidden, outside, covered, beside, removed]
    for last in range(1, 6):
        for views in (ranked[:last], ranked[:last][::-1]):
            assert miss_cause(0, truths, [], views).guard == last - 1


def test_a_late_box_got_farther_than_returns_outside_a_window() -> None:
    now = intruder(1.0, 0.3)
    late = guard_view(MET, truths=[now], centers_at_scan=[(1.0, 0.0)])
    outside = guard_view(MET, truths=[now], guard=1, window=Box.square(0.0, 0.0, 1.8))
    assert miss_cause(0, [now], [], [outside, late]).name == "delay"
    # a guard that has not seen it yet is behind both
    unseen = guard_view(truths=[now], guard=2, beams={16.7: (1.0, 0)})
    assert miss_cause(0, [now], [], [outside, unseen]).name == "outside_window"


def test_of_guards_that_got_it_equally_far_the_first_counts() -> None:
    views = [guard_view(MET, truths=[HERE], guard=guard, walls=[COVERING]) for guard in (3, 1)]
    assert miss_cause(0, [HERE], [], views).guard == 3


def test_one_box_of_two_that_was_no_ally_was_dropped_by_the_fusion() -> None:
    wide = intruder(1.0, 0.0, side_m=0.6)
    view = guard_view(returns(0, (0.725, -0.225), (0.725, 0.225)), truths=[wide], taken={0: 1})
    assert len(view.found) == 2
    assert miss_cause(0, [wide], [], [view]).name == "dropped_by_fusion"


def test_a_return_inside_the_window_counts_and_one_outside_does_not() -> None:
    wide = intruder(1.0, 0.0, side_m=0.6)
    view = guard_view(
        returns(0, (0.725, 0.025), (1.275, 0.025)), truths=[wide], window=Box.square(0.0, 0.0, 1.8)
    )
    assert miss_cause(0, [wide], [], [view]).name == "dropped_by_fusion"
