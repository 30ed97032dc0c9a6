"""The ``midnet-bench`` command: parse, call, print. Heavy rooms are imported inside the commands."""

import errno
import functools
import os
import re
import sys
import warnings
from typing import Any

import typer
from typer.main import get_command

from midnet_bench import compiled
from midnet_bench.cli import (  # noqa: F401 - each adds its commands
    campaigns,
    inputs,
    maps,
    messages,
    replay,
    reports,
)
from midnet_bench.cli.app import app
from midnet_bench.cli.replay import key_of
from midnet_bench.errors import InputError, MidnetBenchError

PLAIN = {
    r"Invalid value for '(\S+)' / '(\S+)': ": r"\1 / \2: ",
    r"Invalid value for '(\S+)': ": r"\1: ",
    r"Value error, ": "",
    r"Input should be greater than or equal to (\S+)": r"must be at least \1",
    r"Input should be less than or equal to (\S+)": r"must be at most \1",
    r"Input should be greater than (\S+)": r"must be above \1",
    r"Input should be a valid integer(, unable to parse string as an integer)?": "a whole number is needed",
    r"Input should be a valid number(, unable to parse string as a number)?": "a number is needed",
    r"Input should be a finite number": "a finite number is needed",
    r"Input should be a valid boolean(, unable to interpret input)?": "true or false is needed",
    r"Missing argument 'DIR'\.": "give a campaign's folder, such as results/detection",
}
"""what the parsers of the command line and of settings say -> what a user reads"""
NO_PATH = (errno.ENAMETOOLONG, errno.ELOOP, errno.EACCES)  # error numbers of a path that cannot be looked up


@functools.cache
def _commands() -> Any:
    """Every command with its options; Typer takes 30 ms to make them, once in a process."""
    return get_command(app)


def main() -> None:
    """Run the command line; exit 0, 2 for unusable input, 130 when interrupted, else as the command says.

    A known error is one line on stderr; with MIDNET_BENCH_DEBUG set it keeps its traceback.
    """
    messages.set_up()
    compiled.collect_garbage_rarely()
    # where it cannot use /dev/shm; a command that runs trials says so itself
    warnings.filterwarnings("ignore", ".*joblib will operate in serial mode", UserWarning)
    keeps_traceback = os.environ.get("MIDNET_BENCH_DEBUG")
    try:
        with messages.printing():
            code = _commands()(prog_name="midnet-bench", standalone_mode=False)
    except typer.TyperException as error:
        if text := _complaint(error):
            messages.refuse(_in_plain_words(text))
        code = error.exit_code
    except MidnetBenchError as error:
        if keeps_traceback:
            raise
        messages.refuse(_in_plain_words(str(error)))
        code = error.exit_code
    except OSError as error:
        # a path that the user gave, wherever it was first used
        if error.errno not in NO_PATH or error.filename is None or keeps_traceback:
            raise
        messages.refuse(f"{error.filename}: {error.strerror}; give another")
        code = InputError.exit_code
    except (KeyboardInterrupt, typer.Abort):
        code = 130
    finally:
        messages.shut_down()
    sys.exit(code)


def _in_plain_words(text: str) -> str:
    for pattern, words in PLAIN.items():
        text = re.sub(pattern, words, text)
    return text


def _complaint(error: Any) -> str:
    """What is wrong with a command line; of an option that is a key of a recording's setup, where it goes."""
    text = error.format_message()
    option, context = getattr(error, "option_name", ""), getattr(error, "ctx", None)
    if context is not None and context.info_name == "replay" and (key := key_of(option)):
        text = f"{option}: write '{key}: ...' into setup.yaml and give --setup setup.yaml"
    return str(text)
