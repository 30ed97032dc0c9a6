import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.campaign.trial import Row
from midnet_bench.errors import InputError
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import LabyrinthTrial, run_labyrinth
from midnet_bench.io.map_server import save_map
from tests.experiments import corridor as corridors

Floats = npt.NDArray[np.float64]


def corridor(**changes: object) -> LabyrinthParameters:
    values = {
        "arena": corridors.corridor(9.0, 1, 3.0),
        "prior_map": "exact",
        "escape_distance_m": 5.5,
        "time_limit_s": 90.0,
        "engine": "fast",
    }
    return LabyrinthParameters.of(**{**values, **changes})


@pytest.fixture(scope="module")
def leaves() -> dict[str, list[Row]]:
    """The tables of a trial whose intruder leaves when it is caught."""
    return run_labyrinth(corridor(), 1).tables


def run_to_its_end(trial: LabyrinthTrial) -> None:
    for _ in trial.frames():
        pass


def test_a_guard_in_the_way_catches_who_has_to_pass(leaves: dict[str, list[Row]]) -> None:
    row, intruder = leaves["trial"][0], leaves["intruders"][0]
    assert (row["caught"], row["escaped"], row["success_rate"]) == (1, 0, 100.0)
    assert 0.0 < float(intruder["detected_at_s"]) <= float(intruder["caught_at_s"]) == row["duration_s"]
    assert math.isnan(float(intruder["escaped_at_s"]))
    assert row["ended"] == "nobody left"


def test_seeing_is_catching_under_the_weakest_reading() -> None:
    intruder = run_labyrinth(corridor(capture="detected", pursuit="none"), 1).tables["intruders"][0]
    assert intruder["detected_at_s"] == intruder["caught_at_s"]


def test_who_is_not_come_close_to_is_not_caught_and_gone_at_his_escape() -> None:
    parameters = corridor(capture_distance_m=0.01, pursuit="none")
    with LabyrinthTrial(parameters, 5) as trial:
        run_to_its_end(trial)
        outcome = trial.outcomes[trial.intruders[0].index]
        assert (outcome.result, outcome.detected_at_s > 0.0) == ("escaped", True)
        assert not trial.world.active[trial.intruders[0].index]
        assert math.dist(outcome.start, outcome.escape) >= 5.5
    row = run_labyrinth(parameters, 5).tables["trial"][0]
    assert (row["detected"], row["caught"], row["success_rate"]) == (1, 0, 0.0)


@pytest.mark.slow
def test_an_intruder_that_drives_on_at_its_escape_stays_until_the_time_is_up() -> None:
    unseen = {"capture_distance_m": 0.01, "pursuit": "none"}
    tables, places = {}, {}
    for at_escape in ("leaves", "drives_on"):
        with LabyrinthTrial(corridor(at_escape=at_escape, **unseen), 5) as trial:
            intruder = trial.intruders[0]
            places[at_escape] = [trial.world.pose(intruder.index) for _ in trial.frames()]
            heads_for = trial.outcomes[intruder.index].escape
            assert trial.world.active[intruder.index] == (at_escape == "drives_on")
        tables[at_escape] = run_labyrinth(corridor(at_escape=at_escape, **unseen), 5).tables
    first, second = (tables[name]["intruders"][0] for name in ("leaves", "drives_on"))
    assert (first["outcome"], second["outcome"]) == ("escaped", "at large")
    assert math.isnan(float(second["escaped_at_s"]))
    assert math.isnan(float(second["left_at_s"]))
    assert (tables["drives_on"]["trial"][0]["ended"], tables["drives_on"]["trial"][0]["escaped"]) == (
        "time limit",
        0,
    )
    # the same way to the first escape, where one is taken out, then on to other places
    assert first["straight_m"] == second["straight_m"]
    way = places["leaves"][:-1]
    assert len(way) > 100
    assert places["drives_on"][: len(way)] == way
    assert int(tables["drives_on"]["robots"][-1]["goals_reached"]) >= 2
    assert math.dist(heads_for, (way[-1].x, way[-1].y)) > 0.3


@pytest.mark.slow
def test_a_caught_intruder_that_drives_on_is_caught_once_and_keeps_the_trial_going(
    leaves: dict[str, list[Row]],
) -> None:
    drives_on = run_labyrinth(corridor(after_capture="drives_on"), 1).tables
    (first,), (second,) = leaves["intruders"], drives_on["intruders"]
    assert first["left_at_s"] == first["caught_at_s"] == second["caught_at_s"]
    assert (second["outcome"], drives_on["trial"][0]["caught"]) == ("caught", 1)
    assert math.isnan(float(second["escaped_at_s"]))
    assert float(second["left_at_s"]) > float(second["caught_at_s"]) + 5.0
    assert drives_on["trial"][0]["duration_s"] == second["left_at_s"]


def test_an_intruder_that_waits_stands_until_then() -> None:
    with LabyrinthTrial(corridor(intruder_wait_s=10.0), 1) as trial:
        intruder = trial.intruders[0].index
        start = trial.world.poses()[intruder, :2].copy()
        for _ in trial.frames():
            moved_m = float(np.hypot(*(trial.world.poses()[intruder, :2] - start)))
            if trial.fleet.time_s > 13.0:
                break
            assert moved_m < 0.01 or trial.fleet.time_s > 10.0
        assert moved_m > 0.1


@pytest.mark.parametrize(
    ("ends", "time_limit_s", "caught"), [("time_limit", 20.0, 1), ("nobody_left", 2.0, 0)]
)
def test_a_trial_may_go_on_to_the_time_limit_which_is_no_success(
    ends: str, time_limit_s: float, caught: int
) -> None:
    row = run_labyrinth(corridor(ends=ends, time_limit_s=time_limit_s), 1).tables["trial"][0]
    assert (row["caught"], row["duration_s"], row["ended"]) == (caught, time_limit_s, "time limit")
    assert row["success_rate"] == 100.0 * caught


def test_intruders_escape_by_a_door_far_enough_or_else_by_the_farthest() -> None:
    west, east = (-10.0, 5.0), (10.0, -5.0)
    for seed, least_m in ((1, 12.0), (2, 3.0), (3, 60.0)):
        parameters = LabyrinthParameters.of(
            intruders=5, escape_at="doors", escape_distance_m=least_m, engine="fast"
        )
        with LabyrinthTrial(parameters, seed) as trial:
            for outcome in trial.outcomes.values():
                taken, other = sorted((west, east), key=lambda door: math.dist(door, outcome.escape))
                assert math.dist(taken, outcome.escape) < 0.02
                reach_m = math.dist(outcome.start, taken)
                assert reach_m >= least_m - 0.02 or reach_m >= math.dist(outcome.start, other) - 0.02


def test_an_arena_without_doors_has_no_escape_by_them() -> None:
    with pytest.raises(InputError, match="outer wall has no gap; take escape_at: anywhere"):
        corridor(escape_at="doors").with_files_read()


def test_a_guard_is_sent_to_the_box_and_not_to_the_true_position() -> None:
    with LabyrinthTrial(corridor(capture_distance_m=0.01), 1) as trial:
        intruder, guard = trial.intruders[0].index, trial.guards[0]
        midnet = next(frame for frame in trial.frames() if trial.pursuit.targets)
        (target,) = trial.pursuit.targets.values()
        assert target.place in [box.center for box in midnet.detections]
        assert guard.goal == target.place
        assert math.dist(target.place, trial.world.poses()[intruder, :2]) > 0.001


def test_an_oracle_names_the_intruder_and_calls_guards_off_at_once() -> None:
    with LabyrinthTrial(corridor(pursuit="oracle"), 1) as trial:
        intruder = trial.intruders[0].index
        next(frame for frame in trial.frames() if trial.pursuit.targets)
        assert set(trial.pursuit.targets) == {intruder}
        run_to_its_end(trial)
        assert trial.outcomes[intruder].result == "caught"
        assert not trial.pursuit.targets
        assert (trial.targets, trial.false_targets, trial.false_pursuits) == (0, set(), 0)


def test_the_time_spent_on_false_targets_is_that_of_the_guards_that_pursue_them() -> None:
    with LabyrinthTrial(corridor(time_limit_s=4.0, escape_distance_m=5.0), 1) as trial:
        trial.pursuit.detected(99, (0.0, 2.0), 0.0)  # a target that only the guards believe in
        trial.pursuit.update(0.0)
        trial.false_targets.add(99)
        guard_frames, frames = 0, trial.frames()
        while True:
            guard_frames += len(trial.pursuit.targets[99].pursuers) if 99 in trial.pursuit.targets else 0
            if next(frames, None) is None:
                break
        assert guard_frames > 5
        assert trial.false_pursuits == guard_frames


def test_guards_are_not_told_who_was_caught() -> None:
    with LabyrinthTrial(corridor(), 1) as trial:
        run_to_its_end(trial)
        assert trial.outcomes[trial.intruders[0].index].result == "caught"
        assert trial.pursuit.targets, "nobody told them that there is nothing left to pursue"
        assert trial.guards[0].goal is not None


class Liar:
    """A world that tells the referee nonsense about where robots are, and everything else as it is.

    The robots' sensors keep the world itself.
    """

    def __init__(self, trial: LabyrinthTrial) -> None:
        self._world = trial.world

    def __getattr__(self, name: str) -> object:
        return getattr(self._world, name)

    def poses(self) -> Floats:
        return self._world.poses()[::-1] + 1.0


def driven(lies: bool) -> list[Floats]:
    """Where all robots are at each frame of a trial in which nobody can be caught or escape."""
    nobody = {"capture": "within", "capture_distance_m": 1e-6, "escape_radius_m": 1e-6, "time_limit_s": 6.0}
    with LabyrinthTrial(LabyrinthParameters.of(**{**corridors.SOON, **nobody}), 6) as trial:
        true_world = trial.world
        if lies:
            # the referee's own eyes: who is where, which box is on whom, how long somebody stood
            trial.world = Liar(trial)  # type: ignore[assignment]
            trial._boxes_on = lambda robot, midnet: []  # type: ignore[method-assign]
            for stand in trial.fleet.stands:
                stand.update = lambda *where: None  # type: ignore[method-assign]
        places = [true_world.poses().copy() for _ in trial.frames()]
        assert lies or trial.targets > len(trial.false_targets), "an intruder was pursued"
        return places


@pytest.mark.slow
def test_lies_of_the_referee_move_no_robot() -> None:
    honest, lied = driven(lies=False), driven(lies=True)
    assert len(honest) == len(lied) == 30
    assert all((one == other).all() for one, other in zip(honest, lied, strict=True))


@pytest.mark.slow
def test_the_labyrinth_is_repeatable_and_its_cells_share_their_worlds() -> None:
    short = LabyrinthParameters.of(robots=2, intruders=2, time_limit_s=2.0, engine="fast")
    first, again = run_labyrinth(short, 9), run_labyrinth(short, 9)
    assert json.dumps(first.tables) == json.dumps(again.tables)
    more_guards = run_labyrinth(replace(short, robots=4, time_limit_s=0.2), 9)
    straight = [[row["straight_m"] for row in result.tables["intruders"]] for result in (first, more_guards)]
    assert straight[0] == straight[1]
    assert min(straight[0]) >= 12.0


@pytest.mark.slow
def test_a_fleeing_intruder_keeps_away_longer() -> None:
    evasions: tuple[dict[str, object], ...] = ({"evasion": "none"}, {"evasion": "flee", "flee_radius_m": 2.5})
    caught = [
        run_labyrinth(corridor(time_limit_s=36.0, **one), 2).tables["trial"][0]["caught"] for one in evasions
    ]
    assert caught == [1, 0]


@pytest.mark.slow
def test_the_labyrinth_takes_scan_matching_and_a_map_from_a_file(tmp_path: Path) -> None:
    save_map(render_exact(load_arena("map2")), tmp_path / "map.yaml")
    parameters = LabyrinthParameters.of(
        prior_map=str(tmp_path / "map.yaml"),
        engine="fast",
        robots=2,
        time_limit_s=4.0,
        localization="ukf+map",
        odometry="encoder",
    )
    robots = run_labyrinth(parameters, 1001).tables["robots"]
    assert len(robots) == 3
    assert max(float(str(row["pose_error_m"])) for row in robots) < 0.05
