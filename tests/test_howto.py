"""README and the pages under docs/howto: every command runs, in a folder with the files that they show."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from midnet_bench.analysis import sample_size
from midnet_bench.workflows import size
from tests.cli.command import midnet_bench

SHORT = {
    "run rivals": ["--seeds", "2", "--frames", "3", "--engine", "fast", "--robots", "2"],
    "detection": ["--seeds", "1", "--frames", "3", "--engine", "fast", "--robots", "2"],
    "size": ["--within", "10", "--probability", "0.02", "--trials", "8"],
}
"""what makes a command short; whether it runs is the question, not what comes of it"""
PAGES = sorted((Path(__file__).parents[1] / "docs" / "howto").glob("*.md"))


def write_plan(folder: Path) -> None:
    """``plan.png``: four walls."""
    walls = np.full((160, 200), 255, np.uint8)
    walls[:6] = walls[-6:] = walls[:, :6] = walls[:, -6:] = 0
    assert cv2.imwrite(str(folder / "plan.png"), walls)


@pytest.fixture(autouse=True)
def _small_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    """``size`` looks after every eight trials instead of forty."""
    monkeypatch.setattr(sample_size, "BATCH", 8)
    monkeypatch.setattr(size, "BATCH", 8)


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_s_commands_run(page: Path, tmp_path: Path) -> None:
    text = page.read_text(encoding="utf-8")
    write_plan(tmp_path)
    commands = 0
    for shown in re.finditer(r"```(\w*)\n(.*?)```", text, re.DOTALL):
        if shown[1]:
            (tmp_path / re.findall(r"`([\w./-]+)`:\s*$", text[: shown.start()])[0]).write_text(shown[2])
            continue
        for line in shown[2].splitlines():
            # whether it runs, not what comes of it
            line = re.sub(r"--seeds 3", "--seeds 2", re.sub(r"--frames \d+", "--frames 2", line))
            words = shlex.split(line)
            if words[0] == "python":
                subprocess.run([sys.executable, *words[1:]], cwd=tmp_path, check=True)
                continue
            assert words[0] == "midnet-bench"
            words += SHORT["size"] if words[1] == "size" else []
            if words[1] in ("labyrinth", "map") and not re.search("time_limit_s|--exact|--from", line):
                words += ["--set", "time_limit_s=2"]
            done = midnet_bench(*words[1:], folder=tmp_path)
            assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
            commands += 1
    assert commands


README = Path(__file__).parents[1] / "README.md"
OF_THE_BAG = {"/pose": "/guard_1/pose"}  # README's name of a topic -> that of an exported trial


def readme_commands() -> list[str]:
    """The lines that README has in code blocks without their comments."""
    blocks = re.findall(
        r"^```(\w*)\n(.*?)^```$", README.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )
    plain = [block for language, block in blocks if not language]
    lines = [line.partition("#")[0].strip() for block in plain for line in block.splitlines()]
    return [line for line in lines if line.startswith("midnet-bench")]


@pytest.fixture
def newcomer(tmp_path: Path) -> Path:
    """A folder with the files that README names: a detector, a recording with map and labels, a plan."""
    text = README.read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    (tmp_path / "mine.py").write_text(code)
    write_plan(tmp_path)
    recorded = ("detection", "--engine", "fast", "--robots", 1, "--frames", 30, "--format", "ros1")
    assert midnet_bench("export", *recorded, "-o", "drive.bag", folder=tmp_path).returncode == 0
    assert midnet_bench("map", "--exact", "map1", "-o", "exact", folder=tmp_path).returncode == 0
    for part in (tmp_path / "exact").glob("map.*"):
        shutil.copy(part, tmp_path)
    (tmp_path / "truth.csv").write_text("t,id,x,y\n1.0,car,1.0,1.0\n")
    return tmp_path


@pytest.mark.slow
def test_readme_s_commands_run(newcomer: Path) -> None:
    commands = readme_commands()
    assert len(commands) == 9
    for command in commands:
        words = [OF_THE_BAG.get(word, word) for word in shlex.split(command)[1:]]
        short = next((more for start, more in SHORT.items() if " ".join(words).startswith(start)), [])
        done = midnet_bench(*words, *short, folder=newcomer)
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    assert "mine.py:Returns" in (newcomer / "results" / "rivals" / "leaderboard.md").read_text()
