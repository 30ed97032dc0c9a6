"""The commands that run campaigns: ``detection``, ``labyrinth``, ``run``."""

import dataclasses
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from midnet_bench.cli import completion, messages, options
from midnet_bench.cli.app import command, print_json

if TYPE_CHECKING:
    from midnet_bench.campaign.definition import Campaign
    from midnet_bench.campaign.runner import CampaignOutcome, Plan

EXECUTION = ("jobs", "backend", "scheduler", "fresh", "retry_failed")
"""options of how a campaign is run, none of which changes a number"""
MAX_REASONS = 5
"""different reasons that are listed when trials fail; failures.csv has them all"""


@command(example="midnet-bench detection --seeds 20 -o results/twenty")
def detection(campaign: options.Campaign) -> None:
    """Run the paper's detection test and print its table: precision, recall and F1 beside the paper's.

    The same command again continues where it stopped, or prints the table of what is there.
    """
    _run_packaged("detection", campaign)


@command(example="midnet-bench labyrinth --seeds 5 --robots 1,3")
def labyrinth(campaign: options.Campaign) -> None:
    """Run the paper's labyrinth test: the share of intruders that each team size catches.

    Every team size meets every number of intruders. The same command again continues where it stopped; more
    seeds are added to those that are there.
    """
    _run_packaged("labyrinth", campaign)


@command(example="midnet-bench run readings --seeds 2 --set frames=500")
def run(
    campaign: options.Campaign,
    file: Annotated[
        str | None,
        options.argument(
            "[CAMPAIGN]",
            "A campaign file, or the name of a packaged campaign; without it, they are listed.",
            completion.campaigns,
        ),
    ] = None,
) -> None:
    """Run a campaign, or list those that come with the package.

    The same command again continues where it stopped.
    """
    from midnet_bench.workflows.campaigns import campaign_file

    if file is None:
        _list_campaigns(campaign.as_json)
    else:
        _run_file(campaign_file(file), campaign)


def _list_campaigns(as_json: bool) -> None:
    """The packaged campaigns, each with what it is for."""
    from midnet_bench.cli.terminal import filled, width
    from midnet_bench.workflows.campaigns import packaged_campaigns, summary_of

    found = {name: summary_of(path) for name, path in packaged_campaigns().items()}
    if as_json:
        print_json(found)
        return
    indent = max(map(len, found)) + 2
    for name, summary in found.items():
        first, *more = filled(summary, max(20, width() - indent)) or [""]
        typer.echo("\n".join([f"{name:{indent}}{first}", *(" " * indent + line for line in more)]))


def _run_packaged(name: str, chosen: options.Campaign) -> None:
    from midnet_bench.workflows.campaigns import packaged_campaigns

    _run_file(packaged_campaigns()[name], chosen)


def _run_file(file: Path, chosen: options.Campaign) -> None:
    """Run the campaign in a file, with what the command line changes."""
    from midnet_bench.campaign.definition import load_campaign, override

    written = load_campaign(file)
    changes = chosen.sweep(written.experiment)
    _run(override(written, changes, trials=chosen.seeds, base_seed=chosen.seed), chosen)


def _run(campaign: "Campaign", chosen: options.Campaign) -> None:
    from midnet_bench.campaign.definition import resolve
    from midnet_bench.campaign.runner import plan
    from midnet_bench.cli.progress import CampaignProgress, compiling
    from midnet_bench.cli.reports import log_page, present
    from midnet_bench.experiments import registry
    from midnet_bench.experiments.campaigns import run_resolved
    from midnet_bench.workflows.campaigns import recorded_if_small

    directory = chosen.output or options.RESULTS / campaign.name
    resolved = resolve(campaign, registry)
    for note in resolved.notes:
        messages.note(f"note: {note}")
    given = {name: getattr(chosen, name) for name in EXECUTION}
    if chosen.dry_run:
        ahead = plan(resolved, directory, **given)
        _print_plan(resolved.definition.experiment, ahead, directory, chosen.as_json)
        return
    small = recorded_if_small(resolved)
    outcome = run_resolved(small, directory, compiling, progress=CampaignProgress(), **given)
    present(directory, chosen.as_json, 2, chosen.wide)  # a lone point is no curve, and takes seconds to draw
    if not chosen.as_json:
        log_page(directory)
    if outcome.failed:
        raise typer.Exit(_log_failures(outcome, directory / "failures.csv"))


def _print_plan(experiment: str, ahead: "Plan", directory: Path, as_json: bool) -> None:
    if as_json:
        from midnet_bench.analysis.tables import Table, to_json

        table = Table("plan", "What would run", [dataclasses.asdict(ahead)])
        print_json(to_json(experiment, [table], directory=str(directory)))
        return
    basis = (
        f"from {messages.counted(ahead.measured_on, 'finished trial')}"
        if ahead.measured_on
        else "before any trial is measured"
    )
    typer.echo(
        f"{messages.counted(ahead.cells, 'cell')}, {messages.counted(ahead.trials, 'trial')},"
        f" {ahead.to_run} of them to run; estimated {timedelta(seconds=round(ahead.wall_s))}"
        f" and {ahead.disk_bytes / 1e6:.1f} MB in {directory} ({basis})"
    )


def _log_failures(outcome: "CampaignOutcome", file: Path) -> int:
    """Says why trials failed; the exit code: 2 if nothing but their input was wrong."""
    from midnet_bench.errors import InputError

    for reason, count in list(outcome.unusable.items())[:MAX_REASONS]:
        messages.log.error("error: %s (%s)", reason, messages.counted(count, "trial"))
    unusable = sum(outcome.unusable.values())
    if unusable:
        messages.log.error("%s could not use the input: see %s", messages.counted(unusable, "trial"), file)
    others = outcome.failed - unusable
    if others:
        messages.log.error(
            "%s failed: see %s; --retry-failed tries again", messages.counted(others, "trial"), file
        )
    return 1 if others else InputError.exit_code
