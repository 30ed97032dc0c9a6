"""``size``: the smallest team for a building, by real trials of some seconds."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from midnet_bench.analysis import sample_size
from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.free_space import doors
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import layout_of
from midnet_bench.workflows import size
from tests.cli.command import midnet_bench, one_line_of_complaint, worked

QUICK = ("--within", 1, "--trials", 10, "--set", "engine=fast", "-q")


@pytest.fixture(autouse=True)
def _small_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    """A look after every five trials instead of forty."""
    monkeypatch.setattr(sample_size, "BATCH", 5)
    monkeypatch.setattr(size, "BATCH", 5)


def room(folder: Path, *, closed: bool = False) -> str:
    """A plan of 5 x 4 m with a door in the west, drawn and made an arena; closed: with a room without one."""
    plan = np.full((200, 250), 255, np.uint8)
    cv2.rectangle(plan, (4, 4), (245, 195), 0, 8)
    plan[80:110, 0:10] = 255
    if closed:
        cv2.rectangle(plan, (150, 110), (235, 190), 0, 8)
    cv2.imwrite(str(folder / "plan.png"), plan)
    worked("arena", "from-image", "plan.png", "--resolution", 0.02, "-o", "room.yaml", folder=folder)
    return "room.yaml"


@pytest.mark.slow
@pytest.mark.usefixtures("trials_in_this_process")
def test_the_answer_is_the_smallest_team_that_reaches_the_probability(tmp_path: Path) -> None:
    arena = room(tmp_path)
    asked = ("size", arena, *QUICK, "--probability", 0.2, "-o", "answer", "--json")
    done = worked(*asked, folder=tmp_path)
    found = json.loads(done.stdout)["tables"]
    teams = {row["robots"]: row for row in found["size"]}
    enough = [robots for robots, row in teams.items() if row["enough"] == "yes"]
    for row in teams.values():
        assert row["successes"] == round(row["probability"]["value"] * row["trials"])
        assert row["probability"]["low"] <= row["probability"]["value"] <= row["probability"]["high"]
    if enough and min(enough) > 1:
        assert teams[min(enough) - 1]["enough"] != "yes"
    assert sum(row["trials"] for row in found["entrances"]) == teams[min(enough or teams)]["trials"]
    for name in ("probability_over_time.png", "entrances.png", "size.csv"):
        assert (tmp_path / "answer" / name).stat().st_size > 100

    # the same question again runs nothing and gives the same bytes
    before = {path: path.read_bytes() for path in (tmp_path / "answer").glob("*.*")}
    stores = {path: path.read_bytes() for path in (tmp_path / "answer").glob("*/campaign.sqlite")}
    assert worked(*asked, folder=tmp_path).stdout == done.stdout
    assert before == {path: path.read_bytes() for path in (tmp_path / "answer").glob("*.*")}
    assert stores == {path: path.read_bytes() for path in stores}


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--within", 0), "--within"),
        (("--probability", 1), "--probability"),
        (("--trials", 53), "--trials"),
        (("--set", "robots=3"), "--set robots"),
        (("--set", "foo=1"), "foo"),
        (("--intruders", "99,0"), "--intruders"),
        (("--intruders", "here"), "--intruders"),
    ],
)
def test_wrong_questions_get_one_line(arguments: tuple[object, ...], named: str, tmp_path: Path) -> None:
    assert named in one_line_of_complaint(midnet_bench("size", "map1", "-q", *arguments, folder=tmp_path))


def test_a_building_with_a_closed_room_is_refused_before_any_trial(tmp_path: Path) -> None:
    asked = ("size", room(tmp_path, closed=True), *QUICK)
    complaint = one_line_of_complaint(midnet_bench(*asked, folder=tmp_path))
    assert "cannot be guarded" in complaint
    assert not (tmp_path / "results").exists()


@pytest.mark.slow
def test_a_dry_run_says_the_cost_and_runs_nothing(tmp_path: Path) -> None:
    done = worked("size", "office", "--dry-run", folder=tmp_path)
    assert "if the answer is clear" in done.stderr
    assert not (tmp_path / "results").exists()


def test_intruders_start_at_doors_or_at_places(tmp_path: Path) -> None:
    arena = str(tmp_path / room(tmp_path))
    (door,) = doors(load_arena(arena))
    assert door == pytest.approx((-2.45, 0.06), abs=0.12)
    for start_at, expected in (("doors", {door}), ("(0,0.5) (1,1)", {(0.0, 0.5), (1.0, 1.0)})):
        parameters = LabyrinthParameters.of(arena=arena, start_at=start_at, escape_distance_m=1.0)
        starts = [layout_of(parameters, seed).intruders for seed in range(12)]
        assert {(pose.x, pose.y) for (pose,) in starts} == expected
