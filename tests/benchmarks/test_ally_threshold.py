"""The rule that chooses t of Algorithm 2: by hand, and on a campaign whose boxes are known."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from benchmarks import ally_threshold
from benchmarks.ally_threshold import (
    Count,
    boxes_on_teammates,
    chosen,
    gap_to_teammate_m,
    removed_from_intruders,
)
from midnet_bench.campaign.store import FILE_NAME
from midnet_bench.campaign.trial import Row
from midnet_bench.errors import InputError
from midnet_bench.experiments.guarded.record import RecordedBox, RecordedFrame, RecordedRobot, RecordedTruth
from midnet_bench.geometry import Box, Point, Pose2D
from tests.conftest import campaign_folder


@pytest.mark.parametrize(
    ("boxes", "choice"),
    [
        # the greatest without any, though a greater one ties with it within the tolerance
        ({0.01: 0, 0.02: 3, 0.03: 0, 0.04: 1}, 0.03),
        # none is without: the least rate is 10 in 1000 frames, 11 ties with it and 12 does not
        ({0.01: 20, 0.02: 22, 0.03: 24, 0.04: 30}, 0.02),
        ({0.01: 30, 0.02: 20, 0.03: 23}, 0.02),
        ({0.05: 7}, 0.05),
    ],
)
def test_the_rule_takes_the_greatest_without_a_box_or_near_the_least(
    boxes: dict[float, int], choice: float
) -> None:
    assert chosen({candidate: Count(2000, count, 99) for candidate, count in boxes.items()}) == choice


def test_a_box_lies_on_a_teammate_and_never_on_its_own_finder() -> None:
    box, axles = Box.square(1.0, 0.0, 0.2), [(1.0, 0.0), (1.3, 0.0), None]
    assert gap_to_teammate_m(box, 0, axles) == pytest.approx(0.3)
    assert gap_to_teammate_m(box, 1, axles) == 0.0
    assert gap_to_teammate_m(box, 0, axles[:1]) == float("inf")


INTRUDER = RecordedTruth("intruder 1", Box.square(0.5, 0.0, 0.2), True, None)


def frame(number: int, *axles: Point, found: tuple[RecordedBox, ...] = ()) -> RecordedFrame:
    """Guards that truly are at these places and believe to be elsewhere; an intruder's robot behind them."""
    robots = [RecordedRobot(Pose2D(x, y, 0.0), Pose2D(9.0, 9.0, 0.0), None) for x, y in [*axles, (0.5, 0.0)]]
    return RecordedFrame(number, list(robots), [INTRUDER], list(found), [], [], [])


def error(number: int, x: float, guard: int, cause: str = "ally_left") -> Row:
    sides = dict(zip(("x_min_m", "y_min_m", "x_max_m", "y_max_m"), Box.square(x, 0.0, 0.2), strict=True))
    return {"frame": number, "cause": cause, "guard": guard, **sides}


def test_boxes_count_by_cause_and_by_the_place_of_their_own_frame() -> None:
    frames = [frame(1, (0.0, 0.0), (2.0, 0.0)), frame(2, (0.0, 0.0), (4.0, 0.0))]
    errors = [
        error(1, 2.29, 1),  # counts
        error(2, 2.29, 1),  # guard 2 has gone on
        error(1, 2.31, 1),  # too far off
        error(1, 2.0, 1, "wall_by_pose"),
        error(1, 2.0, 2),  # on its finder
        error(1, 0.5, 1),  # on an intruder, which is no teammate
    ]
    assert boxes_on_teammates(frames, errors, guards=2) == Count(frames=2, boxes=1, of=5)


def test_what_is_taken_from_intruders_is_what_touches_one_near_a_teammate() -> None:
    found = (
        RecordedBox(0, Box.square(0.6, 0.0, 0.3), ally=1),  # removed
        RecordedBox(0, Box.square(0.4, 0.0, 0.3)),  # not removed
        RecordedBox(0, Box.square(0.9, 0.0, 0.3), ally=1),  # on the teammate alone
        RecordedBox(1, Box.square(0.6, 0.0, 0.3), ally=0),  # 0.6 m from the only teammate
    )
    assert removed_from_intruders([frame(7, (0.0, 0.0), (0.9, 0.0), found=found)], [], 2) == Count(1, 1, 2)


def test_a_campaign_is_read_and_each_candidate_has_its_row(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trials = {"experiment": "detection", "trials": 1, "base_seed": 9453, "grid": {"iou_ally": [0.02, 0.9]}}
    parameters = {"robots": 4, "frames": 20, "engine": "fast", "record": True}
    for arena in ("empty", "map1"):
        campaign_folder(tmp_path / arena, **trials, parameters={**parameters, "arena": arena})
    ally_threshold.main([str(tmp_path / "empty"), str(tmp_path / "map1")])
    lines = capsys.readouterr().out.splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:4]]
    assert [row[:2] for row in rows] == [["0.02", "20"], ["0.90", "20"]]
    assert [row[5] for row in rows] == ["chosen", ""]
    # with a t that no box comes up to every teammate in sight stays, and nothing is removed
    assert int(rows[0][3]) == 0 < int(rows[1][3])
    assert rows[1][7] == "0"


def test_a_campaign_that_was_not_recorded_or_varies_something_else_is_refused(tmp_path: Path) -> None:
    parameters = {"arena": "empty", "robots": 1, "frames": 1, "engine": "fast"}
    for name, grid in (("unrecorded", {"iou_ally": [0.1]}), ("other", {"iou_fuse": [0.1]})):
        campaign_folder(tmp_path / name, experiment="detection", trials=1, grid=grid, parameters=parameters)
        with pytest.raises(InputError, match="a campaign of iou_ally alone, with record: true, is needed"):
            ally_threshold.main([str(tmp_path / name)])
    with pytest.raises(InputError, match="give the folder of ally-threshold"):
        ally_threshold.main([])


def test_nothing_is_chosen_before_each_candidate_has_all_its_trials(tmp_path: Path) -> None:
    parameters = {"arena": "empty", "robots": 1, "frames": 1, "engine": "fast", "record": True}
    campaign = {"experiment": "detection", "trials": 2, "base_seed": 9454, "parameters": parameters}
    folder = campaign_folder(tmp_path / "half", grid={"iou_ally": [0.05, 0.1]}, **campaign)
    with closing(sqlite3.connect(folder / FILE_NAME)) as store, store:
        store.execute("DELETE FROM trials WHERE cell = (SELECT max(cell) FROM cells) AND seed = 9455")
    with pytest.raises(InputError, match="3 of 4 trials have finished; run the campaign again"):
        ally_threshold.main([str(folder)])
