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
from midnet_bench.detectors.events import Events
from midnet_bench.errors import InputError
from midnet_bench.geometry import Box, Scan
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.files import cannot_be_written, temporary_path, write_atomically
from midnet_bench.io.map_server import save_map
from midnet_bench.recording import causes
from midnet_bench.recording.files.readings import NS
from midnet_bench.recording.fitting.fit import samples_of
from midnet_bench.recording.fitting.setup_check import Proposal, SetBy, find_setup, line_of, start_of
from midnet_bench.recording.inputs import Note, ReplayInputs, prepared
from midnet_bench.recording.plan import AllyPlan
from midnet_bench.recording.ray_counts import RayCounts, Unmapped, unmapped
from midnet_bench.recording.replay import Replay, ReplayFrame
from midnet_bench.recording.replay_bag import check_place, replay_bag
from midnet_bench.recording.scores import FrameScore, Scorer
from midnet_bench.recording.setup import EVERY, RecordingSetup
from midnet_bench.recording.summary import (
    cause_table,
    event_rows,
    event_table,
    input_summary,
    lag_lines,
    replay_faults,
    report_fit,
    score_tables,
    setup_table,
    unlabelled,
)
from midnet_bench.recording.truth import Label, Labels, LabelTable

SETUP_FILE = "setup.yaml"


@dataclass
class Replayed:
    """Results of ``replay`` or ``check``."""

    tables: list[Table]
    files: list[Path]
    faults: list[str]
    """what does not fit or could not be read; results are there all the same"""


def replay(
    files: Sequence[Path],
    setup: RecordingSetup,
    note: Note,
    progress: Callable[[float], None],
    film: bool = False,
    output: Path | None = None,
    bag: Path | None = None,
) -> Replayed:
    """Play recordings into the detectors of the presets; score and explain, and write the tables.

    Args:
        files: of one recording each.
        setup: topics, frames, clocks, map, labels and detector options.
        note: gets each line that a user is to see before the scores, as soon as it is known.
        progress: gets the share that is done, 0 to 1.
        film: whether ``trial.mp4`` and ``storyboard.png`` are drawn.
        output: the folder of the results, default ``results/replay-NAME``.
        bag: what was found is written to it too, as topics of ROS.

    Raises:
        InputError: the recordings, the map or a key of the setup cannot be used.
    """
    if bag is not None:
        check_place(bag, [*files, Path(setup.background or files[0])])
    with prepared(files, setup, note) as inputs, ExitStack() as stack:
        run = _Run(inputs, _folder(inputs, output), stack)
        for line in input_summary(inputs, run.settings):
            note(line)
        faults = [line for robot in inputs.robots for line in report_fit(inputs, robot, note)]
        run.play(film, bag, progress, faults, note)
        progress(1.0)
        faults += replay_faults(run.played, inputs.setup, note)
        if not run.played.tally.frames:
            raise InputError("; ".join(faults) or f"{files[0]}: no frame came of it")
        faults += unlabelled(inputs.setup, run.label_table, run.scorers, run.played)
        return run.results(film, faults, note)


def _folder(inputs: ReplayInputs, output: Path | None) -> Path:
    return output or Path("results") / f"replay-{inputs.names[0]}"


class _Run:
    """One pass over the recordings with a scorer for each preset."""

    def __init__(self, inputs: ReplayInputs, folder: Path, stack: ExitStack) -> None:
        """``stack`` closes the files of the explanations. Raises InputError: settings, allies or labels."""
        self.inputs, self.folder, self.settings = inputs, folder, inputs.settings()
        setup, prior_map = inputs.setup, inputs.prior_map
        self.first = setup.presets[0]
        self.main = self.settings[self.first]
        self.label_table, self.label_topics = inputs.labels()
        self.played = Replay(
            inputs.sources,
            inputs.robots,
            inputs.allies(self.main.midnet.ally_diameter_m),
            prior_map,
            self.settings,
            setup,
            inputs.offsets_ns,
            correctors=inputs.localizers(),
            followed=self.label_topics,
        )
        self.counts = RayCounts(prior_map.resolution, prior_map.origin, (prior_map.height, prior_map.width))
        self.explainers = {
            name: causes.Explainer(
                name,
                prior_map,
                self.played.nodes[name],
                settings,
                self.counts,
                stack.enter_context(TemporaryFile()),  # noqa: SIM115
            )
            for name, settings in self.settings.items()
        }
        self.scorers = {
            name: Scorer(name, self.explainers[name], settings.range_m, setup)
            for name, settings in self.settings.items()
        }
        self.events = {name: Events() for name in self.settings}
        self.tracked: dict[str, dict[str, int]] = {name: {} for name in self.settings}
        """preset -> label -> the track that it was on last"""
        self.switches = Counter[str]()
        """preset -> how often a label came to another track"""

    def play(
        self, film: bool, bag: Path | None, progress: Callable[[float], None], faults: list[str], note: Note
    ) -> None:
        """Score frame after frame and write the boxes; a damaged file is added to the faults."""
        reach_m = 2.0 * max(settings.range_m for settings in self.settings.values())
        scored_from_ns, newest = self.inputs.scored_from_ns, dict[int, Scan]()
        with _boxes_file(self.folder) as boxes, ExitStack() as drawn:
            append = self._film(drawn) if film else None
            as_bag = None
            if bag is not None:
                as_bag = drawn.enter_context(replay_bag(bag, self.inputs, self.played.nodes, note))
            try:
                for frame in self.played.frames():
                    if scored_from_ns is not None and frame.time_ns < scored_from_ns:
                        continue
                    for one in frame.observed:
                        if one.scan is not None and one.scan is not newest.get(one.robot):
                            newest[one.robot] = one.scan
                            with suppress(InputError):  # a pose far off any map, where there are no boxes
                                self.counts.take(one.scan, one.returns, reach_m)
                    labels = self._labels(frame)
                    for name, scorer in self.scorers.items():
                        frame_score = scorer.take(frame, labels)
                        self._watch(name, frame, frame_score)
                        _write_boxes(boxes, frame, name)
                        if append is not None and name == self.first:
                            append(frame, frame_score, scorer.score)
                    if as_bag is not None:
                        as_bag.write(frame)
                    progress(self.played.done)
            except InputError as error:
                faults.append(str(error))

    def _watch(self, name: str, frame: ReplayFrame, score: FrameScore | None) -> None:
        """Take the boxes for events; with labels, those within sector and window alone."""
        boxes = frame.outputs[name].frame.detections
        scored = range(len(boxes)) if score is None else score.scored
        true = [False] * len(scored) if score is None else [bool(on) for on in score.match.touched]
        tracks = self.events[name].take([boxes[k] for k in scored], true, frame.time_ns / NS)
        for label, place in zip(score.labels, score.match.detection_of, strict=True) if score else ():
            if place is not None:
                before = self.tracked[name].setdefault(label.name, tracks[place])
                self.switches[name] += before != tracks[place]
                self.tracked[name][label.name] = tracks[place]

    def _film(self, stack: ExitStack) -> Callable[..., None]:
        from midnet_bench.workflows.replay_film import film  # drawing takes a while to import

        inputs, setup = self.inputs, self.inputs.setup
        route = None
        if not setup.localize:  # corrected poses are known on the way alone
            route = driven(
                Replay(inputs.sources, inputs.robots, [], inputs.prior_map, {}, setup, inputs.offsets_ns)
            )
        return stack.enter_context(
            film(
                f"{inputs.names[0]}, preset {self.first}",
                self.first,
                self.played,
                inputs.prior_map,
                self.main,
                frames_hz(inputs),
                labelled_at_once(self.label_table, self.label_topics),
                self.folder,
                route,
            )
        )

    def _labels(self, frame: ReplayFrame) -> Labels | None:
        if self.label_table is not None:
            return self.label_table.at(frame.time_ns, frame.scan_index)
        labels = [
            Label(plan.name, estimate.pose.x, estimate.pose.y)
            for plan, estimate in frame.followed
            if estimate is not None and estimate.age_s <= self.inputs.setup.max_pose_age_s
        ]
        return Labels(labels, []) if labels else None

    def results(self, film: bool, faults: list[str], note: Note) -> Replayed:
        """Write errors and tables."""
        folder, setup = self.folder, self.inputs.setup
        counted = _write_errors(folder / "errors.csv", self.explainers)
        write_atomically(folder / "events.csv", event_rows(self.events, bool(setup.truth)))
        tables = [
            *score_tables(self.scorers, bool(setup.truth)),
            event_table(self.events, self.scorers if setup.truth else {}, self.switches),
        ]
        tables.append(cause_table(counted))
        files = [folder / "boxes.csv", folder / "errors.csv", folder / "events.csv"]
        for table in tables:
            files += table.write(folder)
        if film:
            files += [folder / "trial.mp4", folder / "storyboard.png"]
        if setup.unmapped:
            prior = self.played.nodes[self.first].prior
            files += write_unmapped(folder, self.counts, self.inputs.prior_map, prior, note)
        return Replayed(tables, files, faults)


def driven(replay: Replay) -> Box | None:
    """The box of all the positions of a replay's robots, map frame, metres; None if it has no frames.

    A fault in a recording ends it here and is reported by the replay that follows.
    """
    positions: list[tuple[float, float]] = []
    with suppress(InputError):
        for frame in replay.frames():
            positions += [(one.estimate.pose.x, one.estimate.pose.y) for one in frame.observed]
    if not positions:
        return None
    return Box(*np.min(positions, axis=0).tolist(), *np.max(positions, axis=0).tolist())


def frames_hz(inputs: ReplayInputs) -> float:
    """Frames a second that the recording gives."""
    if inputs.setup.rate_hz is not None:
        return inputs.setup.rate_hz
    surveys = inputs.surveys
    scans = sum(surveys[one.source].streams[one.scan_topic].topic.messages for one in inputs.robots)
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
    rows = [
        ",".join(f"{cell:.3f}" if isinstance(cell, float) else str(cell) for cell in thing)
        for thing in things
    ]
    write_atomically(folder / "unmapped.csv", "\n".join([",".join(Unmapped._fields), *rows]) + "\n")
    save_map(patched, folder / "map_with_unmapped.yaml", comment="with what stays put and was not on it")
    note(f"{len(things)} things stay put and are not on the map; map_with_unmapped.yaml has them")
    return [folder / "unmapped.csv", folder / "map_with_unmapped.yaml"]


def check(files: Sequence[Path], setup: RecordingSetup, note: Note, output: Path | None = None) -> Replayed:
    """Search for the setup by which scans lie best on the map, and write it as ``setup.yaml``.

    The tables have its parameters for each robot. An earlier ``setup.yaml`` in the folder is kept as
    ``setup.yaml.old``.

    Raises:
        InputError: the recordings, the map or a key of the setup cannot be used.
    """
    tables, found = [], {}
    with prepared(files, setup, note) as inputs:
        setup = inputs.setup
        for robot in inputs.robots:
            for line in lag_lines(inputs.surveys, robot, setup.clock):
                note(line)
            samples = samples_of(inputs.surveys, robot, setup.clock, setup.max_pose_age_s, inputs.offsets_ns)
            if not samples:
                raise InputError(f"{robot.name}: no scan of it has a pose; see 'midnet-bench replay FILE'")
            proposal = found[robot.name] = find_setup(samples, inputs.prior_map)
            set_by = SetBy(robot.is_mirrored, robot.delay_ns / NS)
            note(f"{robot.name}: {line_of(proposal, set_by)}")
            for line in proposal.cannot_tell:
                note(f"{robot.name}: {line}")
            tables.append(setup_table(robot.name, proposal))
        path = _folder(inputs, output) / SETUP_FILE
        text = proposed_setup(inputs, found).to_yaml(path.parent)
    if path.exists() and path.read_text(encoding="utf-8") != text:
        path.replace(path.with_name(f"{SETUP_FILE}.old"))
    write_atomically(path, text)
    return Replayed(tables, [path], [])


def proposed_setup(inputs: ReplayInputs, found: Mapping[str, Proposal]) -> RecordingSetup:
    """The setup with every robot's topics, mount and delay, corrected where that fits the map better.

    ``found``: by robot.
    """
    setup, given = inputs.setup, inputs.setup.mirrored
    carriers = [robot.carrier for robot in inputs.robots]
    values: dict[str, dict[str, object]] = {
        key: {} for key in ("scan", "pose", "mount", "mirrored", "delay_s", "start")
    }
    for robot in inputs.robots:
        proposal = found[robot.name]
        kinds = set(proposal.kinds) if proposal.is_good else set()
        name = robot.carrier if len(set(carriers)) > 1 else EVERY
        laser = robot.scan_topic if carriers.count(robot.carrier) > 1 else name
        mirrored = given.get(robot.scan_topic, given.get(robot.carrier, given.get(EVERY, False)))
        x, y, yaw = proposal.setup.mount if kinds & {"mount", "turn"} else robot.mount
        delay_s = robot.delay_ns / NS + (proposal.setup.delay_s if "delay" in kinds else 0.0)
        others = [other.scan_topic for other in inputs.robots if other.carrier == robot.carrier]
        values["scan"][name] = others if len(others) > 1 else robot.scan_topic
        values["pose"][name] = robot.pose_key
        values["mount"][laser] = [round(x, 3), round(y, 3), round(float(np.degrees(yaw)), 2)]
        values["mirrored"][laser] = mirrored != ("mirror" in kinds)
        if "map" in kinds:
            values["start"][name] = start_of(proposal)
        elif name in setup.start and name not in values["start"]:
            values["start"][name] = setup.start[name]
        if delay_s:
            values["delay_s"][laser] = round(delay_s, 3)
    return setup.changed(values)


@contextmanager
def _boxes_file(folder: Path) -> Iterator["csv._writer"]:  # type: ignore[name-defined]
    """``boxes.csv``, row by row; what was written stays, whatever ends the replay."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "boxes.csv").unlink(missing_ok=True)
        with open(folder / "boxes.csv", "x", encoding="utf-8", newline="") as file:  # through no link
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(
                ["preset", "frame", "t", "scan_index", "robot", "x_min_m", "y_min_m", "x_max_m", "y_max_m"]
            )
            yield writer
    except OSError as error:
        raise cannot_be_written(folder / "boxes.csv", error) from error


def _write_boxes(writer: "csv._writer", frame: ReplayFrame, name: str) -> None:  # type: ignore[name-defined]
    boxes = frame.outputs[name].frame
    for box, robot in zip(boxes.detections, boxes.robots, strict=True):
        index = "" if frame.scan_index is None else frame.scan_index
        number = frame.observed[robot].carrier
        sides = [f"{side:.4f}" for side in box]
        writer.writerow([name, frame.number, f"{frame.time_ns / NS:.6f}", index, number, *sides])


def _write_errors(
    path: Path, explainers: Mapping[str, causes.Explainer]
) -> dict[str, Counter[tuple[str, str]]]:
    """Write every error, row by row; how many there are of each kind and cause, by preset."""
    counted: dict[str, Counter[tuple[str, str]]] = {}
    with temporary_path(path) as draft, open(draft, "w", encoding="utf-8", newline="") as file:
        file.write(",".join(["preset", *causes.ErrorRow._fields]) + "\n")
        for name, explainer in explainers.items():
            counted[name] = Counter()
            for one in explainer.settled():
                cells = [f"{cell:.4f}" if isinstance(cell, float) else str(cell) for cell in one]
                file.write(",".join([name, *cells]) + "\n")
                counted[name][one.kind, one.cause] += 1
    return counted
