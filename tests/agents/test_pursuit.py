"""Which guard pursues what: rules on hand-made teams and on random ones, and targets that come and go."""

import itertools
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.agents.agent_settings import PURSUITS, PursuitSettings
from midnet_bench.agents.mobile_robot import Guard, GuardState
from midnet_bench.agents.pursuit import Pursuit, TargetState, TeamPursuit
from midnet_bench.geometry import Box, Point, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.fusion import ally_squares
from midnet_bench.navigation.navigator import Navigator
from midnet_bench.plugins import PluginError

FLOOR = OccupancyGrid(np.zeros((200, 200), np.int8), 0.05, (-5.0, -5.0))
RULES = [name for name in PURSUITS.own if not PURSUITS.is_made_here(name)]

Team = list[GuardState]
Targets = dict[int, TargetState]


def rule(name: str) -> TeamPursuit:
    return TeamPursuit(name, FLOOR, np.random.default_rng(1))


def team_at(*xs: float) -> Team:
    return [GuardState((x, 0.0), None) for x in xs]


def targets_at(**xs: float) -> Targets:
    """Targets nobody pursues yet, by numbers such as ``t7``."""
    return {int(name[1:]): TargetState((x, 0.0), 0.2, ()) for name, x in xs.items()}


@pytest.mark.parametrize(
    ("name", "sent"),
    [
        # the pair that is nearest of all takes guard 1 away from target 4, 2 m off
        ("nearest", {1: 3, 0: 4}),
        ("assignment", {0: 3, 1: 4}),
        ("all", {0: 3, 1: 3}),
        ("none", {}),
    ],
)
def test_each_rule_sends_two_guards_after_two_targets_in_its_way(name: str, sent: dict[int, int]) -> None:
    team, targets = team_at(0.0, 3.0), targets_at(t3=2.0, t4=5.0)
    assert rule(name).pursue(team, targets, 0.2) == sent


def test_a_pursuer_stays_with_its_target_unless_guards_are_assigned_anew() -> None:
    team = team_at(0.0, 3.0)
    targets = targets_at(t3=2.9)
    targets[3] = targets[3]._replace(pursuers=(0,))
    assert rule("nearest").pursue(team, targets, 0.4) == {0: 3}
    assert rule("all").pursue(team, targets, 0.4) == {0: 3, 1: 3}
    assert rule("assignment").pursue(team, targets, 0.4) == {1: 3}


places = st.tuples(st.floats(-10, 10), st.floats(-10, 10))


@st.composite
def situations(draw: st.DrawFn) -> tuple[Team, Targets]:
    """Up to five guards and targets; some guards pursue already, several of them one target perhaps."""
    team = [GuardState(place, None) for place in draw(st.lists(places, min_size=1, max_size=5))]
    seen = draw(st.dictionaries(st.integers(0, 99), places, min_size=1, max_size=5))
    of_guard = [draw(st.sampled_from([None, *seen])) for _ in team]
    pursuers = {name: tuple(i for i, one in enumerate(of_guard) if one == name) for name in seen}
    return team, {name: TargetState(place, 1.0, pursuers[name]) for name, place in seen.items()}


@given(situation=situations())
def test_each_rule_gives_the_same_again_and_sends_whom_it_says(situation: tuple[Team, Targets]) -> None:
    team, targets = situation
    sent = {name: rule(name).pursue(team, targets, 1.0) for name in RULES}
    assert sent == {name: rule(name).pursue(team, targets, 1.0) for name in RULES}
    before = {guard: name for name, known in targets.items() for guard in known.pursuers}
    assert sent["nearest"].items() >= before.items() <= sent["all"].items()
    # no free guard is left where a target waits
    new = [name for guard, name in sent["nearest"].items() if guard not in before]
    waiting = [name for name, known in targets.items() if not known.pursuers]
    assert len(set(new)) == len(new) == min(len(team) - len(before), len(waiting))
    assert set(new) <= set(waiting)
    # under 'all' every guard pursues, and a free one what is nearest to it
    assert set(sent["all"]) == set(range(len(team)))
    for guard, name in sent["all"].items():
        gaps = {known.place: math.dist(team[guard].place, known.place) for known in targets.values()}
        assert guard in before or gaps[targets[name].place] == min(gaps.values())


@given(situation=situations())
def test_no_other_pairs_have_a_shorter_way_than_those_assigned(situation: tuple[Team, Targets]) -> None:
    team, targets = situation
    sent = rule("assignment").pursue(team, targets, 1.0)
    count = min(len(team), len(targets))
    assert len(set(sent.values())) == len(sent) == count

    def way_m(pairs: Iterable[tuple[int, int]]) -> float:
        return math.fsum(math.dist(team[guard].place, targets[target].place) for guard, target in pairs)

    least = min(
        way_m(zip(guards, names, strict=True))
        for guards in itertools.combinations(range(len(team)), count)
        for names in itertools.permutations(targets, count)
    )
    assert way_m(sent.items()) == pytest.approx(least, abs=1e-9)


HEAD = "class Mine:\n    def __init__(self, prior_map, rng): pass\n"


@pytest.mark.parametrize(
    ("gives", "says"),
    [
        ("[0]", "pursue gave list; give a dict"),
        ("{2: 7}", "pursue gave a guard 2; there are 0 to 1"),
        ("{'guard 1': 7}", "pursue gave a guard 'guard 1'; there are 0 to 1"),
        ("{0: 8}", "pursue gave guard 0 a target 8; there are 7"),
        ("{0: [7]}", "TypeError: unhashable type: 'list'"),
        ("self.nothing", "AttributeError: 'Mine' object has no attribute 'nothing'"),
    ],
)
def test_what_comes_from_outside_is_watched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, gives: str, says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(HEAD + f"    def pursue(self, team, targets, time_s): return {gives}\n")
    name = PURSUITS.pinned("mine.py:Mine")
    with pytest.raises(PluginError) as caught:
        rule(name).pursue(team_at(0.0, 1.0), targets_at(t7=2.0), 0.2)
    assert says in str(caught.value)
    assert str(caught.value).startswith(f"pursuit {name}: ")


def pursuing(rule_name: str, *places: Point) -> tuple[Pursuit, list[Guard]]:
    team = [
        Guard(i, f"guard {i}", Pose2D(x, y, 0.0), Navigator(FLOOR), None, lambda robot: None, 30.0)
        for i, (x, y) in enumerate(places)
    ]
    return Pursuit(team, PursuitSettings(rule=rule_name), rule(rule_name)), team


NEAR = 1.0 + 0.9 * PursuitSettings().retarget_m
Step = tuple[float, dict[int, Point], list[Point | None]]


@pytest.mark.parametrize(
    ("rule_name", "places", "steps"),
    [
        pytest.param(
            "nearest",
            [(-3.0, 0.0), (1.0, 0.0), (3.0, 3.0)],
            [(0.2, {7: (2.0, 0.0)}, [None, (2.0, 0.0), None])],
            id="the nearest guard goes and the others patrol",
        ),
        pytest.param(
            "nearest",
            [(0.0, 0.0), (3.0, 0.0)],
            [
                (0.2, {7: (1.0, 0.0)}, [(1.0, 0.0), None]),
                (0.4, {7: (NEAR, 0.0)}, [(1.0, 0.0), None]),
                (0.6, {7: (3.0, 0.1)}, [(3.0, 0.1), None]),
            ],
            id="a pursuer stays on its target and follows it",
        ),
        pytest.param(
            "nearest",
            [(0.0, 0.0)],
            [(0.2, {7: (1.0, 0.0)}, [(1.0, 0.0)]), (3.2, {}, [(1.0, 0.0)]), (3.4, {}, [None])],
            id="a target out of sight is given up",
        ),
        pytest.param(
            "assignment",
            [(0.0, 0.0), (-3.0, 0.0)],
            [(0.2, {7: (1.0, 0.0)}, [(1.0, 0.0), None]), (0.4, {7: (-2.0, 0.0)}, [None, (-2.0, 0.0)])],
            id="a guard that is called off has no goal and its target goes to another",
        ),
        pytest.param(
            "assignment",
            [(0.0, 0.0), (4.0, 0.0)],
            [
                (0.2, {7: (1.0, 0.0), 8: (3.0, 0.0)}, [(1.0, 0.0), (3.0, 0.0)]),
                (0.4, {7: (3.0, 1.0), 8: (1.0, 1.0)}, [(1.0, 1.0), (3.0, 1.0)]),
            ],
            id="two guards exchange their targets",
        ),
    ],
)
def test_guards_get_and_lose_goals_frame_by_frame(
    rule_name: str, places: list[Point], steps: list[Step]
) -> None:
    pursuit, team = pursuing(rule_name, *places)
    for time_s, seen, goals in steps:
        for target, place in seen.items():
            pursuit.detected(target, place, time_s)
        pursuit.update(time_s)
        assert [guard.goal for guard in team] == goals


def test_a_target_that_is_dropped_frees_its_pursuer_alone() -> None:
    pursuit, team = pursuing("nearest", (0.0, 0.0), (4.0, 0.0))
    pursuit.detected(7, (1.0, 0.0), 0.2)
    pursuit.detected(8, (3.0, 0.0), 0.2)
    pursuit.update(0.2)
    pursuit.drop(7)
    assert [guard.goal for guard in team] == [None, (3.0, 0.0)]


SIDE_M = 0.225
"""of the square that a guard is taken to cover"""


def seen(pursuit: Pursuit, team: list[Guard], places: Iterable[Point], time_s: float) -> list[int]:
    """The targets of boxes 0.2 m wide at these places, with guards where they believe to be."""
    squares = ally_squares([guard.pose for guard in team], SIDE_M)
    return [*pursuit.see([Box.square(x, y, 0.2) for x, y in places], squares, time_s)]


def test_a_box_here_and_there_is_one_target_and_one_far_off_another() -> None:
    pursuit, team = pursuing("nearest", (0.0, 0.0))
    assert seen(pursuit, team, [(1.0, 0.0)], 0.2) == [0]
    assert seen(pursuit, team, [(4.0, 0.0), (1.05, 0.0)], 0.4) == [1, 0]
    assert sorted(pursuit.targets) == [0, 1]


TOUCH_M = (SIDE_M + 0.2) / 2.0
"""from a guard to the centre of a box, along an axis, if both share an edge"""


@pytest.mark.parametrize("name", [*RULES, "mine.py:Mine"])
@pytest.mark.parametrize("at", [0, 1])
def test_no_rule_gets_a_box_on_a_guard_whichever_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, at: int
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(
        HEAD + "    def pursue(self, team, targets, time_s): return {0: max(targets)}\n"
    )
    rule_name = PURSUITS.pinned(name) if name not in RULES else name
    on, beside = ((3.0 * at + TOUCH_M + gap_m, 0.0) for gap_m in (-0.01, 0.01))
    pursuit, team = pursuing(rule_name, (0.0, 0.0), (3.0, 0.0))
    assert seen(pursuit, team, [on], 0.2) == []
    pursuit.update(0.2)
    assert not pursuit.targets
    assert [guard.goal for guard in team] == [None, None]
    assert seen(pursuit, team, [on, beside], 0.4) == [0]
    assert pursuit.targets[0].place == pytest.approx(beside)
    pursuit.update(0.4)
    assert any(guard.is_pursuing for guard in team) == (name != "none")


def test_a_pursuer_in_contact_drives_on_to_the_last_place_that_was_free() -> None:
    pursuit, (guard,) = pursuing("nearest", (0.0, 0.0))
    for place, time_s in (((0.4, 0.0), 0.2), ((0.1, 0.0), 0.4)):
        seen(pursuit, [guard], [place], time_s)
        pursuit.update(time_s)
    assert (guard.goal, guard.is_pursuing) == (pytest.approx((0.4, 0.0)), True)
    pursuit.update(1.4)  # more than a second without a box beside it
    assert (guard.goal, guard.is_pursuing) == (None, False)


def test_boxes_on_guards_are_targets_if_that_is_asked_for() -> None:
    team = pursuing("nearest", (0.0, 0.0))[1]
    settings = PursuitSettings(rule="nearest", ignores_allies=False)
    pursuit = Pursuit(team, settings, rule("nearest"))
    assert seen(pursuit, team, [(0.0, 0.0)], 0.2) == [0]


def test_a_guard_pursues_until_it_gets_a_patrol_point_or_none() -> None:
    _, (guard,) = pursuing("nearest", (0.0, 0.0))
    guard.pursue((1.0, 0.0))
    assert guard.state == GuardState((0.0, 0.0), (1.0, 0.0), is_pursuing=True)
    guard.drive_to((2.0, 0.0))
    assert guard.state == GuardState((0.0, 0.0), (2.0, 0.0))
    guard.pursue((1.0, 0.0))
    guard.cancel_goal()
    assert guard.state == GuardState((0.0, 0.0), None)


def test_a_pursuer_that_finds_the_place_empty_gives_it_up_and_one_on_its_way_does_not() -> None:
    for place, has_target in (((0.4, 0.0), False), ((3.0, 0.0), True)):
        pursuit, (guard,) = pursuing("nearest", (0.0, 0.0))
        seen(pursuit, [guard], [place], 0.2)
        pursuit.update(0.2)
        pursuit.update(1.0)
        assert pursuit.targets
        pursuit.update(1.4)
        assert bool(pursuit.targets) == has_target
        assert guard.goal == (pytest.approx(place) if has_target else None)
