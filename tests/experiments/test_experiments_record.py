"""Recorded trials: what is kept of a frame, and that it comes back out of a campaign's folder."""

from pathlib import Path

import pytest

from midnet_bench.analysis.frames import load_results, records
from midnet_bench.experiments.guarded.record import RecordedFrame
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import run_labyrinth
from midnet_bench.experiments.registry import tables_of
from tests.cli.command import rows, unpainted, worked
from tests.experiments.corridor import SOON

pytestmark = pytest.mark.slow


def test_a_campaign_over_team_sizes_gives_its_recorded_frames_back(recorded_campaign: Path) -> None:
    recorded = records(load_results(recorded_campaign, tables_of).table("recorded"))
    assert [row["frame"] for row in recorded[:10]] == list(range(1, 11))
    for row in recorded:
        frame = RecordedFrame.from_row(row)
        assert len(frame.scans_m) == len(frame.sensors) == row["robots"]
        for robot, sensor, scan in zip(frame.robots, frame.sensors, frame.scans_m, strict=False):
            assert sensor.distance_to(robot.believed) < 0.1
            assert len(scan) == 90


def test_a_labyrinth_trial_records_who_pursues_and_who_is_left() -> None:
    values = {**SOON, "record": True}
    parameters = LabyrinthParameters.from_flat(values).with_files_read()
    tables = run_labyrinth(parameters, 6).tables
    frames = [RecordedFrame.from_row(row) for row in tables["recorded"]]
    assert [frame.number for frame in frames] == list(range(1, len(frames) + 1))
    assert any(robot is not None and robot.pursues for frame in frames for robot in frame.robots)
    caught = [row["intruder"] for row in tables["intruders"] if row["outcome"] == "caught"]
    assert [row["intruder"] for row in tables["captures"]] == caught != []
    assert {row["guard"] for row in tables["captures"]} <= {1, 2}
    for outcome in tables["intruders"]:
        name = f"intruder {outcome['intruder']}"
        there = [frame.number for frame in frames if name in [truth.name for truth in frame.truths]]
        left_s = float(str(outcome["left_at_s"]))
        # who has left at a frame is on that frame's record, and on none after it
        assert there == list(range(1, 1 + (len(frames) if left_s != left_s else round(5.0 * left_s))))
    without = run_labyrinth(LabyrinthParameters.from_flat({**values, "record": False}).with_files_read(), 6)
    # as texts: NaN is not equal to itself
    assert {name: str(rows) for name, rows in tables.items() if name not in ("recorded", "captures")} == {
        name: str(rows) for name, rows in without.tables.items()
    }


def test_a_recorded_trial_without_intruders_is_reported_with_its_causes(tmp_path: Path) -> None:
    """Every error there is of the kind ``false``, which is a text and no boolean."""
    options = ("--robots", 2, "--frames", 5, "--engine", "fast", "--record", "--set", "arena=empty")
    options += ("--set", "ally_diameter_m=0.05", "-o", "empty")
    with unpainted():
        assert "error" not in worked("detection", *options, folder=tmp_path).stderr
    (tmp_path / "empty" / "campaign.sqlite").unlink()  # the report's files say the same
    for is_report in (False, True):
        if is_report:
            with unpainted():
                worked("report", "empty", folder=tmp_path)
        causes = rows(tmp_path / "empty" / "error_causes.csv")
        assert {row["kind"] for row in causes} == {"false"}, is_report
        assert sum(int(row["errors"]) for row in causes) == len(rows(tmp_path / "empty" / "errors.csv")) > 0
