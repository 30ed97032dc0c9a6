"""The trials that a campaign lacks, in the order in which they begin; there may be millions of them."""

import itertools
import threading
from collections.abc import Hashable, Iterable, Iterator

from midnet_bench.campaign.definition import ResolvedCampaign
from midnet_bench.campaign.pools import Group
from midnet_bench.campaign.store import Inventory
from midnet_bench.campaign.trial import Cell, TrialSpec

FEW_TRIALS = 10
"""for a worker, each with those that share its simulation: no more are begun by their length alone"""
MOST_TOGETHER = 100
"""trials of one simulation, which has all their tables in memory"""


class PendingTrials:
    """Trials that have no outcome yet, in groups that run together.

    To iterate begins with those that were handed out before in vain.
    """

    def __init__(self, groups: Iterable[Group] = (), count: int = 0) -> None:
        """``groups`` have ``count`` trials, and are read as they are wanted."""
        self._groups = iter(groups)
        self._count = count
        self._handed_out: dict[str, TrialSpec] = {}
        self._group_of: dict[str, Group] = {}
        self._lock = threading.Lock()  # joblib reads on in threads of its own

    def __len__(self) -> int:
        return self._count

    def __contains__(self, trial_id: str) -> bool:
        """Whether this trial was handed out and is not taken."""
        return trial_id in self._handed_out

    def __iter__(self) -> Iterator[Group]:
        with self._lock:
            begun = {id(group): group for group in self._group_of.values()}.values()
            in_vain = [self._left_of(group) for group in begun]
        yield from in_vain
        while (group := self._next()) is not None:
            yield group

    def _next(self) -> Group | None:
        with self._lock:
            group = next(self._groups, None)
            if group is not None:
                self._hand_out(group)
            return group

    def _hand_out(self, group: Group) -> None:
        for spec in group:
            self._handed_out[spec.trial_id] = spec
            self._group_of[spec.trial_id] = group

    def _left_of(self, group: Group) -> Group:
        return [spec for spec in group if spec.trial_id in self._handed_out]

    def group_of(self, trial_id: str) -> Group:
        """What was handed out together with this trial, itself included, and is not taken."""
        with self._lock:
            return self._left_of(self._group_of[trial_id])

    def add(self, spec: TrialSpec) -> None:
        """One more trial, to run alone."""
        with self._lock:
            self._hand_out([spec])
            self._count += 1

    def take(self, trial_id: str) -> TrialSpec:
        """The trial, which counts as finished from now on. Raises KeyError unless it was handed out."""
        with self._lock:
            self._count -= 1
            del self._group_of[trial_id]
            return self._handed_out.pop(trial_id)


def pending_trials(
    campaign: ResolvedCampaign, inventory: Inventory, retry_failed: bool, workers: int
) -> PendingTrials:
    """What is to run.

    Seed by seed, so that an interrupted campaign has visited all cells about equally, and of each seed the
    trials that take longest first. Where there are few trials for each worker, those that take longest come
    first of all: a worker that begins one at the end would keep the others waiting. Trials of one seed that
    share a simulation come as one group, up to ``MOST_TOGETHER`` of them.
    """
    nothing: set[int] = set()
    wanted = campaign.seeds
    ranked = sorted(
        zip(campaign.numbered_cells, (one.effort for one in campaign.checked), campaign.sharing, strict=True),
        key=lambda one: -one[1],
    )
    done = [
        inventory.finished.get(cell.number, nothing)
        | (nothing if retry_failed else inventory.failed.get(cell.number, nothing))
        for cell, *_ in ranked
    ]
    shared: dict[Hashable, list[tuple[Cell, float, set[int]]]] = {}
    for (cell, effort, sharing), seeds in zip(ranked, done, strict=True):
        shared.setdefault(sharing.simulation_key, []).append((cell, effort, seeds))
    together = [
        cells[first : first + MOST_TOGETHER]
        for cells in shared.values()
        for first in range(0, len(cells), MOST_TOGETHER)
    ]
    missing = (
        (cells[0][1], group)
        for seed in wanted
        for cells in together
        if (
            group := [
                TrialSpec(cell.experiment, cell.parameters, seed)
                for cell, _, seeds in cells
                if seed not in seeds
            ]
        )
    )
    first = list(itertools.islice(missing, FEW_TRIALS * workers + 1))
    if len(first) <= FEW_TRIALS * workers:
        first.sort(key=lambda one: -one[0])
    count = sum(len(wanted) - sum(seed in wanted for seed in seeds) for seeds in done)
    return PendingTrials((group for _, group in itertools.chain(first, missing)), count)
