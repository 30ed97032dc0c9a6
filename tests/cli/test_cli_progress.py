"""What a command shows of its progress: a bar on a terminal, lines elsewhere, nothing with ``-q``."""

import os
import pty
import select
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from midnet_bench import compiled
from midnet_bench.campaign.trial import Outcome
from midnet_bench.cli import messages, progress
from midnet_bench.cli.progress import Bar, CampaignProgress, meter

GOOD = Outcome("0" * 16, 1.0, 1.0, b"result")
BAD = Outcome("1" * 16, 1.0, failure="ValueError: no")


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(progress.time, "monotonic", clock.monotonic)
    return clock


@pytest.fixture(autouse=True)
def _messages() -> Iterator[None]:
    messages.set_up()
    yield
    messages.shut_down()


def run_campaign(clock: Clock) -> None:
    lines = CampaignProgress()
    lines.begin(total=100, done=20)
    for k in range(80):
        clock.now_s += 1.0
        lines.advance(BAD if k == 3 else GOOD)
    lines.end()


def test_compiling_says_how_many_loops_and_how_long_once_and_only_where_there_are_any(
    capsys: pytest.CaptureFixture[str], clock: Clock
) -> None:
    with progress.compiling():
        pass
    assert capsys.readouterr().err == ""
    with progress.compiling() as show:
        for done in range(1, 41):
            clock.now_s += 1.0
            show(done, 80)
    said = capsys.readouterr().err.splitlines()
    assert said[0] == "compiling 80 loops, once, about 48 s"
    assert said[1] == "compiled 11 loops, estimated 0:01:03 left"
    assert len(said) == 1 + 4


def test_a_command_that_compiles_several_loops_says_so_once(capsys: pytest.CaptureFixture[str]) -> None:
    messages.announce_compiling()
    (count,) = compiled.after_compiling
    for _ in range(10):
        count()
    assert capsys.readouterr().err == "compiling loops, once: up to a minute\n"


def test_lines_are_few_and_end_with_the_whole(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    run_campaign(clock)
    said = capsys.readouterr().err.splitlines()
    assert said[:2] == [
        "20 of 100 trials are already stored",
        "30/100 trials, 1 failed, estimated 0:01:10 left",
    ]
    assert said[-1] == "100/100 trials, 1 failed, took 0:01:20"
    assert len(said) == 1 + 8


def test_a_campaign_that_is_complete_says_so_once(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    lines = CampaignProgress()
    lines.note("before it begins")
    lines.begin(total=20, done=20)
    lines.end()
    assert capsys.readouterr().err.splitlines() == ["before it begins", "20 of 20 trials are already stored"]


def test_work_without_an_estimate_says_its_last_line(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    with meter(estimates=False) as shown:
        for second in range(1, 26):
            clock.now_s += 1.0
            shown.show(second / 50.0, 1.0, f"{second} s simulated")
    assert capsys.readouterr().err.splitlines() == ["10 s simulated", "20 s simulated", "25 s simulated"]


def test_work_that_stops_early_ends_without_an_estimate(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    with meter() as shown:
        for frame in range(1, 13):
            clock.now_s += 1.0
            shown.show(frame, 20, f"frame {frame} of at most 20")
    assert capsys.readouterr().err.splitlines() == [
        "frame 10 of at most 20, estimated 0:00:10 left",
        "frame 12 of at most 20",
    ]


def test_quiet_leaves_the_lines_to_the_log_file(
    clock: Clock, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    messages.set_up(quiet=True, log_file=tmp_path / "log.txt")
    run_campaign(clock)
    messages.shut_down()
    assert capsys.readouterr().err == ""
    log = (tmp_path / "log.txt").read_text()
    assert log.count("finished after 1.0 s") == 79
    assert f"trial {BAD.trial_id} failed" in log
    assert "100/100 trials, 1 failed, took 0:01:20" in log


@contextmanager
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """stderr is a terminal; what is given is its other end."""
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    own, other = pty.openpty()
    with os.fdopen(own, "rb") as screen, os.fdopen(other, "w") as stream:
        # here and not in a fixture: between those and the test, pytest puts its own stderr back
        monkeypatch.setattr(sys, "stderr", stream)
        yield screen.fileno()
        monkeypatch.undo()


def shown_until(last: bytes, screen: int) -> str:
    """What a terminal shows up to ``last``: it arrives in pieces, and on a busy machine not at once."""
    sys.stderr.flush()
    shown = b""
    while last not in shown and select.select([screen], [], [], 10.0)[0]:
        shown += os.read(screen, 4096)
    return shown.decode()


def test_a_terminal_gets_a_bar_unless_it_wants_none_or_lines_are_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def is_bar() -> bool:
        with meter() as shown:
            return isinstance(shown, Bar)

    with terminal(monkeypatch):
        assert is_bar()
        for variable, value in (("NO_COLOR", "1"), ("TERM", "dumb")):
            with monkeypatch.context() as setting:
                setting.setenv(variable, value)
                assert not is_bar()
        assert is_bar()
        messages.set_up(verbose=True)
        assert not is_bar()


def test_the_bar_counts_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    with terminal(monkeypatch) as screen:
        bar = CampaignProgress()
        bar.begin(total=4, done=1)
        bar.advance(GOOD)
        bar.note("a [note]")
        bar.advance(BAD)
        bar.advance(GOOD)
        bar.end()
        shown = shown_until(b"4/4", screen)
    assert "4/4 trials, 1 failed" in shown
    assert "a [note]" in shown
    assert "1 of 4 trials are already stored" in shown
