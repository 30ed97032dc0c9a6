"""The first lines of a labyrinth campaign: the success rates by team size, and the result in words."""

import math

from midnet_bench.analysis.frames import Results
from midnet_bench.experiments.experiment import Headline
from midnet_bench.experiments.guarded.metric_tables import metric_tables
from midnet_bench.experiments.labyrinth.tables import success_table
from midnet_bench.experiments.labyrinth.trials import variants_of


def headline(results: Results, reference: Results | None = None) -> Headline:
    """The table of success rates, the rise with the team in words, and what to type next.

    Args:
        results: of a labyrinth campaign with a finished trial.
        reference: not used; the paper prints no numbers of this test.
    """
    variants = variants_of(results)
    sentences = []
    for name, one in variants.items():
        rates = {robots: one.success(None, robots) for robots in one.team_sizes}
        known = [(robots, rate) for robots, rate in rates.items() if not math.isnan(rate.value)]
        parts = [
            f"{robots} robot{'' if robots == 1 else 's'} {rate.value:.0f} %"
            for robots, rate in (known[:1] + known[-1:] if len(known) > 1 else known)
        ]
        if parts:
            sentences.append(f"{name + ': c' if name else 'C'}aught of all intruders: {', '.join(parts)}.")
    trials = results.definition.trials
    following = (
        f"{trials} trial{'' if trials == 1 else 's'} per cell say little: --seeds 20 runs the paper's number."
        if trials < 20
        else f"Next: 'midnet-bench verify {results.directory}' checks each claim of the paper."
    )
    notes = ["Times, health of the robots and speed: --wide."]
    return Headline([success_table(variants), *metric_tables(results)], sentences, notes, following)
