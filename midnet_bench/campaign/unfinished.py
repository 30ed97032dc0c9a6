"""The trials that a campaign lacks, in the order in which they begin; there may be millions of them."""

import itertools
import threading
from collections.abc import Iterable, Iterator

from midnet_bench.campaign.definition import ResolvedCampaign
from midnet_bench.campaign.store import Inventory
from midnet_bench.campaign.trial import TrialSpec

FEW_TRIALS = 10
"""for a worker: no more of them are begun by their length alone"""


class Unfinished:
    """Trials that have no outcome yet. To iterate begins with those that were handed out before in vain."""

    def __init__(self, specs: Iterable[TrialSpec] = (), count: int = 0) -> None:
        """``specs`` are ``count`` trials, which are read as they are wanted."""
        self._specs = iter(specs)
        self._count = count
        self._handed_out: dict[str, TrialSpec] = {}
        self._lock = threading.Lock()  # joblib reads on in threads of its own

    def __len__(self) -> int:
        return self._count

    def __contains__(self, trial_id: str) -> bool:
        """Whether this trial was handed out and is not taken."""
        return trial_id in self._handed_out

    def __iter__(self) -> Iterator[TrialSpec]:
        with self._lock:
            in_vain = list(self._handed_out.values())
        yield from in_vain
        while (spec := self._next()) is not None:
            yield spec

    def _next(self) -> TrialSpec | None:
        with self._lock:
            spec = next(self._specs, None)
            if spec is not None:
                self._handed_out[spec.trial_id] = spec
            return spec

    def add(self, spec: TrialSpec) -> None:
        """One more trial."""
        with self._lock:
            self._handed_out[spec.trial_id] = spec
            self._count += 1

    def take(self, trial_id: str) -> TrialSpec:
        """The trial, which counts as finished from now on. Raises KeyError unless it was handed out."""
        with self._lock:
            self._count -= 1
            return self._handed_out.pop(trial_id)


def unfinished(
    campaign: ResolvedCampaign, inventory: Inventory, retry_failed: bool, workers: int
) -> Unfinished:
    """What is to run.

    Seed by seed, so that an interrupted campaign has visited all cells about equally, and of each seed the
    trials that take longest first. Where there are few trials for each worker, those that take longest come
    first of all: a worker that begins one at the end would keep the others waiting.
    """
    nothing: set[int] = set()
    wanted = campaign.seeds
    ranked = sorted(zip(campaign.numbered_cells, campaign.efforts, strict=True), key=lambda one: -one[1])
    done = [
        inventory.finished.get(cell.number, nothing)
        | (nothing if retry_failed else inventory.failed.get(cell.number, nothing))
        for cell, _ in ranked
    ]
    missing = (
        (effort, TrialSpec(cell.experiment, cell.parameters, seed))
        for seed in wanted
        for (cell, effort), seeds in zip(ranked, done, strict=True)
        if seed not in seeds
    )
    first = list(itertools.islice(missing, FEW_TRIALS * workers + 1))
    if len(first) <= FEW_TRIALS * workers:
        first.sort(key=lambda one: -one[0])
    count = sum(len(wanted) - sum(seed in wanted for seed in seeds) for seeds in done)
    return Unfinished((spec for _, spec in itertools.chain(first, missing)), count)
