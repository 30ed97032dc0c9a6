"""Patrols on small graphs, and who visits what."""

import numpy as np
import numpy.typing as npt
import pytest

from midnet_bench.agents.agent_settings import PATROLS
from midnet_bench.agents.graph_patrols import (
    COARSE_M,
    ConscientiousReactive,
    CoordinatedIdleness,
    CyclicRoute,
    GraphPatrol,
)
from midnet_bench.agents.mobile_robot import GuardState
from midnet_bench.agents.patrol import TeamPatrol
from midnet_bench.errors import InputError
from midnet_bench.geometry import Point
from midnet_bench.plugins import PluginError

RULES = [CyclicRoute, ConscientiousReactive, CoordinatedIdleness]
Points = npt.NDArray[np.float64]


def ring() -> Points:
    """Places every 10 cm in a corridor, one metre wide, around a block of 4 x 4 m."""
    x, y = np.meshgrid(np.arange(-3.0, 3.01, 0.1), np.arange(-3.0, 3.01, 0.1))
    places = np.column_stack((x.ravel(), y.ravel()))
    return places[np.abs(places).max(axis=1) > 2.0]


def travel(rule, guards: int, moves: int) -> list[list[Point]]:
    """Where each guard went; all reach their goals in turn, one every ten seconds."""
    places = ring()
    team = [GuardState(tuple(places[i * 40]), None) for i in range(guards)]
    went: list[list[Point]] = [[] for _ in range(guards)]
    for move in range(moves):
        guard = move % guards
        goal = rule.next_point(guard, team, 10.0 * move)
        team[guard] = GuardState(goal, goal)
        went[guard].append(goal)
    return went


def test_nodes_are_apart_and_ways_go_around_the_block() -> None:
    graph = GraphPatrol(ring(), 1, np.random.default_rng(1))
    gaps = np.hypot(*(graph.nodes[:, None] - graph.nodes[None]).transpose(2, 0, 1))
    assert gaps[~np.eye(len(gaps), dtype=bool)].min() >= 1.5
    left, right = graph.nearest((-2.5, 0.0)), graph.nearest((2.5, 0.0))
    assert gaps[left, right] < 5.5
    assert graph.ways_m[left, right] > 7.0
    np.testing.assert_allclose(graph.ways_m, graph.ways_m.T)
    # every place is near a node
    far = np.hypot(*(ring()[:, None] - graph.nodes[None]).transpose(2, 0, 1)).min(axis=1)
    assert far.max() < 1.5 + COARSE_M * 2**0.5


@pytest.mark.parametrize("make", RULES)
@pytest.mark.parametrize("guards", [1, 3])
def test_every_node_is_visited_again_and_again(make, guards: int) -> None:
    rule = make(ring(), guards, np.random.default_rng(1))
    nodes = rule.nodes
    went = [point for own in travel(rule, guards, 4 * len(nodes)) for point in own]
    visits = [went.count(tuple(node)) for node in nodes.tolist()]
    assert min(visits) >= 1
    assert sum(visits) == 4 * len(nodes)


def test_a_route_takes_each_node_once_a_round_and_guards_are_apart() -> None:
    rule = CyclicRoute(ring(), 2, np.random.default_rng(1))
    count = len(rule.nodes)
    first, second = travel(rule, 2, 2 * count)
    assert len(set(first)) == len(set(second)) == count
    assert second[0] == first[round(count / 2)]


def test_coordinated_guards_have_goals_apart() -> None:
    rule = CoordinatedIdleness(ring(), 3, np.random.default_rng(1), apart_m=2.0)
    went = travel(rule, 3, 60)
    for i in range(19):
        assert np.hypot(*np.subtract(went[1][i], went[0][i])) >= 2.0


@pytest.mark.parametrize("make", RULES)
def test_one_place_is_enough(make) -> None:
    rule = make(ring()[:1], 1, np.random.default_rng(1))
    here = tuple(ring()[0].tolist())
    assert rule.next_point(0, [GuardState(here, None)], 0.0) == here


@pytest.mark.parametrize("make", RULES)
def test_the_same_numbers_send_the_same_way(make) -> None:
    one, other = (travel(make(ring(), 2, np.random.default_rng(7)), 2, 30) for _ in range(2))
    assert one == other


@pytest.mark.slow
def test_what_comes_from_outside_is_watched(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(
        "class Lost:\n"
        "    def __init__(self, points, guards, rng): pass\n"
        "    def next_point(self, guard, team, time_s): return float('nan'), 0.0\n"
        "class Late(Lost):\n"
        "    def next_point(self, guard, team, time_s): return self.nothing\n"
    )
    for name, says in (("Lost", "a finite point is needed"), ("Late", "AttributeError")):
        patrol = TeamPatrol(PATROLS.pinned(f"mine.py:{name}"), ring(), 1, np.random.default_rng(1))
        with pytest.raises(PluginError, match=says):
            patrol.next_point(0, [GuardState((0.0, 0.0), None)], 0.0)
    with pytest.raises(InputError, match="expected a class with a method 'next_point'"):
        PATROLS.pinned("midnet_bench.detectors.fusions:NoFusion")
