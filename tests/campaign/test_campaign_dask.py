"""Campaigns on a real Dask scheduler with two workers, all in processes of their own on loopback."""

import contextlib
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from midnet_bench.campaign.runner import run_campaign
from midnet_bench.campaign.spec import Campaign
from midnet_bench.campaign.store import open_store
from midnet_bench.errors import InputError
from tests.campaign import coin_experiments as coins
from tests.campaign.campaign_process import environment, exported, finish, start, wait_for

distributed = pytest.importorskip("distributed", reason="the extra midnet-bench[dask] is not installed")

PLAIN = {"grid": {"coins": [1, 2, 3], "table": ["wood", "glass"]}, "trials": 3}


def serve(*arguments: str, folder: Path, path: Path | None = None) -> subprocess.Popen[bytes]:
    env = {**environment(), "PYTHONWARNINGS": "default"}
    env["PYTHONPATH"] = os.pathsep.join([*([str(path)] if path else []), env["PYTHONPATH"]])
    with (folder / "dask.log").open("ab") as log:
        command = [sys.executable, "-m", *arguments, "--scheduler-file", "contact.json", "--no-dashboard"]
        return subprocess.Popen(command, stdout=log, stderr=log, cwd=folder, env=env)


@contextlib.contextmanager
def cluster(folder: Path, workers: int, path: Path | None = None) -> Iterator[str]:
    """The address of a scheduler with workers of one thread each, all with ``path`` before their own."""
    contact = folder / "contact.json"
    here = ("--host", "127.0.0.1")
    processes = [serve("distributed.cli.dask_scheduler", *here, "--port", "0", folder=folder)]
    try:
        deadline_s = time.monotonic() + 60
        while not contact.exists():
            assert time.monotonic() < deadline_s, (folder / "dask.log").read_text()
            time.sleep(0.05)
        several = ("--nthreads", "1", "--nworkers", str(workers))
        processes.append(serve("distributed.cli.dask_worker", *here, *several, folder=folder, path=path))
        address = json.loads(contact.read_text())["address"]
        with distributed.Client(address, set_as_default=False) as client:
            client.wait_for_workers(workers, timeout=60)
        yield address
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait(30)


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with cluster(tmp_path_factory.mktemp("cluster"), workers=2) as address:
        yield address


def run(directory: Path, scheduler: str | None, **keys: object) -> None:
    campaign = Campaign.model_validate({"experiment": "coins", **PLAIN, **keys})
    backend = "dask" if scheduler else "loky"
    run_campaign(campaign, directory, jobs=2, backend=backend, scheduler=scheduler, experiments=coins)


def test_a_cluster_gives_the_same_bytes_as_this_machine(tmp_path: Path, scheduler: str) -> None:
    run(tmp_path / "cluster", scheduler)
    run(tmp_path / "here", None)

    assert exported(tmp_path / "cluster") == exported(tmp_path / "here")


def test_a_campaign_begun_here_goes_on_in_a_cluster(tmp_path: Path, scheduler: str) -> None:
    run(tmp_path, None, trials=1)
    run(tmp_path, scheduler, trials=3)
    run(tmp_path / "here", None, trials=3)

    assert exported(tmp_path) == exported(tmp_path / "here")


@pytest.mark.parametrize(
    ("trouble", "last_line"),
    [
        ("raise", "ValueError: the coin stands on its edge"),
        ("spin", "still running after its limit of 0.5 s of wall time"),
        ("die", "its worker died twice"),
    ],
)
def test_trials_that_go_wrong_fail_alone(
    tmp_path: Path, scheduler: str, trouble: str, last_line: str
) -> None:
    parameters = {"trouble": trouble, "trouble_seed": 2}
    run(tmp_path, scheduler, grid={"coins": [1]}, trials=4, trial_timeout_s=0.5, parameters=parameters)

    with open_store(tmp_path / "campaign.sqlite") as store:
        stored = {trial.seed: trial.traceback for trial in store.trials()}
    assert [seed for seed, traceback in stored.items() if traceback is None] == [1, 3, 4]
    assert last_line in str(stored[2]).splitlines()[-1]


def test_an_interrupt_leaves_the_cluster_in_order(tmp_path: Path, scheduler: str) -> None:
    long = {"trials": 400, "parameters": {"work_s": 0.1}}
    process = start(tmp_path, long, backend="dask", scheduler=scheduler)
    wait_for(process, "stored", 3)
    process.send_signal(2)
    code, _, err = finish(process)

    assert code == 130
    assert len(err.splitlines()) == 1
    run(tmp_path / "next", scheduler, trials=1)


def test_a_scheduler_that_does_not_answer_is_one_line(tmp_path: Path) -> None:
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        mute.listen()
        with pytest.raises(InputError, match=r"no Dask scheduler answers there within 5 s") as caught:
            run(tmp_path, f"tcp://127.0.0.1:{mute.getsockname()[1]}")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "campaign.sqlite").exists()


@pytest.mark.parametrize("address", ["nonsense", "http://127.0.0.1:8786", "tcp://"])
def test_an_address_that_is_none_is_one_line(tmp_path: Path, address: str) -> None:
    with pytest.raises(InputError, match="expected an address such as"):
        run(tmp_path, address)


def test_workers_with_another_version_are_refused(tmp_path: Path) -> None:
    other = tmp_path / "other" / "midnet_bench-9.9.9.dist-info"
    other.mkdir(parents=True)
    (other / "METADATA").write_text("Metadata-Version: 2.1\nName: midnet-bench\nVersion: 9.9.9\n")

    with (
        cluster(tmp_path, workers=1, path=other.parent) as address,
        pytest.raises(InputError, match=r"its workers have midnet-bench 9\.9\.9, here it is"),
    ):
        run(tmp_path / "results", address)
