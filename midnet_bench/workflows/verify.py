"""The paper's claims, each checked against a campaign, and the sample size that a difference needs."""

from pathlib import Path

from midnet_bench.analysis.claims import Verdict, verdict_table, verdicts
from midnet_bench.analysis.frames import load_results
from midnet_bench.analysis.power import POWER
from midnet_bench.analysis.tables import Table
from midnet_bench.errors import InputError
from midnet_bench.experiments.registry import experiment_of, tables_of

EXIT_CODES = {Verdict.REPRODUCED: 0, Verdict.INCONCLUSIVE: 3, Verdict.NOT_REPRODUCED: 4}


def verify(directory: str | Path) -> tuple[str, Table, int]:
    """The experiment, each of the paper's claims that the campaign in ``directory`` bears on, an exit code.

    The code is 0 if all were reproduced, 4 if one was not, 3 if none failed but some are inconclusive.

    Raises:
        InputError: a campaign that the paper states nothing about, or without the trials it takes.
    """
    results = load_results(directory, tables_of)
    found = experiment_of(results).claims(results)
    if not found:
        raise InputError(f"{directory}: nothing here that the paper states a result for")
    worst = max(verdicts(found), key=EXIT_CODES.__getitem__)
    return results.definition.experiment, verdict_table(found), EXIT_CODES[worst]


def power_report(
    directory: str | Path, difference: float, robots: tuple[int, int] = (4, 5), power: float = POWER
) -> tuple[str, Table]:
    """The experiment, and how many trials a change of the main score needs to be detected.

    Args:
        directory: of a campaign whose experiment can tell; of this package's, a labyrinth campaign.
        difference: in percentage points.
        robots: the two team sizes that are compared.
        power: the probability of finding the difference if it is there.

    Raises:
        InputError: another experiment, a team size that the campaign lacks, or numbers out of range.
    """
    if not 0.0 < abs(difference) <= 100.0:
        raise InputError(f"--difference {difference:g}: expected percentage points, from above 0 to 100")
    if not 0.0 < power < 1.0:
        raise InputError(f"--power {power:g}: expected a probability between 0 and 1")
    if robots[0] == robots[1]:
        raise InputError(f"--robots {robots[0]} {robots[1]}: give two different team sizes")
    results = load_results(directory, tables_of)
    record = experiment_of(results)
    if record.power is None:
        raise InputError(f"{directory}: a {record.name} campaign; --difference works on labyrinth campaigns")
    if results.definition.trials < 2:
        raise InputError(
            f"{directory}: one trial per cell shows no spread; --difference needs 2, so --seeds 2"
        )
    return results.definition.experiment, record.power(results, abs(difference), robots, power)
