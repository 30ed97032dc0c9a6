"""How commands end when names are too long, pipes break, or what they write to is taken away."""

import contextlib
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, NoReturn

import pytest
import yaml

from midnet_bench.campaign.definition import Campaign, resolve
from midnet_bench.campaign.runner import Progress, run_campaign
from midnet_bench.campaign.trial import Outcome
from midnet_bench.cli.messages import LONGEST, one_line
from midnet_bench.errors import MidnetBenchError, nearest_name
from midnet_bench.io.files import plain_name, temporary_path
from tests.campaign import coin_experiments as coins
from tests.cli.command import REPOSITORY, midnet_bench, one_line_of_complaint

LONG, ENDLESS = "x" * 300, "x" * 10_000


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", ENDLESS),
        ("run", f"{LONG}.yaml"),
        ("report", ENDLESS),
        ("report", LONG, "--format", "pdf"),
        ("compare", LONG, ENDLESS),
        ("detection", "-o", LONG, "-n"),
        ("detection", "-o", ENDLESS, "-n"),
        ("detection", "--frames", 2, "-o", LONG),
        ("detection", "--set", f"{ENDLESS}=3"),
        ("detection", "--set", f"arena={ENDLESS}"),
        ("detection", "--set", f"prior_map={ENDLESS}"),
        ("detection", "--map", ENDLESS),
        ("detection", "--engine", ENDLESS),
        ("parameters", ENDLESS),
        ("run", "--log-file", ENDLESS),
        ("map", ENDLESS),
        ("render", ENDLESS),
        ("map", "map1", "--exact", "-o", LONG),
        ("map", "--from-log", LONG),
    ],
    ids=lambda arguments: " ".join(str(one)[:12] for one in arguments),
)
def test_an_endless_name_leaves_room_to_say_what_is_wrong(
    arguments: tuple[object, ...], tmp_path: Path
) -> None:
    complaint = one_line_of_complaint(midnet_bench(*arguments, folder=tmp_path))
    assert len(complaint) <= LONGEST
    assert complaint.count("x") < 200, complaint
    assert not complaint.endswith(("x", "\N{HORIZONTAL ELLIPSIS}")), complaint
    assert list(tmp_path.iterdir()) == []


def test_a_campaigns_name_fits_a_folder(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(f"experiment: detection\nname: {LONG}\n")
    complaint = one_line_of_complaint(midnet_bench("run", "c.yaml", "-n", folder=tmp_path))
    assert "name: the results' folder is named so; at most 255 bytes" in complaint


def test_lines_keep_both_ends_of_long_words() -> None:
    assert one_line("a short line\n") == "a short line\\n"
    line = one_line(f"error: results/{'y' * 500}: cannot be written: {'z' * 500}; make room")
    assert line.startswith("error: results/yyy")
    assert line.endswith("; make room")
    assert len(line) <= LONGEST
    assert LONGEST - 1 <= len(one_line("word " * 100)) <= LONGEST


def test_names_of_files_are_plain_and_short() -> None:
    for honest in ("labyrinth_details_capture-within", "labyrinth_details_prior_map-explored"):
        assert plain_name(honest) == honest
    odd = (
        [f"a/../../../{letter}" for letter in "xy"] + [f"{ENDLESS}{letter}" for letter in "xy"] + ["é" * 200]
    )
    made = [plain_name(one) for one in odd]
    assert len(set(made)) == len(made)
    assert all("/" not in one and len(one.encode()) <= 160 for one in made)


def test_an_unknown_setting_gets_the_nearest_name_and_the_command_that_lists_all(tmp_path: Path) -> None:
    complaint = one_line_of_complaint(midnet_bench("detection", "--set", "bogus=3", folder=tmp_path))
    assert len(complaint) < 200
    assert complaint.endswith("; 'midnet-bench parameters detection' lists them")
    assert nearest_name("frame", ["frames", "robots"]) == "; did you mean 'frames'?"
    assert nearest_name("q", ["frames", "robots"]) == "; valid: frames, robots"


@pytest.mark.parametrize("center", [(1.0, 0.0), (0.0, -1.0), (1.0, 1.0)])
def test_robots_do_not_start_on_the_edge_of_the_plane(center: tuple[float, float], tmp_path: Path) -> None:
    values = yaml.safe_load((REPOSITORY / "midnet_bench/arena/arenas/empty.yaml").read_text())
    values["enclosure_m"] = values["plane_m"]
    half = [side / 2.0 for side in values["plane_m"]]
    values["robots"]["center_m"] = [share * side for share, side in zip(center, half, strict=True)]
    (tmp_path / "edge.yaml").write_text(yaml.safe_dump(values))
    done = midnet_bench("detection", "--arena", "edge.yaml", "--frames", 2, folder=tmp_path)
    complaint = one_line_of_complaint(done)
    assert "robots.center_m" in complaint
    assert "is not inside the enclosure" in complaint


def test_a_pipe_that_breaks_elsewhere_is_not_taken_for_the_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks(*_: object) -> NoReturn:
        raise BrokenPipeError(32, "Broken pipe")

    (tmp_path / "c").mkdir()
    monkeypatch.setattr("midnet_bench.workflows.verify.verify", breaks)
    done = midnet_bench("verify", "c", folder=tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("error: a connection to another program broke")


@pytest.mark.slow
def test_a_command_goes_on_without_a_reader_of_its_messages(tmp_path: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "midnet_bench", "parameters", "frames", "-v"]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    done = subprocess.run(
        command, stdout=subprocess.PIPE, stderr=write, text=True, cwd=tmp_path, env=environment, check=False
    )
    os.close(write)
    assert done.returncode == 0
    assert "frames" in done.stdout


class _Taker(Progress):
    """Takes the store away as soon as a trial is in it."""

    def __init__(self, take: Any) -> None:
        self._take = take

    def advance(self, outcome: Outcome) -> None:
        """See :class:`Progress`."""
        if self._take is not None:
            self._take()
            self._take = None


@pytest.mark.parametrize("how", ["file", "folder", "replaced"])
def test_a_store_that_is_taken_away_is_said_to_be_gone(how: str, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    store = folder / "campaign.sqlite"

    def take() -> None:
        if how == "folder":
            folder.rename(tmp_path / "gone")
        else:
            store.unlink()
        if how == "replaced":
            store.write_bytes(b"")

    campaign = resolve(Campaign.model_validate({"experiment": "coins", "trials": 4}), coins)
    with pytest.raises(MidnetBenchError, match="deleted or replaced") as caught:
        run_campaign(campaign, folder, jobs=1, progress=_Taker(take))
    assert caught.value.exit_code == 1


def test_what_is_written_is_on_the_disk_before_it_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    happened = []
    fsync, replace = os.fsync, os.replace

    def note_sync(file: int) -> None:
        happened.append(os.path.realpath(f"/proc/self/fd/{file}"))
        fsync(file)

    def note_replace(source: Any, target: Any) -> None:
        happened.append("replace")
        replace(source, target)

    monkeypatch.setattr(os, "fsync", note_sync)
    monkeypatch.setattr(os, "replace", note_replace)
    with temporary_path(tmp_path / "film.mp4") as draft:
        draft.write_bytes(b"by somebody who does not sync")
    assert happened == [str(draft), "replace", str(tmp_path)]


@pytest.mark.slow
def test_the_cursor_is_never_hidden(tmp_path: Path) -> None:
    """So that whatever ends a command, also kill -9, leaves it there."""
    pty = pytest.importorskip("pty")
    leader, follower = pty.openpty()
    code = (
        "import os\nfrom midnet_bench.cli.progress import Bar\nBar().show(1, 2, 'x')\nos.kill(os.getpid(), 9)"
    )
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), "TERM": "xterm"}
    environment.pop("NO_COLOR", None)
    subprocess.run([sys.executable, "-c", code], stderr=follower, env=environment, check=False)
    os.close(follower)
    written = b""
    with contextlib.suppress(OSError):  # nobody is left who could write
        while part := os.read(leader, 100_000):
            written += part
    os.close(leader)
    said = written.decode()
    assert said.rfind("\x1b[?25h") > said.rfind("\x1b[?25l")


def test_a_map_for_which_the_disk_has_no_room_ends_with_1(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(disk)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("mounting a small disk needs root")
    try:
        done = midnet_bench("map", "map2", "--exact", "-o", disk, folder=tmp_path)
    finally:
        subprocess.run(["umount", str(disk)], check=True)
    assert done.returncode == 1
    assert "cannot be written: No space left on device; make room" in done.stderr.splitlines()[-1]
