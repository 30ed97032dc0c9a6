"""``replay``: what the detector makes of a recording, whether its inputs fit, and why it errs."""

import csv
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np

from midnet_bench.analysis.tables import Table
from midnet_bench.errors import InputError
from midnet_bench.geometry import Scan
from midnet_bench.io.files import cannot_be_written, temporary_path, write_atomically
from midnet_bench.io.map_server import save_map
from midnet_bench.recording import summary
from midnet_bench.recording.files.readings import NS
from midnet_bench.recording.fitting.fit import samples_of
from midnet_bench.recording.fitting.setup_check import Proposal, find_setup, line_of, start_of
from midnet_bench.recording.inputs import Note, ReplayInputs, prepared
from midnet_bench.recording.ray_counts import RayCounts, Unmapped, unmapped
from midnet_bench.recording.replay import ReplayFrame
from midnet_bench.recording.scores import ErrorRow, Scorer
from midnet_bench.recording.setup import EVERY, RecordingSetup

SETUP_FILE = "setup.yaml"
BOXES = ("preset", "frame", "t", "scan_index", "robot", "x_min_m", "y_min_m", "x_max_m", "y_max_m")


@dataclass
class Replayed:
    """Results of ``replay`` or ``check``."""

    tables: list[Table]
    files: list[Path]
    faults: list[str]  # what does not fit or could not be read; results are there all the same


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
        from midnet_bench.workflows.replay_output import check_place  # drawing takes a while to import

        check_place(bag, [*files, Path(setup.background or files[0])])
    with prepared(files, setup, note) as inputs, ExitStack() as stack:
        run = _Run(inputs, _folder(inputs, output), stack)
        for line in summary.input_summary(inputs, run.played.settings):
            note(line)
        faults = [line for robot in inputs.robots for line in summary.report_fit(inputs, robot, note)]
        with run.writing(film, bag, note) as take:
            try:
                for frame in run.played.frames():
                    take(frame)
                    progress(run.played.done)
            except InputError as error:
                faults.append(str(error))
        progress(1.0)
        faults += summary.replay_faults(run.played, inputs.setup, note)
        if not run.played.tally.frames:
            raise InputError("; ".join(faults) or f"{files[0]}: no frame came of it")
        if inputs.setup.truth and not any(one.score.labelled for one in run.scorers.values()):
            faults.append(summary.unlabelled(inputs.setup, run.labels, run.played))
        return run.results(film, faults, note)


def _folder(inputs: ReplayInputs, output: Path | None) -> Path:
    return output or Path("results") / f"replay-{inputs.recorded.names[0]}"


class _Run:
    """One pass over the recordings with all presets."""

    def __init__(self, inputs: ReplayInputs, folder: Path, stack: ExitStack) -> None:
        """``stack`` closes the files of the explanations. Raises InputError: settings, allies or labels."""
        self.inputs, self.folder, self.labels, grid = inputs, folder, inputs.labels(), inputs.prior_map
        self.played = inputs.replay(inputs.settings(), self.labels.followed)
        self.counts = RayCounts(grid.resolution, grid.origin, (grid.height, grid.width))
        self._newest: dict[int, Scan] = {}
        """laser -> the scan of it that was counted last"""
        self.scorers = {
            name: Scorer(name, self.played, self.counts, stack.enter_context(TemporaryFile()))  # noqa: SIM115
            for name in self.played.settings
        }

    @contextmanager
    def writing(self, film: bool, bag: Path | None, note: Note) -> Iterator[Callable[[ReplayFrame], None]]:
        """What scores a frame and writes it to all files that are open meanwhile."""
        reach_m = 2.0 * max(settings.range_m for settings in self.played.settings.values())
        scored_from_ns, first = self.inputs.scored_from_ns, next(iter(self.scorers))
        with _boxes_file(self.folder) as write_boxes, ExitStack() as stack:
            draw, as_bag = None, None
            if film:
                from midnet_bench.workflows import replay_output

                drawn = replay_output.film(first, self.played, self.inputs, self.labels.objects, self.folder)
                draw = stack.enter_context(drawn)
            if bag is not None:
                from midnet_bench.workflows.replay_output import replay_bag

                as_bag = stack.enter_context(replay_bag(bag, self.inputs, self.played.nodes, note))

            def take(frame: ReplayFrame) -> None:
                if scored_from_ns is not None and frame.time_ns < scored_from_ns:
                    return
                self._count(frame, reach_m)
                labels = self.labels.at(frame)
                for name, scorer in self.scorers.items():
                    frame_score = scorer.take(frame, labels)
                    write_boxes(_box_rows(name, frame))
                    if draw is not None and name == first:
                        draw(frame, frame_score, scorer.score)
                if as_bag is not None:
                    as_bag.write(frame)

            yield take

    def _count(self, frame: ReplayFrame, reach_m: float) -> None:
        for one in frame.observed:
            if one.scan is not None and one.scan is not self._newest.get(one.robot):
                self._newest[one.robot] = one.scan
                with suppress(InputError):  # a pose far off any map, where there are no boxes
                    self.counts.take(one.scan, one.returns, reach_m)

    def results(self, film: bool, faults: list[str], note: Note) -> Replayed:
        """Write errors and tables."""
        folder, has_truth = self.folder, bool(self.inputs.setup.truth)
        counted = _write_errors(folder / "errors.csv", self.scorers)
        scores = {name: one.score for name, one in self.scorers.items()}
        write_atomically(folder / "events.csv", summary.event_rows(scores, has_truth))
        tables = [*summary.score_tables(scores, has_truth), summary.cause_table(counted)]
        files = [folder / "boxes.csv", folder / "errors.csv", folder / "events.csv"]
        for table in tables:
            files.append(folder / f"{table.name}.csv")
            write_atomically(files[-1], table.to_csv())
        files += [folder / "trial.mp4", folder / "storyboard.png"] * film
        if self.inputs.setup.unmapped:
            files += self._write_unmapped(note)
        return Replayed(tables, files, faults)

    def _write_unmapped(self, note: Note) -> list[Path]:
        """What stays put and is not on the map: ``unmapped.csv``, and the map with it."""
        prior, folder = next(iter(self.played.nodes.values())).prior, self.folder
        things, patched = unmapped(self.counts, self.inputs.prior_map, prior)
        lines = [",".join(_cells(thing, 3)) for thing in (Unmapped._fields, *things)]
        write_atomically(folder / "unmapped.csv", "\n".join(lines) + "\n")
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
        for robot in inputs.robots:
            for line in summary.lag_lines(inputs, robot):
                note(line)
            samples = samples_of(inputs.recorded, robot, inputs.setup)
            if not samples:
                raise InputError(f"{robot.name}: no scan of it has a pose; see 'midnet-bench replay FILE'")
            proposal = found[robot.name] = find_setup(samples, inputs.prior_map)
            found_line = line_of(proposal, robot.is_mirrored, robot.delay_ns / NS)
            for line in (found_line, *proposal.cannot_tell):
                note(f"{robot.name}: {line}")
            tables.append(summary.setup_table(robot.name, proposal))
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
    keys = ("scan", "pose", "mount", "mirrored", "delay_s", "start")
    values: dict[str, dict[str, object]] = {key: {} for key in keys}
    is_team = len({robot.carrier for robot in inputs.robots}) > 1
    for robot in inputs.robots:
        proposal = found[robot.name]
        kinds = set(proposal.found.kinds) if proposal.is_good else set()
        streams = [other.scan_topic for other in inputs.robots if other.carrier == robot.carrier]
        name = robot.carrier if is_team else EVERY
        laser = robot.scan_topic if len(streams) > 1 else name
        mirrored = given.get(robot.scan_topic, given.get(robot.carrier, given.get(EVERY, False)))
        x, y, yaw = proposal.found.mount if kinds & {"mount", "turn"} else robot.mount
        delay_s = robot.delay_ns / NS + (proposal.found.delay_s if "delay" in kinds else 0.0)
        values["scan"][name] = streams if len(streams) > 1 else robot.scan_topic
        values["pose"][name] = robot.pose_key
        values["mount"][laser] = [round(x, 3), round(y, 3), round(float(np.degrees(yaw)), 2)]
        values["mirrored"][laser] = mirrored != ("mirror" in kinds)
        if "map" in kinds:
            values["start"][name] = start_of(proposal.found)
        elif name in setup.start:
            values["start"].setdefault(name, setup.start[name])
        if delay_s:
            values["delay_s"][laser] = round(delay_s, 3)
    return setup.changed(values)


@contextmanager
def _boxes_file(folder: Path) -> Iterator[Callable[[Iterable[Sequence[object]]], None]]:
    """``boxes.csv``, row by row; what was written stays, whatever ends the replay."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "boxes.csv").unlink(missing_ok=True)
        with open(folder / "boxes.csv", "x", encoding="utf-8", newline="") as file:  # through no link
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(BOXES)
            yield writer.writerows
    except OSError as error:
        raise cannot_be_written(folder / "boxes.csv", error) from error


def _box_rows(preset: str, frame: ReplayFrame) -> Iterator[list[object]]:
    boxes = frame.outputs[preset].frame
    index = "" if frame.scan_index is None else frame.scan_index
    for box, robot in zip(boxes.detections, boxes.robots, strict=True):
        place = f"{frame.time_ns / NS:.6f}", index, frame.observed[robot].carrier
        yield [preset, frame.number, *place, *_cells(box, 4)]


def _cells(row: Iterable[Any], digits: int) -> list[str]:
    return [f"{cell:.{digits}f}" if isinstance(cell, float) else str(cell) for cell in row]


def _write_errors(path: Path, scorers: Mapping[str, Scorer]) -> dict[str, Counter[tuple[str, str]]]:
    """Write every error, row by row; how many there are of each kind and cause, by preset."""
    counted: dict[str, Counter[tuple[str, str]]] = {}
    with temporary_path(path) as draft, open(draft, "w", encoding="utf-8", newline="") as file:
        file.write(",".join(["preset", *ErrorRow._fields]) + "\n")
        for name, scorer in scorers.items():
            counted[name] = Counter()
            for one in scorer.explainer.settled():
                file.write(",".join([name, *_cells(one, 4)]) + "\n")
                counted[name][one.kind, one.cause] += 1
    return counted
