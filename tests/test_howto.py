"""README and the pages under docs/howto: every command runs, in a folder with the files that they show."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from unittest import mock

import cv2
import numpy as np
import pytest

from midnet_bench.workflows import report
from tests.cli.command import worked

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs" / "howto").glob("*.md"))
README = (ROOT / "README.md").read_text(encoding="utf-8")
GUARDED = r"(run(?! walking)|detection)"  # walks have neither guards nor frames
SMALLER = {r"--seeds 3": "--seeds 2", r"--jobs 2": "--jobs 1", r"time_limit_s=\d+": "time_limit_s=2"}
MORE = {
    rf"{GUARDED} ": "--frames 2",
    rf"{GUARDED} (?!.*--robots)": "--robots 2",
    rf"{GUARDED} (?!.*--engine)": "--engine fast",
    r"run (?!.*--seeds)": "--seeds 2",
    r"(labyrinth|map) (?!.*(time_limit_s|--exact|--from))": "--set time_limit_s=2",
    r"size ": "--within 10 --trials 2",
    r"size (?!.*--robots)": "--robots 1",
}
"""what begins a command -> words that make it short: whether it runs is the question, not what comes of it"""

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("trials_in_this_process")]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with ``plan.png``: four walls."""
    walls = np.full((160, 200), 255, np.uint8)
    walls[:6] = walls[-6:] = walls[:, :6] = walls[:, -6:] = 0
    assert cv2.imwrite(str(tmp_path / "plan.png"), walls)
    return tmp_path


def run(line: str, folder: Path) -> None:
    """Run a command line of ``midnet-bench`` or ``python``, made short; ``report`` alone draws figures."""
    program, _, command = line.partition(" ")
    if program == "python":
        subprocess.run([sys.executable, *shlex.split(command)], cwd=folder, check=True)
        return
    assert program == "midnet-bench"
    for written, short in SMALLER.items():
        command = re.sub(written, short, command)
    more = [words for beginning, words in MORE.items() if re.match(beginning, command)]
    drawn = report._drawn if command.startswith("report ") else lambda *figures: []
    with mock.patch.object(report, "_drawn", drawn):
        worked(*shlex.split(" ".join([command, *more])), folder=folder)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_s_commands_run(page: Path, folder: Path) -> None:
    text = page.read_text(encoding="utf-8")
    commands = 0
    for shown in re.finditer(r"```(\w*)\n(.*?)```", text, re.DOTALL):
        if shown[1]:
            (folder / re.findall(r"`([\w./-]+)`:\s*$", text[: shown.start()])[0]).write_text(shown[2])
            continue
        for line in shown[2].splitlines():
            run(line, folder)
            commands += line.startswith("midnet-bench")
    assert commands


def test_readme_s_commands_run(folder: Path) -> None:
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", README, re.DOTALL | re.MULTILINE)
    (code,) = (block for language, block in blocks if language == "python")
    (folder / "mine.py").write_text(code)
    recorded = ("detection", "--engine", "fast", "--robots", 1, "--frames", 30, "--format", "ros1")
    worked("export", *recorded, "-o", "drive.bag", folder=folder)
    worked("map", "--exact", "map1", "-o", "exact", folder=folder)
    for part in (folder / "exact").glob("map.*"):
        shutil.copy(part, folder)
    (folder / "truth.csv").write_text("t,id,x,y\n0.967,car,1.0,1.0\n")
    lines = [line for language, block in blocks if not language for line in block.splitlines()]
    commands = [line.partition("#")[0].strip() for line in lines if line.startswith("midnet-bench")]
    assert len(commands) == 9
    for command in commands:
        run(command.replace(" /pose", " /guard_1/pose"), folder)
    assert "mine.py:Returns" in (folder / "results" / "rivals" / "leaderboard.md").read_text()
