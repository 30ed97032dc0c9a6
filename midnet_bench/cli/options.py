"""Options that mean the same for every command."""

from pathlib import Path
from typing import Annotated

import typer

RESULTS = Path("results")
"""Where results go unless ``-o`` says otherwise."""

Output = Annotated[Path | None, typer.Option("-o", "--output", help="Folder for the results.")]
Jobs = Annotated[int | None, typer.Option(min=1, help="Worker processes; all cores unless given.")]
Seed = Annotated[int, typer.Option(min=0, help="First seed.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Any parameter; see 'midnet-bench parameters'."),
]
Map = Annotated[Path | None, typer.Option("--map", help="Prior map: a map_server YAML file.")]
DryRun = Annotated[bool, typer.Option("--dry-run", "-n", help="Say what would run, and stop.")]
Fresh = Annotated[bool, typer.Option(help="Start over; the old store is kept aside.")]
RetryFailed = Annotated[bool, typer.Option(help="Run failed trials again.")]
Json = Annotated[bool, typer.Option("--json", help="Print the results as JSON.")]
Backend = Annotated[str, typer.Option(help="loky (this machine) or dask.")]
Scheduler = Annotated[str | None, typer.Option(help="Dask scheduler, such as tcp://127.0.0.1:8786.")]
