"""``replay``: what the detector makes of a recording, whether its inputs fit, and why it errs."""

import csv
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np

from midnet_bench.analysis.tables import Table
from midnet_bench.errors import InputError
from midnet_bench.geometry import Box
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.files import cannot_be_written, draft_of, write_atomically
from midnet_bench.io.map_server import save_map
from midnet_bench.messages import Scan
from midnet_bench.recording import causes
from midnet_bench.recording.files.readings import NS, Source
from midnet_bench.recording.files.survey import Survey, survey
from midnet_bench.recording.fitting.localize import Localizer
from midnet_bench.recording.fitting.samples import samples_of
from midnet_bench.recording.fitting.setup_check import SetBy, find_setup, line_of
from midnet_bench.recording.inputs import (
    Note,
    ReplayWishes,
    file_names,
    labels_of,
    offsets_of,
    options_of,
    prepared,
    prior_map_of,
    settings_of,
    with_exported,
)
from midnet_bench.recording.plan import (
    AllyPlan,
    RobotPlan,
    allies_of,
    robots_of,
)
from midnet_bench.recording.ray_counts import RayCounts
from midnet_bench.recording.replay import Replay, ReplayFrame, ReplayOptions
from midnet_bench.recording.scores import ScoreOptions, Scorer, sector_of
from midnet_bench.recording.told import (
    cause_table,
    lag_lines,
    score_tables,
    setup_table,
    told_after,
    told_before,
    told_of_fit,
    unlabelled,
)
from midnet_bench.recording.truth import Label, Labels, LabelTable
from midnet_bench.recording.unmapped import csv_of, unmapped


@dataclass
class Replayed:
    """What came of it."""

    tables: list[Table]
    files: list[Path]
    faults: list[str]
    """what does not fit or could not be read; results are there all the same"""


def replay(wishes: ReplayWishes, note: Note, progress: Callable[[float], None]) -> Replayed:
    """Play recordings into the detectors of the presets; score and explain, and write the tables.

    Args:
        wishes: what is asked for.
        note: gets each line that a user is to see before the scores, as soon as it is known.
        progress: gets the share that is done, 0 to 1.

    Raises:
        InputError: the recordings, the map or an option cannot be used.
    """
    with prepared(wishes) as (filled, sources), ExitStack() as stack:
        return _replay(filled, sources, stack, note, progress)


def _replay(
    wishes: ReplayWishes,
    sources: Sequence[Source],
    stack: ExitStack,
    note: Note,
    progress: Callable[[float], None],
) -> Replayed:
    surveys = [survey(source) for source in sources]
    for source in sources:
        for remark in source.remarks:
            note(remark)
    wishes = with_exported(wishes, surveys)
    names = file_names([Path(source.path) for source in sources])
    robots = robots_of(surveys, wishes.recording, names)
    prior_map, until_ns = prior_map_of(wishes, surveys, robots, note)
    settings = settings_of(wishes, prior_map.resolution)
    main = settings[wishes.presets[0]]
    allies = allies_of(surveys, wishes.recording.ally, main.midnet.ally_diameter_m)
    table, label_topics = labels_of(wishes, surveys)
    if table is not None and table.by_index and len(robots) > 1:
        raise InputError(
            f"--truth {wishes.truth[0]}: scan_index does not say of which of {len(robots)} robots; label by t"
        )
    options = options_of(wishes, offsets_of(wishes, names))
    score_options = ScoreOptions(
        wishes.distance_m, None if wishes.sector is None else sector_of(wishes.sector), wishes.window_m
    )
    for line in told_before(surveys, robots, settings, wishes):
        note(line)
    faults: list[str] = []
    for robot in robots:
        faults += told_of_fit(surveys, robot, prior_map, options, note)
    correctors = [Localizer(prior_map) for _ in robots] if wishes.localize else []
    played = Replay(
        sources,
        robots,
        allies,
        prior_map,
        settings,
        options,
        followed=label_topics,
        correctors=correctors,
    )
    counts = RayCounts(prior_map.resolution, prior_map.origin, (prior_map.height, prior_map.width))
    explainers = {
        name: causes.Explainer(
            name,
            prior_map,
            played.nodes[name],
            one,
            counts,
            stack.enter_context(TemporaryFile()),  # noqa: SIM115
        )
        for name, one in settings.items()
    }
    scorers = {
        name: Scorer(name, explainers[name], one.range_m, score_options) for name, one in settings.items()
    }
    reach_m = 2.0 * max(one.range_m for one in settings.values())
    last: dict[int, Scan] = {}
    folder = wishes.output or Path("results") / f"replay-{names[0]}"
    first = wishes.presets[0]
    with _boxes_file(folder) as boxes, ExitStack() as drawn:
        append = None
        if wishes.film:
            from midnet_bench.workflows.replay_film import film  # drawing takes a while to import

            append = drawn.enter_context(
                film(
                    f"{names[0]}, preset {first}",
                    first,
                    played,
                    prior_map,
                    main,
                    frames_hz(surveys, robots, options),
                    labelled_at_once(table, label_topics),
                    folder,
                    # corrected poses are known on the way alone
                    None if wishes.localize else driven(Replay(sources, robots, [], prior_map, {}, options)),
                )
            )
        try:
            for frame in played.frames():
                if until_ns is not None and frame.time_ns < until_ns:
                    continue
                for one in frame.seen:
                    if one.scan is not None and one.scan is not last.get(one.robot):
                        last[one.robot] = one.scan
                        with suppress(InputError):  # a pose far off any map, of which boxes know nothing
                            counts.take(one.scan, one.returns, reach_m)
                labels = _labels(frame, table, wishes.max_pose_age_s)
                for name, scorer in scorers.items():
                    judged = scorer.take(frame, labels)
                    _write_boxes(boxes, frame, name)
                    if append is not None and name == first:
                        append(frame, judged, scorer.score)
                progress(played.done)
        except InputError as error:
            faults.append(str(error))
    progress(1.0)
    faults += told_after(played, wishes, note)
    if not played.tally.frames:
        raise InputError("; ".join(faults) or f"{wishes.files[0]}: no frame came of it")
    faults += unlabelled(wishes, table, scorers, played)
    counted = _write_errors(folder / "errors.csv", explainers)
    tables = [*score_tables(scorers, bool(wishes.truth)), cause_table(counted)]
    files = [folder / "boxes.csv", folder / "errors.csv"]
    for made in tables:
        files += made.write(folder)
    if wishes.film:
        files += [folder / "trial.mp4", folder / "storyboard.png"]
    if wishes.unmapped:
        files += write_unmapped(folder, counts, prior_map, played.nodes[first].prior, note)
    return Replayed(tables, files, faults)


def driven(replay: Replay) -> Box | None:
    """The box of all the positions of a replay's robots, map frame, metres; None if it has no frames.

    A fault in a recording ends it here and is reported by the replay that follows.
    """
    places: list[tuple[float, float]] = []
    with suppress(InputError):
        for frame in replay.frames():
            places += [(one.told.pose.x, one.told.pose.y) for one in frame.seen]
    if not places:
        return None
    return Box(*np.min(places, axis=0).tolist(), *np.max(places, axis=0).tolist())


def _labels(frame: ReplayFrame, table: LabelTable | None, max_age_s: float) -> Labels | None:
    if table is not None:
        return table.at(frame.time_ns, frame.scan_index)
    there = [
        Label(plan.name, told.pose.x, told.pose.y)
        for plan, told in frame.followed
        if told is not None and told.age_s <= max_age_s
    ]
    return Labels(there, []) if there else None


def frames_hz(surveys: Sequence[Survey], robots: Sequence[RobotPlan], options: ReplayOptions) -> float:
    """How many frames a second the recording gives."""
    if options.rate_hz is not None:
        return options.rate_hz
    scans = sum(surveys[one.source].streams[one.scan_topic].topic.messages for one in robots)
    return max(scans / max(max(one.duration_s for one in surveys), 0.1), 0.5)


def labelled_at_once(table: LabelTable | None, topics: Sequence[AllyPlan]) -> int:
    """How many objects there are labels of."""
    if table is None:
        return len(topics)
    names = {one.name for there in table.by_index.values() for one in there}
    return len(names | table.by_time.keys())


def write_unmapped(
    folder: Path, counts: RayCounts, prior_map: OccupancyGrid, prior: OccupancyGrid, note: Note
) -> list[Path]:
    """Write what stays put and is not on the map: ``unmapped.csv``, and the map with it."""
    things, patched = unmapped(counts, prior_map, prior)
    write_atomically(folder / "unmapped.csv", csv_of(things))
    save_map(patched, folder / "map_with_unmapped.yaml", comment="with what stays put and was not on it")
    note(f"{len(things)} things stay put and are not on the map; map_with_unmapped.yaml has them")
    return [folder / "unmapped.csv", folder / "map_with_unmapped.yaml"]


def check(wishes: ReplayWishes, note: Note) -> list[Table]:
    """Search for the setup by which scans lie best on the map; a table of its parameters for each robot.

    Raises:
        InputError: the recordings, the map or an option cannot be used.
    """
    tables = []
    with prepared(wishes) as (filled, sources):
        surveys = [survey(source) for source in sources]
        filled = with_exported(filled, surveys)
        robots = robots_of(surveys, filled.recording, file_names([Path(source.path) for source in sources]))
        prior_map, _ = prior_map_of(filled, surveys, robots, note)
        for robot in robots:
            for line in lag_lines(surveys, robot, filled.clock):
                note(line)
            samples = samples_of(surveys, robot, filled.clock, filled.max_pose_age_s, ())
            if not samples:
                raise InputError(f"{robot.name}: no scan of it has a pose; see 'midnet-bench replay FILE'")
            found = find_setup(samples, prior_map)
            set_by = SetBy(robot.is_mirrored, robot.delay_ns / NS)
            note(f"{robot.name}: {line_of(found, prior_map, set_by)}")
            for line in found.cannot_tell:
                note(f"{robot.name}: {line}")
            tables.append(setup_table(robot.name, found))
    return tables


@contextmanager
def _boxes_file(folder: Path) -> Iterator["csv._writer"]:  # type: ignore[name-defined]
    """``boxes.csv``, row by row; what was written stays, whatever ends the replay."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with open(folder / "boxes.csv", "w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(
                ["preset", "frame", "t", "scan_index", "robot", "x_min_m", "y_min_m", "x_max_m", "y_max_m"]
            )
            yield writer
    except OSError as error:
        raise cannot_be_written(folder / "boxes.csv", error) from error


def _write_boxes(writer: "csv._writer", frame: ReplayFrame, name: str) -> None:  # type: ignore[name-defined]
    look = frame.looks[name].frame
    for box, robot in zip(look.detections, look.robots, strict=True):
        index = "" if frame.scan_index is None else frame.scan_index
        who = frame.seen[robot].robot
        sides = [f"{side:.4f}" for side in box]
        writer.writerow([name, frame.number, f"{frame.time_ns / NS:.6f}", index, who, *sides])


def _write_errors(
    path: Path, explainers: Mapping[str, causes.Explainer]
) -> dict[str, Counter[tuple[str, str]]]:
    """Write every error, row by row; how many there are of each kind and cause, by preset."""
    counted: dict[str, Counter[tuple[str, str]]] = {}
    with draft_of(path) as draft, open(draft, "w", encoding="utf-8", newline="") as file:
        file.write(",".join(["preset", *causes.ErrorRow._fields]) + "\n")
        for name, explainer in explainers.items():
            counted[name] = Counter()
            for one in explainer.settled():
                cells = [f"{cell:.4f}" if isinstance(cell, float) else str(cell) for cell in one]
                file.write(",".join([name, *cells]) + "\n")
                counted[name][one.kind, one.cause] += 1
    return counted
