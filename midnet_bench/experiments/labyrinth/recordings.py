"""Recorded labyrinth trials for the player of ``report.html``: with the captures."""

import math
from collections.abc import Iterator
from dataclasses import replace

from midnet_bench.analysis.frames import Results, records
from midnet_bench.campaign.trial import Row
from midnet_bench.experiments.guarded.recordings import by_trial, keyed_recordings
from midnet_bench.page.recording import COLUMNS, Event, Recording


def recordings(results: Results) -> Iterator[Recording]:
    """Each recorded trial in the campaign's order. Raises InputError if a recorded frame is damaged."""
    outcomes, trials = by_trial(results, "intruders"), by_trial(results, "trial")
    for key, recording in keyed_recordings(results):
        (trial,) = records(trials[key])
        events = [event for row in records(outcomes[key]) for event in _events(row, recording)]
        summary = (
            f"{trial['caught']} of {len(outcomes[key])} caught, {trial['escaped']} escaped; "
            f"{trial['ended']} after {trial['duration_s']:.1f} s"
        )
        yield replace(recording, events=sorted(events, key=lambda event: event.frame), summary=summary)


def _events(outcome: Row, recording: Recording) -> Iterator[Event]:
    name = f"intruder {outcome['intruder']}"
    for column, what in (
        ("detected_at_s", "detected"),
        ("caught_at_s", "caught"),
        ("escaped_at_s", "escaped"),
    ):
        at_s = float(str(outcome[column]))
        if not math.isnan(at_s):
            frame = round(at_s * recording.hz)
            by = f" by {_nearest_guard(name, frame, recording)}" if what == "caught" else ""
            yield Event(frame, what, f"{name} {what}{by}, {at_s:.1f} s")


def _nearest_guard(name: str, frame: int, recording: Recording) -> str:
    """The guard that stood nearest to an intruder at a frame."""
    rows = recording.frames["robots"][frame - 1]
    x, y = (COLUMNS["robots"].index(axis) for axis in ("x", "y"))
    places = {robot: (row[x], row[y]) for (robot, _), row in zip(recording.robots, rows, strict=True)}
    guards = [robot for robot, is_guard in recording.robots if is_guard]
    return min(guards, key=lambda guard: math.dist(places[guard], places[name]))
