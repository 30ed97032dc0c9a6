"""Chooses t of Algorithm 2, ``iou_ally``, by IV.C.2's criterion.

    midnet-bench run campaigns/ally-threshold.yaml
    midnet-bench run campaigns/ally-threshold-map1.yaml
    python -m benchmarks.ally_threshold results/ally-threshold results/ally-threshold-map1

The first lines of ``campaigns/ally-threshold.yaml`` state the rule, which was committed before its run. The
second campaign shows what each candidate takes from the intruders; it chooses nothing and may be left out.
"""

import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.store import FILE_NAME, StoredTrial, open_store
from midnet_bench.campaign.trial import Row
from midnet_bench.errors import InputError
from midnet_bench.experiments.guarded.record import ERRORS, FRAMES, RecordedFrame
from midnet_bench.geometry import Box, Point
from midnet_bench.scoring.frame_counts import touches

OPTION, CAUSE = "iou_ally", "ally_left"
ON_TEAMMATE_M = 0.3
"""A box counts as one on a teammate up to this distance from its centre to that guard's true axle."""
NEAR_TEAMMATE_M = 0.5  # likewise, of boxes on intruders
TIE_PER_1000 = 1.0  # boxes per 1000 frames by which a rate may exceed the least one


class Count(NamedTuple):
    """What some trials of one candidate gave."""

    frames: int
    boxes: int  # of those that are looked for
    of: int  # boxes among which they were looked for

    @property
    def per_1000(self) -> float:
        """Boxes per 1000 frames."""
        return 1000.0 * self.boxes / self.frames


def chosen(counts: Mapping[float, Count]) -> float:
    """The candidate that the rule names; ``counts`` of its boxes on teammates, by candidate, at least one."""
    without = [candidate for candidate, count in counts.items() if not count.boxes]
    least = min(count.per_1000 for count in counts.values())
    near = [candidate for candidate, count in counts.items() if count.per_1000 <= least + TIE_PER_1000]
    return max(without or near)


def gap_to_teammate_m(box: Box, finder: int, axles: Sequence[Point | None]) -> float:
    """From a box's centre to the nearest axle of a guard but its finder, metres; inf if there is none."""
    gaps_m = (
        math.dist(box.center, at) for guard, at in enumerate(axles) if guard != finder and at is not None
    )
    return min(gaps_m, default=math.inf)


def boxes_on_teammates(frames: Iterable[RecordedFrame], errors: Iterable[Row], guards: int) -> Count:
    """The team's boxes on a teammate, among its boxes of the cause ``ally_left``, in one trial."""
    axles = {frame.number: _axles(frame, guards) for frame in frames}
    left = [row for row in errors if row["cause"] == CAUSE]
    gaps_m = [
        gap_to_teammate_m(_box(row), int(str(row["guard"])) - 1, axles[int(str(row["frame"]))])
        for row in left
    ]
    return Count(len(axles), sum(gap_m <= ON_TEAMMATE_M for gap_m in gaps_m), len(left))


def removed_from_intruders(frames: Iterable[RecordedFrame], errors: Iterable[Row], guards: int) -> Count:
    """Guards' boxes on intruders near a teammate that were removed for an ally, among all such boxes.

    Boxes are those before fusion, of one trial; ``errors`` have no part in it.
    """
    count = Count(0, 0, 0)
    for frame in frames:
        axles = _axles(frame, guards)
        near = [
            found
            for found in frame.found
            if gap_to_teammate_m(found.box, found.guard, axles) <= NEAR_TEAMMATE_M
            and any(touches(found.box, truth.box) for truth in frame.truths)
        ]
        removed = sum(found.ally is not None for found in near)
        count = Count(count.frames + 1, count.boxes + removed, count.of + len(near))
    return count


Counter = Callable[[Iterable[RecordedFrame], Iterable[Row], int], Count]


def counted(folder: Path, counter: Counter) -> dict[float, Count]:
    """What a campaign's trials gave together, by candidate.

    Raises InputError: there is no campaign, it has other factors than ``iou_ally``, it was not recorded, or
    some of its trials have not finished.
    """
    with open_store(folder / FILE_NAME) as store:
        definition = store.definition
        if list(definition.grid) != [OPTION] or not definition.parameters.get("record"):
            raise InputError(f"{folder}: a campaign of {OPTION} alone, with record: true, is needed")
        finished, _ = store.inventory().count()
        wanted = definition.cells * definition.trials
        if finished < wanted:
            raise InputError(f"{folder}: {finished} of {wanted} trials have finished; run the campaign again")
        counts = dict[float, Count]()
        for trial in store.trials():
            candidate = float(str(trial.parameters[OPTION]))
            before, count = counts.get(candidate, Count(0, 0, 0)), _of_trial(trial, counter)
            counts[candidate] = Count(*map(sum, zip(before, count, strict=True)))
    return counts


def table(on_teammates: Mapping[float, Count], taken: Mapping[float, Count] | None = None) -> Table:
    """A row for each candidate, and which of them the rule chooses."""
    choice = chosen(on_teammates)
    rows = []
    for candidate, count in sorted(on_teammates.items()):
        beside = (taken or {}).get(candidate)
        rows.append(
            {
                "iou_ally": candidate,
                "frames": count.frames,
                "ally_left": count.of,
                "on_teammates": count.boxes,
                "per_1000_frames": count.per_1000,
                "chosen": "chosen" if candidate == choice else "",
                **({} if beside is None else {"on_intruders": beside.of, "removed": beside.boxes}),
            }
        )
    notes = [
        f"ally_left: the team's boxes of that cause; on_teammates: of these, within {ON_TEAMMATE_M:g} m of a "
        "teammate's true axle.",
        *[
            f"on_intruders: guards' boxes in the second campaign that touch an intruder, within "
            f"{NEAR_TEAMMATE_M:g} m of a teammate; removed: of these, by Algorithm 2."
        ]
        * bool(taken),
    ]
    return Table(
        "ally_threshold", "t of Algorithm 2 by IV.C.2", rows, {OPTION: 2, "per_1000_frames": 2}, notes=notes
    )


def main(arguments: Sequence[str]) -> None:
    """Print the table of one or two campaigns' folders. Raises InputError as :func:`counted`."""
    if len(arguments) not in (1, 2):
        raise InputError("give the folder of ally-threshold, and that of ally-threshold-map1 if it has run")
    folders = [Path(argument) for argument in arguments]
    taken = counted(folders[1], removed_from_intruders) if len(folders) > 1 else None
    print(table(counted(folders[0], boxes_on_teammates), taken).to_markdown())


def _of_trial(trial: StoredTrial, counter: Counter) -> Count:
    tables = trial.tables()
    frames = map(RecordedFrame.from_row, tables[FRAMES])
    return counter(frames, tables.get(ERRORS, []), int(str(trial.parameters["robots"])))


def _axles(frame: RecordedFrame, guards: int) -> list[Point | None]:
    """Where the guards' axles truly are, to the millimetre; guards are the first robots of a trial."""
    return [robot and (robot.pose.x, robot.pose.y) for robot in frame.robots[:guards]]


def _box(row: Row) -> Box:
    return Box(*(float(str(row[side])) for side in ("x_min_m", "y_min_m", "x_max_m", "y_max_m")))


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except InputError as error:
        print(error, file=sys.stderr)
        sys.exit(2)
