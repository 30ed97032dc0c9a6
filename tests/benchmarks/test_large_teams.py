"""The test of large teams: its scenes, and what it counts."""

import numpy as np
import pytest

from benchmarks.large_teams import Scene, Team, draw_scene, scenes_of, seen_by_all
from midnet_bench.geometry import Box
from midnet_bench.midnet.midnet_settings import MIDNetSettings
from midnet_bench.rng import stream


def scene(robots: list[tuple[float, float]], *intruders: tuple[float, float, float, float]) -> Scene:
    places = np.array(robots)
    return Scene(places, places, np.array(intruders).reshape(-1, 4))


@pytest.mark.parametrize("robots", [1, 5, 40])
def test_a_scene_is_as_dense_as_map_1_with_five_guards(robots: int) -> None:
    drawn = draw_scene(robots, 0.0, stream(1, "scene"))
    assert len(drawn.robots) == robots
    assert len(drawn.intruders) == pytest.approx(robots * 8 / 5, abs=1.0)
    side_m = 6.0 * np.sqrt(robots / 5)
    assert drawn.robots.min() >= 0.0
    assert drawn.robots.max() <= side_m
    boxes = [Box(*row) for row in drawn.intruders.tolist()]
    apart = [one.intersection_area(other) for i, one in enumerate(boxes) for other in boxes[:i]]
    assert sum(apart) == 0.0
    assert not any(box.distance_to_point(x, y) <= 0.0 for box in boxes for x, y in drawn.robots.tolist())


def test_a_robot_boxes_the_sides_that_face_it() -> None:
    thing = (1.0, -0.5, 1.5, 0.5)
    ahead = seen_by_all(scene([(0.0, 0.0)], thing), 3.0)
    (box,) = ahead.boxes[0]
    # the near side at x = 1, grown by 0.105 m to cells of 0.05 m
    assert box == pytest.approx([0.85, -0.65, 1.15, 0.65])
    corner = seen_by_all(scene([(0.0, -1.0)], thing), 3.0)
    (box,) = corner.boxes[0]
    assert box == pytest.approx([0.85, -0.65, 1.65, 0.65])


def test_a_robot_sees_what_is_in_its_window_and_its_allies() -> None:
    found = seen_by_all(scene([(0.0, 0.0), (1.0, 0.0)], (-1.3, 0.0, -1.1, 0.2)), 3.0)
    assert [len(own) for own in found.boxes] == [2, 1]
    assert found.in_range.tolist() == [True]
    assert seen_by_all(scene([(1.0, 0.0)], (-1.3, 0.0, -1.1, 0.2)), 3.0).in_range.tolist() == [False]


def test_a_box_lies_where_the_robot_believes() -> None:
    off = scene([(0.0, 0.0)], (1.0, 0.0, 1.2, 0.2))._replace(believed=np.array([[0.5, 0.0]]))
    (box,) = seen_by_all(off, 3.0).boxes[0]
    assert box[0] == pytest.approx(1.35)


def test_scenes_are_the_same_again_and_have_what_is_there() -> None:
    row = scenes_of(Team(5), 3, frames=4)
    assert scenes_of(Team(5), 3, frames=4) == row
    assert row["orders"] == 20
    assert row["matched"] + row["missed"] == row["intruders_in_range"]  # type: ignore[operator]


def test_nothing_depends_on_the_order_where_neither_part_looks_at_it() -> None:
    blind = Team(30, "components", midnet=MIDNetSettings.from_flat({"ally_remove": "all"}))
    assert scenes_of(blind, 3, frames=4)["reordered"] == 0
    assert scenes_of(Team(30), 3, frames=4)["reordered"] > 0  # type: ignore[operator]
