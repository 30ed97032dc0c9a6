"""Recorded frames and what the page makes of them, by hand: steps of scans, and ranges by the robot."""

from pathlib import Path

import numpy as np
import pytest

from midnet_bench.analysis.frames import load_results
from midnet_bench.campaign import provenance
from midnet_bench.campaign.trial import Scalar
from midnet_bench.experiments.guarded.record import (
    BEAM_STEP,
    RecordedFrame,
    RecordedRobot,
    recorded_scan,
    scan_step_cm,
)
from midnet_bench.experiments.guarded.recordings import recordings
from midnet_bench.experiments.guarded.tables import usable_range
from midnet_bench.experiments.registry import tables_of
from midnet_bench.geometry import Floats, Pose2D
from tests.experiments.test_detection_nothing_to_score import store

POSE = Pose2D(1.0, -0.5, 0.25)


def frame_of(ranges_m: Floats, range_m: float) -> RecordedFrame:
    """Of two guards: one that has a scan to record up to ``range_m``, and one that has none yet."""
    step_cm = scan_step_cm(range_m)
    robots = [RecordedRobot(POSE, POSE, None)] * 2
    scans = [recorded_scan(ranges_m, step_cm), []]
    return RecordedFrame(1, [*robots], [], [], [], scans, [POSE, None], step_cm)


@pytest.mark.parametrize(
    ("range_m", "step_cm"), [(0.5, 1), (2.5, 1), (2.54, 1), (2.55, 2), (3.5, 2), (12.0, 5), (30.0, 12)]
)
def test_a_byte_for_each_beam_holds_the_usable_range(range_m: float, step_cm: int) -> None:
    assert scan_step_cm(range_m) == step_cm
    ranges_m = np.linspace(0.1, range_m, 360)
    ranges_m[8] = np.inf
    ranges_m[12] = 2.0 * range_m + 0.1 * step_cm + 3.0  # in no step
    frame = frame_of(ranges_m, range_m)
    row = frame.to_row()
    again = RecordedFrame.from_row(row)
    assert again.to_row() == row
    assert (again.sensors, again.scan_step_cm) == ([POSE, None], step_cm)
    assert str(row["scans"]).endswith("@1000,-500,250 @" if step_cm == 1 else f"@1000,-500,250,{step_cm} @")
    scan, nothing = again.scans_m
    assert nothing == []
    assert [one is None for one in scan] == [k in (2, 3) for k in range(360 // BEAM_STEP)]
    off_m = [abs(one - own) for one, own in zip(scan, ranges_m[::BEAM_STEP], strict=True) if one is not None]
    assert max(off_m) <= 0.005 * step_cm + 1e-9


@pytest.mark.parametrize(
    ("robot", "asked_m", "range_m"),
    [
        ("burger", 2.5, 2.5),
        ("burger", 12, 3.5),  # no farther than the LDS-01 reaches
        ("burger(lidar=ld19)", 12.0, 12.0),
        ("burger(lidar=ld19)", 2.5, 2.5),
        ("mine.py:ROBOT@0123456789ab", 12.0, 12.0),  # whose file may not be there
        ("mine.py:ROBOT@0123456789ab", "2.5 | 12.0", None),
        (None, 2.5, 2.5),  # results from before robots could be chosen
    ],
)
def test_results_are_shown_up_to_where_their_robots_look(
    robot: str | None, asked_m: Scalar, range_m: float | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(provenance, "all_code", True)  # as with --trust
    given: dict[str, Scalar] = {"obstacle_range_m": asked_m, "local_size_m": 24.0}
    given |= {} if robot is None else {"robot": robot}
    assert usable_range(given) == range_m
    ranges_m = np.full(455 if robot == "burger(lidar=ld19)" else 360, 1.0)
    frame = frame_of(ranges_m, 12.0)
    row = frame._replace(robots=frame.robots[:1], scans_m=frame.scans_m[:1], sensors=[POSE]).to_row()
    folder = store(tmp_path / "a", {"robots": [1]}, {(1,): {}}, [row], **given)
    (recording,) = recordings(load_results(folder, tables_of))
    assert (recording.range_m, recording.window_m) == (range_m, 24.0)
    step_m = recording.beams[2]
    assert step_m == pytest.approx(0.1)  # two of five centimetres
    (beams,) = recording.scans["beams"]
    assert {float(step_m * steps) for _, steps in beams} == {1.0}
