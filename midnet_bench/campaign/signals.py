"""Signals that ask a campaign to end: which processes hear them, and when."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

SIGNALS_TO_END = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
"""Ctrl-C; what schedulers send; a terminal that is closed. All processes of a campaign get them."""


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """The first signal to end raises KeyboardInterrupt with its number, a second one ends all at once."""

    def interrupt(signum: int, frame: FrameType | None) -> None:
        for number in before:
            signal.signal(number, signal.SIG_DFL)
        raise KeyboardInterrupt(signum)

    if threading.current_thread() is not threading.main_thread():  # Python delivers signals to no other
        yield
        return
    # what nohup ignores stays ignored; SIGINT is ignored wherever a script starts a campaign behind itself
    before = {
        number: handler
        for number in SIGNALS_TO_END
        if (handler := signal.getsignal(number)) is not None
        if number == signal.SIGINT or handler is not signal.SIG_IGN
    }
    try:
        for number in before:
            signal.signal(number, interrupt)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
