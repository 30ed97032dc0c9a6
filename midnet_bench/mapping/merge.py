"""One map of a team's maps, whether or not the robots know where they started.

Where one map lies in another is proposed by features, refined on the grids, and judged against its rivals.
"""

import math
from collections.abc import Sequence
from itertools import combinations, product
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
import scipy.fft

from midnet_bench.geometry import Floats, Pose2D, mean_point, wrap_angle
from midnet_bench.grid import (
    OCCUPIED_FROM,
    UNKNOWN,
    OccupancyGrid,
    cell_centers,
    cells_to_unset,
    same_resolution,
    values_at,
)
from midnet_bench.mapping.grid_slam import ORIGIN, hill_climb

Image = npt.NDArray[np.float32]

TOLERANCE_M = 0.1
"""Walls this near to each other are the same wall; a wall deeper than this in free space contradicts it."""

_REACHES_M = {0.2: 3, 0.1: 3, 0.05: 4}
"""reach of a wall's pull, metres: how often the step is halved, to 3 mm at last"""
_POINTS = 1500  # of a map's walls that a refinement looks at, about
_COARSE_CELL_M = 0.1
_PEAKS_PER_TURN, _PEAK_CELLS = 2, 6  # placements that a turn suggests, and how far they are apart
_CONTRADICTION_WEIGHT = 3.0
_HALO_M = 1.0  # features see walls up to this distance
_RATIO = 0.7  # of Lowe's ratio test
_INLIER_CELLS = 3.0
_MIN_MATCHES = 6

# Two maps are merged within these limits and refused beyond any one of them.
MIN_CONFIDENCE = 0.7  # of the features; multirobot_map_merge's 1.0 leaves out good pairs
MAX_SCALE_ERROR = 0.02  # of the features
MIN_AGREEMENT = 0.9  # of the grids
MIN_OVERLAP = 0.25  # share of the smaller map's wall
MAX_RIVAL = 0.3  # share of the best placement's evidence


class Proposal(NamedTuple):
    """A placement of one map in another, as features suggest it."""

    pose: Pose2D  # the second map's frame in the first map's frame
    confidence: float  # inliers / (8 + 0.3 * matches), OpenCV's measure of a pair of images
    scale: float
    """what the features say of the maps' relative size, divided out of ``pose``; 1 when they agree"""


def propose(first: OccupancyGrid, second: OccupancyGrid) -> Proposal | None:
    """The placement that most feature matches agree on; None when fewer than six matches are found.

    multirobot_map_merge's front end: AKAZE features, the ratio test at 0.7 both ways, RANSAC for rotation,
    translation and one scale (OpenCV's draws from a generator of its own, always alike). What it is fed
    differs: not the grid's bytes, where the ragged edge of the unknown is the strongest feature, but each
    cell's distance from the nearest occupied one up to 1 m, which two partial views of a wall have in
    common. The maps are int8, occupied from 65 on, of any resolutions.
    """
    (points_a, described_a), (points_b, described_b) = _features(first), _features(second)
    there, back = _distinct(described_a, described_b), _distinct(described_b, described_a)
    pairs = np.array(sorted(set(there) | {(a, b) for b, a in back}))
    if len(pairs) < _MIN_MATCHES:
        return None
    matched_a, matched_b = points_a[pairs[:, 0]], points_b[pairs[:, 1]]
    transform, inlier_mask = cv2.estimateAffinePartial2D(
        matched_b,
        matched_a,
        method=cv2.RANSAC,
        ransacReprojThreshold=_INLIER_CELLS * max(first.resolution, second.resolution),
        maxIters=5000,
        confidence=0.999,
    )
    if transform is None:
        return None
    inliers = inlier_mask.ravel().astype(bool)
    (c, _, _), (s, _, _) = transform.tolist()
    yaw = math.atan2(s, c)
    x, y = matched_a[inliers].mean(axis=0).tolist()
    x_b, y_b = matched_b[inliers].mean(axis=0).tolist()
    turned = Pose2D(0.0, 0.0, yaw).compose(Pose2D(x_b, y_b, 0.0))
    confidence = float(inliers.sum()) / (8.0 + 0.3 * len(pairs))
    return Proposal(Pose2D(x - turned.x, y - turned.y, yaw), confidence, math.hypot(c, s))


def _features(grid: OccupancyGrid) -> tuple[Floats, npt.NDArray[np.uint8]]:
    """((N, 2) x, y in the grid's frame in metres, (N, 61) descriptors)."""
    not_wall = (grid.data < OCCUPIED_FROM).view(np.uint8)
    descriptors = None
    # of one row AKAZE writes past the end of its buffers, and of one cell it raises cv2.error
    if not not_wall.all() and min(not_wall.shape) > 1:
        distance_m = cells_to_unset(not_wall) * grid.resolution
        image = np.rint(np.minimum(distance_m, _HALO_M) * (255.0 / _HALO_M)).astype(np.uint8)
        keypoints, descriptors = cv2.AKAZE.create().detectAndCompute(image, None)
    if descriptors is None:
        return np.zeros((0, 2)), np.zeros((0, 61), dtype=np.uint8)
    pixels = np.array([keypoint.pt for keypoint in keypoints])
    return (pixels + 0.5) * grid.resolution + grid.origin, descriptors


def _distinct(queries: npt.NDArray[np.uint8], targets: npt.NDArray[np.uint8]) -> list[tuple[int, int]]:
    """(query, target) where the best target is clearly better than the second best."""
    if len(targets) < 2:
        return []
    ranked = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(queries, targets, k=2)
    return [
        (best.queryIdx, best.trainIdx) for best, other in ranked if best.distance < _RATIO * other.distance
    ]


class WallMap(NamedTuple):
    """A map as the alignment sees it."""

    grid: OccupancyGrid
    walls: Floats  # (N, 2) centres of the occupied cells, metres
    open_space: Floats  # (M, 2) centres of the free cells deeper than the tolerance
    to_wall_m: Image  # (H, W) from each cell to the nearest occupied one
    depth_m: Image  # (H, W) from each free cell to the nearest that is not free; 0 there
    pulls: tuple[Image, ...]
    """(H, W) each, from far-reaching to near: what a wall of the other map gains here, -1 to 1"""

    @property
    def wall_m(self) -> float:
        """Length of all its wall, as if one cell thick."""
        return len(self.walls) * self.grid.resolution

    @classmethod
    def of(cls, grid: OccupancyGrid) -> "WallMap":
        """The alignment's view of an int8 grid with at least one occupied cell."""
        occupied = grid.data >= OCCUPIED_FROM
        free = (grid.data >= 0) & ~occupied
        to_wall_m = cells_to_unset(~occupied) * np.float32(grid.resolution)
        depth_m = cells_to_unset(np.pad(free, 1))[1:-1, 1:-1] * np.float32(grid.resolution)
        pulls = tuple(
            np.exp(-0.5 * (to_wall_m / reach) ** 2) - np.minimum(depth_m / (2.0 * reach), 1.0)
            for reach in _REACHES_M
        )
        walls, open_space = cell_centers(grid, occupied), cell_centers(grid, depth_m > TOLERANCE_M)
        return cls(grid, walls, open_space, to_wall_m, depth_m, pulls)


class Fit(NamedTuple):
    """What two maps say of each other: metres of wall one cell thick, the mean of both directions."""

    shared_m: float  # wall of one that meets wall of the other
    contradicted_m: float
    """wall of one that lies in open space of the other; wall in the unknown counts nowhere"""

    @property
    def agreement(self) -> float:
        """Share of shared wall in both, 0 to 1; 0 without overlap."""
        total = self.shared_m + self.contradicted_m
        return self.shared_m / total if total > 0.0 else 0.0

    @property
    def evidence_m(self) -> float:
        """Shared wall less contradictions, weighted so that it is 0 at ``MIN_AGREEMENT``."""
        return self.shared_m - self.contradicted_m * MIN_AGREEMENT / (1.0 - MIN_AGREEMENT)


def fit(a: WallMap, b: WallMap, pose: Pose2D) -> Fit:
    """How ``a`` and ``b`` agree with b's frame at ``pose`` in a's frame."""
    shared_m = contradicted_m = 0.0
    for seen, other, placed in ((a, b, pose), (b, a, pose.inverse())):
        walls = placed.transform(other.walls)
        same = values_at(seen.to_wall_m, seen.grid, walls, outside=math.inf) <= TOLERANCE_M
        in_the_open = values_at(seen.depth_m, seen.grid, walls, outside=0.0) > TOLERANCE_M
        shared_m += 0.5 * other.grid.resolution * float(np.count_nonzero(same))
        contradicted_m += 0.5 * other.grid.resolution * float(np.count_nonzero(in_the_open & ~same))
    return Fit(shared_m, contradicted_m)


def refine(a: WallMap, b: WallMap, pose: Pose2D) -> Pose2D:
    """The placement near ``pose`` at which walls lie best on walls and not in open space.

    A hill climb on a score that is summed over the walls of both maps; its reach shrinks from 0.2 to 0.05 m.
    Open space has to count against a wall: on walls alone, two views of a wall from either side settle face
    on face, a wall's thickness off.
    """
    points_a, points_b = (m.walls[:: max(1, len(m.walls) // _POINTS)] for m in (a, b))
    middle = b.walls.mean(axis=0)
    radius_m = float(np.hypot(*(b.walls - middle).T).mean()) + b.grid.resolution
    # Turning about b's middle keeps the three moves independent.
    to_middle = Pose2D(float(middle[0]), float(middle[1]), 0.0)
    from_middle = to_middle.inverse()
    at = pose.compose(to_middle)

    def score(pulls: tuple[Image, Image], pose: Pose2D, enough: float) -> float:
        placed = pose.compose(from_middle)
        on_a = _interpolated(pulls[0], a.grid, placed.transform(points_b))
        return on_a + _interpolated(pulls[1], b.grid, placed.inverse().transform(points_a))

    both = zip(a.pulls, b.pulls, strict=True)
    for pulls, (reach_m, halvings) in zip(both, _REACHES_M.items(), strict=True):
        at, _ = hill_climb(score, pulls, at, reach_m, reach_m / radius_m, halvings)
    return at.compose(from_middle)


def coarse_placements(a: WallMap, b: WallMap, yaw_rad: float) -> list[Pose2D]:
    """Placements anywhere, good to 0.1 m, at ``yaw_rad`` and the three quarter turns from it, best first.

    Buildings have right angles, so this is where a placement's rivals are. For each turn all shifts
    are scored at once by correlation (FFT): wall on wall less three times wall on open space.
    """
    placements: list[tuple[float, Pose2D]] = []
    walls_a, open_a, origin_a = _coarse(a, 0.0)
    gain_a = np.where(_dilated(walls_a), 1.0, -_CONTRADICTION_WEIGHT * open_a)
    for quarter in range(4):
        yaw = yaw_rad + quarter * math.pi / 2.0
        walls_b, open_b, origin_b = _coarse(b, yaw)
        loss_b = np.where(_dilated(walls_b), 0.0, _CONTRADICTION_WEIGHT * open_b)
        sizes = zip(walls_a.shape, walls_b.shape, strict=True)
        shape = np.array([scipy.fft.next_fast_len(m + n, real=True) for m, n in sizes])
        spectrum = scipy.fft.rfft2(gain_a, shape) * np.conj(scipy.fft.rfft2(walls_b, shape))
        spectrum -= scipy.fft.rfft2(walls_a, shape) * np.conj(scipy.fft.rfft2(loss_b, shape))
        scores = scipy.fft.irfft2(spectrum, shape)
        for _ in range(_PEAKS_PER_TURN):
            peak = np.array(np.unravel_index(int(np.argmax(scores)), scores.shape))
            # The correlation is cyclic: shifts past the first map's size stand for negative ones.
            row, column = peak - np.where(peak >= walls_a.shape, shape, 0)
            x, y = (origin_a + _COARSE_CELL_M * np.array([column, row]) - origin_b).tolist()
            placements.append((float(scores[tuple(peak)]), Pose2D(x, y, yaw)))
            around = np.arange(-_PEAK_CELLS, _PEAK_CELLS + 1)
            rows, columns = (peak[:, None] + around) % shape[:, None]
            scores[np.ix_(rows, columns)] = -np.inf
    return [pose for score, pose in sorted(placements, key=lambda item: -item[0]) if score > 0.0]


def _coarse(m: WallMap, yaw_rad: float) -> tuple[Floats, Floats, Floats]:
    """(walls, open space, origin) of the map turned by ``yaw_rad``: 1 on cells of 0.1 m that hold any."""
    turn = Pose2D(0.0, 0.0, yaw_rad)
    walls, spaces = turn.transform(m.walls), turn.transform(m.open_space)
    points = np.concatenate((walls, spaces))
    origin = points.min(axis=0)
    width, height = ((points.max(axis=0) - origin) / _COARSE_CELL_M).astype(np.int64) + 1
    grids = np.zeros((2, height, width))
    for grid, centres in zip(grids, (walls, spaces), strict=True):
        columns, rows = ((centres - origin) / _COARSE_CELL_M).astype(np.int64).T
        grid[rows, columns] = 1.0
    return grids[0], grids[1], origin


def _dilated(cells: Floats) -> npt.NDArray[np.bool_]:
    """The set cells and their eight neighbours."""
    return cv2.dilate(cells, np.ones((3, 3))) > 0.0


def _interpolated(image: Image, grid: OccupancyGrid, points: Floats) -> float:
    """The sum over the points of the image's values between cell centres; 0 off the grid."""
    columns, rows = ((points - grid.origin) / grid.resolution - 0.5).astype(np.float32).T.copy()
    return float(np.sum(cv2.remap(image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)))


class MapMatch(NamedTuple):
    """What came of matching a map against another: a placement, or why there is none."""

    placement: Pose2D | None  # the second map's frame in the first map's frame; None when refused
    refusal: str  # why not; empty when there is a placement
    confidence: float  # inliers / (8 + 0.3 * matches) of the features; 0 without features
    evidence_m: float = 0.0  # shared wall less weighted contradictions, metres


Matches = dict[tuple[int, int], MapMatch]
"""of each pair of a team's maps by their places in the team, the lower one first"""


def match_maps(first: OccupancyGrid, second: OccupancyGrid) -> MapMatch:
    """Where ``second`` lies in ``first``: a rigid placement, or a refusal with its reason.

    Features propose a placement; the grids improve it and judge it: how much wall they share, how
    much of one's wall stands in the other's open space, and whether the maps would fit elsewhere too.
    A square room fits in four ways, and then none is drawn. The maps are int8, -1 unknown, 0 to 100, occupied
    from 65 on.

    Not as in multirobot_map_merge: the package accepts a pair whose features agree (confidence >= 1),
    keeps the features' scale in its transform and looks neither at the grids nor for a second solution.
    """
    proposal = propose(first, second)
    if proposal is None:
        return MapMatch(None, "too few features match", 0.0)
    if abs(proposal.scale - 1.0) > MAX_SCALE_ERROR:
        refusal = f"features want a scale of {proposal.scale:.3f}, not 1"
        return MapMatch(None, refusal, proposal.confidence)

    a, b = WallMap.of(first), WallMap.of(second)
    poses = [refine(a, b, proposal.pose)]
    poses += [refine(a, b, pose) for pose in coarse_placements(a, b, poses[0].yaw)]
    fits = [fit(a, b, pose) for pose in poses]
    evidence = [found.evidence_m for found in fits]
    best = int(np.argmax(evidence))
    x, y = mean_point(b.walls).tolist()
    judged = zip(poses, evidence, strict=True)
    elsewhere = [value for pose, value in judged if not _same_place(pose, poses[best], Pose2D(x, y, 0.0))]
    rival = max(elsewhere, default=0.0) / evidence[best] if evidence[best] > 0.0 else 0.0
    overlap = evidence[best] / min(a.wall_m, b.wall_m)
    confidence, agreement = proposal.confidence, fits[best].agreement
    refusal = ""
    if confidence < MIN_CONFIDENCE:
        refusal = f"confidence {confidence:.2f} of the features is below {MIN_CONFIDENCE}"
    elif agreement < MIN_AGREEMENT:
        refusal = f"agreement {agreement:.2f} of the grids is below {MIN_AGREEMENT}"
    elif overlap < MIN_OVERLAP:
        refusal = f"only {overlap:.0%} of the smaller map's wall is shared, less than {MIN_OVERLAP:.0%}"
    elif rival > MAX_RIVAL:
        refusal = f"ambiguous: another placement has {rival:.0%} of the best one's evidence"
    return MapMatch(None if refusal else poses[best], refusal, confidence, evidence[best])


def compose(maps: Sequence[OccupancyGrid], placements: Sequence[Pose2D]) -> OccupancyGrid:
    """All maps in one grid that holds them all: the largest value known of each cell, -1 where none is.

    Nearest neighbour and signed maximum, as in multirobot_map_merge: known beats unknown, occupied beats
    free, the order does not matter. Not so the transform: the package puts metres into one of pixels,
    applies the inverse, ignores origins and moves (0, 0) to the middle of the result. Cells have the first
    map's resolution, and lie on its lattice if its placement is not turned, so that a map alone at the
    identity comes back as it is.
    ``maps``: at least one; int8, -1 unknown, 0 to 100; ``placements``: their frames in the result's frame.
    """
    resolution = maps[0].resolution
    # so that none reaches a rounding beyond its cells
    maps = [
        grid.at_resolution(resolution) if same_resolution(grid.resolution, resolution) else grid
        for grid in maps
    ]
    outer = [np.array([*product(grid.extent[::2], grid.extent[1::2])]) for grid in maps]
    corners = np.concatenate([pose.transform(each) for each, pose in zip(outer, placements, strict=True)])
    anchor = placements[0].transform(np.array([maps[0].origin]))[0]
    low = np.floor((corners.min(axis=0) - anchor) / resolution + 1e-6).astype(int)
    high = np.ceil((corners.max(axis=0) - anchor) / resolution - 1e-6).astype(int)
    origin_x, origin_y = (anchor + low * resolution).tolist()
    width, height = (high - low).tolist()
    merged = OccupancyGrid(np.full((height, width), UNKNOWN, dtype=np.int8), resolution, (origin_x, origin_y))
    for grid, pose in zip(maps, placements, strict=True):
        _draw(grid, pose, merged)
    return merged


def _draw(grid: OccupancyGrid, pose: Pose2D, onto: OccupancyGrid) -> None:
    """Raise the cells of ``onto`` to what ``grid`` says, nearest neighbour."""
    corner = (pose.transform(np.array([grid.origin]))[0] - onto.origin) / onto.resolution
    column, row = np.rint(corner).astype(int).tolist()
    if pose.yaw == 0.0 and grid.resolution == onto.resolution and np.abs(corner - (column, row)).max() < 1e-6:
        cells = onto.data[row : row + grid.height, column : column + grid.width]
        np.maximum(cells, grid.data, out=cells)
        return
    centres = cell_centers(onto, np.ones(onto.data.shape, dtype=np.bool_))
    values = values_at(grid.data, grid, pose.inverse().transform(centres), outside=UNKNOWN)
    np.maximum(onto.data, values.reshape(onto.data.shape), out=onto.data)


def _same_place(a: Pose2D, b: Pose2D, middle: Pose2D) -> bool:
    """Whether two placements of a map with this middle are one and the same, to 0.3 m and 0.1 rad."""
    apart_m = a.compose(middle).distance_to(b.compose(middle))
    return apart_m < 0.3 and abs(wrap_angle(a.yaw - b.yaw)) < 0.1


def _grow(root: int, links: Sequence[tuple[int, int, Pose2D]]) -> dict[int, Pose2D]:
    """Placements in the root's frame of all maps that links connect to it, strongest links first."""
    placed = {root: ORIGIN}
    while link := next((link for link in links if (link[0] in placed) != (link[1] in placed)), None):
        first, second, step = link
        if first in placed:
            placed[second] = placed[first].compose(step)
        else:
            placed[first] = placed[second].compose(step.inverse())
    return placed


def largest(maps: Sequence[OccupancyGrid]) -> OccupancyGrid:
    """The map that knows most cells; the first of several."""
    return max(maps, key=lambda grid: np.count_nonzero(grid.data >= 0))


def by_known_starts(maps: Sequence[OccupancyGrid]) -> OccupancyGrid:
    """The team's map where every robot began its own at its known start: all are in one frame."""
    return compose(maps, [ORIGIN] * len(maps))


def by_features(maps: Sequence[OccupancyGrid], starts: Sequence[Pose2D]) -> tuple[OccupancyGrid, Matches]:
    """The team's map where no robot knows another's start, and what came of matching every pair.

    Each map is matched in a frame that begins at its robot's start, so that nothing but the features can
    bring them together. The largest group that accepted pairs connect is drawn, each map placed over the
    pairs with the most evidence. Maps outside the group are left out; where every pair is refused, the
    largest single map comes back. The start of the first robot among the merged lays the result into the
    common frame, so that it can be compared with a true map.

    ``maps``: one per robot; int8, -1 unknown, 0 to 100; ``starts``: where each began; both in that frame.
    """
    own = [compose([grid], [start.inverse()]) for grid, start in zip(maps, starts, strict=True)]
    matches = {(i, j): match_maps(own[i], own[j]) for i, j in combinations(range(len(maps)), 2)}
    by_evidence = sorted(matches.items(), key=lambda item: (-item[1].evidence_m, item[0]))
    links = [(*pair, match.placement) for pair, match in by_evidence if match.placement is not None]
    placed = max((_grow(root, links) for root in range(len(maps))), key=len)
    if len(placed) == 1:
        return largest(maps), matches
    merged = sorted(placed)
    root = starts[merged[0]]
    placements = [root.compose(placed[k]).compose(starts[k].inverse()) for k in merged]
    return compose([maps[k] for k in merged], placements), matches


def confidence(matches: Matches) -> float:
    """Of the features: of the worst pair accepted, of the best if all were refused; NaN without pairs."""
    accepted = [match.confidence for match in matches.values() if not match.refusal]
    return min(accepted, default=max((match.confidence for match in matches.values()), default=math.nan))


def refusals(matches: Matches) -> list[str]:
    """A line for each pair of maps that was not merged, and why."""
    return [
        f"the maps of robots {first + 1} and {second + 1} were not merged: {match.refusal}"
        for (first, second), match in matches.items()
        if match.refusal
    ]
