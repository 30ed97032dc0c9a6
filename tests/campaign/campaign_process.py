"""Campaigns of coins in processes of their own, for tests that interrupt and kill them; what they stored."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from midnet_bench.campaign.child import attempt
from midnet_bench.campaign.definition import ResolvedCampaign
from midnet_bench.campaign.store import export_csv, open_store

HERE = Path(__file__).parent
REPOSITORY = HERE.parents[1]


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(REPOSITORY), "PYTHONWARNINGS": "error"}


def start(directory: Path, campaign: dict[str, object], **options: object) -> subprocess.Popen[str]:
    """``drive.py`` on its way; a process group of its own, as a shell would give it."""
    command = [sys.executable, str(HERE / "drive.py"), str(directory)]
    return subprocess.Popen(
        [*command, json.dumps({"campaign": campaign, **options})],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
        start_new_session=True,
        preexec_fn=_hear_all_signals,
    )


def _hear_all_signals() -> None:
    """Whoever runs the tests may have told their processes to ignore some, as nohup does."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def finish(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Exit code, stdout and stderr."""
    out, err = process.communicate(timeout=120)
    return process.returncode, out, err


def wait_for(process: subprocess.Popen[str], word: str, times: int = 1) -> None:
    """Reads the process's lines until ``times`` of them began with ``word``."""
    while times > 0:
        line = process.stdout.readline()
        assert line, "the process ended early"
        times -= line.startswith(word)


def exported(directory: Path) -> dict[str, bytes]:
    """The campaign's CSV files but for its wall times."""
    with open_store(directory / "campaign.sqlite") as store:
        export_csv(store, directory / "csv")
    return {
        path.name: path.read_bytes() for path in (directory / "csv").glob("*.csv") if path.stem != "timing"
    }


def payloads(directory: Path) -> dict[str, bytes | None]:
    """Trial id -> the bytes that are stored; None for one that failed."""
    with open_store(directory / "campaign.sqlite") as store:
        return {trial.trial_id: trial.payload for trial in store.trials()}


def alone(campaign: ResolvedCampaign) -> dict[str, bytes | None]:
    """The same of trials that run one by one in this process, and share nothing."""
    outcomes = (attempt(campaign.run_trials, [spec])[0] for spec in campaign.trials())
    return {outcome.trial_id: outcome.payload for outcome in outcomes}


def children_of(pid: int) -> list[int]:
    """The worker processes of a campaign's process; each belongs to the thread that started it."""
    tasks = Path(f"/proc/{pid}/task")
    if not tasks.exists():
        pytest.skip("needs Linux's /proc to find the workers")
    found = []
    for children in tasks.glob("*/children"):
        with contextlib.suppress(OSError):  # a thread, or a child, that has just ended
            for child in children.read_text().split():
                if "campaign.child" in Path(f"/proc/{child}/cmdline").read_text():
                    found.append(int(child))
    return found
