"""Results name code: that of another's folder runs when the user asks for it, and the user's own at once."""

import shutil
import stat
from pathlib import Path

import pytest

from midnet_bench.campaign import provenance
from midnet_bench.campaign.definition import Definition
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from midnet_bench.workflows.replay import _boxes_file
from tests.cli.command import midnet_bench
from tests.stores import detection_store
from tests.workflows.test_own_experiment import CAMPAIGN, DRIFT

EVIL = "open({trap!r}, 'w').close()\n"
COMMANDS = (
    ("report",),
    ("report", "--format", "svg"),
    ("verify",),
    ("compare", "--by", "robots"),
    ("errors",),
)


@pytest.fixture
def trap(tmp_path: Path) -> Path:
    return tmp_path / "the code ran"


@pytest.fixture
def evil(tmp_path: Path, trap: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The name of a module that can be imported, and of a file in the working folder."""
    (tmp_path / "evil_of_a_stranger.py").write_text(EVIL.format(trap=str(trap)))
    monkeypatch.syspath_prepend(str(tmp_path))
    return "evil_of_a_stranger"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "place"),
    [
        *((key, place) for key in ("experiment", "detector") for place in ("{}.py:X", "{}:X")),
        *((key, "{}.py:X") for key in ("metrics", "engine", "robot", "anything")),
    ],
)
def test_no_command_runs_what_results_from_elsewhere_name(
    key: str, place: str, evil: str, trap: Path, tmp_path: Path
) -> None:
    reference = place.format(evil)
    parameters = {} if key == "experiment" else {key: f"ospa; {reference}" if key == "metrics" else reference}
    folder = detection_store(tmp_path / "foreign", {1: {1: (1.0, 1.0, 1.0)}, 5: {1: (1.0, 1.0, 1.0)}}, None)
    rewrite(folder, reference if key == "experiment" else "detection", parameters)
    commands = [*COMMANDS, ("export", "--robots", "1")]
    for command in commands if key in ("experiment", "detector") else commands[:1]:
        done = midnet_bench(command[0], folder, *command[1:], folder=tmp_path)
        assert (done.returncode, done.stdout, "--trust" in done.stderr) == (2, "", True), done
        assert len(done.stderr.splitlines()) == 1
        assert not trap.exists()
    if key == "experiment":
        midnet_bench("report", folder, "--trust", folder=tmp_path)
        assert trap.exists()


@pytest.mark.slow
@pytest.mark.parametrize("place", ["{}.py:", "{}.py :", " {}.py:"])
def test_no_way_to_write_a_reference_goes_past_the_question(
    place: str, evil: str, trap: Path, tmp_path: Path
) -> None:
    folder = detection_store(tmp_path / "foreign", {1: {1: (1.0, 1.0, 1.0)}}, None)
    for form in ("X ()", "X (a=1)", " X", "1", "", "X.Y", "\u2118", " X (a=1)#00"):
        rewrite(folder, "detection", {"detector": place.format(evil) + form})
        done = midnet_bench("verify", folder, folder=tmp_path)
        is_file = place.format("").strip().startswith(".py:")
        assert (done.returncode, "--trust" in done.stderr) == (2, True) or not is_file, done
        assert not trap.exists()


def test_a_name_that_is_none_runs_no_file(evil: str, trap: Path, tmp_path: Path) -> None:
    for name in ("1", "", "X.Y", " ", "X Y"):
        done = midnet_bench("detection", "--detector", f"{evil}.py:{name}", "--frames", 1, folder=tmp_path)
        assert (done.returncode, trap.exists()) == (2, False), done


def rewrite(folder: Path, experiment: str, parameters: dict[str, str]) -> None:
    """Another's experiment and parameters in the store of ``folder``."""
    import sqlite3

    connection = sqlite3.connect(folder / "campaign.sqlite")
    definition = Definition(experiment, 1, 1, {"robots": [1, 5]}, dict(parameters))
    connection.execute("UPDATE campaign SET definition = ?", (definition.to_json(),))
    connection.commit()
    connection.close()


@pytest.mark.usefixtures("trials_in_this_process")
def test_ones_own_run_is_trusted_as_it_ran_and_no_copy_of_it(tmp_path: Path) -> None:
    code = tmp_path / "walk.py"
    code.write_text(DRIFT)
    (tmp_path / "walking.yaml").write_text(CAMPAIGN)
    run = ("run", "walking.yaml", "--jobs", 1, "-q", "-o")
    assert midnet_bench(*run, "mine", folder=tmp_path).returncode == 0

    def exit_code(folder: str, *more: str) -> int:
        return midnet_bench("verify", folder, *more, folder=tmp_path).returncode

    assert exit_code("mine") == 0
    shutil.copytree(tmp_path / "mine", tmp_path / "copy")
    assert exit_code("copy") == 2
    assert exit_code("copy", "--trust") == 0
    (tmp_path / "mine").rename(tmp_path / "moved")
    assert exit_code("moved") == 0
    code.write_text(DRIFT + "\n# changed\n")
    assert exit_code("moved") == 2
    assert midnet_bench(*run, "moved", folder=tmp_path).returncode == 0
    assert exit_code("moved") == 0

    notes = provenance._file()
    assert [stat.S_IMODE(one.stat().st_mode) for one in (notes.parent, notes)] == [0o700, 0o600]
    notes.chmod(0o666)
    assert exit_code("moved") == 2
    notes.chmod(0o600)


def test_boxes_of_a_replay_are_not_written_through_a_link(tmp_path: Path) -> None:
    victim, folder = tmp_path / "thesis.txt", tmp_path / "out"
    victim.write_text("years of work")
    folder.mkdir()
    (folder / "boxes.csv").symlink_to(victim)
    with _boxes_file(folder) as write:
        write([["paper"]])
    assert victim.read_text() == "years of work"
    assert (folder / "boxes.csv").read_text().endswith("\npaper\n")


def test_what_comes_with_the_package_needs_no_trust(tmp_path: Path) -> None:
    own = Definition(
        "detection", 1, 1, {"arena": ["paper", '{"a": [1], "b": "x.y"}']}, {"detector": "midnet"}
    )
    provenance.refuse_untrusted(own, tmp_path)
    module = "midnet_bench.experiments.registry:DETECTION"
    assert registry.experiment_in(Definition(module, 1, 1, {}, {}), tmp_path).name == "detection"
    with pytest.raises(InputError, match="--trust"):
        provenance.refuse_untrusted(
            Definition("detection", 1, 1, {}, {"robot": "midnet_bench_evil.x:Y"}), tmp_path
        )
