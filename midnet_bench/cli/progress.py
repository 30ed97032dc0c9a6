"""How a command shows that it moves: a bar on a terminal, elsewhere at most a line every ten seconds.

``-q`` silences both; ``-v`` shows lines. Lines go to the log file in any case.
"""

import contextlib
import logging
import os
import sys
import time
from collections.abc import Callable, Iterator
from datetime import timedelta

from midnet_bench.campaign.runner import Progress
from midnet_bench.campaign.trial import Outcome
from midnet_bench.cli import messages

SECONDS_BETWEEN_LINES = 10.0
S_PER_LOOP = 0.6  # CPU seconds that numba needs for one of our loops in the mean


class Meter(contextlib.AbstractContextManager["Meter"]):
    """Shows how far a piece of work has come, in lines; the last one is printed in any case."""

    def __init__(self, done: float = 0.0, estimates: bool = True) -> None:
        """``done`` was there before. ``estimates``: whether to say how long the rest takes."""
        self._done_before, self._estimates = done, estimates
        self._start_s = self._printed_s = time.monotonic()
        self._pending = ""

    def show(self, done: float, total: float, text: str) -> None:
        """So much of so much is done; ``text`` says it in words."""
        if done <= self._done_before:
            return
        now_s = time.monotonic()
        elapsed_s = now_s - self._start_s
        self._pending = f"{text}, took {_clock(elapsed_s)}" if self._estimates and done >= total else text
        if now_s - self._printed_s >= SECONDS_BETWEEN_LINES:
            self._printed_s = now_s
            if self._estimates and done < total:
                left_s = elapsed_s / (done - self._done_before) * (total - done)
                self._pending += f", estimated {_clock(left_s)} left"
            self.close()

    def note(self, text: str) -> None:
        """A line that the user should read."""
        messages.note(text)

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Print what is left; nothing more will come."""
        if self._pending:
            messages.note(self._pending)
        self._pending = ""


class Bar(Meter):
    """A bar with the time that is left."""

    def __init__(self, done: float = 0.0, estimates: bool = True) -> None:
        """As :class:`Meter`."""
        # rich takes a while to import, and a program that shows no bar has no use for it
        from rich import progress
        from rich.console import Console

        columns: list[progress.ProgressColumn] = [
            progress.TextColumn("{task.description}", markup=False),
            progress.BarColumn(),
            progress.TaskProgressColumn(),
            progress.TimeElapsedColumn(),
        ]
        if estimates:
            columns += [progress.TextColumn("eta"), progress.TimeRemainingColumn()]
        console = Console(file=sys.stderr)
        self._bar = progress.Progress(*columns, console=console, speed_estimate_period=600.0)
        self._task = self._bar.add_task("", total=None)
        self._bar.start()
        # rich hides it until the end, and not every end can bring it back: kill -9, a second Ctrl-C
        console.show_cursor(True)

    def show(self, done: float, total: float, text: str) -> None:
        """See :class:`Meter`."""
        self._bar.update(self._task, completed=done, total=total, description=text)

    def note(self, text: str) -> None:
        """See :class:`Meter`."""
        self._bar.console.print(text, markup=False, highlight=False)
        messages.log.debug("%s", text)

    def close(self) -> None:
        """See :class:`Meter`."""
        self._bar.stop()


def meter(done: float = 0.0, estimates: bool = True) -> Meter:
    """A bar if stderr may be animated and neither ``-q`` nor ``-v`` is given, else lines."""
    is_plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    # a bar that the lines of -v run through would be neither
    as_bar = messages.level() == logging.INFO and sys.stderr.isatty() and not is_plain
    return Bar(done, estimates) if as_bar else Meter(done, estimates)


@contextlib.contextmanager
def compiling() -> Iterator[Callable[[int, int], None]]:
    """Shows how many loops are compiled, of about how many; says nothing where none has to be."""
    opened: list[Meter] = []
    with contextlib.ExitStack() as held:

        def show(done: int, total: int) -> None:
            if not opened:
                messages.note(f"compiling {total} loops, once, about {round(total * S_PER_LOOP)} s")
                opened.append(held.enter_context(meter()))
            opened[0].show(done, max(done, total), f"compiled {done} loops")

        yield show


class CampaignProgress(Progress):
    """A campaign's progress on a meter; the log file gets each trial."""

    _meter: Meter | None = None

    def begin(self, total: int, done: int) -> None:
        """See :class:`Progress`."""
        self._total, self._done, self._failed = total, done, 0
        self._meter = meter(done)
        messages.log.debug("%d trials, %d of them already stored", total, done)
        if done:
            self._meter.note(f"{done} of {total} trials are already stored")
        self._show()

    def advance(self, outcome: Outcome) -> None:
        """See :class:`Progress`."""
        self._done += 1
        self._failed += outcome.failure is not None
        how = "failed" if outcome.failure else "finished"
        messages.log.debug("trial %s %s after %.1f s", outcome.trial_id, how, outcome.wall_s)
        self._show()

    def note(self, text: str) -> None:
        """See :class:`Progress`."""
        (self._meter or Meter()).note(text)

    def end(self) -> None:
        """See :class:`Progress`."""
        if self._meter is not None:
            self._meter.close()
            self._meter = None

    def _show(self) -> None:
        assert self._meter is not None
        failed = f", {self._failed} failed" if self._failed else ""
        self._meter.show(self._done, self._total, f"{self._done}/{self._total} trials{failed}")


def _clock(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))
