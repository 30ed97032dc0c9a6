"""How a campaign tells its user that it moves: a bar on a terminal, now and then a line elsewhere."""

import os
import sys
import time
from datetime import timedelta
from typing import TextIO

from midnet_bench.campaign.worker import Outcome

SECONDS_BETWEEN_LINES = 10.0


class Progress:
    """What the runner calls; this one keeps silent."""

    def begin(self, total: int, done: int) -> None:
        """``total`` trials in the campaign, ``done`` of them by earlier runs."""

    def advance(self, outcome: Outcome) -> None:
        """One more trial is stored."""

    def note(self, text: str) -> None:
        """Something that the user should know, in one line."""

    def end(self) -> None:
        """Nothing more will come."""


class Lines(Progress):
    """Plain lines for logs: at most one every ten seconds, and the last."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def begin(self, total: int, done: int) -> None:
        """See :class:`Progress`."""
        self._total, self._done, self._done_before, self._failed = total, done, done, 0
        self._start_s = self._printed_s = time.monotonic()
        if done:
            self.note(f"{done} of {total} trials are already stored")

    def advance(self, outcome: Outcome) -> None:
        """See :class:`Progress`."""
        self._done += 1
        self._failed += outcome.failure is not None
        now_s = time.monotonic()
        is_last = self._done == self._total
        if is_last or now_s - self._printed_s >= SECONDS_BETWEEN_LINES:
            self._printed_s = now_s
            elapsed_s = now_s - self._start_s
            left_s = elapsed_s / (self._done - self._done_before) * (self._total - self._done)
            failed = f", {self._failed} failed" if self._failed else ""
            time_note = f"took {_clock(elapsed_s)}" if is_last else f"estimated {_clock(left_s)} left"
            self.note(f"{self._done}/{self._total} trials{failed}, {time_note}")

    def note(self, text: str) -> None:
        """See :class:`Progress`."""
        print(text, file=self._stream, flush=True)


class Bar(Progress):
    """A bar with the time that is left."""

    def __init__(self, stream: TextIO) -> None:
        # rich takes a while to import, and a program that shows no bar has no use for it
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )

        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("eta"),
            TimeRemainingColumn(),
            console=Console(file=stream),
            speed_estimate_period=600.0,
        )
        self._failed = 0

    def begin(self, total: int, done: int) -> None:
        """See :class:`Progress`."""
        self._task = self._bar.add_task("trials", total=total, completed=done)
        self._bar.start()

    def advance(self, outcome: Outcome) -> None:
        """See :class:`Progress`."""
        self._failed += outcome.failure is not None
        description = f"trials ({self._failed} failed)" if self._failed else "trials"
        self._bar.update(self._task, advance=1, description=description)

    def note(self, text: str) -> None:
        """See :class:`Progress`."""
        self._bar.console.print(text, markup=False, highlight=False)

    def end(self) -> None:
        """See :class:`Progress`."""
        self._bar.stop()


def progress_on(stream: TextIO = sys.stderr) -> Progress:
    """A bar if ``stream`` may be animated, else lines."""
    return Bar(stream) if may_animate(stream) else Lines(stream)


def may_animate(stream: TextIO) -> bool:
    """Whether ``stream`` is a terminal, and neither NO_COLOR nor TERM=dumb asks for plain lines."""
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def _clock(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))
