"""``size``: the smallest team for a building, by real trials of some seconds and by trials written down."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from midnet_bench.analysis.frames import Results, load_results
from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.free_space import doors
from midnet_bench.drawing.charts import drawn_data
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import layout_of
from midnet_bench.workflows import size
from tests.cli.command import midnet_bench, one_line_of_complaint, worked
from tests.stores import labyrinth_store

QUICK = ("--within", 1, "--trials", 3, "--robots", "1,2", "-q")
FOUND = {1: 10, 2: 34, 3: 40}  # of 40 intruders by so many guards


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


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """Three team sizes with 40 trials each, as ``FOUND`` says."""
    folder = tmp_path_factory.mktemp("size")
    grid = {"intruders": [1], "robots": [*FOUND]}
    labyrinth_store(
        folder / "campaign.sqlite",
        lambda intruders, robots, seed: int(seed <= FOUND[robots]),
        seeds=40,
        grid=grid,  # type: ignore[arg-type]
    ).close()
    return load_results(folder)


@pytest.mark.parametrize(
    ("probability", "enough", "first", "second"),
    [
        (
            0.85,
            ["no", "open", "yes"],
            "3 guards find an intruder within 60 s with probability 1.00 [0.91, 1.00]; 2 do with 0.85 "
            "[0.70, 0.93]; whether 2 are enough stays open.",
            "--trials 160 makes the intervals half as long.",
        ),
        (
            0.95,
            ["no", "no", "open"],
            "No team is shown to be enough: 3 guards find an intruder within 60 s with "
            "probability 1.00 [0.91, 1.00]; whether 3 are enough stays open.",
            "--trials 160 makes the intervals half as long. --robots 1,2,3,6 adds a larger team.",
        ),
        (
            0.1,
            ["yes", "yes", "yes"],
            "1 guard finds an intruder within 60 s with probability 0.25 [0.14, 0.41].",
            "A team is enough where its whole interval is at or above 0.1",
        ),
    ],
)
def test_the_answer_is_the_smallest_team_whose_interval_is_above(
    results: Results, probability: float, enough: list[str], first: str, second: str
) -> None:
    answer = size.answer(size.Question("map2", probability=probability), results)
    assert [row["enough"] for row in answer.table.rows] == enough
    assert [row["successes"] for row in answer.table.rows] == [*FOUND.values()]
    assert answer.sentences[0] == first
    assert answer.sentences[1].startswith(second)


def test_without_an_open_team_no_further_trials_are_advised(results: Results) -> None:
    for robots, of_table in results.tables["intruders"].groupby("robots"):
        assert of_table["caught_at_s"].notna().sum() == FOUND[int(str(robots))]
    answer = size.answer(size.Question("map2", probability=0.995), results)
    only = size.Answer(answer.question, answer.teams[:2], answer.entrances)
    assert only.sentences[0].startswith("No team is enough: 2 guards find")
    assert only.sentences[1] == "--robots 1,2,5 adds a larger team."


def test_the_figure_marks_open_teams_and_ends_in_their_intervals(results: Results) -> None:
    answer = size.answer(size.Question("map2", probability=0.85), results)
    figure = size.figures(answer, load_arena("map2"))["probability_over_time"]
    rows = drawn_data("figure", figure).rows
    assert [row["series"] for row in rows] == ["1 guard: not enough", "2 guards: open", "3 guards: enough"]
    for row, team in zip(rows, answer.teams, strict=True):
        found = [row["value"], row["low"], row["high"]]
        assert found == pytest.approx([*team.probability[:3]])


@pytest.mark.slow
@pytest.mark.usefixtures("trials_in_this_process")
def test_the_command_runs_a_campaign_that_goes_on_where_it_stopped(tmp_path: Path) -> None:
    arena = room(tmp_path)
    asked = ("size", arena, *QUICK, "--probability", 0.2, "-o", "answer", "--json")
    done = worked(*asked, folder=tmp_path)
    found = json.loads(done.stdout)["tables"]
    assert [(row["robots"], row["trials"]) for row in found["size"]] == [(1, 3), (2, 3)]
    for row in found["size"]:
        assert row["successes"] == round(row["probability"]["value"] * row["trials"])
    assert sum(row["trials"] for row in found["entrances"]) == 3
    for name in ("probability_over_time.png", "entrances.png", "size.csv"):
        assert (tmp_path / "answer" / name).stat().st_size > 100

    # the same question again runs nothing and gives the same bytes
    before = {path: path.read_bytes() for path in (tmp_path / "answer").glob("*.*")}
    assert worked(*asked, folder=tmp_path).stdout == done.stdout
    assert before == {path: path.read_bytes() for path in before}

    # more trials and a larger team are added to those that are there
    more = ("size", arena, *QUICK, "--trials", 4, "--robots", "1,2,3", "-o", "answer")
    ahead = worked(*more, "--dry-run", folder=tmp_path)
    assert "3 cells, 12 trials, 6 of them to run" in ahead.stdout


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--within", 0), "--within"),
        (("--probability", 1), "--probability"),
        (("--trials", 0), "--trials"),
        (("--robots", "0,1"), "--robots 0"),
        (("--robots", "two"), "--robots two"),
        (("--set", "robots=3"), "--set robots"),
        (("--set", "at_escape=leaves"), "--set at_escape"),
        (("--set", "capture=contact"), "--capture too"),
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
    assert "5 cells, 500 trials, 500 of them to run" in done.stdout
    assert not (tmp_path / "results").exists()


def test_intruders_start_at_doors_or_at_places(tmp_path: Path) -> None:
    arena = str(tmp_path / room(tmp_path))
    (door,) = doors(load_arena(arena))
    assert door == pytest.approx((-2.45, 0.06), abs=0.12)
    for start_at, expected in (("doors", {door}), ("(0,0.5) (1,1)", {(0.0, 0.5), (1.0, 1.0)})):
        parameters = LabyrinthParameters.of(arena=arena, start_at=start_at, escape_distance_m=1.0)
        starts = [layout_of(parameters, seed).intruders for seed in range(12)]
        assert {(pose.x, pose.y) for (pose,) in starts} == expected
