"""The exceptions that this package raises on purpose. Only the command line exits."""

import difflib
from collections.abc import Iterable


class MidnetBenchError(Exception):
    """A failure that its message explains in full: what happened, where, and what to do next."""

    exit_code = 1


class InputError(MidnetBenchError):
    """What the user gave cannot be used. The message names the file and the key."""

    exit_code = 2


def nearest_name(name: str, valid: Iterable[str]) -> str:
    """A hint for a mistyped name: ``; did you mean 'x'?``, else the list of the valid ones."""
    names = sorted(valid)
    close = difflib.get_close_matches(name, names, n=1)
    return f"; did you mean '{close[0]}'?" if close else f"; valid: {', '.join(names)}"
