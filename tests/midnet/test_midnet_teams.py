"""A team's boxes, fused on arrays, against the same box by box in plain Python: equal to the last bit."""

import numpy as np

from midnet_bench.geometry import Box, Pose2D
from midnet_bench.midnet.fusion import AllyRemove, iou
from tests.midnet import plain_fusion
from tests.midnet.plain_fusion import Detection
from tests.midnet.teams import fused_team, rows

CELL_M = 0.05
TEAMS = 300


def random_team(rng: np.random.Generator) -> tuple[list[Pose2D], list[list[Box]]]:
    """Up to 12 robots, close together or apart, and boxes of whole cells, some shrunk, on and beside them."""
    robots, side_m = int(rng.integers(1, 13)), float(rng.choice([1.0, 4.0, 12.0]))
    poses = [Pose2D(*rng.uniform(0.0, side_m, 2).tolist(), 0.0) for _ in range(robots)]
    x0, y0 = rng.uniform(-9.0, 9.0, 2).tolist() if rng.random() < 0.5 else (-4.03, 1.0)
    margin_m = float(rng.choice([0.0, 0.0, 0.06]))
    lists = []
    for _ in range(robots):
        own = []
        for _ in range(int(rng.integers(0, 9))):
            near = poses[rng.integers(robots)] if rng.random() < 0.5 else None
            x, y = (near.x, near.y) if near else rng.uniform(0.0, side_m, 2).tolist()
            column, row = (int((p - o) / CELL_M) + int(rng.integers(-5, 3)) for p, o in ((x, x0), (y, y0)))
            width, height = (int(side) for side in rng.integers(1, 12, 2))
            box = Box(
                x0 + column * CELL_M,
                y0 + row * CELL_M,
                x0 + (column + width) * CELL_M,
                y0 + (row + height) * CELL_M,
            )
            own.append(box.shrunk(margin_m))
        lists.append(list(dict.fromkeys(own)))
    return poses, lists


def plain_team(
    poses: list[Pose2D], lists: list[list[Box]], di: float, t: float, remove: AllyRemove, fuse_t: float
) -> tuple[list[list[Detection]], list[tuple[int, Detection]], list[Detection]]:
    found = [[Detection(box, robot) for box in own] for robot, own in enumerate(lists)]
    left = plain_fusion.remove_ally_detections(poses, found, di, t, remove)
    fused = plain_fusion.divide_and_conquer(left.kept, 0, len(lists) - 1, fuse_t)
    return left.kept, [(one.ally, one.detection) for one in left.removed], fused


def check(seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses, lists = random_team(rng)
    remove: AllyRemove = ("first", "best", "all")[seed % 3]  # type: ignore[assignment]
    t, fuse_t = float(rng.choice([0.05, 0.3])), float(rng.choice([0.1, 0.5, 1.0]))
    kept, removed, fused = plain_team(poses, lists, 0.297, t, remove, fuse_t)
    team = fused_team(poses, lists, 0.297, t, remove, fuse_t)
    flat = [Detection(box, robot) for robot, own in enumerate(lists) for box in own]
    of_array = zip(team.detections.tolist(), team.found_by.tolist(), strict=True)
    assert [Detection(Box(*box), robot) for box, robot in of_array] == fused
    assert [flat[k] for k in team.kept] == [one for own in kept for one in own]
    assert [(ally, flat[k]) for ally, k in team.removed.tolist()] == removed


def test_random_teams_come_out_as_box_by_box() -> None:
    for seed in range(TEAMS):
        check(seed)


def test_iou_of_arrays_is_eq_7_of_boxes() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        _, lists = random_team(rng)
        boxes = [box for own in lists for box in own]
        array = rows(boxes)
        for i, box in enumerate(boxes):
            assert [iou(array[i], other) for other in array] == [box.iou(other) for other in boxes]
