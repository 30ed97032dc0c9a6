"""What a campaign says while it runs, what its CSV files look like, and what it notes about its origin."""

import csv
import io
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import midnet_bench
from midnet_bench.analysis.tables import csv_text
from midnet_bench.campaign import provenance
from midnet_bench.campaign.provenance import collect, versions_note


def test_floats_survive_the_csv_bit_by_bit() -> None:
    numbers = np.random.default_rng(1).normal(size=200) * 10.0 ** np.arange(-100, 100)
    text = csv_text([{"x": float(number)} for number in numbers])

    assert [float(row["x"]) for row in csv.DictReader(io.StringIO(text))] == numbers.tolist()


def test_undefined_numbers_are_empty_cells_and_columns_unite() -> None:
    rows = [{"a": 1, "b": math.nan}, {"a": None, "c": "x,y"}, {"b": True}]

    assert csv_text(rows) == 'a,b,c\n1,,\n,,"x,y"\n,True,\n'
    assert csv_text([]) == "\n"


def test_the_origin_is_json_without_paths_of_this_machine(tmp_path: Path) -> None:
    inside = Path.cwd() / "results" / "mine"
    command = [sys.executable, "run", str(tmp_path / "x.yaml"), "-o", str(inside), f"--map={tmp_path}/m.yaml"]

    noted = collect(7, command)

    text = json.dumps(noted)
    assert noted["command"] == "midnet-bench run x.yaml -o results/mine --map=m.yaml"
    assert noted["seed"] == 7
    assert noted["midnet_bench"] == midnet_bench.__version__
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


def test_another_python_or_numpy_is_said_in_a_line() -> None:
    here = collect(1)
    assert versions_note([here, here]) == []
    other = {**here, "python": "CPython 3.99.1"}
    (note,) = versions_note([here, other])
    assert "CPython 3.99 with NumPy" in note
    (note,) = versions_note([here, {**here, "libraries": {"numpy": "9.1.0"}}, other])
    assert "3 interpreters" in note


def git(folder: Path, *arguments: str) -> None:
    provenance.subprocess.run(["git", "-C", str(folder), *arguments], check=True, capture_output=True)
