"""The commands that look at results and trials: ``compare``, ``verify``, ``errors`` and ``render``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from midnet_bench.cli import messages, options
from midnet_bench.cli.app import command
from midnet_bench.cli.messages import print_lines, show
from midnet_bench.errors import InputError

if TYPE_CHECKING:
    from midnet_bench.workflows.verify import Verified


@command(example="midnet-bench compare results/one results/other -o results/comparison")
def compare(
    directories: Annotated[
        list[Path],
        options.results_folder(
            "DIR...", "Two or more folders of campaigns of one experiment; one with --by, --rank or --exact."
        ),
    ],
    by: Annotated[
        str | None,
        typer.Option(
            metavar="FACTOR", help="A factor of the only campaign's grid, such as engine: compare its values."
        ),
    ] = None,
    baseline: Annotated[
        str | None,
        typer.Option(
            metavar="VALUE", help="The factor's value that the others are compared with (default the first)."
        ),
    ] = None,
    fail_if_worse: Annotated[
        str | None,
        typer.Option(
            metavar="MEASURE",
            help="Exit code 1 if this score, such as f1, is significantly worse than the first's.",
        ),
    ] = None,
    rank: Annotated[
        bool,
        typer.Option(
            "--rank", help="Rank what the only campaign compares, the best first, and write leaderboard.md."
        ),
    ] = False,
    of: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FACTOR",
            help="With --rank: a factor whose values are ranked; may be repeated (default: those that name "
            "code, such as detector and fusion).",
        ),
    ] = None,
    rank_by: Annotated[
        str | None, typer.Option(metavar="SCORE", help="With --rank: the score, such as f1.")
    ] = None,
    exact: Annotated[
        bool,
        typer.Option(
            "--exact",
            help="Compare each number with those that are committed: of the packaged campaign of the "
            "folder's name, or in a second folder. Exit code 1 if any is off.",
        ),
    ] = False,
    update: Annotated[
        bool, typer.Option("--update", help="With --exact: commit this run's numbers instead; in a checkout.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="PATH",
            help="Also write tables and figures into this folder; with --rank, the page into this file.",
        ),
    ] = None,
    trust: options.Trust = False,
    as_json: options.Json = False,
    wide: options.Wide = False,
) -> None:
    """Compare campaigns on the seeds they share: each score's difference, and the settings that differ.

    Numbers that are compared exactly have to agree in every byte on the platform that made them; elsewhere
    they have to be near.
    """
    if exact or update:
        from midnet_bench.workflows.verify import compare_exactly

        if len(directories) > 2:
            raise InputError(
                "compare: --exact compares one folder with the committed numbers, or two folders"
            )
        lines, how = compare_exactly(*directories, update=update)
        how = "expected numbers updated" if update else f"{messages.counted(len(lines), 'difference')}, {how}"
        typer.echo("\n".join([*lines, how]))
        raise typer.Exit(1 if lines else 0)
    if rank or of or rank_by:
        from midnet_bench.workflows import ranking

        if len(directories) != 1:
            raise InputError("compare: --rank ranks one campaign; give one folder")
        page = output or directories[0] / "leaderboard.md"
        if page.suffix != ".md":
            raise InputError(f"-o {page}: the ranking is a page of Markdown; give a name that ends in .md")
        tables = ranking.rank(directories[0], of or [], rank_by)
        ranking.write_ranking(directories[0], tables, page)
        show(None, tables, as_json, wide)
        if not as_json:
            messages.note(f"written to {page}")
        return
    from midnet_bench.workflows import compare as workflow

    found = workflow.compare(directories, by, baseline)
    if output is not None:
        from midnet_bench.workflows.report import write_comparison

        write_comparison(found, output)
    regressions = [] if fail_if_worse is None else workflow.worse(found, fail_if_worse)
    if as_json or wide:
        show(found.experiment.name, found.tables, as_json, wide)
    else:
        lines, tables = workflow.shown(found)
        print_lines([*lines, ""])
        show(None, tables)
    if output is not None and not as_json:
        messages.log_folder(output)
    for line in regressions:
        messages.log.error("%s", line)
    raise typer.Exit(1 if regressions else 0)


@command(example="midnet-bench verify results/labyrinth")
def verify(
    directory: options.ResultsFolder,
    everything: Annotated[
        bool, typer.Option("--all", help="List the claims that hold or are within, too.")
    ] = False,
    difference: Annotated[
        float | None,
        typer.Option(
            metavar="POINTS",
            help="Instead, say how many trials show a change of the labyrinth's success rate by so many "
            "percentage points.",
        ),
    ] = None,
    robots: Annotated[
        str | None, typer.Option(metavar="N,N", help="With --difference: the two team sizes (default 4,5).")
    ] = None,
    probability: Annotated[
        float | None,
        typer.Option(
            "--power", metavar="P", help="With --difference: probability of detecting it (default 0.8)."
        ),
    ] = None,
    trust: options.Trust = False,
    as_json: options.Json = False,
    wide: options.Wide = False,
) -> None:
    """Check each claim of the paper against your results.

    Directions and causes hold, do not hold, or are inconclusive. A number of the paper's only run is within
    or outside the range of our runs.

    Exit code: 0 all hold or are within, 3 some are inconclusive, 4 some do not hold or are outside.
    """
    from midnet_bench.workflows import verify as workflow

    if difference is not None:
        sizes = options.whole_numbers(robots or "4,5", "--robots")
        if not isinstance(sizes, list) or len(sizes) != 2:
            raise InputError(f"--robots {robots}: give two team sizes, such as 4,5")
        power = 0.8 if probability is None else probability
        name, table = workflow.power_report(directory, difference, (sizes[0], sizes[1]), power)  # type: ignore[arg-type]
        show(name, [table], as_json, wide)
        return
    if robots is not None or probability is not None:
        raise InputError("verify: --robots and --power go with --difference; give it, such as --difference 5")
    found = workflow.verify(directory)
    if as_json or wide:
        show(found.experiment, [found.table], as_json, wide)
    else:
        _show_claims(directory, found, everything)
    raise typer.Exit(found.code)


def _show_claims(directory: Path, found: "Verified", everything: bool) -> None:
    """The counts first, then each claim with its numbers; of too few seeds the counts alone."""
    from midnet_bench.analysis.claims import UNSURPRISING, is_decided, lines_by_verdict

    print_lines([found.summary])
    if not is_decided(found.table):
        return
    for verdict, claims in lines_by_verdict(found.table, everything).items():
        print_lines(["", verdict])
        for claim, words in claims:
            print_lines([claim])
            print_lines([words], indent="    ")
    print_lines([""])
    unlisted = sum(row["verdict"] in UNSURPRISING for row in found.table.rows)
    if unlisted and not everything:
        print_lines([f"holds, or is within: {messages.counted(unlisted, 'claim')}; --all lists them."])
    if (file := directory / "claims.csv").exists():
        print_lines([f"Each in {file}"])


@command(example="midnet-bench errors results/detection --robots 5 --seed 3 --frame 60")
def errors(
    directory: options.ResultsFolder,
    robots: Annotated[int | None, typer.Option(metavar="N", help="Only trials with this team size.")] = None,
    where: options.Where = None,
    seed: Annotated[int | None, typer.Option(help="Only this seed's trials.")] = None,
    frame: Annotated[
        int | None, typer.Option(help="Explain each error of this frame, counted from 1, in a line.")
    ] = None,
    grids: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="With --frame: draw each guard's grids A to D into this folder; the trial runs again.",
        ),
    ] = None,
    steps: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="With --frame: walk the frame through the paper's equations, a page in this folder; the "
            "trial runs again, recorded or not.",
        ),
    ] = None,
    guard: Annotated[
        int | None, typer.Option(metavar="N", help="With --steps: whose grids are shown, from 1.")
    ] = None,
    versus: Annotated[
        Path | None,
        typer.Option(
            metavar="OTHER_DIR",
            help="Another recorded campaign: count errors of both, and of one alone, by cause.",
        ),
    ] = None,
    versus_where: Annotated[
        list[str] | None, typer.Option(metavar="FACTOR=VALUE", help="As --where, of the other campaign.")
    ] = None,
    trust: options.Trust = False,
    as_json: options.Json = False,
    wide: options.Wide = False,
) -> None:
    """List the causes of missed intruders and false boxes in a recorded campaign.

    Trials are recorded with '--record'. --frame explains one frame; --versus compares two campaigns.
    """
    from midnet_bench.workflows import errors as workflow

    own = [*(where or ()), *([] if robots is None else [f"robots={robots}"])]
    if versus is not None:
        if seed is not None or frame is not None or grids is not None:
            raise InputError("errors: --versus compares campaigns; leave out --seed, --frame and --grids")
        show(None, [workflow.versus(directory, versus, own, versus_where or own)], as_json, wide)
    elif frame is None:
        if grids is not None or steps is not None:
            option = "--grids draws" if steps is None else "--steps walks through"
            raise InputError(f"errors: {option} one frame; give --frame, such as --frame 60")
        show(None, workflow.errors(directory, own, seed), as_json, wide)
    elif steps is not None:
        from midnet_bench.workflows.steps import steps_of_trial

        for file in steps_of_trial(directory, seed, frame, own, steps, guard):
            typer.echo(file)
    else:
        table = workflow.explain(directory, seed, frame, own)
        if as_json:
            show(None, [table], as_json)
        else:
            print_lines([table.title, *(str(row["line"]) for row in table.rows)])
            if grids is None:
                player = directory / "report.html"
                print_lines([f"To draw this frame add --grids DIR. The player in {player} shows all frames."])
        if grids is not None:
            workflow.grids(directory, seed, frame, own, grids)
            if not as_json:
                messages.log_folder(grids)


@command(example="midnet-bench render labyrinth --robots 3 --intruders 2 --seed 4")
def render(
    experiment: Annotated[
        str,
        typer.Argument(autocompletion=options.offer_experiments, help="detection, labyrinth, or your own."),
    ] = "detection",
    robots: Annotated[int | None, typer.Option(metavar="N", help="Security robots (default 5).")] = None,
    intruders: options.Number = None,
    frames: options.Number = None,
    seed: options.Seed = options.SEED,
    frame: Annotated[
        int | None,
        typer.Option(
            metavar="N", help="Which frame the pictures show, counted from 1 (default 100 or the last)."
        ),
    ] = None,
    clip: Annotated[
        bool, typer.Option("--clip/--no-clip", help="Make a film (MP4) and a storyboard of the whole trial.")
    ] = True,
    speed: Annotated[
        float, typer.Option(metavar="FACTOR", help="How much faster than real time the film runs.")
    ] = 4.0,
    scans: Annotated[
        bool, typer.Option("--scans/--no-scans", help="Show the returns of the robots' LiDARs.")
    ] = False,
    arena: options.Arena = None,
    engine: options.Plugin = None,
    robot_model: options.Plugin = None,
    map_file: options.Map = None,
    settings: options.Settings = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder for the pictures (default results/render-...)."
        ),
    ] = None,
) -> None:
    """Draw one trial: the arena from above, each robot's grids A to D, the detections, and a film."""
    from midnet_bench.cli.progress import meter
    from midnet_bench.experiments import registry
    from midnet_bench.workflows.render import render_trial

    chosen = {"robots": robots, "intruders": intruders, "frames": frames, "arena": arena}
    chosen |= {"engine": engine, "robot": robot_model}
    parameters = options.joined(chosen, settings, map_file)
    found = registry.experiment(experiment)
    options.check_values(experiment, chosen, "--{key}")
    if "robots" in found.parameters.defaults():
        parameters = {"robots": options.ROBOTS, **parameters}
    directory = output or options.RESULTS / f"render-{found.name}-{seed}"
    with meter() as bar:
        files = render_trial(
            *(experiment, parameters, seed, directory, frame, clip),
            progress=lambda done, most: bar.show(done, most, f"frame {done} of at most {most}"),
            speed=speed,
            scans=scans,
        )
    for file in files:
        typer.echo(file)
