"""Pictures of arenas."""

from pathlib import Path
from unittest import mock

from midnet_bench.arena.arena import load_arena
from midnet_bench.workflows import arenas


def test_a_picture_shows_the_largest_team_that_starts_in_the_arena(tmp_path: Path) -> None:
    arena = load_arena("map1")
    for team in (2, 6):
        robots = arena.robots.model_copy(update={"team": team})
        with mock.patch.object(arenas, "draw_arena", wraps=arenas.draw_arena) as draw:
            arenas.write_picture(arena.model_copy(update={"robots": robots}), [], tmp_path / "map1.png")
        setup, scene, _ = draw.call_args.args
        assert setup.guards == team
        assert sum(robot.is_guard for robot in scene.robots) == team
        assert len(scene.robots) == team + setup.mobile_intruders > team
