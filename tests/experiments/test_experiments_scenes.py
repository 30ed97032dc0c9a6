"""A trial as the plain data that pictures are drawn from."""

import pytest

from midnet_bench.drawing.scene import Scene
from midnet_bench.experiments import registry
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import LabyrinthTrial
from midnet_bench.experiments.scenes import labyrinth_demo, scene_of, setup_of
from midnet_bench.settings import Scalar
from tests.experiments.corridor import SOON


def test_false_and_missed_are_those_that_the_score_counts() -> None:
    # ghosts that no beam clears, so that there are false detections
    parameters = DetectionParameters.parse(
        {"engine": "fast", "robots": 3, "frames": 12, "inf_is_valid": False}, "test"
    )
    scored, scenes = [], []
    with DetectionTrial(parameters, 1) as trial:
        for frame in trial.frames(explain=True):
            scored.append(frame)
            scenes.append(scene_of(trial, frame))
    false = [sum(found.is_false for found in scene.detections) for scene in scenes]
    assert false == [frame.counts.fp for frame in scored]
    assert sum(false) > 0, "a trial without any shows nothing here"
    further = [sum(found.is_further for found in scene.detections) for scene in scenes]
    assert further == [frame.counts.duplicates for frame in scored]
    missed = [sum(truth.is_missed for truth in scene.truths) for scene in scenes]
    assert missed == [frame.counts.fn for frame in scored]
    assert sum(missed) > 0, "a trial without any shows nothing here"
    assert [scene.frame for scene in scenes] == [frame.number for frame in scored]


def test_robots_that_are_gone_are_not_in_a_scene_and_escapes_are_goals() -> None:
    with LabyrinthTrial(LabyrinthParameters.of(robots=2, intruders=2, engine="fast"), 3) as trial:
        setup = setup_of(trial)
        frame = next(iter(trial.frames(explain=True)))
        before = scene_of(trial, trial.scored(frame))
        trial.fleet.remove(trial.intruders[0])
        trial.outcomes[trial.intruders[0].index].left_at_s = trial.fleet.time_s
        after = scene_of(trial, trial.scored(frame))
        escapes = [trial.outcomes[robot.index].escape for robot in trial.intruders]
    assert (setup.guards, setup.mobile_intruders, setup.plan.title) == (2, 2, "Map 2, seed 3")
    assert [robot.goal for robot in before.robots if not robot.is_guard] == escapes
    assert [robot.number for robot in before.robots] == [1, 2, 1, 2]
    assert [robot.number for robot in after.robots if not robot.is_guard] == [2]
    assert len(after.truths) == len(before.truths) - 1
    assert before.explanation is frame.explanation is not None


def labyrinth(seed: int, **values: Scalar) -> list[Scene]:
    given: dict[str, Scalar] = {"robots": 2, "intruders": 2, "engine": "fast", **values}
    with labyrinth_demo(LabyrinthParameters.parse(given, "test"), seed) as drawn:
        return list(drawn.scenes)


def test_a_labyrinth_tells_who_caught_whom_and_shows_the_caught_one_for_the_last_time() -> None:
    *before, last, after = labyrinth(6, **{**SOON, "time_limit_s": 3.6})
    assert {(scene.counter, scene.remark) for scene in before} == {("caught 0 of 2", "")}
    caught = ("caught 1 of 2", "intruder 1 caught by guard 2, 3.4 s")
    assert (last.counter, last.remark) == (after.counter, after.remark) == caught
    assert last.time_s == pytest.approx(3.4)
    assert [robot.number for robot in last.robots if not robot.is_guard] == [1, 2]
    assert [found.guard for found in last.detections if not found.is_false] == [2]
    assert last.truths[0].is_found
    assert [robot.number for robot in after.robots if not robot.is_guard] == [2]


def test_a_labyrinth_tells_who_got_away() -> None:
    near: dict[str, Scalar] = {
        "robots": 1,
        "escape_distance_m": 0.0,
        "escape_radius_m": 5.0,
        "time_limit_s": 0.4,
    }
    at_once, _ = labyrinth(2, **near)
    assert (at_once.counter, at_once.remark) == ("caught 0 of 2, 1 escaped", "intruder 1 escaped, 0.2 s")
    (alone,) = labyrinth(2, **near, intruders=1)
    assert (alone.counter, alone.remark) == ("caught 0 of 1, 1 escaped", "escaped, 0.2 s")


def test_every_experiment_with_guards_gives_a_demo() -> None:
    for name, frames in (("detection", 3), ("labyrinth", 2)):
        found = registry.experiment(name)
        values = {"robots": 1, **({"time_limit_s": 0.4} if name == "labyrinth" else {"frames": 3})}
        with found.trials.demo(found.parameters.parse(values, name), 2) as demo:
            assert demo.max_frames == frames
            assert [scene.frame for scene in demo.scenes] == list(range(1, frames + 1))
    assert registry.experiment("mapping").trials.demo is None
