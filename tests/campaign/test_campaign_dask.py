"""Campaigns on a real Dask scheduler with two workers, all in processes of their own on loopback."""

import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from midnet_bench.campaign.definition import Campaign, load_campaign, parse_campaign, resolve
from midnet_bench.campaign.runner import run_campaign
from midnet_bench.campaign.store import open_store
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from tests.campaign import coin_experiments as coins
from tests.campaign import dice
from tests.campaign.campaign_process import environment, exported, finish, start, wait_for
from tests.cli.command import in_its_own_process, worked

distributed = pytest.importorskip("distributed", reason="the extra midnet-bench[dask] is not installed")

PLAIN = {"grid": {"coins": [1, 2, 3], "table": ["wood", "glass"]}, "trials": 3}
HERE = ("--host", "127.0.0.1")
MINE = """
class Mine:
    def __init__(self, prior_map, range_m):
        self.range_m = range_m
    def detect(self, team):
        return [self.boxes(robot.scan) for robot in team]
    def boxes(self, scan):
        return [] if scan is None else [(x, y, x + 0.1, y + 0.1) for x, y in scan.returns(self.range_m)[1]]

class Boxes:
    def frame(self, seen):
        return {"boxes": len(seen.boxes)}

class First:
    def __init__(self, prior_map, rng):
        pass
    def pursue(self, team, targets, time_s):
        return dict.fromkeys(range(len(team)), min(targets))
"""
CHASE = {"arena": "map1", "escape_distance_m": 2.0, "time_limit_s": 5.0, "pursuit": "mine.py:First"}


def serve(*arguments: str, folder: Path, path: Path | None = None) -> subprocess.Popen[bytes]:
    env = {**environment(), "PYTHONWARNINGS": "default", "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0"}
    env["PYTHONPATH"] = os.pathsep.join([*([str(path)] if path else []), env["PYTHONPATH"]])
    with (folder / "dask.log").open("ab") as log:
        command = [sys.executable, "-m", *arguments, "--scheduler-file", "contact.json", "--no-dashboard"]
        return subprocess.Popen(command, stdout=log, stderr=log, cwd=folder, env=env)


@contextlib.contextmanager
def process_of(process: subprocess.Popen[bytes]) -> Iterator[None]:
    try:
        yield
    finally:
        process.terminate()
        process.wait(30)


@contextlib.contextmanager
def scheduler_in(folder: Path) -> Iterator[str]:
    """The address of a scheduler without workers; it leaves its address in ``folder`` for them.

    A trial that one worker died of is given up at once, so that the tests need not wait for three more.
    """
    contact = folder / "contact.json"
    with process_of(serve("distributed.cli.dask_scheduler", *HERE, "--port", "0", folder=folder)):
        deadline_s = time.monotonic() + 60
        while not (contact.exists() and contact.read_text().endswith("}")):
            assert time.monotonic() < deadline_s, (folder / "dask.log").read_text()
            time.sleep(0.05)
        yield json.loads(contact.read_text())["address"]


def one_worker(folder: Path, path: Path | None = None) -> contextlib.AbstractContextManager[None]:
    """A worker of one thread for the scheduler in ``folder``, with ``path`` before its own."""
    one = ("--nthreads", "1", "--no-nanny")
    return process_of(serve("distributed.cli.dask_worker", *HERE, *one, folder=folder, path=path))


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a scheduler with one worker."""
    folder = tmp_path_factory.mktemp("cluster")
    with scheduler_in(folder) as address, one_worker(folder):
        yield address


@pytest.fixture(scope="module")
def two_mended_workers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a scheduler with two workers, each of which is started again when it dies."""
    two, folder = ("--nthreads", "1", "--nworkers", "2"), tmp_path_factory.mktemp("mended")
    with (
        scheduler_in(folder) as address,
        process_of(serve("distributed.cli.dask_worker", *HERE, *two, folder=folder)),
    ):
        yield address


def run(directory: Path, scheduler: str | None, **keys: object) -> None:
    campaign = Campaign.model_validate({"experiment": "coins", **PLAIN, **keys})
    backend = "dask" if scheduler else "loky"
    run_campaign(resolve(campaign, coins), directory, jobs=2, backend=backend, scheduler=scheduler)


@pytest.mark.slow
def test_a_cluster_gives_the_same_bytes_as_this_machine(tmp_path: Path, scheduler: str) -> None:
    run(tmp_path / "cluster", scheduler)
    run(tmp_path / "here", None)

    assert exported(tmp_path / "cluster") == exported(tmp_path / "here")


@pytest.mark.slow
def test_without_an_address_a_cluster_of_this_machine_is_started_and_ended(tmp_path: Path) -> None:
    pytest.importorskip("dask")
    there, here = tmp_path / "there", tmp_path / "here"
    command = ("detection", "--engine", "fast", "--frames", "3", "--robots", "1,2", "--seeds", "1", "-q")
    cluster = in_its_own_process(*command, "--backend", "dask", "--jobs", 2, "-o", there, folder=tmp_path)
    assert cluster.returncode == 0, cluster.stderr
    worked(*command, "--jobs", 1, "-o", here, folder=tmp_path)
    assert (there / "scores.csv").read_bytes() == (here / "scores.csv").read_bytes()
    listed = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True).stdout
    assert str(there) not in listed


@pytest.mark.slow
def test_an_experiment_in_a_file_runs_in_a_cluster(tmp_path: Path, scheduler: str) -> None:
    (tmp_path / "rolling.yaml").write_text("{experiment: dice.py:DICE, trials: 2}")
    shutil.copy(dice.__file__, tmp_path / "dice.py")
    campaign = resolve(load_campaign(tmp_path / "rolling.yaml"), registry)
    run_campaign(campaign, tmp_path / "cluster", backend="dask", scheduler=scheduler)
    run_campaign(campaign, tmp_path / "here", jobs=2)

    assert exported(tmp_path / "cluster") == exported(tmp_path / "here")
    assert run_campaign(campaign, tmp_path / "cluster", jobs=2).ran == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("experiment", "parameters"),
    [
        ("detection", {"frames": 3, "detector": "mine.py:Mine", "metrics": "mine.py:Boxes; ospa"}),
        ("labyrinth", CHASE),
    ],
)
def test_parts_in_a_file_travel_to_the_cluster_s_workers(
    tmp_path: Path,
    scheduler: str,
    monkeypatch: pytest.MonkeyPatch,
    experiment: str,
    parameters: dict[str, object],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(MINE)
    written = {"experiment": experiment, "parameters": {"engine": "fast", **parameters}, "trials": 1}
    campaign = parse_campaign(written, "test")
    resolved = resolve(campaign, registry)
    (tmp_path / "mine.py").unlink()  # nobody can read it there
    run_campaign(resolved, tmp_path / "cluster", backend="dask", scheduler=scheduler)
    run_campaign(resolved, tmp_path / "here", jobs=1)

    assert exported(tmp_path / "cluster") == exported(tmp_path / "here")
    assert not (tmp_path / "cluster" / "failures.csv").exists()


@pytest.mark.slow
def test_a_campaign_begun_here_goes_on_in_a_cluster(tmp_path: Path, scheduler: str) -> None:
    run(tmp_path, None, trials=1)
    run(tmp_path, scheduler, trials=3)
    run(tmp_path / "here", None, trials=3)

    assert exported(tmp_path) == exported(tmp_path / "here")


@pytest.mark.slow
def test_a_trial_that_raises_fails_alone(tmp_path: Path, scheduler: str) -> None:
    assert "ValueError: the coin stands on its edge" in failure_of_the_second_trial(
        tmp_path, scheduler, "raise"
    )


@pytest.mark.slow
@pytest.mark.parametrize("trouble", ["die", "spin"])
def test_a_trial_that_its_workers_die_of_fails_alone(
    tmp_path: Path, two_mended_workers: str, trouble: str
) -> None:
    """One that is over its time limit takes its worker along: Dask runs it outside the main thread."""
    last_line = failure_of_the_second_trial(tmp_path / "run", two_mended_workers, trouble)
    assert "its worker died twice" in last_line


def failure_of_the_second_trial(directory: Path, scheduler: str, trouble: str) -> str:
    """The last line of its traceback; the other three trials have finished."""
    parameters = {"trouble": trouble, "trouble_seed": 2}
    run(directory, scheduler, grid={"coins": [1]}, trials=4, trial_timeout_s=0.5, parameters=parameters)
    with open_store(directory / "campaign.sqlite") as store:
        stored = {trial.seed: trial.traceback for trial in store.trials()}
    assert {seed: stored[seed] for seed in (1, 3, 4)} == {1: None, 3: None, 4: None}
    return str(stored[2]).splitlines()[-1]


@pytest.mark.slow
def test_an_interrupt_leaves_the_cluster_in_order(tmp_path: Path, scheduler: str) -> None:
    long = {"trials": 400, "parameters": {"work_s": 0.1}}
    process = start(tmp_path, long, backend="dask", scheduler=scheduler)
    wait_for(process, "stored", 3)
    process.send_signal(signal.SIGINT)
    code, _, err = finish(process)

    assert code == 130
    assert len(err.splitlines()) == 1
    run(tmp_path / "next", scheduler, trials=1)


@pytest.mark.slow
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


@pytest.mark.slow
def test_workers_with_another_version_are_refused(tmp_path: Path) -> None:
    other = tmp_path / "other" / "midnet_bench-9.9.9.dist-info"
    other.mkdir(parents=True)
    (other / "METADATA").write_text("Metadata-Version: 2.1\nName: midnet-bench\nVersion: 9.9.9\n")

    with (
        scheduler_in(tmp_path) as address,
        one_worker(tmp_path, path=other.parent),
        pytest.raises(InputError, match=r"its workers have midnet-bench 9\.9\.9, here it is"),
    ):
        run(tmp_path / "results", address)


@pytest.mark.slow
def test_trials_wait_for_workers_longer_than_joblib_would(tmp_path: Path) -> None:
    """The note comes after two seconds; it was after five that the campaign ended."""
    with scheduler_in(tmp_path) as address:
        process = start(tmp_path / "run", {"trials": 3}, backend="dask", scheduler=address)
        wait_for(process, "note")
        time.sleep(5.0)
        assert process.poll() is None
        with one_worker(tmp_path):
            code, out, err = finish(process)

    assert (code, err) == (0, "")
    assert "done 3 0 3" in out
    assert "note" not in out  # one was enough


@pytest.mark.slow
def test_workers_that_leave_in_the_middle_are_waited_for_and_an_interrupt_is_heard(tmp_path: Path) -> None:
    long = {"trials": 400, "parameters": {"work_s": 0.1}}
    with scheduler_in(tmp_path) as address:
        with one_worker(tmp_path):
            process = start(tmp_path / "run", long, backend="dask", scheduler=address)
            wait_for(process, "stored", 2)
        wait_for(process, "note")
        with one_worker(tmp_path):
            wait_for(process, "stored", 2)
        wait_for(process, "note")
        process.send_signal(signal.SIGINT)
        code, _, err = finish(process)

    assert code == 130
    assert err.startswith("error: interrupted; ")
    assert len(err.splitlines()) == 1
