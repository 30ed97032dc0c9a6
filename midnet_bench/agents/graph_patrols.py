"""Patrols over a graph of places: a cyclic route, conscientious reactive guards, and coordinated ones."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from midnet_bench.agents.mobile_robot import GuardState
from midnet_bench.geometry import Floats, Point, lengths
from midnet_bench.settings import option

SPEED_MPS = 0.22  # of a Burger at its fastest
COARSE_M = 0.25  # side of the cells that ways are measured on, in steps to eight neighbours


@dataclass
class GraphPatrol:
    """Sends guards to nodes, some of the points, about evenly apart, with ways between them round walls."""

    points: Floats  # (n, 2) where a guard may be sent, each within reach of the others, metres, map frame
    guards: int
    rng: np.random.Generator
    spacing_m: float = option(1.5, "Least distance between two of the places.", ge=0.5, le=1000)

    def __post_init__(self) -> None:
        cells = np.floor(self.points / COARSE_M).astype(np.int64)
        cells, first = np.unique(cells, axis=0, return_index=True)
        places = self.points[first]
        chosen: list[int] = []
        for i, place in enumerate(places):
            if not chosen or lengths(places[chosen] - place).min() >= self.spacing_m:
                chosen.append(i)
        self.nodes = places[chosen]  # (k, 2) metres
        tree = KDTree(cells)
        steps = tree.sparse_distance_matrix(tree, 1.5, output_type="coo_matrix")  # weights 1 and sqrt 2
        ways_m = dijkstra(steps, indices=chosen)[:, chosen] * COARSE_M  # inf where none was found
        straight = lengths(self.nodes[:, None] - self.nodes[None])
        # thin passages may be lost on coarse cells
        self.ways_m = np.where(np.isinf(ways_m), 10.0 * straight, np.maximum(ways_m, straight))  # (k, k)

    def nearest(self, place: Point) -> int:
        """The node that is nearest to ``place`` in a straight line."""
        return int(lengths(self.nodes - place).argmin())

    def point(self, node: int) -> Point:
        """Where a node is: (x, y), metres."""
        x, y = self.nodes[node].tolist()
        return x, y


@dataclass
class CyclicRoute(GraphPatrol):
    """All guards follow one closed route, evenly apart.

    Chevaleyre, "Theoretical analysis of the multi-agent patrolling problem", IAT 2004. The route is a tour of
    the nodes: nearest neighbour, then two-opt.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        self._route = _tour(self.ways_m)
        self._next: dict[int, int] = {}

    def next_point(self, guard: int, team: Sequence[GuardState], time_s: float) -> Point:
        """The next node of the route; at first, a share of the way round from the first guard's node."""
        if guard not in self._next:
            begin = self._route.index(self.nearest(team[0].place))
            self._next[guard] = begin + round(guard * len(self._route) / self.guards)
        place = self._next[guard] % len(self._route)
        self._next[guard] = place + 1
        return self.point(self._route[place])


@dataclass
class ConscientiousReactive(GraphPatrol):
    """Each guard goes to that neighbour of its node which it has not visited itself for longest.

    Machado, Ramalho, Zucker and Drogoul, "Multi-agent patrolling: an empirical analysis", MABS 2002.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        self._visited_s = np.full((self.guards, len(self.nodes)), -math.inf)

    def next_point(self, guard: int, team: Sequence[GuardState], time_s: float) -> Point:
        """The neighbour of longest idleness; of several, one at random."""
        here = self.nearest(team[guard].place)
        visited_s = self._visited_s[guard]
        visited_s[here] = time_s
        near = np.flatnonzero(self.ways_m[here] <= 2.0 * self.spacing_m)
        near = near[near != here]
        if not len(near):
            near = np.delete(np.arange(len(visited_s)), here)
        if not len(near):  # one node is all there is
            return self.point(here)
        longest = near[visited_s[near] == visited_s[near].min()]
        return self.point(int(self.rng.choice(longest)))


@dataclass
class CoordinatedIdleness(GraphPatrol):
    """A guard goes where no guard was for longest, less the time to get there, and to no other guard's goal.

    Idleness is shared: a node counts as visited when any guard is sent on from it.
    """

    apart_m: float = option(3.0, "A node this near to another's goal is the last choice.", ge=0, le=1000)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._visited_s = np.zeros(len(self.nodes))

    def next_point(self, guard: int, team: Sequence[GuardState], time_s: float) -> Point:
        """The node of greatest idleness less travel that is apart from others' goals, if there is any."""
        here = self.nearest(team[guard].place)
        self._visited_s[here] = time_s
        worth_s = time_s - self._visited_s - self.ways_m[here] / SPEED_MPS
        worth_s[here] = -math.inf
        taken = [one.goal for i, one in enumerate(team) if i != guard and one.goal is not None]
        free = np.ones(len(worth_s), np.bool_)
        for goal in taken:
            free &= lengths(self.nodes - goal) >= self.apart_m
        worth_s[~free] -= 1e6  # only if nothing else is left
        best = np.flatnonzero(worth_s == worth_s.max())
        return self.point(int(self.rng.choice(best)))


def _tour(ways_m: Floats) -> list[int]:
    """A short closed tour of all nodes from node 0."""
    route, left = [0], set(range(1, len(ways_m)))
    while left:
        route.append(min(left, key=lambda node: (ways_m[route[-1], node], node)))
        left.remove(route[-1])
    improved = True
    while improved:
        improved = False
        for i in range(1, len(route) - 1):
            for j in range(i + 1, len(route)):
                a, b, c, d = route[i - 1], route[i], route[j], route[(j + 1) % len(route)]
                if ways_m[a, c] + ways_m[b, d] < ways_m[a, b] + ways_m[c, d] - 1e-9:
                    route[i : j + 1] = route[i : j + 1][::-1]
                    improved = True
    return route
