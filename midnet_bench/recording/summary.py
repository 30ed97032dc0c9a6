"""Lines and tables of ``replay``: how inputs are read, whether they fit, what was left out, the scores."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.trial import Scalar
from midnet_bench.detectors.tracking import Event
from midnet_bench.errors import InputError
from midnet_bench.recording.files.readings import NS, PoseReading, ScanReading
from midnet_bench.recording.files.survey import lag_in_words, lags_s, stand_still
from midnet_bench.recording.fitting.fit import samples_of
from midnet_bench.recording.fitting.setup_check import QUICK_SAMPLES, Proposal, verdict
from midnet_bench.recording.inputs import Note, ReplayInputs
from midnet_bench.recording.plan import Link, RobotPlan, beam_time
from midnet_bench.recording.replay import Replay
from midnet_bench.recording.scores import Score
from midnet_bench.recording.setup import RecordingSetup, ReplaySettings
from midnet_bench.recording.truth import Truth
from midnet_bench.scoring.error_causes import MISS, RECORDED_BOXES, RECORDED_MISSES


def input_summary(inputs: ReplayInputs, settings: Mapping[str, ReplaySettings]) -> list[str]:
    """How each robot's scans are read, and what thresholds mean, a line each."""
    lines = []
    for robot in inputs.robots:
        stream = inputs.recorded.surveys[robot.source].streams[robot.scan_topic]
        x, y, yaw = robot.mount
        mirrored = ", mirrored" if robot.is_mirrored else ""
        lines.append(
            f"{robot.name}: scans {robot.scan_topic}, pose {robot.pose.in_words}, mount {x:.3f},{y:.3f},"
            f"{math.degrees(yaw):.2f}{mirrored}; no return: {robot.no_return.in_words}"
        )
        lines += lag_lines(inputs, robot)
        if inputs.setup.deskew and (fault := beam_time(stream)[1]):
            lines.append(f"{robot.name}: deskew: {fault}")
        beams = {len(scan.ranges_m) for scan in stream.scans}
        if len(beams) > 1:
            lines.append(
                f"{robot.name}: scans have {min(beams)} to {max(beams)} beams; each is read as it is"
            )
    first = inputs.robots[0]
    increment = inputs.recorded.surveys[first.source].streams[first.scan_topic].scans[0].angle_increment_rad
    return lines + [f"{name}: {line}" for name, one in settings.items() for line in one.in_words(increment)]


def report_fit(inputs: ReplayInputs, robot: RobotPlan, note: Note) -> list[str]:
    """Note whether a robot's scans lie on the map; the lines that say what does not fit."""
    samples = samples_of(inputs.recorded, robot, inputs.setup, QUICK_SAMPLES)
    if not samples or not (inputs.prior_map.data == 100).any():
        note(f"{robot.name}: nothing can be said of how scans and map fit: no scan with a pose, or no wall")
        return []
    found = verdict(samples, inputs.prior_map, robot.is_mirrored, robot.delay_ns / NS)
    lines = [f"{robot.name}: {line}" for line in found.lines]
    for line in lines:
        note(line if found.fits else f"does not fit: {line}")
    return [] if found.fits or found.kinds == ("few returns",) else lines


def setup_table(name: str, proposal: Proposal) -> Table:
    """The setup that was found: each parameter with how far it can be changed within noise."""
    found = proposal.found
    rows: list[dict[str, Scalar]] = []
    values = (*found.mount, found.delay_s, *found.map_moved)
    for (parameter, span), value in zip(proposal.ranges.items(), values, strict=True):
        is_angle = parameter.endswith("yaw")
        factor, unit = (math.degrees(1.0), "deg") if is_angle else (1.0, "m")
        rows.append(
            {
                "parameter": parameter,
                "value": value * factor,
                "unit": "s" if parameter == "scan delay" else unit,
                "less_by": span.below * factor,
                "more_by": span.above * factor,
                "sure": "no" if span.is_open else "yes",
            }
        )
    rest = {
        "mirrored": "yes" if found.is_mirrored else "no",
        "share before": proposal.share_before,
        "share after": found.share,
    }
    rows += [{"parameter": parameter, "value": value} for parameter, value in rest.items()]
    return Table(f"setup_{name}", f"{name}: the setup by which most returns lie on mapped walls", rows)


LAG_S = 0.02  # by which the stamps of scans and poses may differ before a line says so


def lag_lines(inputs: ReplayInputs, robot: RobotPlan) -> list[str]:
    """Whether scans and poses were stamped alike. Raises InputError: the stamps stand still."""
    surveys, clock = inputs.recorded.surveys, inputs.setup.clock
    scans = surveys[robot.source].streams[robot.scan_topic].scans
    readings = {link.in_words: link.seen(surveys) for link in robot.pose.links if isinstance(link, Link)}
    seen_on: list[tuple[str, str, Sequence[ScanReading | PoseReading]]] = [
        (robot.scan_topic, "scans", scans),
        *((link, "poses", poses) for link, poses in readings.items()),
    ]
    for topic, what, seen in seen_on:
        if clock == "header" and stand_still(seen):
            raise InputError(
                f"{surveys[robot.source].source.path}: {topic}: the stamps of the {what} stand still at "
                f"{seen[0].stamp_ns / NS:g} s; use 'clock: record' in setup.yaml"
            )
    scan_lags_s = lags_s(scans)
    pose_lags_s = lags_s([pose for poses in readings.values() for pose in poses])
    if not len(scan_lags_s) or not len(pose_lags_s):
        return []
    lines, pose_lag_s = [], float(np.median(pose_lags_s))
    apart_s = float(np.median(scan_lags_s)) - pose_lag_s
    if abs(apart_s) > LAG_S:
        lines.append(
            f"{robot.name}: each scan is {lag_in_words(scan_lags_s)}, a pose {1000.0 * pose_lag_s:.3g} ms: "
            f"'clock: header' puts a scan {1000.0 * apart_s:.0f} ms earlier than 'clock: record' "
            f"(now: {clock})"
        )
    half = len(scan_lags_s) // 2
    drift_s = float(np.median(scan_lags_s[half:]) - np.median(scan_lags_s[:half])) if half else 0.0
    if abs(drift_s) > LAG_S:
        lines.append(
            f"{robot.name}: the clocks run apart: stamps and record times of the scans drift by "
            f"{drift_s:.3f} s between the two halves of the recording"
        )
    return lines


AT_THE_START, AT_THE_START_SHARE = 3, 0.02  # so many scans before the first pose are noted, and are no fault


def replay_faults(played: Replay, setup: RecordingSetup, note: Note) -> list[str]:
    """What was left out, a line each; what is no fault is noted."""
    tally = played.tally
    taken, left = sum(tally.scans.values()), sum(tally.skipped.values())
    faults = [
        f"{count} of {count + taken} scans were left out: each {why}; the first: {tally.first[why]}"
        for why, count in tally.skipped.items()
    ]
    # poses begin a little after the scans, or end before them
    if tally.without_pose == left and left <= max(AT_THE_START, AT_THE_START_SHARE * taken):
        for line in faults:
            note(line)
        faults = []
    if tally.oldest_pose_s > 0.0:
        oldest_ms = 1000.0 * tally.oldest_pose_s
        note(f"no scan lies farther than {oldest_ms:.0f} ms from the poses that it is placed by")
    for track in played.tracks.values():
        if track.void:
            faults.append(
                f"{track.name}: {track.void} poses are not finite, too far off or no rotation, "
                f"the first at {(track.first_void_ns or 0) / NS:.3f} s; they were left out"
            )
    faults += [f"{track.name}: no pose of it came" for track in played.tracks.values() if not track.taken]
    if not tally.frames and tally.skipped:
        faults.append(
            "scans and poses never meet in time: compare their stamps with 'midnet-bench replay FILE', "
            "and try 'clock: record' or offset_s in setup.yaml"
        )
    for name, age_s in tally.oldest_ally_s.items():
        oldest = "none yet" if math.isinf(age_s) else f"{age_s:.3f} s"
        late = f"in {tally.late_allies[name]} of {tally.frames} frames over {setup.max_ally_age_s:g} s"
        line = f"ally {name}: oldest pose at a frame: {oldest}"
        note(f"{line}; {late}: not taken out there" if tally.late_allies[name] else line)
    return faults


def unlabelled(setup: RecordingSetup, truth: Truth, played: Replay) -> str:
    """That none of the labels is at the time of any frame."""
    first_s, last_s = played.tally.first_ns / NS, played.tally.last_ns / NS
    return (
        f"truth: {next(iter(setup.truth.values()))}: nothing is scored: {truth.span}, {played.tally.frames} "
        f"frames t {first_s:.3f} to {last_s:.3f} (clock: {setup.clock})"
    )


def score_tables(scores: Mapping[str, Score], has_truth: bool) -> list[Table]:
    """A row for each preset: frames and events; with labels, the paper's scores and one-to-one scores too."""
    kinds: list[tuple[str, str, Callable[[Score], Mapping[str, Scalar]]]] = [
        ("recording_frames", "Frames and boxes", Score.looked_at),
        ("recording_scores", "Detection scores, as the paper counts", Score.scored),
        ("recording_matching", "One-to-one matching: a second box on one label is false", Score.paired),
        (
            "recording_events",
            "Events: what came, however many boxes it had",
            lambda one: one.event_counts(has_truth),
        ),
    ]
    return [
        Table(name, title, [{"preset": preset, **row_of(one)} for preset, one in scores.items()])
        for name, title, row_of in (kinds if has_truth else [kinds[0], kinds[-1]])
    ]


def event_rows(scores: Mapping[str, Score], has_truth: bool) -> str:
    """``events.csv``: a row for each event of each preset."""
    fields = Event._fields if has_truth else Event._fields[:-1]
    lines = [",".join(("preset", "event", *fields))]
    for name, score in scores.items():
        for number, event in enumerate(score.events.gathered(), start=1):
            cells = [f"{cell:.3f}" if isinstance(cell, float) else str(cell).lower() for cell in event]
            lines.append(",".join((name, str(number), *cells[: len(fields)])))
    return "\n".join(lines) + "\n"


def cause_table(counted: Mapping[str, Counter[tuple[str, str]]]) -> Table:
    """How many errors of each kind and cause, by preset."""
    meanings = {False: RECORDED_BOXES, True: RECORDED_MISSES}
    rows: list[dict[str, Scalar]] = [
        {
            "preset": name,
            "kind": kind,
            "cause": cause,
            "count": count,
            "share": count / errors.total(),
            "meaning": meanings[kind == MISS][cause],
        }
        for name, errors in counted.items()
        for (kind, cause), count in errors.most_common()
    ]
    return Table("recording_causes", "What boxes are made of, and why labels were missed", rows)
