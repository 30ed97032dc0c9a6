"""How commands behave whatever they do: help, options given twice, messages, completion, the last line."""

import contextlib
import json
import shlex
from pathlib import Path

import pytest
import typer.main
import yaml

from midnet_bench.cli.app import app
from tests.cli.command import (
    REPOSITORY,
    in_its_own_process,
    midnet_bench,
    one_line_of_complaint,
    unpainted,
    worked,
)

COMMANDS = [one.name or one.callback.__name__ for one in app.registered_commands if one.callback]
TINY = ("detection", "--robots", 1, "--frames", 2)


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_every_command_opens_with_an_example_that_it_understands(
    name: str, tmp_path: Path
) -> None:
    done = midnet_bench(name, "-h", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    example = next(line.strip() for line in done.stdout.splitlines() if line.strip().startswith("$ "))
    assert example.startswith(f"$ midnet-bench {name}")
    arguments = shlex.split(example)[3:]
    command = typer.main.get_command(app).commands[name]
    for argument in arguments:  # folders that the example names
        if argument.startswith("results/"):
            (tmp_path / argument).mkdir(parents=True, exist_ok=True)
    with contextlib.chdir(tmp_path):
        assert command.make_context(name, arguments).args == []


def test_the_options_help_names_the_defaults_of_the_packaged_campaigns(tmp_path: Path) -> None:
    def campaign(name: str) -> dict[str, object]:
        values = yaml.safe_load((REPOSITORY / "campaigns" / f"{name}.yaml").read_text())
        return {**values, **values["grid"], **values.get("parameters", {})}

    for name, options in (
        ("detection", {"robots": "robots", "frames": "frames", "seeds": "trials"}),
        ("labyrinth", {"robots": "robots", "intruders": "intruders", "seeds": "trials"}),
    ):
        command = typer.main.get_command(app).commands[name]
        helps = {parameter.name: parameter.help for parameter in command.params}
        values = campaign(name)
        for option, key in options.items():
            value = values[key]
            said = ",".join(map(str, value)) if isinstance(value, list) else str(value)
            assert f"{name if option == 'seeds' else 'default'} {said}" in helps[option]


@pytest.mark.slow
def test_a_run_ends_by_naming_its_folder_unless_it_is_quiet_or_prints_json(tmp_path: Path) -> None:
    done = worked(*TINY, folder=tmp_path)
    assert done.stderr.splitlines()[-1] == "Open results/detection/report.html"
    assert "1 robot" in done.stdout
    quiet = worked(*TINY, "-q", folder=tmp_path)
    assert (quiet.stderr, quiet.stdout) == ("", done.stdout)
    as_json = worked(*TINY, "--json", folder=tmp_path)
    assert json.loads(as_json.stdout)
    assert "Open" not in as_json.stderr
    with unpainted():
        again = worked("report", "results/detection", folder=tmp_path)
    assert again.stderr == "drawing figures and the page\nOpen results/detection/report.html\n"


@pytest.mark.slow
def test_verbose_and_the_log_file_tell_each_trial(tmp_path: Path) -> None:
    with unpainted():
        done = worked(*TINY, "--seeds", 2, "-v", "--log-file", "logs/run.txt", folder=tmp_path)
    lines = (tmp_path / "logs" / "run.txt").read_text().splitlines()
    for text in (done.stderr.splitlines(), lines):
        assert sum(" finished after " in line for line in text) == 2
    assert "detection --robots 1" in lines[0]
    assert all(line.split()[2] in ("DEBUG", "INFO") for line in lines)

    wrong = midnet_bench(
        "detection", "--set", "frames=-1", "-q", "--log-file", "logs/run.txt", folder=tmp_path
    )
    last = (tmp_path / "logs" / "run.txt").read_text().splitlines()[-1]
    assert last.split(maxsplit=3)[2:] == ["ERROR", wrong.stderr.strip()]


def test_a_log_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    done = midnet_bench(*TINY, "--log-file", tmp_path, folder=tmp_path)
    assert f"--log-file {tmp_path}" in one_line_of_complaint(done)
    assert not (tmp_path / "results").exists()


@pytest.mark.slow
def test_the_shell_completes_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("results/mine", "results/not-a-campaign", "elsewhere/other"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "results/mine/campaign.sqlite").touch()
    (tmp_path / "elsewhere/other/configuration.json").touch()
    (tmp_path / "labels.yaml").touch()
    for line, offered in (
        ("ver", "verify"),
        ("run lab", "labyrinth labyrinth-report labels.yaml"),
        ("parameters lab", "labyrinth"),
        ("detection --arena map", "map1 map2"),
        ("report ", "results/mine"),
        ("report elsewhere/o", "elsewhere/other"),
        ("labyrinth --set escape_", "escape_distance_m= escape_at= escape_radius_m="),
    ):
        words = {"COMP_WORDS": f"midnet-bench {line}", "COMP_CWORD": str(len(line.split(" ")))}
        for name, value in {"_MIDNET_BENCH_COMPLETE": "complete_bash", **words}.items():
            monkeypatch.setenv(name, value)
        done = (in_its_own_process if line == "ver" else midnet_bench)(folder=tmp_path)
        assert (done.stdout.split(), done.stderr) == (offered.split(), "")


def test_help_leaves_out_options_that_the_command_refuses(tmp_path: Path) -> None:
    for command, option in (("labyrinth", "--frames"), ("detection", "--pursuit")):
        assert option not in midnet_bench(command, "-h", folder=tmp_path).stdout
        assert option in midnet_bench("run", "-h", folder=tmp_path).stdout
        assert midnet_bench(command, option, "3", "-n", folder=tmp_path).returncode == 2
