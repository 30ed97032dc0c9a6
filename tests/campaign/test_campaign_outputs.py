"""What a campaign says while it runs, what its CSV files look like, and what it notes about its origin."""

import csv
import io
import json
import math
import os
import pty
import select
import sys
from pathlib import Path

import numpy as np
import pytest

import midnet_bench
from midnet_bench.campaign import progress, provenance
from midnet_bench.campaign.export import csv_text
from midnet_bench.campaign.progress import Lines, progress_on
from midnet_bench.campaign.provenance import collect
from midnet_bench.campaign.worker import Outcome
from midnet_bench.errors import InputError
from midnet_bench.io.files import write_atomically

GOOD = Outcome("0" * 16, 1.0, 1.0, b"result")
BAD = Outcome("1" * 16, 1.0, failure="ValueError: no")


def test_floats_survive_the_csv_bit_by_bit() -> None:
    numbers = np.random.default_rng(1).normal(size=200) * 10.0 ** np.arange(-100, 100)
    text = csv_text([{"x": float(number)} for number in numbers])

    assert [float(row["x"]) for row in csv.DictReader(io.StringIO(text))] == numbers.tolist()


def test_undefined_numbers_are_empty_cells_and_columns_unite() -> None:
    rows = [{"a": 1, "b": math.nan}, {"a": None, "c": "x,y"}, {"b": True}]

    assert csv_text(rows) == 'a,b,c\n1,,\n,,"x,y"\n,True,\n'
    assert csv_text([]) == "\n"


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "new" / "table.csv"
    write_atomically(path, "one")
    write_atomically(path, b"two")
    assert path.read_bytes() == b"two"
    assert list(path.parent.iterdir()) == [path]

    with pytest.raises(InputError, match=r"table\.csv/deeper\.csv: cannot be written: .*; its folder must"):
        write_atomically(path / "deeper.csv", "three")
    assert path.read_bytes() == b"two"


def test_lines_are_few_and_end_with_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 0.0
    monkeypatch.setattr(progress.time, "monotonic", lambda: now_s)
    stream = io.StringIO()
    lines = Lines(stream)

    lines.begin(total=100, done=20)
    for k in range(80):
        now_s += 1.0
        lines.advance(BAD if k == 3 else GOOD)
    lines.end()

    said = stream.getvalue().splitlines()
    assert said[0] == "20 of 100 trials are already stored"
    assert said[1] == "30/100 trials, 1 failed, estimated 0:01:10 left"
    assert said[-1] == "100/100 trials, 1 failed, took 0:01:20"
    assert len(said) == 1 + 8


@pytest.mark.parametrize(("variable", "value"), [("NO_COLOR", "1"), ("TERM", "dumb")])
def test_a_terminal_that_wants_none_gets_no_bar(
    monkeypatch: pytest.MonkeyPatch, variable: str, value: str
) -> None:
    assert isinstance(progress_on(io.StringIO()), Lines)
    own, other = pty.openpty()
    with os.fdopen(own, "rb"), os.fdopen(other, "w") as terminal:
        monkeypatch.setenv("TERM", "xterm")
        monkeypatch.delenv("NO_COLOR", raising=False)
        assert not isinstance(progress_on(terminal), Lines)
        monkeypatch.setenv(variable, value)
        assert isinstance(progress_on(terminal), Lines)


def test_the_bar_counts_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    own, other = pty.openpty()
    with os.fdopen(own, "rb") as screen, os.fdopen(other, "w") as terminal:
        bar = progress_on(terminal)
        bar.begin(total=4, done=1)
        bar.advance(GOOD)
        bar.note("a [note]")
        bar.advance(BAD)
        bar.advance(GOOD)
        bar.end()
        terminal.flush()
        shown = shown_until(b"4/4", screen.fileno())

    assert "4/4" in shown
    assert "trials (1 failed)" in shown
    assert "a [note]" in shown


def test_the_origin_is_json_without_paths_of_this_machine(tmp_path: Path) -> None:
    inside = Path.cwd() / "results" / "mine"
    command = [sys.executable, "run", str(tmp_path / "x.yaml"), "-o", str(inside), f"--map={tmp_path}/m.yaml"]

    noted = collect(7, command)

    text = json.dumps(noted)
    assert noted["command"] == "midnet-bench run x.yaml -o results/mine --map=m.yaml"
    assert noted["seed"] == 7
    assert noted["midnet_bench"] == midnet_bench.__version__
    assert isinstance(noted["libraries"], dict)
    assert noted["libraries"]["numpy"] == np.__version__
    assert str(noted["started_utc"]).endswith("+00:00")
    for path in (str(Path.cwd()), str(Path.home()), str(tmp_path), sys.prefix):
        assert path not in text


def test_a_checkout_is_known_by_commit_and_an_installation_by_version_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "checkout" / "midnet_bench"
    package.mkdir(parents=True)
    (package / "code.py").write_text("one")
    monkeypatch.setattr(provenance.midnet_bench, "__file__", str(package / "__init__.py"))
    assert (collect(1)["commit"], collect(1)["uncommitted_changes"]) == (None, None)

    git(package.parent, "init", "--quiet")
    git(package.parent, "add", ".")
    git(package.parent, "-c", "user.name=x", "-c", "user.email=x@y", "commit", "--quiet", "-m", "one")
    clean = collect(1)
    (package / "code.py").write_text("two")
    dirty = collect(1)

    assert len(str(clean["commit"])) == 40
    assert clean["uncommitted_changes"] is False
    assert dirty["commit"] == clean["commit"]
    assert dirty["uncommitted_changes"] is True


def git(folder: Path, *arguments: str) -> None:
    provenance.subprocess.run(["git", "-C", str(folder), *arguments], check=True, capture_output=True)


def shown_until(last: bytes, screen: int) -> str:
    """What a terminal shows up to ``last``: it arrives in pieces, and on a busy machine not at once."""
    shown = b""
    while last not in shown and select.select([screen], [], [], 10.0)[0]:
        shown += os.read(screen, 4096)
    return shown.decode()
