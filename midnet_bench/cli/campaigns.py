"""The commands that run campaigns, ``detection``, ``labyrinth``, ``run`` and ``size``, and ``report``."""

import dataclasses
import sys
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from midnet_bench.cli import messages, options
from midnet_bench.cli.app import command
from midnet_bench.cli.messages import counted, filled, print_json, print_lines, show, width
from midnet_bench.errors import InputError

if TYPE_CHECKING:
    from midnet_bench.campaign.runner import CampaignOutcome, Plan
    from midnet_bench.workflows.report import Report

EXECUTION = ("jobs", "backend", "scheduler", "fresh", "retry_failed")
"""options of how a campaign is run, none of which changes a number"""
MAX_REASONS = 5  # different reasons that are listed when trials fail; failures.csv has them all


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
        typer.Argument(
            metavar="[CAMPAIGN]",
            autocompletion=options.offer_campaigns,
            help="A campaign file, or the name of a packaged campaign; without it, they are listed.",
        ),
    ] = None,
) -> None:
    """Run a campaign, or list those that come with the package.

    The same command again continues where it stopped.
    """
    from midnet_bench.workflows.campaigns import campaign_file, packaged_campaigns, summary_of

    if file is not None:
        _run(campaign_file(file), campaign)
        return
    found = {name: summary_of(path) for name, path in packaged_campaigns().items()}
    if campaign.as_json:
        print_json(found)
        return
    indent = max(map(len, found)) + 2
    for name, summary in found.items():
        first, *more = filled(summary, max(20, width() - indent)) or [""]
        typer.echo("\n".join([f"{name:{indent}}{first}", *(" " * indent + line for line in more)]))


def _run_packaged(name: str, chosen: options.Campaign) -> None:
    from midnet_bench.workflows.campaigns import packaged_campaigns

    _run(packaged_campaigns()[name], chosen)


def _run(file: Path, chosen: options.Campaign) -> None:
    """Run the campaign in a file, with what the command line changes, and print its results."""
    from midnet_bench.campaign.definition import load_campaign, override, resolve
    from midnet_bench.campaign.runner import plan
    from midnet_bench.cli.progress import CampaignProgress, compiling
    from midnet_bench.experiments import registry
    from midnet_bench.workflows.campaigns import recorded_if_small, run_resolved

    written = load_campaign(file)
    changes = chosen.sweep(written.experiment)
    campaign = override(written, changes, trials=chosen.seeds, base_seed=chosen.seed)
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
        _log_page(directory)
    if outcome.failed:
        raise typer.Exit(_log_failures(outcome, directory / "failures.csv"))


def _print_plan(experiment: str, ahead: "Plan", directory: Path, as_json: bool) -> None:
    if as_json:
        from midnet_bench.analysis.tables import Table

        table = Table("plan", "What would run", [dataclasses.asdict(ahead)])
        show(experiment, [table], as_json, directory=str(directory))
        return
    measured = ahead.measured_on
    basis = f"from {counted(measured, 'finished trial')}" if measured else "before any trial is measured"
    typer.echo(
        f"{counted(ahead.cells, 'cell')}, {counted(ahead.trials, 'trial')}, {ahead.to_run} of them to run;"
        f" estimated {timedelta(seconds=round(ahead.wall_s))}"
        f" and {ahead.disk_bytes / 1e6:.1f} MB in {directory} ({basis})"
    )


def _log_failures(outcome: "CampaignOutcome", file: Path) -> int:
    """Say why trials failed; the exit code: 2 if nothing but their input was wrong."""
    for reason, count in list(outcome.unusable.items())[:MAX_REASONS]:
        messages.log.error("error: %s (%s)", reason, counted(count, "trial"))
    unusable = sum(outcome.unusable.values())
    if unusable:
        messages.log.error("%s could not use the input: see %s", counted(unusable, "trial"), file)
    if others := outcome.failed - unusable:
        messages.log.error("%s failed: see %s; --retry-failed tries again", counted(others, "trial"), file)
    return 1 if others else InputError.exit_code


@command(example="midnet-bench report results/detection --x thresh_local --y f1 --format pdf")
def report(
    directory: options.ResultsFolder,
    x: Annotated[
        str | None, typer.Option(metavar="FACTOR", help="Draw scores over this numeric factor of the grid.")
    ] = None,
    y: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN", help="Which score, such as f1, or another column (default the main scores)."
        ),
    ] = None,
    formats: Annotated[
        str | None,
        typer.Option(
            "--format", metavar="NAME,NAME", help="Formats of the figures: pdf, png, svg (default png,svg)."
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="PATH",
            help="Draw the figures only, into this folder, or one figure into this .pdf, .png or .svg file.",
        ),
    ] = None,
    trust: options.Trust = False,
    as_json: options.Json = False,
    wide: options.Wide = False,
) -> None:
    """Rebuild all tables, figures and the page from the stored trials, without simulating.

    With --x, --y, --format or -o only figures are drawn.
    """
    if x or y or formats or output:
        from midnet_bench.workflows.report import plot

        wanted = None if formats is None else [part.strip() for part in formats.split(",")]
        for file in plot(directory, output, x, y, wanted):
            typer.echo(file)
        return
    if not present(directory, as_json, wide=wide):
        hint = "; see failures.csv there" if (directory / "failures.csv").exists() else ""
        raise InputError(f"{directory}: no finished trial yet{hint}")
    if not as_json:
        _log_page(directory)


def present(directory: Path, as_json: bool, drawn_from: int = 1, wide: bool = False) -> bool:
    """Print a campaign's result, then write its figures and its page; whether any trial finished.

    CSV files and tables are written first. Figures are drawn from ``drawn_from`` finished trials on.
    ``wide``: print the main tables whole.
    """
    from midnet_bench.workflows.report import write_report

    def show_tables(report: "Report") -> None:
        _show_report(report, as_json, wide)
        sys.stdout.flush()
        if report.results.finished >= drawn_from and not as_json:
            messages.note("drawing figures and the page")

    return write_report(directory, drawn_from, before_drawing=show_tables).results.finished > 0


def _show_report(report: "Report", as_json: bool, wide: bool) -> None:
    results, tables, printed, first = report
    if results.definition.variants and results.finished:  # the protocol has some; others load no detectors
        from midnet_bench.workflows import ranking

        if ranking.is_standard(results.definition):
            first = ranking.standard_headline(results)
    if as_json:
        show(results.definition.experiment, tables, as_json)
    elif first is not None and not wide:
        show(None, first.tables)
        print_lines([*first.conclusion, *first.notes, "", first.following])
    elif results.finished:
        show(None, printed, wide=wide)


def _log_page(directory: Path) -> None:
    """The last line of a command that wrote a campaign's page: what to open."""
    page = directory / "report.html"
    if page.exists():
        messages.note(f"Open {page}")
    else:
        messages.log_folder(directory)


@command(example="midnet-bench size office --within 60 --probability 0.9")
def size(
    arena: options.ArenaFile,
    within: Annotated[
        float, typer.Option(metavar="S", help="Time in which an intruder has to be found, from its entry.")
    ] = 60.0,
    probability: Annotated[
        float, typer.Option(metavar="P", help="With which probability it has to be found, at least.")
    ] = 0.9,
    capture: Annotated[
        bool, typer.Option("--capture", help="It has to be caught: a guard within capture_distance_m.")
    ] = False,
    intruders: Annotated[
        str | None,
        typer.Option(
            metavar="PLACES",
            help="Where an intruder enters: doors, anywhere, or 'X,Y X,Y' in metres (default doors if the "
            "outer wall has gaps, else anywhere).",
        ),
    ] = None,
    robots: Annotated[str | None, typer.Option(metavar="N,N", help="Team sizes (default 1,2,3,4,5).")] = None,
    engine: options.Plugin = None,
    robot_model: options.Plugin = None,
    detector: options.Plugin = None,
    fusion: options.Plugin = None,
    patrol: options.Plugin = None,
    pursuit: options.Plugin = None,
    settings: options.Settings = None,
    trials: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Trials of each team size (default 100).")
    ] = None,
    seed: options.Seed = 1,
    jobs: options.Jobs = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder for the results (default results/size-ARENA)."
        ),
    ] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Run all trials anew.")] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", "-n", help="Say what it would cost, and stop.")
    ] = False,
    as_json: options.Json = False,
) -> None:
    """Find the smallest team that finds an intruder in time, for a building, its robots and a patrol.

    Runs the packaged campaign 'size': the intruder stays in the building until it is found or the time is
    over, and each team size meets it on the same seeds. The same command again continues where it stopped.
    """
    from midnet_bench.cli.progress import CampaignProgress, compiling
    from midnet_bench.workflows import size as workflow

    chosen = {"engine": engine, "robot": robot_model, "detector": detector, "fusion": fusion}
    parameters = options.joined({**chosen, "patrol": patrol, "pursuit": pursuit}, settings)
    options.check_values("labyrinth", parameters, "--set {key}=")
    sizes = None if robots is None else options.whole_numbers(robots, "--robots")
    options.check_values("labyrinth", {"robots": sizes}, "--{key}")
    question = workflow.Question(
        arena, within, probability, capture, intruders, parameters, sizes, trials, seed
    )
    question, building, notes = workflow.ask(question)
    for text in notes:
        messages.note(f"note: {text}")
    directory = output or options.RESULTS / f"size-{building.name}"
    if dry_run:
        _print_plan("labyrinth", workflow.plan_of(question, directory, jobs, fresh), directory, as_json)
        return
    answer = workflow.size(
        question, directory, jobs=jobs, fresh=fresh, compiling=compiling, progress=CampaignProgress()
    )
    workflow.write(answer, building, directory)
    if as_json:
        show("size", [answer.table, answer.places], as_json, answer=answer.sentences)
        return
    first, *others = answer.sentences
    print_lines([first, ""])
    show(None, [answer.table])
    print_lines(others)
    messages.log_folder(directory)
