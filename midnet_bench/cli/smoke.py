"""The command that continuous integration runs: ``smoke``."""

from pathlib import Path
from typing import Annotated

import typer

from midnet_bench.cli import options
from midnet_bench.cli.app import app

GOLDEN = Path("results/reference/smoke")
TABLES = {
    "smoke-detection": ("scores", "robots"),
    "smoke-labyrinth": ("trial", "intruders", "robots"),
}
"""Campaign of ``campaigns/`` -> its tables that have golden numbers."""


@app.command(rich_help_panel="Campaigns")
def smoke(
    update: Annotated[bool, typer.Option(help="Make this run's numbers the golden ones.")] = False,
    output: options.Output = None,
    jobs: options.Jobs = None,
) -> None:
    """Run a small grid of both tests and compare it with the committed numbers; in a checkout only."""
    from midnet_bench.campaign.progress import progress_on
    from midnet_bench.experiments.campaigns import load_campaign, run_campaign
    from midnet_bench.workflows.report import write_report
    from midnet_bench.workflows.smoke import differences_from_golden, update_golden

    lines: list[str] = []
    where = ""
    for name, tables in TABLES.items():
        directory = (output or Path("results/smoke")) / name
        campaign = load_campaign(Path("campaigns") / f"{name}.yaml")
        outcome = run_campaign(campaign, directory, jobs=jobs, fresh=True, progress=progress_on())
        write_report(directory)
        if outcome.failed:
            lines.append(f"{name}: {outcome.failed} trials failed")
        elif update:
            update_golden(directory, GOLDEN / name, tables)
        else:
            same_platform, off = differences_from_golden(directory, GOLDEN / name, tables)
            where = "compared to the byte" if same_platform else "within another platform's bounds"
            lines += [f"{name}: {line}" for line in off]
    for line in lines:
        typer.echo(line)
    typer.echo("golden numbers made anew" if update else f"{len(lines)} differences from golden, {where}")
    if lines:
        raise typer.Exit(1)
