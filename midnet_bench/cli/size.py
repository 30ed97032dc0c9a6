"""The command that answers how many robots a building needs: ``size``."""

from datetime import timedelta
from pathlib import Path
from typing import Annotated

from midnet_bench.cli import completion, messages, options
from midnet_bench.cli.app import command, print_json
from midnet_bench.cli.reports import print_lines, show


@command(example="midnet-bench size office --within 60 --probability 0.9")
def size(
    arena: Annotated[str, options.argument("ARENA", "A packaged arena or a YAML file.", completion.arenas)],
    within: Annotated[
        float, options.option("S", "Time in which an intruder has to be found, from its entry.")
    ] = 60.0,
    probability: Annotated[
        float, options.option("P", "With which probability it has to be found, at least.")
    ] = 0.9,
    capture: Annotated[
        bool, options.flag("It has to be caught: a guard within capture_distance_m.", "--capture")
    ] = False,
    intruders: Annotated[
        str | None,
        options.option(
            "PLACES",
            "Where an intruder enters: doors, anywhere, or 'X,Y X,Y' in metres (default doors if the "
            "outer wall has gaps, else anywhere).",
        ),
    ] = None,
    engine: options.Engine = None,
    robot_model: options.RobotModel = None,
    detector: options.Part = None,
    fusion: options.Part = None,
    patrol: options.Part = None,
    pursuit: options.Part = None,
    settings: options.Settings = None,
    trials: Annotated[int, options.option("N", "Most trials of each team size, a multiple of 40.")] = 400,
    seed: options.Seed = 1,
    jobs: options.Jobs = None,
    output: Annotated[
        Path | None, options.output_option("DIR", "Folder for the results (default results/size-ARENA).")
    ] = None,
    fresh: Annotated[bool, options.flag("Run all trials anew.", "--fresh")] = False,
    dry_run: Annotated[bool, options.flag("Say what it would cost, and stop.", "--dry-run", "-n")] = False,
    as_json: options.Json = False,
) -> None:
    """Find the smallest team that finds an intruder in time, for a building, its robots and a patrol.

    Teams of 1, 2, 4, 8 ... guards are tried until one is enough, then those between. The same command again
    continues where it stopped.
    """
    from midnet_bench.analysis.tables import to_json
    from midnet_bench.workflows import size as workflow

    chosen = {"engine": engine, "robot": robot_model, "detector": detector, "fusion": fusion}
    chosen |= {"patrol": patrol, "pursuit": pursuit}
    parameters = options.joined(chosen, settings)
    options.check_values("labyrinth", parameters, "--set {key}=")
    question = workflow.Question(arena, within, probability, capture, intruders, parameters, trials, seed)
    question, building, notes = workflow.ask(question)
    for text in notes:
        messages.note(f"note: {text}")
    least_s, most_s = workflow.cost_of(question, building, jobs)
    clear, unclear = (timedelta(seconds=round(time_s)) for time_s in (least_s, most_s))
    messages.note(
        f"Up to {trials} trials of {within:g} s for each team size: about {clear} if the answer is clear, "
        f"{unclear} if it is not."
    )
    if dry_run:
        return
    directory = output or options.RESULTS / f"size-{building.name}"
    answer = workflow.size(
        question,
        building,
        directory,
        jobs=jobs,
        fresh=fresh,
        note=messages.note,
    )
    workflow.write(answer, building, directory)
    if as_json:
        document = to_json("size", [answer.table, answer.places], answer=answer.sentences)
        print_json(document)
        return
    first, *others = answer.sentences
    print_lines([first, ""])
    show(None, [answer.table], as_json=False)
    print_lines(others)
    messages.log_folder(directory)
