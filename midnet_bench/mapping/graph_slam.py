"""Graph SLAM: a scan is matched with those before it, loops are closed, and a graph of poses is optimized."""

import math
import statistics
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from midnet_bench.elementary import directions
from midnet_bench.geometry import Floats, Indices, LidarGeometry, Pose2D, lengths, wrap_angle
from midnet_bench.mapping.correlative_matcher import (
    HitField,
    Match,
    Window,
    crossed,
    hit_field,
    match,
    slid_scores,
)
from midnet_bench.mapping.grid_slam import ORIGIN, GridSlam, ScanRays

# Chosen on one log and on drawn buildings: docs/studies/slips.md.
FEWEST_BEAMS = 90
"""Of fewer beams too little is left for a match to tell one place from another; GMapping maps such logs."""
LINEAR_UPDATE_M = 0.3  # A scan becomes a node after a drive of this length (Karto: MinimumTravelDistance).
ANGULAR_UPDATE_RAD = 0.3  # It becomes one after a turn by this angle too (Karto: MinimumTravelHeading).
FARTHEST_M = 25.0  # Farther returns are drawn, but not matched.
THIN_M = 0.1  # One return in a square of this side is matched: near walls count no more than far ones.
RUNNING_SCANS = 20  # A new scan is matched against so many before it (Karto: ScanBufferSize).
COLLAPSED = 0.75  # Below this share of the median of 50 scores a match is searched for in ``WIDE`` too.
GAIN = 0.1  # The match in ``WIDE`` is taken if its score is better by this much.
SLIP_SCORE, CROSSED = 0.85, 0.3
"""And if it is at least this share of the usual score, or if this share of the beams would pass through walls
where the wheels put the robot: in a place never seen before nothing contradicts the wheels."""
SLIDE_M, SLIDE_SCORE = 0.15, 0.9  # A match that keeps this share when slid so far does not hold that way.
LOOP_RADIUS_M = 4.0  # A loop may close with scans from so near (Karto: LoopSearchMaximumDistance).
LOOP_SCANS = 10  # A closure is matched against so many scans either side of an earlier visit's nearest.
LOOP_SCORE = 0.55  # Least score of a closure, 0 to 1 (Karto: LoopMatchMinimumResponseFine).
LATELY_SCANS = 8  # After a long way without a loop so many scans are matched at once, as one.
LONG_WAY_M = 10.0  # How far a long way is.
SURPRISE_M = 0.3  # A closure that moves the robot by more than this is a surprise.
SURPRISE_RAD = 0.1  # A closure that turns the robot by more than this is one too.
AGREEING = 3  # So many surprises within eight nodes have to agree before they are taken.
HIT_DEVIATION_M = 0.1  # Standard deviation of a hit from its wall: what an edge of the graph weighs.
ODOMETRY_DEVIATION = 0.2  # Standard deviation of the odometry between two nodes, metres and radians.
RESOLUTION_M = 0.05  # Side of a cell of the map.
OCCUPIED_THRESHOLD = 0.25  # Cells hit in more than this share of the visits are occupied in the map.
NARROW = Window(0.3, 0.2, 0.5, 0.5)
"""Search window around the odometry's pose; its pull holds where a corridor says nothing."""
WIDE = Window(1.0, 3.2, 0.05, 0.01)  # Search window as wide as wheels slip.
_WAYS = directions(np.linspace(0.0, 2.0 * math.pi, 16, endpoint=False).astype(np.float64))
_MOST_CHAINS = 3  # of old scans with which one scan may close loops
_PENDING_NODES = 8
_FEWEST_POINTS = 20  # fewer close no loop
_ROWS = np.arange(3)[:, None]  # of a node's block in the graph's equations
_DOUBT = 25.0  # chi squared at which a doubted edge of the graph counts half
_CONVERGED = 1e-4  # metres and radians that a step moves a pose at most when the poses count as settled


def parameters() -> dict[str, float]:
    """The public numbers above by their names in small letters, as the file beside a map lists them."""
    return {
        name.lower(): value
        for name, value in globals().items()
        if name.isupper() and not name.startswith("_") and isinstance(value, int | float)
    }


class _Scan(NamedTuple):
    """A scan as it is matched."""

    points: Floats  # (B, 2) thinned hits in the sensor frame, metres
    normals: Floats
    """(B, 2) unit normals of the walls that they lie on, by the beams beside them; 0 where far apart"""


class Edge(NamedTuple):
    """Node ``b`` was seen from ``a``; an edge that is doubted loses weight where it disagrees."""

    a: int
    b: int
    measured: Pose2D  # of b in the frame of a
    information: Floats  # (3, 3) in 1/m^2, 1/m and 1
    is_doubted: bool = False


class PoseGraph:
    """Nodes are planar poses, of which the first stays where it is; edges are measurements between them."""

    def __init__(self) -> None:
        self.poses: Floats = np.empty((0, 3))  # (N, 3) x, y (metres), yaw (radians)
        self.edges: list[Edge] = []

    def pose(self, node: int) -> Pose2D:
        """Where a node lies now; -1 is the last one."""
        return Pose2D(*self.poses[node].tolist())

    def add_node(self, pose: Pose2D) -> None:
        """A further node."""
        self.poses = np.vstack([self.poses, pose])

    def optimize(self, rounds: int, doubting: bool = True) -> None:
        """Move the nodes to the least sum of squared, weighed disagreements (Gauss-Newton).

        It ends after ``rounds``, or sooner when no pose moves any more. With ``doubting`` doubted edges
        weigh as Cauchy's loss lets them, else like all others.
        """
        if not self.edges:
            return
        a, b, measured, information, is_doubted = map(np.array, zip(*self.edges, strict=True))
        for _ in range(rounds):
            error, by_a, by_b = _disagreement(self.poses[a], self.poses[b], measured)
            chi_squared = (error * _times(information, error)).sum(axis=1)
            weight = np.where(is_doubted & doubting, 1.0 / (1.0 + chi_squared / _DOUBT), 1.0)
            weighed = weight[:, None, None] * information
            gradient, rows, columns, values = np.zeros(self.poses.shape), [], [], []
            for one, by_one in ((a, by_a), (b, by_b)):
                pull = _product(np.transpose(by_one, (0, 2, 1)), weighed)
                np.add.at(gradient, one, _times(pull, error))
                for other, by_other in ((a, by_a), (b, by_b)):
                    block = _product(pull, by_other)
                    rows.append(np.broadcast_to(3 * one[:, None, None] + _ROWS, block.shape).ravel())
                    columns.append(np.broadcast_to(3 * other[:, None, None] + _ROWS.T, block.shape).ravel())
                    values.append(block.ravel())
            places = (np.concatenate(rows), np.concatenate(columns))
            shape = (gradient.size, gradient.size)
            normal = coo_matrix((np.concatenate(values), places), shape).tocsc()[3:, 3:]
            solver = splu(normal, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
            step = solver.solve(-gradient.ravel()[3:]).reshape(-1, 3)
            self.poses[1:] += step
            if np.abs(step).max() < _CONVERGED:
                break


def _times(matrices: Floats, vectors: Floats) -> Floats:
    return (matrices * vectors[:, None, :]).sum(axis=2)


def _product(first: Floats, second: Floats) -> Floats:
    return (first[:, :, :, None] * second[:, None, :, :]).sum(axis=2)


def _disagreement(a: Floats, b: Floats, measured: Floats) -> tuple[Floats, Floats, Floats]:
    """(E, 3) pose of b seen from a, less the measured one, and its (E, 3, 3) derivatives by a and b."""
    cos, sin = directions(a[:, 2]).T
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    x, y = cos * dx + sin * dy, cos * dy - sin * dx
    turn = b[:, 2] - a[:, 2] - measured[:, 2]
    turn = (turn + math.pi) % (2.0 * math.pi) - math.pi
    error = np.stack([x - measured[:, 0], y - measured[:, 1], turn], axis=1)
    zero, one = np.zeros(len(a)), np.ones(len(a))
    by_a = np.stack([-cos, -sin, y, sin, -cos, -x, zero, zero, -one], axis=1).reshape(-1, 3, 3)
    by_b = np.stack([cos, sin, zero, -sin, cos, zero, zero, zero, one], axis=1).reshape(-1, 3, 3)
    return error, by_a, by_b


class _Closure(NamedTuple):
    """A later node was seen from an earlier one."""

    edge: Edge
    pose: Pose2D  # of the later node in the map as it was then


class GraphSlam(GridSlam):
    """SLAM with one hypothesis: what a slip of the wheels or a loop shows to be wrong is put right later.

    A scan is searched for in a window around the odometry's pose in the map of the last scans; if its score
    collapses, in a wider one. Scans of earlier visits close loops: their match is an edge of the graph. After
    a long way the last scans are matched together, so that one doorway is not taken for another. The scheme
    is open_karto's (Konolige et al. 2010, "Efficient sparse pose adjustment"). Nothing is left to chance.
    Each integrated scan is a node.
    ``initial``: the robot's base in the map frame when the first scan arrives.
    """

    _SLACK = (0.02, 0.005)

    def __init__(self, geometry: LidarGeometry, initial: Pose2D) -> None:
        update = (LINEAR_UPDATE_M, ANGULAR_UPDATE_RAD, None)
        super().__init__(geometry, math.inf, update, RESOLUTION_M, OCCUPIED_THRESHOLD)
        self._initial = initial
        self._graph = PoseGraph()
        self._matched: list[_Scan] = []
        self._odometry = self._node_odometry = initial
        self._untied_m = 0.0  # driven since the last closed loop
        self._relaxed = 0  # the node at which the graph was optimized last
        self._pending: list[_Closure] = []
        self.slips: list[tuple[int, float, float]] = []
        """taken against the wheels: the node, by how many metres and radians"""

    def finish(self) -> None:
        """Let the graph settle after the last scan."""
        self._graph.optimize(rounds=20)

    @property
    def best_pose(self) -> Pose2D:
        """The robot's base in the map frame: the last node, and the odometry since."""
        since = self._odometry.relative_to(self._node_odometry)
        pose = self._base_pose(self._graph.poses[-1]).compose(since)
        return pose._replace(yaw=wrap_angle(pose.yaw))

    def _sensor_poses(self) -> Floats:
        return self._graph.poses

    def _move(self, odometry_pose: Pose2D) -> Pose2D:
        step = odometry_pose.relative_to(self._odometry) if self._scans else ORIGIN
        self._odometry = odometry_pose
        return step

    def _integrate(self, rays: ScanRays) -> None:
        scan, score, mount = _matchable(rays), math.nan, self.geometry.mount
        if self._scans:
            step = self._odometry.compose(mount).relative_to(self._node_odometry.compose(mount))
            score = self._add_node(scan, step)
            self._untied_m += self._way_m
        else:
            self._graph.add_node(self._initial.compose(mount))
        self.scores.append(score)
        self._matched.append(scan)
        self._node_odometry = self._odometry
        self._close_loops(scan)

    def _add_node(self, scan: _Scan, step: Pose2D) -> float:
        """Add the scan's node, ``step`` by the wheels after the last one; its score, NaN without a match."""
        node, last = len(self._matched), self._graph.pose(-1)
        pose, score = last.compose(step), math.nan
        field = self._field(range(max(0, node - RUNNING_SCANS), node), pose, WIDE.half_m)
        if field is not None and len(scan.points):
            found = match(field, scan.points, pose, NARROW)
            usual = [score for score in self.scores[-50:] if math.isfinite(score)]
            if usual and found.score < COLLAPSED * statistics.median(usual):
                slipped = match(field, scan.points, pose, WIDE)
                is_clear = slipped.score >= SLIP_SCORE * statistics.median(usual)
                contradicts = is_clear or crossed(field, scan.points, pose) >= CROSSED
                if slipped.score > found.score + GAIN and contradicts:
                    turned = wrap_angle(slipped.pose.yaw - pose.yaw)
                    self.slips.append((node, slipped.pose.distance_to(pose), turned))
                    found = slipped
            pose, score = self._held(field, scan, pose, found), found.score
        information = _information(scan, last, pose, score)
        information += np.diag(np.full(3, 1.0 / (ODOMETRY_DEVIATION * ODOMETRY_DEVIATION)))
        self._graph.add_node(pose)
        self._graph.edges.append(Edge(node - 1, node, pose.relative_to(last), information))
        return score

    def _held(self, field: HitField, scan: _Scan, by_wheels: Pose2D, found: Match) -> Pose2D:
        """The match where walls hold it, the wheels where it slides: along a wall, beside a bare one."""
        scores = slid_scores(field, scan.points, found.pose, SLIDE_M * _WAYS)
        loose = int(np.argmax(scores)) % (len(_WAYS) // 2)
        if scores.max() < SLIDE_SCORE * found.score:
            return found.pose
        x, y = _WAYS[loose]
        along = (by_wheels.x - found.pose.x) * x + (by_wheels.y - found.pose.y) * y
        return found.pose._replace(x=found.pose.x + along * x, y=found.pose.y + along * y)

    def _close_loops(self, scan: _Scan) -> None:
        """Tie the newest node to earlier visits of its place, and let the graph settle if that moved it."""
        late, here = len(self._matched) - 1, self._graph.pose(-1)
        closures = [closure for early in self._earlier_visits() for closure in self._closure(early, scan)]
        accepted, is_surprised = [], False
        self._pending = [closure for closure in self._pending if late - closure.edge.b <= _PENDING_NODES]
        for closure in sorted(closures, key=lambda one: _far_apart(one.pose, here)):
            if not _far_apart(closure.pose, here):
                accepted.append(closure)
                continue
            self._pending.append(closure)
            alike = [old for old in self._pending if self._agree(old, closure)]
            if len(alike) >= AGREEING:
                is_surprised = True
                accepted += alike
                self._pending = [old for old in self._pending if not self._agree(old, closure)]
        if not accepted:
            return
        self._graph.edges += [closure.edge for closure in accepted]
        self._untied_m = 0.0
        if is_surprised:
            self._graph.optimize(rounds=10, doubting=False)
        if is_surprised or late - self._relaxed >= max(5, late // 100):
            self._graph.optimize(rounds=2)
            self._relaxed = late

    def _earlier_visits(self) -> list[int]:
        """The nearest node of each earlier visit within reach, the nearest visits first."""
        places = self._graph.poses[:, :2]
        away = lengths(places[: max(0, len(places) - 1 - RUNNING_SCANS)] - places[-1])
        near = np.flatnonzero(away < LOOP_RADIUS_M + self._loop_window().half_m)
        if len(near) == 0 or len(self._matched[-1].points) < _FEWEST_POINTS:
            return []
        visits = np.split(near, np.flatnonzero(np.diff(near) > 3) + 1)
        nearest = [int(visit[np.argmin(away[visit])]) for visit in visits]
        return sorted(nearest, key=lambda node: float(away[node]))[:_MOST_CHAINS]

    def _loop_window(self) -> Window:
        """As wide as the pose may have drifted on the way since the last loop."""
        way_m = self._untied_m
        drift_m = 0.2 + 0.02 * way_m
        pull = 0.03 / (drift_m * drift_m)
        return Window(min(0.2 + 0.03 * way_m, 3.0), min(0.1 + 0.005 * way_m, 0.4), pull, 0.1)

    def _closure(self, early: int, scan: _Scan) -> list[_Closure]:
        """The match of the newest node's scan with those around an early node, if it is good enough."""
        late, seen_from = len(self._matched) - 1, self._graph.pose(early)
        nodes = range(max(0, early - LOOP_SCANS), min(late - RUNNING_SCANS, early + LOOP_SCANS + 1))
        pose, window = self._graph.pose(late), self._loop_window()
        field = self._field(nodes, pose, window.half_m + NARROW.half_m)
        if field is None:
            return []
        if self._untied_m > LONG_WAY_M:
            pose, score = match(field, self._recent_points(), pose, window)
            if score < LOOP_SCORE:
                return []
        pose, score = match(field, scan.points, pose, NARROW)
        if score < LOOP_SCORE:
            return []
        information = _information(scan, seen_from, pose, score)
        return [_Closure(Edge(early, late, pose.relative_to(seen_from), information, True), pose)]

    def _recent_points(self) -> Floats:
        """(B, 2) points of the last scans in the newest one's frame, thinned, metres."""
        last = range(max(0, len(self._matched) - LATELY_SCANS), len(self._matched))
        here = self._graph.pose(-1)
        points = np.concatenate(
            [self._graph.pose(node).relative_to(here).transform(self._matched[node].points) for node in last]
        )
        points = points[lengths(points) < FARTHEST_M]
        return points[_thinned(points, THIN_M)]

    def _agree(self, old: _Closure, new: _Closure) -> bool:
        """Whether two closures move the robot alike, the way between them driven as the graph has it."""
        driven = self._graph.pose(new.edge.b).relative_to(self._graph.pose(old.edge.b))
        return not _far_apart(old.pose.compose(driven), new.pose)

    def _field(self, nodes: Sequence[int], around: Pose2D, window_m: float) -> HitField | None:
        """The hits of some nodes as far as a scan from the window around a pose can meet them."""
        near = np.concatenate(
            [self._graph.pose(node).transform(self._matched[node].points) for node in nodes]
        )
        near = near[np.abs(near - (around.x, around.y)).max(axis=1) < FARTHEST_M + window_m]
        return hit_field(near) if len(near) else None


def _far_apart(one: Pose2D, other: Pose2D) -> bool:
    return one.distance_to(other) > SURPRISE_M or abs(wrap_angle(one.yaw - other.yaw)) > SURPRISE_RAD


def _information(scan: _Scan, seen_from: Pose2D, pose: Pose2D, score: float) -> Floats:
    """(3, 3) information of a match: each point holds it along its wall's normal; 0 without a match."""
    if not math.isfinite(score):
        return np.zeros((3, 3))
    cos, sin = pose.relative_to(seen_from).direction
    (x, y), (along_x, along_y) = scan.points.T, scan.normals.T
    by_pose = np.stack(
        [cos * along_x - sin * along_y, sin * along_x + cos * along_y, x * along_y - y * along_x], axis=1
    )
    share = score / HIT_DEVIATION_M
    information: Floats = share * share * (by_pose[:, :, None] * by_pose[:, None, :]).sum(axis=0)
    return information


def _matchable(rays: ScanRays) -> _Scan:
    hits = rays.ends_m[: rays.hits]
    hits = hits[lengths(hits) < FARTHEST_M]
    normals = np.zeros_like(hits)
    if len(hits) > 2:
        # a wall where the beams before and after end near each other
        across = hits[2:] - hits[:-2]
        gap_m = lengths(across)
        wall = (gap_m > 0.0) & (gap_m < 0.2 + 0.1 * lengths(hits[1:-1]))
        normals[1:-1][wall] = np.stack([-across[wall, 1], across[wall, 0]], axis=1) / gap_m[wall, None]
    kept = _thinned(hits, THIN_M)
    return _Scan(hits[kept], normals[kept])


def _thinned(points: Floats, side_m: float) -> Indices:
    """The indices, ascending, of the first point in each square of the plane."""
    cells = np.floor(points / side_m).astype(np.int64)
    cells -= cells.min(axis=0, initial=0)
    _, first = np.unique(cells[:, 1] * (cells[:, 0].max(initial=0) + 1) + cells[:, 0], return_index=True)
    return np.sort(first)
