"""A graph of poses settles where what was measured says."""

import math

import numpy as np
import pytest

from midnet_bench.geometry import Pose2D
from midnet_bench.mapping.graph_slam import Edge, PoseGraph

SURE = np.diag([1e4, 1e4, 1e4])
ROUND = [Pose2D(2.0 * math.cos(a), 2.0 * math.sin(a), a + math.pi / 2) for a in np.arange(12) * math.pi / 6]


def drifted() -> PoseGraph:
    """Twelve poses on a circle, each seen from the one before; as they were driven, with a drift."""
    graph = PoseGraph()
    graph.add_node(ROUND[0])
    for k in range(1, len(ROUND)):
        step = ROUND[k].relative_to(ROUND[k - 1])
        graph.add_node(graph.pose(k - 1).compose(step._replace(x=1.1 * step.x, yaw=step.yaw + 0.05)))
        graph.edges.append(Edge(k - 1, k, step, SURE))
    return graph


def furthest_off_m(graph: PoseGraph) -> float:
    return max(graph.pose(k).distance_to(pose) for k, pose in enumerate(ROUND))


def test_without_an_edge_nothing_moves() -> None:
    graph = PoseGraph()
    graph.add_node(ROUND[3])
    graph.optimize(5)
    assert graph.pose(0) == ROUND[3]


def test_poses_go_where_the_edges_have_them() -> None:
    graph = drifted()
    assert furthest_off_m(graph) > 0.5
    graph.optimize(20)
    assert furthest_off_m(graph) < 1e-4


def test_a_wrong_step_is_found_by_a_loop() -> None:
    """A step of 1 m too much that is hardly believed; the loop's edge puts nearly all of it right there."""
    graph = drifted()
    step = ROUND[6].relative_to(ROUND[5])
    graph.edges.append(Edge(5, 6, step._replace(x=step.x + 1.0), 1e-3 * SURE))
    graph.edges.append(Edge(0, 11, ROUND[11].relative_to(ROUND[0]), SURE, is_doubted=True))
    graph.optimize(20)
    assert furthest_off_m(graph) < 0.01


@pytest.mark.parametrize(("doubted", "off_m"), [(True, 0.05), (False, 1.0)])
def test_a_doubted_edge_that_disagrees_hardly_counts(doubted: bool, off_m: float) -> None:
    graph = drifted()
    graph.optimize(20)
    graph.edges.append(Edge(0, 8, ROUND[8].relative_to(ROUND[0])._replace(x=5.0), SURE, doubted))
    graph.optimize(20)
    assert (furthest_off_m(graph) < off_m) is doubted
    graph.optimize(20, doubting=False)
    assert furthest_off_m(graph) > 0.3
