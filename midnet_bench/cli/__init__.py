"""The ``midnet-bench`` command: parse, call, print. Heavy rooms are imported inside the commands."""

import os
import sys

import typer

from midnet_bench.cli import campaigns, inputs, maps, pictures, reports, smoke
from midnet_bench.cli.app import app, printing
from midnet_bench.errors import MidnetBenchError

__all__ = ["campaigns", "inputs", "main", "maps", "pictures", "reports", "smoke"]


def main() -> None:
    """Run the command line; exit 0, 2 for unusable input, 130 when interrupted, else as the command says.

    A known error is one line on stderr; with MIDNET_BENCH_DEBUG set it keeps its traceback.
    """
    try:
        with printing():
            code = app(standalone_mode=False)
    except typer.TyperException as error:
        # without a command the help is shown, and there is nothing to add
        if message := error.format_message():
            print(f"error: {message}", file=sys.stderr)
        code = error.exit_code
    except MidnetBenchError as error:
        if os.environ.get("MIDNET_BENCH_DEBUG"):
            raise
        print(f"error: {error}", file=sys.stderr)
        code = error.exit_code
    except (KeyboardInterrupt, typer.Abort):
        code = 130
    sys.exit(code)
