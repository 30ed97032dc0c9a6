"""Tables on terminals of 60, 80 and 120 columns and in a pipe: nothing is cut, whatever the table."""

import contextlib
import json
import math
import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import pytest

from midnet_bench.analysis.frames import load_results
from midnet_bench.analysis.statistics import Estimate
from midnet_bench.analysis.tables import Table, rounded, signed
from midnet_bench.cli.messages import MOST_COLUMNS, drawn
from midnet_bench.experiments.detection.conclusions import headline
from midnet_bench.workflows.verify import REFERENCE
from tests.cli.command import REPOSITORY, midnet_bench, unpainted, worked
from tests.stores import detection_store, labyrinth_store

WIDTHS = (60, 80, 120)
ESTIMATE = Estimate(0.748, 0.737, 0.759, 20)
SCORES = {
    1: {1: (0.99, 0.7, 0.82), 2: (0.98, 0.72, 0.83), 3: (0.97, 0.75, 0.84)},
    5: {1: (0.95, 0.9, 0.92), 2: (0.96, 0.93, 0.94), 3: (0.94, 0.95, 0.945)},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Campaigns ``detection``, ``other`` and ``labyrinth`` that never ran."""
    place = tmp_path_factory.mktemp("stores")
    detection_store(place / "detection", SCORES)
    better = {robots: {seed: (1.0, 1.0, 1.0) for seed in rows} for robots, rows in SCORES.items()}
    detection_store(place / "other", better, parameters={"local_size_m": 6.0})
    (place / "labyrinth").mkdir()
    store, grid = place / "labyrinth" / "campaign.sqlite", {"intruders": [1, 5], "robots": [1, 2, 3, 4, 5]}
    labyrinth_store(store, lambda k, n, seed: min(k, n + seed % 2), seeds=12, grid=grid).close()  # type: ignore[arg-type]
    return place


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("columns", [2, 5, 7, 8, 13])
def test_a_table_of_intervals_is_never_cut(columns: int, width: int) -> None:
    row = {"trial": "5-robot, fusion=components(iou=0.02)"}
    row |= {f"score_{k}": ESTIMATE for k in range(columns)} | {"verdict": "no clear difference"}  # type: ignore[dict-item]
    lines = drawn(Table("some", "A title", [row, row]), width).splitlines()
    assert max(map(len, lines)) <= width
    text = " ".join(" ".join(lines).split())
    assert text.count("0.748") == text.count("[0.737, 0.759]") == 2 * columns
    for word in ("fusion=components(iou=0.02)", "difference", "score 0", f"score {columns - 1}"):
        assert word in text or all(part in text for part in word.split())


def test_a_table_is_laid_out_by_hand() -> None:
    rows = [
        {"trial": "1 robot, local_map decay", "score": Estimate(0.5, 0.25, 0.75, 20), "false boxes": 3},
        {"trial": "2 robots", "score": Estimate(math.nan, math.nan, math.nan, 0), "false boxes": 12},
    ]
    table = Table("some", "What it is", rows, notes=("A note.",), labels={"false boxes": "false positives"})  # type: ignore[arg-type]
    assert drawn(table, None).splitlines() == [
        "What it is",
        "trial                                    score  false positives",
        "1 robot, local_map decay  0.500 [0.250, 0.750]                3",
        "2 robots                                   n/a               12",
        "A note.",
    ]
    assert drawn(table, 60).splitlines()[1:4] == [
        "                                                    false",
        "trial                                    score  positives",
        "1 robot, local_map decay  0.500 [0.250, 0.750]          3",
    ]
    assert drawn(table, 50).splitlines()[3:6] == [
        "1 robot, local_map           0.500          3",
        "decay               [0.250, 0.750]",
        "2 robots                       n/a         12",
    ]
    assert drawn(table, 44).splitlines()[1:4] == [
        "1 robot, local_map decay",
        "  score            0.500 [0.250, 0.750]",
        "  false positives  3",
    ]


def test_blanks_behind_a_number_keep_it_below_another() -> None:
    table = Table(
        "some", "T", [{"source": "ours", "F1": "0.980 ±.025"}, {"source": "paper", "F1": "0.975      "}]
    )
    assert drawn(table, 80).splitlines()[2:] == ["ours    0.980 ±.025", "paper   0.975"]
    assert drawn(Table("some", "T", [{"": "", "F1": 0.5}]), 80).splitlines()[1:] == ["     F1", "  0.500"]


def test_columns_are_left_out_by_priority_and_the_table_says_so() -> None:
    row = {"trial": "1-robot"} | {f"c{k}": 0.123456 for k in range(9)}
    table = Table("some", "T", [row], beside=("c3", "c8", "c1"))  # type: ignore[list-item]
    lines = drawn(table, 200).splitlines()
    assert lines[1].split() == ["trial", "c0", "c2", "c3", "c4", "c5", "c6", "c7"][:1] + [
        name for name in row if name not in ("trial", "c1", "c8", "c3")
    ]
    assert len(lines[1].split()) == MOST_COLUMNS
    assert lines[-1] == "Left out: c1, c3, c8; --wide prints all columns."
    assert drawn(table, None).splitlines()[1].split() == list(row)


def test_zero_has_no_sign() -> None:
    assert (rounded(-0.0001, 3), rounded(-0.0, 1, "+"), rounded(-0.5, 0)) == ("0.000", "0.0", "0")
    assert (rounded(-10.0, 1), rounded(0.25, 2, "+")) == ("-10.0", "+0.25")
    assert signed(Estimate(-0.00001, -0.2, 0.3, 5)) == "0.000 [-0.200, +0.300]"


COMMANDS = (
    ("report", "detection"),
    ("report", "labyrinth"),
    ("verify", "detection", "--all"),
    ("verify", "labyrinth"),
    ("compare", "detection", "other"),
    ("compare", "labyrinth", "--by", "robots"),
    ("parameters", "detection"),
)


@pytest.mark.slow
@pytest.mark.parametrize("arguments", COMMANDS, ids=str)
def test_no_line_of_a_command_is_longer_than_the_terminal_or_cut(
    arguments: tuple[str, ...], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = {}
    # a report makes all its figures anew each time: the narrowest terminal, in which least fits, is enough
    for width in (60,) if arguments[0] == "report" else (*WIDTHS, None):
        monkeypatch.delenv("COLUMNS", raising=False)
        if width is not None:
            monkeypatch.setenv("COLUMNS", str(width))
        with unpainted():
            done = midnet_bench(*arguments, "-q", folder=folder)
        assert done.returncode in (0, 3, 4), done.stderr
        lines = done.stdout.splitlines()
        assert lines
        assert max(map(len, lines)) <= (width or 80)
        assert "…" not in done.stdout
        assert "-0.000 " not in done.stdout
        shown[width] = done.stdout
    assert shown.get(None) == shown.get(80), "in a pipe as at 80 columns"


@pytest.mark.slow
def test_a_real_terminal_s_width_is_taken(folder: Path) -> None:
    width = 120
    ours, theirs = pty.openpty()
    subprocess.run(["stty", "cols", str(width)], stdin=theirs, check=True)
    environment = {key: value for key, value in os.environ.items() if key != "COLUMNS"}
    environment["PYTHONPATH"] = str(REPOSITORY)
    command = [sys.executable, "-m", "midnet_bench", "verify", "detection", "-q"]
    done = subprocess.Popen(command, cwd=folder, env=environment, stdout=theirs, stderr=theirs)
    os.close(theirs)
    text = b""
    with contextlib.suppress(OSError):  # the other end has gone
        while part := os.read(ours, 4096):
            text += part
    os.close(ours)
    assert done.wait() in (3, 4)
    assert width - 20 < max(map(len, text.decode().splitlines())) <= width


@pytest.mark.slow
def test_verify_says_the_counts_first_and_lists_what_holds_when_asked(folder: Path) -> None:
    done, everything = (
        midnet_bench("verify", "detection", *more, folder=folder) for more in ((), ("--all",))
    )
    assert " ".join(done.stdout.split("\n\n")[0].split()).endswith("(3 seeds).")
    assert "\nholds\n" not in done.stdout
    assert "\nholds\n" in everything.stdout
    assert "recall rises from 1 robot to 5" not in done.stdout
    assert "recall rises from 1 robot to 5" in everything.stdout
    assert everything.returncode == done.returncode


@pytest.mark.slow
def test_of_one_seed_verify_says_a_sentence_and_what_the_reference_found(tmp_path: Path) -> None:
    detection_store(tmp_path / "one", {robots: {7: by_seed[1]} for robots, by_seed in SCORES.items()})
    done = midnet_bench("verify", "one", folder=tmp_path)
    told = " ".join(done.stdout.split())
    assert told.startswith(
        "One seed decides nothing of the paper's 17 claims; --seeds 20 may. The packaged reference, "
    )
    assert re.search(r"reference, seeds \d+ to \d+: of 17 claims \d+ are within the range of our runs", told)
    assert len(done.stdout.splitlines()) < 6
    assert done.returncode == 3
    rows = json.loads(midnet_bench("verify", "one", "--json", folder=tmp_path).stdout)["tables"]["claims"]
    assert {row["reason"].split(".")[0] for row in rows if "holds" not in row["reason"]} <= {
        "Fewer than 3 seeds give no interval",
        "Not defined in these trials: there is nothing to divide by",
    }


def test_compare_names_what_differs_and_wide_has_every_column(folder: Path) -> None:
    done = worked("compare", "detection", "other", folder=folder)
    assert "other against detection: 3 shared seeds; settings that differ: local_size_m" in done.stdout
    assert "p holm" in worked("compare", "detection", "other", "--wide", folder=folder).stdout


def test_the_same_trials_are_identical(folder: Path, tmp_path: Path) -> None:
    detection_store(tmp_path / "detection", SCORES)
    done = midnet_bench("compare", folder / "detection", "detection", folder=tmp_path)
    assert "are the same, byte for byte" in " ".join(done.stdout.split())
    assert done.stdout.count("identical") == 10
    assert "no clear difference" not in done.stdout


def test_an_interval_without_0_that_holm_holds_back_has_a_note(tmp_path: Path) -> None:
    rises = {1: {seed: (0.5, 0.5, 0.5) for seed in range(1, 6)}}
    detection_store(tmp_path / "a", rises)
    steps = (0.01, 0.05, 0.02, 0.06, 0.005)
    other = {1: {seed: (0.5 + step, 0.5 + step * (-1) ** seed, 0.5) for seed, step in enumerate(steps, 1)}}
    detection_store(tmp_path / "b", other)
    text = " ".join(midnet_bench("compare", "a", "b", folder=tmp_path).stdout.split())
    assert "1-robot precision: no clear difference, though the interval leaves out 0" in text


def test_one_seed_stands_beside_the_reference_and_the_paper(tmp_path: Path) -> None:
    one = {robots: {7: rows[1]} for robots, rows in SCORES.items()}
    ours = load_results(detection_store(tmp_path / "ours", one))
    reference = load_results(detection_store(tmp_path / "reference", SCORES))
    said = headline(ours, reference)
    (table,) = said.tables
    assert [row["source"] for row in table.rows] == ["this seed", "3 seeds", "paper"] * 2
    value, half = str(table.rows[1]["recall"]).split(" ±")
    assert float(value) == pytest.approx((0.7 + 0.72 + 0.75) / 3, abs=1e-3)
    assert 0.0 < float(f"0{half}") < 0.1
    assert said.conclusion[0].startswith(
        "One robot finds 70 % of the intruders within 2.5 m (paper: 79 %), five"
    )
    assert "--seeds 20" in said.following
    # other parameters, or as many seeds, need no reference
    other = load_results(detection_store(tmp_path / "other", one, parameters={"local_size_m": 6.0}))
    for results in (other, reference):
        (table,) = headline(results, reference).tables
        assert "3 seeds" not in [row["source"] for row in table.rows]


def test_the_packaged_reference_can_be_read() -> None:
    results = load_results(REPOSITORY / REFERENCE / "detection")
    (table, *_) = headline(results).tables
    assert {row["source"] for row in table.rows} == {f"these {results.definition.trials} seeds", "paper"}
    assert not any(math.isnan(float(str(row["recall"]).split()[0])) for row in table.rows)


@pytest.mark.slow
def test_a_table_for_a_paper_has_ours_the_paper_s_and_intervals(folder: Path) -> None:
    with unpainted():
        worked("report", "detection", "-q", folder=folder)
    text = (folder / "detection" / "detection_table.tex").read_text()
    assert r"\begin{tabular}" in text
    assert "F1 one-to-one" in text
    assert text.count("paper") == 2
    assert text.count("[") == 6, "F1 one-to-one is the same at every seed of this store"
