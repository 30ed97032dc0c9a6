"""Scenes of upright rectangles, what each robot would box of them, and the team's boxes.

A scene is a square as dense as Map 1 with its five guards. Intruders keep Map 1's distance from each other,
and robots lie anywhere between them; nothing hides anything. A robot sees what has its centre in the window,
and of it the sides that face the robot. Its box is around those, grown by the costmap's inflation to whole
cells, and shifted by the robot's error of its own place.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.arena.arena import TEAM, load_arena
from midnet_bench.campaign.trial import Row
from midnet_bench.detectors.detector_node import TeamFusion
from midnet_bench.detectors.fusions import ious
from midnet_bench.elementary import standard_normals
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.detection import FREE, BoxArray
from midnet_bench.midnet.midnet_settings import MIDNetSettings
from midnet_bench.midnet.pipeline import MIDNet
from midnet_bench.rng import stream
from midnet_bench.robots.turtlebot3 import BURGER
from midnet_bench.scoring.frame_counts import TruthObject, count_frame, total

CELL_M = 0.05
GROWN_M = 0.105  # from a return to the edge of its cells above the default ``thresh_local``

Places = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Team:
    """What sees the scenes, and what is done with it."""

    robots: int = 5
    fusion: str = "paper"
    window_m: float = 3.5  # side of the square around a robot in which it sees; that of MIDNet's costmap
    pose_error_m: float = 0.02  # standard deviation of each coordinate of a robot's believed place
    midnet: MIDNetSettings = field(default_factory=MIDNetSettings)


class Scene(NamedTuple):
    """One frame."""

    robots: Places  # (n, 2) where the robots are, metres
    believed: Places  # (n, 2) where they believe themselves to be
    intruders: BoxArray  # (k, 4)


class Seen(NamedTuple):
    """What the team tells of a scene."""

    boxes: list[BoxArray]  # of each robot, (n, 4), map frame, metres
    poses: list[Pose2D]  # which it believes in
    in_range: npt.NDArray[np.bool_]  # (k,) whether some robot sees the intruder


def draw_scene(robots: int, pose_error_m: float, rng: np.random.Generator) -> Scene:
    """A square with as many robots and intruders on a square metre as Map 1 with five guards."""
    arena = load_arena("map1")
    share = robots / TEAM
    side_m = math.sqrt(arena.enclosure_m[0] * arena.enclosure_m[1] * share)
    standing = round(arena.stationary_intruders.count * share)
    moving = round(arena.mobile_intruders.count * share)
    width_m = 2.0 * BURGER.seen.radius_m
    sides = np.concatenate(
        (rng.uniform(*arena.stationary_intruders.size_m, (standing, 2)), np.full((moving, 2), width_m))
    )
    robot_sides = np.full((robots, 2), 2.0 * BURGER.radius_m)
    gaps_m = np.repeat((arena.mobile_intruders.clearance_m, 0.0), (len(sides), robots))
    boxes = _apart(np.concatenate((sides, robot_sides)), gaps_m, side_m, rng)
    intruders, bodies = boxes[: len(sides)], boxes[len(sides) :]
    places = (bodies[:, :2] + bodies[:, 2:]) / 2.0
    return Scene(places, places + pose_error_m * standard_normals(rng, (robots, 2)), intruders)


def _apart(sides: Places, gaps_m: Places, side_m: float, rng: np.random.Generator) -> BoxArray:
    """(n, 4) boxes of these sides, each at least its gap off all before it, in a square."""
    boxes = np.empty((len(sides), 4))
    for i, (size, gap_m) in enumerate(zip(sides, gaps_m, strict=True)):
        while True:
            centre = rng.uniform(0.0, side_m, 2)
            low, high = centre - size / 2.0, centre + size / 2.0
            others = boxes[:i]
            if not ((low - gap_m < others[:, 2:]) & (high + gap_m > others[:, :2])).all(axis=1).any():
                break
        boxes[i, :2], boxes[i, 2:] = low, high
    return boxes


def seen_by_all(scene: Scene, window_m: float) -> Seen:
    """Each robot's boxes of the intruders and of its allies."""
    half_m = BURGER.seen.radius_m
    allies = np.hstack((scene.robots - half_m, scene.robots + half_m))
    boxes, in_range = [], np.zeros(len(scene.intruders), np.bool_)
    for robot, (place, believed) in enumerate(zip(scene.robots, scene.believed, strict=True)):
        near = _within(scene.intruders, place, window_m)
        in_range |= near
        others = _within(allies, place, window_m)
        others[robot] = False
        things = np.concatenate((scene.intruders[near], allies[others]))
        boxes.append(_cells(_facing(things, place) + np.tile(believed - place, 2)))
    return Seen(boxes, [Pose2D(x, y, 0.0) for x, y in scene.believed.tolist()], in_range)


def _within(boxes: BoxArray, place: Places, window_m: float) -> npt.NDArray[np.bool_]:
    centres = (boxes[:, :2] + boxes[:, 2:]) / 2.0
    return np.asarray((np.abs(centres - place) <= window_m / 2.0).all(axis=1))


def _facing(boxes: BoxArray, place: Places) -> BoxArray:
    """Around the sides of each that face ``place``; all of one that holds it."""
    low, high = boxes[:, :2], boxes[:, 2:]
    before, behind = place < low, place > high
    beside = (before | behind)[:, ::-1]  # a side along x is seen from beyond in y
    return np.hstack((np.where(behind & ~beside, high, low), np.where(before & ~beside, low, high)))


def _cells(boxes: BoxArray) -> BoxArray:
    """Grown by the inflation, to whole cells."""
    low, high = boxes[:, :2] - GROWN_M, boxes[:, 2:] + GROWN_M
    return np.hstack((np.floor(low / CELL_M), np.ceil(high / CELL_M))) * CELL_M


def make_fusion(team: Team) -> TeamFusion:
    """Algorithm 2 and the fusion, which have seen nothing yet."""
    # ally removal and fusion look at no map
    nowhere = OccupancyGrid(np.full((1, 1), FREE, np.uint8), CELL_M, (0.0, 0.0))
    return TeamFusion(MIDNet(nowhere, team.midnet), team.fusion)


def scenes_of(team: Team, seed: int, frames: int = 10, orders: int = 5) -> Row:
    """Some scenes of one seed, each fused in the robots' own order and in others: counts over all of them.

    ``orders`` counts the other orders, ``reordered`` those of them that give other boxes.
    """
    counts, found, reordered, overlapping = [], 0, 0, 0
    for frame in range(frames):
        rng = stream(seed, "scene", frame)
        scene = draw_scene(team.robots, team.pose_error_m, rng)
        seen = seen_by_all(scene, team.window_m)
        found += sum(map(len, seen.boxes))
        boxes = _fused(team, seen, range(team.robots))
        truths = [
            TruthObject(f"intruder {i}", (box := Box(*row)), box.center)
            for i, row in enumerate(scene.intruders.tolist())
        ]
        counts.append(count_frame([Box(*row) for row in boxes.tolist()], truths, seen.in_range.tolist()))
        overlapping += _overlapping(boxes)
        for _ in range(orders):
            other = _fused(team, seen, rng.permutation(team.robots).tolist())
            reordered += not np.array_equal(_sorted(boxes), _sorted(other))
    return {
        "frames": frames,
        **total(counts)._asdict(),
        "found": found,
        "overlapping": overlapping,
        "orders": frames * orders,
        "reordered": reordered,
    }


def _fused(team: Team, seen: Seen, order: Sequence[int]) -> BoxArray:
    """(n, 4) the team's boxes if the robots come in that order."""
    boxes, poses = [seen.boxes[i] for i in order], [seen.poses[i] for i in order]
    return make_fusion(team).fuse(boxes, poses, 0.0)[0]


def _sorted(boxes: BoxArray) -> BoxArray:
    return boxes[np.lexsort(boxes.T)]


def _overlapping(boxes: BoxArray) -> int:
    """How many boxes have some area in common with another one."""
    return int(np.count_nonzero(np.count_nonzero(ious(boxes[:, None], boxes) > 0.0, axis=1) > 1))
