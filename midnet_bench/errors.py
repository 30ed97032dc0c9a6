"""The exceptions that this package raises on purpose. Only the command line exits."""

import difflib
from collections.abc import Iterable

LONGEST_ASKED = 100
FEW_NAMES = 20  # that a message lists


class MidnetBenchError(Exception):
    """A failure that its message explains in full: what happened, where, and what to do next."""

    exit_code = 1


class InputError(MidnetBenchError):
    """What the user gave cannot be used. The message names the file and the key."""

    exit_code = 2


def nearest_name(name: str, valid: Iterable[str], where: str = "") -> str:
    """A hint for a mistyped name: ``; did you mean 'x'?``, else the valid ones, or the nearest of many.

    ``where`` says which command lists them, if they may be many: ``; 'midnet-bench parameters' lists them``.
    """
    names, asked = sorted(valid), name[:LONGEST_ASKED]  # difflib takes long over a long one
    close = difflib.get_close_matches(asked, names, n=1)
    if close:
        return f"; did you mean '{close[0]}'?"
    if len(names) <= FEW_NAMES:
        return f"; valid: {', '.join(names)}"
    nearest = difflib.get_close_matches(asked, names, n=3, cutoff=0.0)
    return f"; the nearest of {len(names)}: {', '.join(nearest)}{where}"
