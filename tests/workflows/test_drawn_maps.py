"""Drawn maps: each becomes an arena without a fault in which a trial runs, or a line says why not."""

from pathlib import Path

import pytest

from midnet_bench.arena.arena import load_arena
from tests.arena.drawn_maps import REFUSED, STYLES, drawn
from tests.cli.command import midnet_bench, one_line_of_complaint, worked

QUICK = {"turtlebot3_world", "tiny", "tiny_3_m", "disconnected", "no_floor", "raw", "metres"}
TRIAL = ("--engine", "fast", "--robots", 1, "--frames", 40, "--seeds", 1, "-o", "results")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else [pytest.mark.slow]) for name in STYLES]
)
def test_a_map_runs_or_a_line_says_why_not(name: str, tmp_path: Path) -> None:
    path = drawn(name).write(tmp_path)
    made = midnet_bench("arena", "from-map", path.name, "-o", "arena.yaml", folder=tmp_path)
    if name in REFUSED:
        assert REFUSED[name] in one_line_of_complaint(made)
        assert not (tmp_path / "arena.yaml").exists()
        return
    assert made.stdout.split() == ["arena.yaml", "arena.png"], made.stderr
    assert worked("arena", "check", "arena.yaml", folder=tmp_path).stdout.startswith("ok (")
    if name in QUICK - {"disconnected"}:
        return
    done = worked("detection", "--arena", "arena.yaml", *TRIAL, folder=tmp_path)
    assert "1 robot " in done.stdout


def test_what_is_taken_in_a_small_or_closed_place_is_told(tmp_path: Path) -> None:
    drawn("tiny_3_m").write(tmp_path, "small")
    made = worked("arena", "from-map", "small.yaml", "-o", "arena.yaml", folder=tmp_path)
    apart, intruder = made.stderr.splitlines()
    assert apart.startswith("note: guards start 0.45 m apart")
    assert intruder.startswith("note: one intruder, 0.5 m from the guards' starts")
    drawn("disconnected").write(tmp_path, "rooms")
    made = worked("arena", "from-map", "rooms.yaml", "--robots", 3, "-o", "arena.yaml", folder=tmp_path)
    (closed,) = made.stderr.splitlines()
    assert closed.startswith("note: no robot reaches 2 pieces of floor, ")
    room = next(word for word in closed.split() if word.startswith("--room="))
    moved = worked("arena", "from-map", "rooms.yaml", room, "-o", "there.yaml", folder=tmp_path)
    x = float(room.removeprefix("--room=").split(",")[0])
    assert room not in moved.stderr
    assert abs(load_arena(tmp_path / "there.yaml").robots.center_m[0] - x) < 2.0
    worked("arena", "check", "there.yaml", folder=tmp_path)
    text = (tmp_path / "arena.yaml").read_text()
    assert "  team: 3\n" in text
    assert text.count("], [") >= 1


@pytest.mark.slow
def test_walls_of_too_many_rectangles_are_taken_in_larger_cells(tmp_path: Path) -> None:
    drawn("scan_large").write(tmp_path)
    made = worked("arena", "from-map", "map.yaml", "-o", "arena.yaml", folder=tmp_path)
    assert "the walls take more than 5000 rectangles in cells of 0.05 m" in made.stderr
    assert "of 0.1 m, which are taken" in (tmp_path / "arena.yaml").read_text()
