"""How an exploration tells its user that it moves: a bar on a terminal, now and then a line elsewhere."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from midnet_bench.campaign.progress import SECONDS_BETWEEN_LINES, may_animate

Tell = Callable[[float, float], None]
"""Takes simulated seconds and the share of the free space that is known."""


@contextmanager
def exploration_progress_on(stream: TextIO) -> Iterator[Tell]:
    """What to call after each simulated second; a bar if ``stream`` may be animated, else lines."""
    with _bar(stream) if may_animate(stream) else _lines(stream) as tell:
        yield tell


@contextmanager
def _lines(stream: TextIO) -> Iterator[Tell]:
    """At most one line every ten seconds of real time, and the last."""
    told_s = time.monotonic()
    last = ""

    def tell(simulated_s: float, known: float) -> None:
        nonlocal told_s, last
        last = f"{simulated_s:.0f} s simulated, {known:.1%} explored"
        if time.monotonic() - told_s >= SECONDS_BETWEEN_LINES:
            told_s = time.monotonic()
            print(last, file=stream, flush=True)
            last = ""

    yield tell
    if last:
        print(last, file=stream, flush=True)


@contextmanager
def _bar(stream: TextIO) -> Iterator[Tell]:
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(file=stream)) as bar:
        task = bar.add_task("exploring", total=1.0)

        def tell(simulated_s: float, known: float) -> None:
            bar.update(task, completed=known, description=f"exploring, {simulated_s:.0f} s simulated")

        yield tell
