"""What a campaign's store costs at scale: ``python -m benchmarks.store [TRIALS]``, 1000 unless given.

A store of the packaged labyrinth campaign is made of so many trials. Each has the columns of a real trial,
which ran for a second, and numbers of its own. Then ``report`` reads it, and the campaign's own command goes
on with one more trial for each cell until the first worker starts, which is where it is stopped.
"""

import itertools
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from midnet_bench.campaign.definition import ResolvedCampaign, load_campaign, override, resolve
from midnet_bench.campaign.provenance import collect
from midnet_bench.campaign.store import FILE_NAME, open_or_create
from midnet_bench.campaign.trial import Outcome, Row, TrialResult, TrialSpec, encode_tables
from midnet_bench.experiments import registry
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.workflows.campaigns import packaged_campaigns
from tests.campaign.campaign_process import children_of

AT_ONCE = 1000  # trials that are committed together
CELLS = 25  # of the packaged campaign
LARGEST_TEAM = 5


def main(trials: int) -> None:
    """Prints the size, what ``report`` costs, and how long a resumed campaign takes to begin a trial."""
    with tempfile.TemporaryDirectory() as folder:
        directory = Path(folder) / "labyrinth"
        # a process of its own, for a child's peak memory counts from what its parent has
        with ProcessPoolExecutor(1, get_context("spawn")) as maker:
            per_cell = maker.submit(make_store, directory, trials).result()
        size, stored = (directory / FILE_NAME).stat().st_size, CELLS * per_cell
        print(f"{stored} labyrinth trials: {size / 1e6:.1f} MB, {size / stored:.0f} bytes a trial")
        cpu_s, peak_mb = cost_of("report", "-q", str(directory))
        print(f"report: {cpu_s:.1f} CPU s, {peak_mb:.0f} MB at its peak")
        wall_s = resume_s(directory, per_cell + 1)
        print(f"a resumed campaign begins its first trial after {wall_s:.1f} s")


def make_store(directory: Path, trials: int) -> int:
    """A store of about ``trials`` finished labyrinth trials; how many each cell has."""
    written = load_campaign(packaged_campaigns()["labyrinth"])
    per_cell = max(1, trials // CELLS)
    campaign = resolve(override(written, {}, trials=per_cell), registry)
    directory.mkdir(parents=True, exist_ok=True)
    with open_or_create(directory / FILE_NAME, campaign.definition_in(directory)) as store:
        run_id = store.begin_run(collect(1))
        outcomes = synthetic_outcomes(campaign)
        while some := list(itertools.islice(outcomes, AT_ONCE)):
            store.record_all(run_id, some)
        store.end_run(run_id)
    return per_cell


def synthetic_outcomes(campaign: ResolvedCampaign) -> Iterator[tuple[TrialSpec, Outcome]]:
    """Every trial of the campaign, with numbers drawn around those of a real one."""
    from midnet_bench.experiments.labyrinth.trial import run_labyrinth

    largest = LabyrinthParameters.of(robots=LARGEST_TEAM, intruders=LARGEST_TEAM, time_limit_s=1)
    real = run_labyrinth(largest, 1).tables
    chance = random.Random(1)
    for spec in campaign.trials():
        intruders, robots = int(str(spec.parameters["intruders"])), int(str(spec.parameters["robots"]))
        result = _varied(real, intruders, robots, chance)
        wall_s = chance.uniform(2.0, 12.0)
        yield spec, Outcome(spec.trial_id, wall_s, result.simulated_s, encode_tables(result))


def _varied(real: Mapping[str, list[Row]], intruders: int, robots: int, chance: random.Random) -> TrialResult:
    duration_s = round(chance.uniform(40.0, 600.0), 1)
    fates: list[Row] = []
    for row in real["intruders"][:intruders]:
        detected_s = round(chance.uniform(1.0, duration_s), 1)
        fate = chance.choice(("caught", "escaped", "at large"))
        nan = float("nan")
        times = {
            "detected_at_s": detected_s if fate == "caught" or chance.random() < 0.5 else nan,
            "caught_at_s": detected_s if fate == "caught" else nan,
            "escaped_at_s": duration_s if fate == "escaped" else nan,
        }
        fates.append({**row, "outcome": fate, **times, "straight_m": chance.uniform(12.0, 17.0)})
    guards = [row for row in real["robots"] if row["role"] == "guard"][:robots]
    others = [row for row in real["robots"] if row["role"] != "guard"][:intruders]
    team: list[Row] = [
        {
            **row,
            "distance_m": chance.uniform(5.0, 100.0),
            "goals_reached": chance.randrange(9),
            "stuck_s": round(chance.expovariate(1.0), 1),
            "recoveries": chance.randrange(2),
            "pose_error_m": chance.uniform(0.0, 0.2) if row["role"] == "guard" else float("nan"),
        }
        for row in guards + others
    ]
    caught = sum(row["outcome"] == "caught" for row in fates)
    trial: Row = {
        **real["trial"][0],
        "caught": caught,
        "detected": sum(row["detected_at_s"] == row["detected_at_s"] for row in fates),
        "escaped": sum(row["outcome"] == "escaped" for row in fates),
        "success_rate": 100.0 * caught / intruders,
        "duration_s": duration_s,
    }
    return TrialResult({"trial": [trial], "intruders": fates, "robots": team}, duration_s)


def cost_of(*arguments: str) -> tuple[float, float]:
    """CPU seconds and peak megabytes of a command."""
    command = [sys.executable, "-m", "midnet_bench", *arguments]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0, f"{arguments[0]} failed"
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0


def resume_s(directory: Path, per_cell: int) -> float:
    """Seconds from the start of the campaign's command to that of its first worker."""
    command = [sys.executable, "-m", "midnet_bench", "labyrinth", "--trials", str(per_cell)]
    start_s = time.perf_counter()
    with subprocess.Popen(
        [*command, "-q", "-o", str(directory)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:
        while not children_of(process.pid) and process.poll() is None:
            time.sleep(0.02)
        took_s = time.perf_counter() - start_s
        process.send_signal(signal.SIGINT)
    return took_s


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
