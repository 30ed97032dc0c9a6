"""``errors`` and ``explain`` on a small recorded campaign, by the real command."""

import json
from pathlib import Path

import pytest

from midnet_bench.analysis.frames import load_results
from midnet_bench.errors import InputError
from midnet_bench.experiments.guarded.record import RecordedFrame
from midnet_bench.experiments.registry import tables_of
from midnet_bench.workflows.errors import errors, explain, versus
from tests.cli.command import midnet_bench, one_line_of_complaint, worked
from tests.conftest import campaign_folder
from tests.stores import detection_store


@pytest.fixture
def folder(_recorded_campaign: Path) -> Path:
    """Not to be changed: two seeds with one and with three guards, 10 frames each."""
    return _recorded_campaign


def test_each_error_of_a_campaign_has_one_row_and_a_known_cause(folder: Path) -> None:
    results = load_results(folder, tables_of)
    found, frames = results.tables["errors"], results.tables["frames"]
    counts = found["kind"].value_counts()
    assert counts["miss"] == frames["missed"].sum()
    assert counts.get("false", 0) == frames["fp"].sum()
    assert counts.get("fragment", 0) == frames["duplicates"].sum()
    paper = found[found["paper"]]["kind"].value_counts()
    assert paper["miss"] == frames["fn"].sum()
    causes = errors(folder)[0]
    assert sum(int(str(row["errors"])) for row in causes.rows) == len(found)
    assert (found["cause"] == "unexplained").mean() <= 0.02


def test_causes_of_one_team_and_seed_are_those_of_its_rows(folder: Path) -> None:
    found = load_results(folder, tables_of).tables["errors"]
    own = found[(found["robots"] == 3) & (found["seed"] == 2)]
    causes, worst = errors(folder, ["robots=3"], seed=2)
    assert sum(int(str(row["errors"])) for row in causes.rows) == len(own)
    assert worst.rows[0]["errors"] == own.groupby("frame").size().max()
    assert {row["seed"] for row in worst.rows} == {2}


def test_a_frame_is_explained_in_a_line_for_each_error(folder: Path) -> None:
    found = load_results(folder, tables_of).tables["errors"]
    row = found[found["robots"] == 3].iloc[0]
    table = explain(folder, int(row["seed"]), int(row["frame"]), ["robots=3"])
    same = found[(found["robots"] == 3) & (found["seed"] == row["seed"]) & (found["frame"] == row["frame"])]
    assert [line["cause"] for line in table.rows] == same["cause"].tolist()
    assert table.title.startswith(f"seed {row['seed']}, frame {row['frame']} (")
    assert all(str(line["cause"]) in str(line["line"]) for line in table.rows)


def test_a_campaign_has_all_its_errors_in_common_with_itself(folder: Path) -> None:
    found = load_results(folder, tables_of).tables["errors"]
    last = versus(folder, folder, ["robots=3"], ["robots=3"]).rows[-1]
    assert (last["both"], last["only_first"], last["only_second"]) == ((found["robots"] == 3).sum(), 0, 0)
    rows = versus(folder, folder, ["robots=1"], ["robots=3"]).rows
    one, three = ((found["robots"] == size).sum() for size in (1, 3))
    total = rows[-1]
    assert int(str(total["both"])) + int(str(total["only_first"])) == one
    assert int(str(total["both"])) + int(str(total["only_second"])) == three
    for name in ("both", "only_first", "only_second"):
        assert sum(int(str(row[name])) for row in rows[:-1]) == total[name]


def test_recorded_frames_read_back_to_the_same_row(folder: Path) -> None:
    rows = load_results(folder, tables_of).tables["recorded"].to_dict("records")
    for row in rows[:20]:
        again = RecordedFrame.from_row(row).to_row()
        assert again == {name: row[name] for name in again}
    with pytest.raises(ValueError, match="frame 1: is no recorded frame"):
        RecordedFrame.from_row({**rows[0], "frame": 1, "truths": "[[1]]"})


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("--where robts=5", "has no factor 'robts'; did you mean 'robots'?"),
        ("--where robots", "--where robots: FACTOR=VALUE is needed, such as robots=5"),
        ("--robots 5", "--where robots=5: the grid has no such value"),
        ("--where frames=9", "has frames=10 alone"),
        ("--seed 9", "--seed 9: was not recorded"),
        ("--frame 1", "--frame: "),
        ("--seed 1 --frame 3", "several trials have seed 1; name one by --where: robots=1 or"),
        ("--seed 1 --frame 11 --where robots=1", "the trial has frames 1 to 10"),
    ],
)
def test_wrong_questions_are_answered_in_one_line(folder: Path, arguments: str, said: str) -> None:
    done = midnet_bench("errors", folder, *arguments.split(), folder=folder)
    assert said in one_line_of_complaint(done)


def test_a_campaign_that_was_not_recorded_says_how_to(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="its trials were not recorded; run them with --record"):
        errors(detection_store(tmp_path, {1: {1: (0.9, 0.5, 0.6)}}))


@pytest.mark.slow
def test_a_labyrinth_has_a_player_and_no_causes(tmp_path: Path) -> None:
    parameters = {"intruders": 1, "engine": "fast", "time_limit_s": 1, "record": True}
    run = {"experiment": "labyrinth", "grid": {"robots": [1]}, "trials": 1, "parameters": parameters}
    with pytest.raises(InputError, match="only the detection test's errors are explained"):
        errors(campaign_folder(tmp_path / "lab", **run))


@pytest.mark.slow
def test_the_grids_of_a_frame_are_drawn_from_the_same_trial(folder: Path, tmp_path: Path) -> None:
    frame = ("--robots", 1, "--seed", 2, "--frame", 4)
    worked("errors", folder, *frame, "--grids", "drawn", folder=tmp_path)
    worked("render", *frame, "--engine", "fast", "--frames", 10, "--no-clip", "-o", "again", folder=tmp_path)
    names = ["arena.png", "detections.png", "grids.png"]
    assert sorted(path.name for path in (tmp_path / "drawn").iterdir()) == names
    for name in names:
        assert (tmp_path / "drawn" / name).read_bytes() == (tmp_path / "again" / name).read_bytes()


def test_causes_and_one_frame_print_json(folder: Path) -> None:
    for frame in ((), ("--robots", 3, "--where", "frames=10", "--seed", 1, "--frame", 1)):
        assert json.loads(worked("errors", folder, *frame, "--json", folder=folder).stdout)["tables"]


@pytest.mark.usefixtures("trials_in_this_process")
def test_a_campaign_without_errors_can_be_the_other_one(folder: Path, tmp_path: Path) -> None:
    run = ("detection", "--robots", 1, "--frames", 4, "--seeds", 1, "--engine", "fast", "--preset", "best")
    worked(*run, "--record", "--jobs", 1, "-o", "clean", folder=tmp_path)
    clean = tmp_path / "clean"
    assert "errors" not in load_results(clean, tables_of).tables
    last = versus(folder, clean, ["robots=1"], ["robots=1"]).rows[-1]
    assert (last["both"], last["only_second"]) == (0, 0)
