"""MIDNet against bare OpenCV, in one process: microseconds of one core a robot and frame, and their ratio.

Run ``python -m benchmarks.midnet``. Bare OpenCV is ``bitwise_or``, ``absdiff``, ``findContours`` and
``boundingRect`` on the same cropped grids: Eqs. 5 and 6, contours and boxes, without Eq. 1, crops, allies and
fusion. Both take turns, each with all frames. The grids, 100 x 100 cells, are those of real detection trials
with one and with five guards. Larger teams are groups of five in buildings side by side, each at another
moment of the trial. The last column is what the ratio comes to where bare OpenCV takes 43 us; the bars, 60 us
with five robots and 80 us with 200, are meant so.
"""

import math
import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np

from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.geometry import Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.pipeline import Frame, MIDNet, Observation

SIDE_M = 5.0
TEAMS = (5, 50, 100, 200, 400)
BARE_US = 43.0  # bare OpenCV on the machine of the bars
EVERY = 4  # frames of the trial between two that are kept


def main(frames: int = 200, teams: Sequence[int] = TEAMS, repeats: int = 41) -> None:
    cv2.setNumThreads(1)
    print("us a robot and frame: MIDNet, bare OpenCV, ratio (median of the repeats, range), MIDNet at 43 us")
    prior, alone = recorded(1, frames)
    compare(prior, alone, repeats)
    prior, five = recorded(5, frames)
    for team in teams:
        compare(*((prior, five) if team == 5 else side_by_side(prior, five, team)), repeats)


def recorded(guards: int, frames: int) -> tuple[OccupancyGrid, list[list[Observation]]]:
    """The prior map of a detection trial, and what the guards told MIDNet at every fourth frame."""
    parameters = DetectionParameters.of(robots=guards, frames=frames, local_size_m=SIDE_M)
    told: list[list[Observation]] = []
    with DetectionTrial(parameters, seed=3) as trial:
        update = trial.detector.midnet.update

        def listen(observations: Sequence[Observation], *others: Any) -> Frame:
            told.append([copied(one) for one in observations])
            return update(observations, *others)

        trial.detector.midnet.update = listen  # type: ignore[method-assign]
        for _ in trial.frames():
            pass
        return trial.prior, told[::EVERY]


def copied(one: Observation, dx: float = 0.0, dy: float = 0.0) -> Observation:
    pose, costmap = one.pose, one.costmap
    origin = (costmap.origin[0] + dx, costmap.origin[1] + dy)
    moved = OccupancyGrid(costmap.data.copy(), costmap.resolution, origin)
    return Observation(Pose2D(pose.x + dx, pose.y + dy, pose.yaw), moved)


def side_by_side(
    prior: OccupancyGrid, frames: list[list[Observation]], team: int
) -> tuple[OccupancyGrid, list[list[Observation]]]:
    """One frame of a larger team, and the prior map of its buildings."""
    group = len(frames[0])
    buildings = team // group
    side = math.ceil(math.sqrt(buildings))
    width_m, height_m = prior.width * prior.resolution, prior.height * prior.resolution
    told = [
        copied(one, (k % side) * width_m, (k // side) * height_m)
        for k in range(buildings)
        for one in frames[7 * k % len(frames)]
    ]
    return OccupancyGrid(np.tile(prior.data, (side, side)), prior.resolution, prior.origin), [told]


def compare(prior: OccupancyGrid, frames: list[list[Observation]], repeats: int) -> None:
    midnet, robots = MIDNet(prior), sum(map(len, frames))
    grids, boxes = [], 0
    for frame in frames:
        explanation = midnet.update(frame, explain=True).explanation
        assert explanation is not None
        grids += [(view.a.data, view.b.data) for view in explanation.views]
        boxes += sum(len(view.found) for view in explanation.views)
    ours, bare = [], []
    for _ in range(repeats):
        ours.append(cpu_us(lambda: [midnet.update(frame) for frame in frames]) / robots)
        bare.append(cpu_us(lambda: [bare_opencv(a, b) for a, b in grids]) / robots)
    ratios = [one / other for one, other in zip(ours, bare, strict=True)]
    spread = f"{min(ratios):.2f} to {max(ratios):.2f}"
    print(
        f"{len(frames[0]):5} robots, {boxes / robots:.1f} boxes each: {statistics.median(ours):6.1f} "
        f"{statistics.median(bare):6.1f}  {statistics.median(ratios):.2f} ({spread})"
        f"  {BARE_US * statistics.median(ratios):.0f}"
    )


def bare_opencv(a: np.ndarray, b: np.ndarray) -> None:
    d = cv2.absdiff(a, cv2.bitwise_or(a, b))
    contours, _ = cv2.findContours(d, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    for contour in contours:
        cv2.boundingRect(contour)


def cpu_us(run: Callable[[], object]) -> float:
    begin = time.process_time()
    run()
    return 1e6 * (time.process_time() - begin)


if __name__ == "__main__":
    main()
