"""Ally removal and fusion for 1 to 200 robots: milliseconds a frame, and how they grow with the team.

Run ``python -m benchmarks.scale``. The scenes of ``benchmarks/large_teams.py`` are as dense as Map 1 with
five guards, so that each robot sees as much in a large team as in a small one. Growth is the exponent p of
time = c * robots ** p, fitted from 20 robots on; 1 is linear. The columns take turns scene by scene.

``IoUs as written`` counts the pairs that Algorithms 2 to 4 compare if they are done to the letter: each box
with each of the other list, up to the first match. It is a count and no time.

``python -m benchmarks.scale scenes.csv`` counts duplicates, and boxes that change with the robots' order: a
row for each fusion, way to take out an ally, team size and seed from 5401 to 5410. About ten minutes.
"""

import math
import statistics
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.large_teams import Seen, Team, draw_scene, make_fusion, scenes_of, seen_by_all
from midnet_bench.analysis.tables import csv_text
from midnet_bench.campaign.trial import Row
from midnet_bench.geometry import Box
from midnet_bench.midnet.midnet_settings import MIDNetSettings
from midnet_bench.rng import stream

TEAMS = (1, 5, 10, 20, 50, 100, 200)
FUSIONS = ("paper", "none", "suppression", "components", "weighted", "centres")
FITTED_FROM = 20
COUNTED_SCENES = 3  # plain Python takes seconds a scene


def main(teams: Sequence[int] = TEAMS, scenes: int = 20) -> None:
    times = {fusion: [times_ms(fusion, seen_in(robots, scenes)) for robots in teams] for fusion in FUSIONS}
    counts = [
        statistics.mean(map(ious_as_written, seen_in(robots, min(scenes, COUNTED_SCENES))))
        for robots in teams
    ]
    print("fusion           ", *(f"{robots:>9}" for robots in teams), "  growth")
    for fusion, row in times.items():
        print(f"{fusion:<14} ms", *(f"{ms:>9.3f}" for ms in row), f"{growth(teams, row):>8.2f}")
    print("IoUs as written  ", *(f"{count:>9.0f}" for count in counts), f"{growth(teams, counts):>8.2f}")


def write_scenes(file: Path, seeds: Sequence[int] = range(5401, 5411)) -> None:
    rows: list[Row] = [
        {"fusion": fusion, "ally_remove": remove, "robots": robots, "seed": seed}
        | scenes_of(Team(robots, fusion, midnet=MIDNetSettings.from_flat({"ally_remove": remove})), seed)
        for fusion in ("paper", "suppression", "components", "weighted")
        for remove in ("first", "all")
        for robots in (1, 2, 5, 20, 50, 100, 200)
        for seed in seeds
    ]
    file.write_text(csv_text(rows), encoding="utf-8")


def seen_in(robots: int, scenes: int) -> list[Seen]:
    """What a team sees in each of some scenes."""
    team = Team(robots)
    return [
        seen_by_all(draw_scene(robots, team.pose_error_m, stream(7, "scene", i)), team.window_m)
        for i in range(scenes)
    ]


def times_ms(fusion: str, scenes: Sequence[Seen]) -> float:
    """The median CPU time of a scene; one that is not timed goes before."""
    made = make_fusion(Team(fusion=fusion))
    made.fuse(scenes[0].boxes, scenes[0].poses, 0.0)
    taken = []
    for seen in scenes:
        start = time.process_time_ns()
        made.fuse(seen.boxes, seen.poses, 0.0)
        taken.append((time.process_time_ns() - start) / 1e6)
    return statistics.median(taken)


def ious_as_written(seen: Seen) -> int:
    """How many IoUs Algorithms 2 to 4 work out in a scene."""
    settings = Team().midnet
    lists = [[Box(*row) for row in own.tolist()] for own in seen.boxes]
    count = 0
    for ally, pose in enumerate(seen.poses):
        square = Box.square(pose.x, pose.y, settings.ally_diameter_m)
        for robot, own in enumerate(lists):
            if robot == ally:
                continue
            for box in own:
                count += 1
                if square.iou(box) >= settings.iou_ally:
                    own.remove(box)
                    break
    while len(lists) > 1:
        merged = []
        for first, second in zip(lists[::2], lists[1::2], strict=False):
            fused, compared = fused_as_written(first, second, settings.iou_fuse)
            merged.append(fused)
            count += compared
        lists = merged + lists[len(merged) * 2 :]
    return count


def fused_as_written(first: list[Box], second: list[Box], threshold: float) -> tuple[list[Box], int]:
    """Algorithm 4, and how many IoUs it worked out."""
    fused, count = list(second), 0
    for box in first:
        for place, other in enumerate(second):
            count += 1
            if box.iou(other) >= threshold:
                if box.area > other.area:
                    fused[place] = box
                break
        else:
            fused.append(box)
    return fused, count


def growth(teams: Sequence[int], values: Sequence[float]) -> float:
    """The exponent, by least squares of logarithms; NaN with fewer than two large teams."""
    large = [
        (math.log(n), math.log(value)) for n, value in zip(teams, values, strict=True) if n >= FITTED_FROM
    ]
    if len(large) < 2:
        return math.nan
    x, y = np.array(large).T
    return float(np.polyfit(x, y, 1)[0])


if __name__ == "__main__":
    write_scenes(Path(sys.argv[1])) if len(sys.argv) > 1 else main()
