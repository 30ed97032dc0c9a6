"""The command that continuous integration runs: ``smoke``."""

from pathlib import Path
from typing import Annotated

import typer

from midnet_bench.cli import options
from midnet_bench.cli.app import command

TABLES = {
    "smoke-detection": ("scores", "robots"),
    "smoke-labyrinth": ("trial", "intruders", "robots"),
}
"""packaged campaign -> its tables that have expected numbers"""


@command(example="midnet-bench smoke")
def smoke(
    update: Annotated[
        bool, typer.Option("--update", help="Make this run's numbers the expected ones; in a checkout.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="DIR",
            help="Folder for the results (default results/smoke).",
        ),
    ] = None,
    jobs: options.Jobs = None,
) -> None:
    """Run a small grid of both tests and compare it with the expected numbers that come with the package.

    On the platform that made the numbers every byte has to agree; elsewhere they have to be near.
    Exit code: 0 they agree, 1 they do not.
    """
    from midnet_bench.cli.progress import CampaignProgress
    from midnet_bench.errors import InputError
    from midnet_bench.experiments.campaigns import run_campaign
    from midnet_bench.workflows.campaigns import load_campaign
    from midnet_bench.workflows.report import write_report
    from midnet_bench.workflows.shipped import installed, shipped_folder
    from midnet_bench.workflows.smoke import differences_from_golden, update_golden

    if update and installed():
        raise InputError("smoke: --update changes the repository's numbers; run it in a checkout")
    lines: list[str] = []
    where = ""
    for name, tables in TABLES.items():
        directory = (output or options.RESULTS / "smoke") / name
        golden = shipped_folder(f"golden/{name}", f"results/reference/smoke/{name}")
        outcome = run_campaign(
            load_campaign(name),
            directory,
            jobs=jobs,
            fresh=True,
            progress=CampaignProgress(),
        )
        write_report(directory)
        if outcome.failed:
            lines.append(f"{name}: {outcome.failed} trials failed")
        elif update:
            update_golden(directory, golden, tables)
        else:
            same_platform, off = differences_from_golden(directory, golden, tables)
            where = "compared to the byte" if same_platform else "within another platform's bounds"
            lines += [f"{name}: {line}" for line in off]
    for line in lines:
        typer.echo(line)
    typer.echo("expected numbers updated" if update else f"{len(lines)} differences, {where}")
    if lines:
        raise typer.Exit(1)
