"""A trial as the plain data that pictures are drawn from."""

from midnet_bench.experiments import registry
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.experiments.guarded.scenes import scene_of, setup_of
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import LabyrinthTrial


def test_false_and_missed_are_those_that_the_score_counts() -> None:
    # ghosts that no beam clears, so that there are false detections
    parameters = DetectionParameters.parse({"robots": 3, "frames": 25, "inf_is_valid": False}, "test")
    scored, scenes = [], []
    with DetectionTrial(parameters, 7) as trial:
        for frame in trial.frames(explain=True):
            scored.append(frame)
            scenes.append(scene_of(trial, frame.midnet))
    false = [sum(found.is_false for found in scene.detections) for scene in scenes]
    assert false == [frame.counts.fp for frame in scored]
    assert sum(false) > 0, "a trial without any shows nothing here"
    missed = [
        sum(truth.is_missed and near for truth, near in zip(scene.truths, frame.in_range, strict=True))
        for scene, frame in zip(scenes, scored, strict=True)
    ]
    assert missed == [frame.counts.fn for frame in scored]
    assert sum(missed) > 0, "a trial without any shows nothing here"
    assert [scene.frame for scene in scenes] == [frame.number for frame in scored]


def test_robots_that_are_gone_are_not_in_a_scene_and_escapes_are_goals() -> None:
    with LabyrinthTrial(LabyrinthParameters.parse({"robots": 2, "intruders": 2}, "test"), 3) as trial:
        setup = setup_of(trial)
        frame = next(iter(trial.frames(explain=True)))
        before = scene_of(trial, frame)
        trial.fleet.remove(trial.intruders[0])
        after = scene_of(trial, frame)
        escapes = [trial.outcomes[robot.index].escape for robot in trial.intruders]
    assert (setup.guards, setup.mobile_intruders, setup.plan.title) == (2, 2, "Map 2, seed 3")
    assert [robot.goal for robot in before.intruders] == escapes
    assert [robot.number for robot in before.robots] == [1, 2, 1, 2]
    assert [robot.number for robot in after.intruders] == [2]
    assert len(after.truths) == len(before.truths) - 1
    assert before.explanation is frame.explanation is not None


def test_every_experiment_with_guards_gives_a_demo() -> None:
    for name, frames in (("detection", 3), ("readings", 3), ("labyrinth", 2)):
        found = registry.experiment(name)
        values = {"robots": 1, **({"time_limit_s": 0.4} if name == "labyrinth" else {"frames": 3})}
        assert found.demo is not None
        with found.demo(found.model.parse(values, name), 2) as demo:
            assert demo.max_frames == frames
            assert [scene.frame for scene in demo.scenes] == list(range(1, frames + 1))
    assert registry.experiment("mapping").demo is None
