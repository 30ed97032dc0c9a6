"""Campaigns on a real Dask scheduler with two workers, all in processes of their own on loopback."""

import contextlib
import itertools
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from multiprocessing import active_children
from pathlib import Path

import pytest

pytest.importorskip("distributed", reason="the extra midnet-bench[dask] is not installed")

from distributed import Client, Future

from midnet_bench.campaign import dask_pool
from midnet_bench.campaign.definition import Campaign, load_campaign, parse_campaign, resolve
from midnet_bench.campaign.runner import Interrupted, Progress, run_campaign
from midnet_bench.campaign.store import open_store
from midnet_bench.campaign.trial import Outcome
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from tests.campaign import coin_experiments as coins
from tests.campaign import dice
from tests.campaign.campaign_process import alone, environment, exported, payloads

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
CHASE = {"arena": "map1", "escape_distance_m": 2.0, "time_limit_s": 2.0, "pursuit": "mine.py:First"}


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
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:  # a worker that waits for its scheduler
            process.kill()
            process.wait()


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
    """The address of a scheduler with one worker, which is started again when it dies."""
    folder = tmp_path_factory.mktemp("cluster")
    one = ("--nthreads", "1", "--nworkers", "1")
    with (
        scheduler_in(folder) as address,
        process_of(serve("distributed.cli.dask_worker", *HERE, *one, folder=folder)),
    ):
        yield address


@pytest.fixture(scope="module")
def deserted(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, str]]:
    """The folder and the address of a scheduler without workers; tests leave it so."""
    folder = tmp_path_factory.mktemp("deserted")
    with scheduler_in(folder) as address:
        yield folder, address


def run(directory: Path, scheduler: str | None, progress: Progress | None = None, **keys: object) -> None:
    campaign = Campaign.model_validate({"experiment": "coins", **PLAIN, **keys})
    where = {"backend": "dask", "scheduler": scheduler} if scheduler else {}
    run_campaign(resolve(campaign, coins), directory, jobs=2, progress=progress, **where)


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What the campaign exports that ran on this machine."""
    directory = tmp_path_factory.mktemp("here")
    run(directory, None)
    return exported(directory)


@pytest.mark.slow
def test_a_campaign_begun_here_goes_on_in_a_cluster_with_the_same_bytes(
    tmp_path: Path, scheduler: str, here: dict[str, bytes]
) -> None:
    run(tmp_path, None, trials=1)
    run(tmp_path, scheduler)

    assert exported(tmp_path) == here


@pytest.mark.slow
def test_without_an_address_a_cluster_of_this_machine_is_started_and_ended(
    tmp_path: Path, here: dict[str, bytes]
) -> None:
    """A command does the same in test_howto.py."""
    before, during = {*active_children()}, set()

    class Watching(Progress):
        def advance(self, outcome: Outcome) -> None:
            during.update({*active_children()} - before)

    campaign = resolve(Campaign.model_validate({"experiment": "coins", **PLAIN}), coins)
    run_campaign(campaign, tmp_path, jobs=2, backend="dask", progress=Watching())

    assert len(during) == 2
    assert {*active_children()} <= before
    assert exported(tmp_path) == here


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
        ("detection", {"frames": 2, "detector": "mine.py:Mine", "metrics": "mine.py:Boxes; ospa"}),
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
    outcome = run_campaign(resolved, tmp_path, backend="dask", scheduler=scheduler)

    assert (outcome.finished, outcome.failed) == (1, 0)
    assert payloads(tmp_path) == alone(resolved)


@pytest.mark.slow
def test_a_trial_that_raises_fails_alone(tmp_path: Path, scheduler: str) -> None:
    assert "ValueError: the coin stands on its edge" in failure_of_the_second_trial(
        tmp_path, scheduler, "raise"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("trouble", "reason"),
    [
        ("native", "still running after its limit of 1 s of wall time"),
        ("die", "its worker died twice"),
        ("orphan", "the workers of the cluster that ran it ended"),
    ],
)
def test_a_trial_that_ends_its_process_or_the_worker_fails_alone(
    tmp_path: Path, scheduler: str, trouble: str, reason: str
) -> None:
    assert reason in failure_of_the_second_trial(tmp_path, scheduler, trouble)


def failure_of_the_second_trial(directory: Path, scheduler: str, trouble: str) -> str:
    """The last line of its traceback; the other three trials have finished."""
    parameters = {"trouble": trouble, "trouble_seed": 2, "trouble_file": "nowhere"}
    run(directory, scheduler, grid={"coins": [1]}, trials=4, trial_timeout_s=1.0, parameters=parameters)
    with open_store(directory / "campaign.sqlite") as store:
        stored = {trial.seed: trial.traceback for trial in store.trials()}
    assert {seed: stored[seed] for seed in (1, 3, 4)} == {1: None, 3: None, 4: None}
    return str(stored[2]).splitlines()[-1]


class Dropped:
    def __del__(self) -> None:
        os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.slow
def test_an_interrupt_inside_dask_is_heard_and_leaves_the_cluster_in_order(
    tmp_path: Path, scheduler: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """In a destructor, which no exception leaves, unless it is in another thread than the signal's."""
    submit, calls = Client.submit, itertools.count()

    def drop_and_submit(*arguments: object, **options: object) -> object:
        if next(calls) == 4:
            Dropped()
        return submit(*arguments, **options)

    monkeypatch.setattr(Client, "submit", drop_and_submit)
    with pytest.raises(Interrupted) as caught:
        run(tmp_path, scheduler, trials=100)
    assert caught.value.exit_code == 130
    assert capfd.readouterr().err == ""
    run(tmp_path / "next", scheduler, trials=1)


@pytest.mark.slow
def test_a_result_that_has_left_with_its_worker_is_waited_for(
    tmp_path: Path, scheduler: str, here: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    result, late = Future.result, set()

    def late_once(future: Future, timeout: float) -> object:
        if future.key not in late:
            late.add(future.key)
            raise TimeoutError
        return result(future, timeout)

    monkeypatch.setattr(Future, "result", late_once)
    run(tmp_path, scheduler)
    assert len(late) == 18
    assert exported(tmp_path) == here


@pytest.mark.slow
def test_a_scheduler_that_does_not_answer_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_pool, "CONNECT_TIMEOUT_S", 0.2)
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        mute.listen()
        with pytest.raises(InputError, match=r"no Dask scheduler answers there within 0\.2 s") as caught:
            run(tmp_path, f"tcp://127.0.0.1:{mute.getsockname()[1]}")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "campaign.sqlite").exists()


@pytest.mark.parametrize("address", ["nonsense", "http://127.0.0.1:8786", "tcp://"])
def test_an_address_that_is_none_is_one_line(tmp_path: Path, address: str) -> None:
    with pytest.raises(InputError, match="expected an address such as"):
        run(tmp_path, address)


@pytest.mark.slow
def test_workers_with_another_version_are_refused(tmp_path: Path, deserted: tuple[Path, str]) -> None:
    other = tmp_path / "other" / "midnet_bench-9.9.9.dist-info"
    other.mkdir(parents=True)
    (other / "METADATA").write_text("Metadata-Version: 2.1\nName: midnet-bench\nVersion: 9.9.9\n")

    folder, address = deserted
    with (
        one_worker(folder, path=other.parent),
        pytest.raises(InputError, match=r"its workers have midnet-bench 9\.9\.9, here it is"),
    ):
        run(tmp_path / "results", address)


@pytest.mark.slow
def test_workers_that_come_and_leave_are_waited_for_and_an_interrupt_is_heard(
    tmp_path: Path, deserted: tuple[Path, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One comes when the campaign has said that there is none, and leaves after some trials."""
    monkeypatch.setattr(dask_pool, "TELL_AFTER_S", 0.2)
    monkeypatch.setattr(dask_pool, "POLL_S", 0.1)
    folder, address = deserted
    notes: list[int] = []
    worker = contextlib.ExitStack()

    class Attending(Progress):
        stored = 0

        def advance(self, outcome: Outcome) -> None:
            self.stored += 1
            worker.close()

        def note(self, text: str) -> None:
            notes.append(self.stored)
            if len(notes) == 1:
                worker.enter_context(one_worker(folder))
            else:
                signal.raise_signal(signal.SIGINT)

    with worker, pytest.raises(Interrupted) as caught:
        run(tmp_path, address, Attending(), trials=400, parameters={"work_s": 0.1})
    assert 0 == notes[0] < notes[1]
    assert caught.value.exit_code == 130
    assert f"; {notes[1]} of 2400 trials are stored in " in str(caught.value)
