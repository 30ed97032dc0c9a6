"""What commands import: start-up is mostly imports, and a short command should not wait for them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from midnet_bench.cli.campaigns import present
from midnet_bench.workflows import report
from tests.cli.command import REPOSITORY
from tests.stores import labyrinth_store


def loaded(program: str, *arguments: object) -> set[str]:
    """The modules that a program of its own has imported by its end."""
    code = f"import sys\n{program}\nprint('modules', *sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        cwd=REPOSITORY,
    )
    return set(done.stdout.splitlines()[-1].split()[1:])


@pytest.mark.parametrize("words", ["--help", "detection -h", "arena -h"])
def test_help_needs_little_more_than_typer(words: str) -> None:
    found = loaded(
        f"sys.argv = ['midnet-bench', *{words.split()}]\n"
        "from midnet_bench.cli import main\n"
        "try:\n    main()\nexcept SystemExit as leaving:\n    assert leaving.code == 0"
    )
    heavy = "rich tabulate cv2 numpy pydantic yaml pandas scipy matplotlib numba joblib sqlite3"
    assert "typer" in found
    assert not found & set(heavy.split())


@pytest.mark.slow
def test_the_tables_of_a_single_trial_need_no_statistics_and_no_plotting(tmp_path: Path) -> None:
    grid = {"intruders": [1], "robots": [1]}
    labyrinth_store(tmp_path / "campaign.sqlite", lambda k, q, seed: k, seeds=1, grid=grid).close()
    found = loaded(
        "from pathlib import Path\n"
        "from midnet_bench.cli.campaigns import present\n"
        "assert present(Path(sys.argv[1]), False, drawn_from=2)",
        tmp_path,
    )
    assert "pandas" in found
    assert not found & {"scipy", "matplotlib", "numba", "pybullet"}
    assert (tmp_path / "success_rate.csv").exists()
    assert not (tmp_path / "success_rate.png").exists()


def test_tables_are_on_the_screen_before_figures_are_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    grid = {"intruders": [1], "robots": [1, 2]}
    labyrinth_store(tmp_path / "campaign.sqlite", lambda k, q, seed: k, seeds=1, grid=grid).close()
    printed: list[str] = []

    def drawn(*_: object) -> list[object]:
        printed.append(capsys.readouterr().out)
        return []

    monkeypatch.setattr(report, "_drawn", drawn)
    assert present(tmp_path, as_json=False)
    assert "Success rate" in printed[0]
    assert (tmp_path / "success_rate.csv").exists()
    assert capsys.readouterr().out == ""


@pytest.mark.slow
def test_what_checks_a_campaign_needs_no_compiler_and_no_simulator() -> None:
    found = loaded(
        "from midnet_bench.experiments.registry import names, parameters_model\n"
        "assert all(parameters_model(name).defaults() for name in names())\n"
        "import midnet_bench.campaign.runner, midnet_bench.workflows.report\n"
        "import midnet_bench.experiments.detection.tables, midnet_bench.experiments.mapping.tables"
    )
    assert "midnet_bench.experiments.labyrinth.parameters" in found
    assert not found & {"numba", "scipy", "pybullet", "matplotlib"}
