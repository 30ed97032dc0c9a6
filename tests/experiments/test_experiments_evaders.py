"""What intruders do, and trials with people in them."""

import json
import math

import numpy as np
import pytest

from midnet_bench.arena.arena import Behaviour, Point, checked_arena, load_arena
from midnet_bench.arena.free_space import free_space
from midnet_bench.arena.layout import place
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial, run_detection
from midnet_bench.experiments.guarded.evaders import HIDE_EVERY_S, EvaderPolicy
from midnet_bench.experiments.guarded.inputs import arena_from, inline_arena
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.simulation.fleet import surfaces

ROOM = {
    **json.loads(load_arena("empty").model_dump_json()),
    "walls": [[[-3, -3], [3, -3], [3, 3], [-3, 3], [-3, -3]], [[1, 3], [1, 0]]],
}
PEOPLE = {
    **ROOM,
    "mobile_intruders": {"count": 1},
    "other_intruders": [
        {"kind": "person", "count": 2, "speed_mps": 1.4, "starts_m": [[-1.5, 1.5]]},
        {"kind": "cylinder", "behaviour": "stand", "starts_m": [[2.0, 2.0]], "size_m": [0.3, 0.3]},
    ],
}


def deed_of(**said: object) -> EvaderPolicy:
    layout = place(checked_arena(ROOM, "room"), 1, 1)
    free = free_space(layout.arena, 0.3)
    return EvaderPolicy(Behaviour.model_validate(said), free, "person 1", 1, surfaces(layout))


def parameters(**changes: object) -> DetectionParameters:
    values = {"arena": json.dumps(PEOPLE), "prior_map": "exact", "robots": 2, "frames": 20, "engine": "fast"}
    return DetectionParameters.parse({**values, **changes}, "test")


def test_who_pauses_stands_for_as_long_as_is_said() -> None:
    deed = deed_of(walk_s=20.0, pause_s=60.0)
    standing = [deed.goal((0.0, 0.0), (1.0, 1.0), time, np.zeros((1, 2))) is None for time in range(320)]
    assert sum(standing) == 240
    changes = np.flatnonzero(np.diff(standing))
    assert set(np.diff(changes).tolist()) == {20, 60}
    assert changes[0] < 20


def test_who_follows_a_path_goes_round_it_and_who_stands_goes_nowhere() -> None:
    path: list[Point] = [(1.0, 1.0), (2.0, 1.0), (2.0, -1.0)]
    deed = deed_of(behaviour="follow", path_m=path)
    nobody = np.empty((0, 2))
    assert [deed.goal((0.0, 0.0), None, 0.0, nobody) for _ in range(4)] == [*path, path[0]]
    assert deed.goal((0.0, 0.0), path[0], 0.0, nobody) == path[0]
    assert deed_of(behaviour="stand").goal((0.0, 0.0), None, 0.0, nobody) is None


def test_who_hides_goes_behind_the_nearest_wall_and_stays_there() -> None:
    deed = deed_of(behaviour="hide")
    guards = np.array([[-1.0, 2.0]])
    x, y = deed.goal((0.5, 2.0), None, 0.0, guards)
    assert x > 1.0 and y > -1.0  # noqa: PT018 - behind the wall at x = 1
    assert deed.goal((x, y), None, 0.5 * HIDE_EVERY_S, guards) is None
    assert deed.goal((x, y), None, 2.0 * HIDE_EVERY_S, guards) is None
    seen = deed.goal((x, y), None, 4.0 * HIDE_EVERY_S, np.array([[x, y - 0.5]]))
    assert seen[0] < 1.0


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("mobile_intruders", {"behaviour": "follow"}, "mobile_intruders: behaviour: follow goes with path_m"),
        ("mobile_intruders", {"pause_s": 60}, "walk_s and pause_s go together"),
        ("other_intruders", [{"kind": "dog"}], "other_intruders.0.kind"),
        ("other_intruders", [{"kind": "person", "size_m": [1, 1]}], "people have none here"),
        ("other_intruders", [{"kind": "box", "starts_m": [[0, 1], [1, 0]]}], "more places than intruders"),
        ("other_intruders", [{"kind": "box", "starts_m": [[4, 1]]}], "starts_m.0: (4, 1) is not inside"),
        ("mobile_intruders", {"behaviour": "follow", "path_m": [[0, 9]]}, "path_m.0: (0, 9) is not"),
    ],
)
def test_wrong_behaviour_is_one_line_with_its_key(key: str, value: object, said: str) -> None:
    with pytest.raises(InputError) as error:
        checked_arena({**ROOM, key: value}, "room")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_start_in_a_wall_is_told_and_drawn_places_are_free() -> None:
    wrong = checked_arena({**ROOM, "other_intruders": [{"kind": "person", "starts_m": [[1.0, 1.0]]}]}, "room")
    with pytest.raises(InputError, match=r"other_intruders.0.starts_m.0: \(1, 1\) is too near to a wall"):
        place(wrong, 1, 1)
    crowded = checked_arena({**ROOM, "other_intruders": [{"kind": "person", "count": 100}]}, "room")
    with pytest.raises(InputError, match=r"other_intruders\.0: no room for 100 with seed 1"):
        place(crowded, 1, 1)
    people = checked_arena(PEOPLE, "room")
    few, many = place(people, 3, 1), place(people, 3, 5, mobile_intruders=0)
    assert few.others == many.others
    assert few.others[0].pose[:2] == (-1.5, 1.5)


def test_older_arenas_are_written_as_ever() -> None:
    text = load_arena("map1").model_dump_json()
    assert not any(key in text for key in ("behaviour", "path_m", "walk_s", "pause_s", "other_intruders"))
    assert arena_from(inline_arena(json.dumps(PEOPLE))).other_intruders[0].count == 2


def test_the_labyrinth_has_no_people() -> None:
    with pytest.raises(InputError, match="leave out other_intruders"):
        LabyrinthParameters.of(arena=json.dumps(PEOPLE), prior_map="exact")


@pytest.mark.slow
def test_people_are_seen_scored_and_the_same_again() -> None:
    with DetectionTrial(parameters(), 1) as trial:
        frames = list(trial.frames())
        names = [truth.name for truth in frames[-1].truths]
        assert names == ["intruder 1", "person 1", "person 2", "cylinder 1"]
        walked = [
            math.dist(first.box.center, last.box.center)
            for first, last in zip(frames[0].truths, frames[-1].truths, strict=True)
        ]
        assert walked[3] == 0.0
        assert max(walked[1:3]) > 0.5
        people = [frame.truths[1].box for frame in frames]
        assert all(0.12 <= box.x_max - box.x_min < 1.1 for box in people)
        assert any(
            box.intersection_area(person.box) > 0.0
            for frame in frames
            for person in frame.truths[1:3]
            for box in frame.midnet.detections
        )
        trial.causes(frames[-1], trial.own)
    short = parameters(frames=5)
    assert run_detection(short, 1) == run_detection(short, 1)


@pytest.mark.slow
def test_burgers_pause_and_their_number_is_an_option() -> None:
    paused = {**ROOM, "mobile_intruders": {"count": 3, "walk_s": 1.0, "pause_s": 30.0}}
    with DetectionTrial(parameters(arena=json.dumps(paused), intruders=2), 1) as trial:
        frames = list(trial.frames())
        assert [truth.name for truth in frames[0].truths] == ["intruder 1", "intruder 2"]
        for early, late in zip(frames[12].truths, frames[-1].truths, strict=True):
            assert early.box.center == pytest.approx(late.box.center, abs=0.01)
    with DetectionTrial(parameters(intruders=0, frames=1), 1) as trial:
        assert not trial.intruders
