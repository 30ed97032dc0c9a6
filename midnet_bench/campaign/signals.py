"""Signals that ask a campaign to end: who hears them, and when."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from multiprocessing import resource_tracker
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


@contextlib.contextmanager
def held_back() -> Iterator[None]:
    """Signals to end wait for the end of this here, and are never heard in processes that begin inside.

    A terminal sends Ctrl-C to the workers too, and one that is still loading its libraries would end with a
    traceback: ``prepare_worker`` is called after that.
    """
    held: list[int] = []
    handlers = {}
    if threading.current_thread() is threading.main_thread():
        found = {number: signal.getsignal(number) for number in SIGNALS_TO_END}
        handlers = {number: handler for number, handler in found.items() if callable(handler)}
    for number in handlers:
        signal.signal(number, lambda number, _: held.append(number))
    # joblib would start it inside, and with it Python lets signals through
    resource_tracker.ensure_running()
    has_masks = hasattr(signal, "pthread_sigmask")  # not on Windows
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS_TO_END) if has_masks else set()
    try:
        yield
    finally:
        if has_masks:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number in held:
            handlers[number](number, None)
