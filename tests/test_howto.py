"""The pages under docs/howto: every command on them runs, in a folder with the files that they show."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.command import midnet_bench

PAGES = sorted((Path(__file__).parents[1] / "docs" / "howto").glob("*.md"))


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_s_commands_run(page: Path, tmp_path: Path) -> None:
    text = page.read_text(encoding="utf-8")
    commands = 0
    for shown in re.finditer(r"```(\w*)\n(.*?)```", text, re.DOTALL):
        if shown[1]:
            (tmp_path / re.findall(r"`([\w./-]+)`:\s*$", text[: shown.start()])[0]).write_text(shown[2])
            continue
        for line in shown[2].splitlines():
            words = shlex.split(line)
            if words[0] == "python":
                subprocess.run([sys.executable, *words[1:]], cwd=tmp_path, check=True)
                continue
            assert words[0] == "midnet-bench"
            if words[1] == "labyrinth" and "time_limit_s" not in line:
                words += ["--set", "time_limit_s=20"]  # whether it runs, not who is caught
            done = midnet_bench(*words[1:], folder=tmp_path)
            assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
            commands += 1
    assert commands
