"""Who pursues whom, on hand-made teams and on random ones."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.agents.agent_settings import PURSUITS
from midnet_bench.agents.mobile_robot import GuardState
from midnet_bench.agents.pursuit import TargetState, TeamPursuit
from midnet_bench.errors import InputError
from midnet_bench.grid import OccupancyGrid
from midnet_bench.plugins import PluginError

FLOOR = OccupancyGrid(np.zeros((20, 20), np.int8), 0.5, (-5.0, -5.0))
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


def way_m(team: Team, targets: Targets, sent: dict[int, int]) -> float:
    return math.fsum(math.dist(team[guard].place, targets[target].place) for guard, target in sent.items())


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


@pytest.mark.parametrize("name", RULES)
@given(situation=situations())
def test_what_a_rule_gives_is_accepted_and_is_the_same_again(
    name: str, situation: tuple[Team, Targets]
) -> None:
    sent = rule(name).pursue(*situation, 1.0)
    assert sent == rule(name).pursue(*situation, 1.0)


@given(situation=situations())
def test_nearest_keeps_pursuers_and_leaves_no_free_guard_where_a_target_waits(
    situation: tuple[Team, Targets],
) -> None:
    team, targets = situation
    before = {guard: name for name, known in targets.items() for guard in known.pursuers}
    sent = rule("nearest").pursue(team, targets, 1.0)
    assert sent.items() >= before.items()
    new = {guard: name for guard, name in sent.items() if guard not in before}
    waiting = [name for name, known in targets.items() if not known.pursuers]
    assert len(set(new.values())) == len(new) == min(len(team) - len(before), len(waiting))
    assert set(new.values()) <= set(waiting)


@given(situation=situations())
def test_under_all_every_guard_pursues_and_a_free_one_what_is_nearest_to_it(
    situation: tuple[Team, Targets],
) -> None:
    team, targets = situation
    before = {guard: name for name, known in targets.items() for guard in known.pursuers}
    sent = rule("all").pursue(team, targets, 1.0)
    assert set(sent) == set(range(len(team)))
    for guard, name in sent.items():
        if guard not in before:
            gaps = [math.dist(team[guard].place, known.place) for known in targets.values()]
            assert math.dist(team[guard].place, targets[name].place) == min(gaps)
        else:
            assert name == before[guard]


@given(situation=situations())
def test_no_other_pairs_have_a_shorter_way_than_those_assigned(situation: tuple[Team, Targets]) -> None:
    team, targets = situation
    sent = rule("assignment").pursue(team, targets, 1.0)
    count = min(len(team), len(targets))
    assert len(set(sent.values())) == len(sent) == count
    least = min(
        way_m(team, targets, dict(zip(guards, names, strict=True)))
        for guards in itertools.combinations(range(len(team)), count)
        for names in itertools.permutations(targets, count)
    )
    assert way_m(team, targets, sent) == pytest.approx(least, abs=1e-9)


HEAD = "class Mine:\n    def __init__(self, prior_map, rng): pass\n"


@pytest.mark.parametrize(
    ("gives", "says"),
    [
        ("[0]", "pursue gave list; give a dict"),
        ("None", "pursue gave NoneType; give a dict"),
        ("{2: 7}", "pursue gave a guard 2; there are 0 to 1"),
        ("{-1: 7}", "pursue gave a guard -1; there are 0 to 1"),
        ("{'guard 1': 7}", "pursue gave a guard 'guard 1'; there are 0 to 1"),
        ("{0: 8}", "pursue gave guard 0 a target 8; there are 7"),
        ("{0: None}", "pursue gave guard 0 a target None; there are 7"),
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


def test_a_class_for_another_seam_is_refused() -> None:
    with pytest.raises(InputError, match="expected a class with a method 'pursue'"):
        PURSUITS.pinned("midnet_bench.detectors.fusions:NoFusion")
