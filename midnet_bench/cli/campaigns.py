"""The commands that run campaigns: ``detection``, ``labyrinth``, ``run``, ``campaigns``."""

import dataclasses
import json
from collections.abc import Mapping
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from midnet_bench.cli import completion, messages, options
from midnet_bench.cli.app import command

if TYPE_CHECKING:
    from midnet_bench.campaign.definition import Campaign, Values
    from midnet_bench.campaign.runner import CampaignOutcome, Plan

MAX_REASONS = 5
"""different reasons that are told when trials fail; failures.csv has them all"""

FirstSeed = Annotated[
    int | None,
    typer.Option(
        min=0,
        metavar="N",
        help="First seed; further trials count up from it (default 1).",
    ),
]


@command("Campaigns", example="midnet-bench detection --seeds 20 -o results/twenty")
def detection(
    campaign: options.Campaign,
    robots: Annotated[
        str | None,
        typer.Option(
            metavar="N,N",
            help="Team sizes, separated by commas (default 1,5).",
        ),
    ] = None,
    frames: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="MIDNet frames per trial, 5 a second (default 1999).",
        ),
    ] = None,
    seed: FirstSeed = None,
    seeds: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Trials per team size, one seed each (default 1).",
        ),
    ] = None,
    intruders: Annotated[
        int | None,
        typer.Option(min=0, metavar="N", help="Burgers that intrude (default as in the arena)."),
    ] = None,
    arena: options.Arena = None,
) -> None:
    """Run the paper's detection test and print its table: precision, recall and F1, ours and the paper's.

    The same command again continues where it stopped, or prints the table of what is there.
    """
    _run_packaged(
        "detection",
        {
            "robots": _integers(robots, "--robots"),
            "frames": frames,
            "intruders": intruders,
            "arena": arena,
        },
        seeds,
        seed,
        campaign,
    )


@command("Campaigns", example="midnet-bench labyrinth --trials 5 --robots 1,3")
def labyrinth(
    campaign: options.Campaign,
    trials: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Trials per cell, one seed each (default 20).",
        ),
    ] = None,
    robots: Annotated[
        str | None,
        typer.Option(
            metavar="N,N",
            help="Team sizes, separated by commas (default 1,2,3,4,5).",
        ),
    ] = None,
    intruders: Annotated[
        str | None,
        typer.Option(
            metavar="N,N",
            help="Numbers of intruders, separated by commas (default 1,2,3,4,5).",
        ),
    ] = None,
    pursuit: options.Pursuit = None,
    seed: FirstSeed = None,
    arena: options.Arena = None,
) -> None:
    """Run the paper's labyrinth test: which share of the intruders is caught, by team size.

    One trial per team size and number of intruders is a cell. The same command again continues where it
    stopped; more trials are added to those that are there.
    """
    _run_packaged(
        "labyrinth",
        {
            "intruders": _integers(intruders, "--intruders"),
            "robots": _integers(robots, "--robots"),
            "arena": arena,
            "pursuit": pursuit,
        },
        trials,
        seed,
        campaign,
    )


@command("Campaigns", example="midnet-bench run readings --trials 2 --set frames=500")
def run(
    campaign: options.Campaign,
    file: Annotated[
        str,
        typer.Argument(
            metavar="CAMPAIGN",
            help="A campaign file, or the name of a packaged one; see 'midnet-bench campaigns'.",
            autocompletion=completion.campaigns,
        ),
    ],
    trials: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Trials per cell (default the campaign's).",
        ),
    ] = None,
    pursuit: options.Pursuit = None,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            metavar="N",
            help="First seed (default the campaign's).",
        ),
    ] = None,
) -> None:
    """Run a campaign; the same command again continues where it stopped."""
    from midnet_bench.campaign.definition import load_campaign, override
    from midnet_bench.workflows.campaigns import campaign_file

    written = load_campaign(campaign_file(file))
    _run(override(written, campaign.sweep({"pursuit": pursuit}), trials=trials, base_seed=seed), campaign)


@command("Campaigns", example="midnet-bench campaigns")
def campaigns(as_json: options.Json = False) -> None:
    """List the campaigns that come with the package; 'midnet-bench run NAME' runs one."""
    from midnet_bench.workflows.campaigns import packaged_campaigns, summary_of

    found = {name: summary_of(path) for name, path in packaged_campaigns().items()}
    if as_json:
        typer.echo(json.dumps(found, indent=1))
        return
    width = max(map(len, found))
    for name, summary in found.items():
        typer.echo(f"{name:{width}}  {summary}")


def _run_packaged(
    name: str,
    named: "Mapping[str, Values]",
    trials: int | None,
    seed: int | None,
    chosen: options.Campaign,
) -> None:
    """Run a packaged campaign with what the command line changes."""
    from midnet_bench.campaign.definition import load_campaign, override
    from midnet_bench.workflows.campaigns import packaged_campaigns

    written = load_campaign(packaged_campaigns()[name])
    _run(override(written, chosen.sweep(named), trials=trials, base_seed=seed), chosen)


def _run(campaign: "Campaign", chosen: options.Campaign) -> None:
    from midnet_bench.campaign.definition import resolve
    from midnet_bench.campaign.runner import plan, run_campaign
    from midnet_bench.cli.progress import CampaignProgress, compiling
    from midnet_bench.cli.reports import present
    from midnet_bench.experiments import registry
    from midnet_bench.experiments.campaigns import refuse_missing_engine
    from midnet_bench.experiments.warm_up import compile_ahead

    directory = chosen.output or options.RESULTS / campaign.name
    resolved = resolve(campaign, registry)
    for note in resolved.notes:
        messages.log.info("note: %s", note)
    if chosen.dry_run:
        ahead = plan(
            resolved,
            directory,
            jobs=chosen.jobs,
            backend=chosen.backend,
            scheduler=chosen.scheduler,
            retry_failed=chosen.retry_failed,
            fresh=chosen.fresh,
        )
        _tell_plan(resolved.definition.experiment, ahead, directory, chosen.as_json)
        return

    if (
        chosen.backend == "loky"
        and plan(
            resolved, directory, jobs=chosen.jobs, retry_failed=chosen.retry_failed, fresh=chosen.fresh
        ).to_run
    ):
        refuse_missing_engine(resolved)

    def prepare() -> None:
        if chosen.backend == "loky":  # Dask's workers may be other machines
            with compiling() as show:
                compile_ahead(resolved, show)

    outcome = run_campaign(
        resolved,
        directory,
        jobs=chosen.jobs,
        backend=chosen.backend,
        scheduler=chosen.scheduler,
        fresh=chosen.fresh,
        retry_failed=chosen.retry_failed,
        progress=CampaignProgress(),
        prepare=prepare,
    )
    present(directory, chosen.as_json, drawn_from=2)  # a lone point is no curve, and takes seconds to draw
    if not chosen.as_json:
        messages.tell_where(directory)
    if outcome.failed:
        raise typer.Exit(_tell_of_failures(outcome, directory / "failures.csv"))


def _tell_plan(experiment: str, ahead: "Plan", directory: Path, as_json: bool) -> None:
    if as_json:
        from midnet_bench.analysis.tables import Table, to_json

        table = Table("plan", "What would run", [dataclasses.asdict(ahead)])
        typer.echo(json.dumps(to_json(experiment, [table], directory=str(directory)), indent=1))
        return
    basis = (
        f"from {_counted(ahead.measured_on, 'finished trial')}"
        if ahead.measured_on
        else "before any trial is measured"
    )
    typer.echo(
        f"{_counted(ahead.cells, 'cell')}, {_counted(ahead.trials, 'trial')},"
        f" {ahead.to_run} of them to run; estimated {timedelta(seconds=round(ahead.wall_s))}"
        f" and {ahead.disk_bytes / 1e6:.1f} MB in {directory} ({basis})"
    )


def _tell_of_failures(outcome: "CampaignOutcome", file: Path) -> int:
    """Says why trials failed; the exit code: 2 if nothing but their input was wrong."""
    from midnet_bench.errors import InputError

    for reason, count in list(outcome.unusable.items())[:MAX_REASONS]:
        messages.log.error("error: %s (%s)", reason, _counted(count, "trial"))
    unusable = sum(outcome.unusable.values())
    if unusable:
        messages.log.error("%s could not use the input: see %s", _counted(unusable, "trial"), file)
    others = outcome.failed - unusable
    if others:
        messages.log.error("%s failed: see %s; --retry-failed tries again", _counted(others, "trial"), file)
    return 1 if others else InputError.exit_code


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _integers(text: str | None, option: str) -> "Values":
    from midnet_bench.errors import InputError

    if text is None:
        return None
    try:
        return [int(part) for part in text.split(",")]
    except ValueError as error:
        raise InputError(
            f"{option} {text}: expected whole numbers separated by commas, such as 1,5"
        ) from error
