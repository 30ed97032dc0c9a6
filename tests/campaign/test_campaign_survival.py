"""The campaign process is killed, interrupted, starved of disk: what was finished stays, the rest resumes."""

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from midnet_bench.campaign import pool as pools
from midnet_bench.campaign.definition import Campaign, resolve
from midnet_bench.campaign.pool import Group
from midnet_bench.campaign.runner import CampaignOutcome, run_campaign
from midnet_bench.campaign.store import StoreFull, only_writer, open_store
from midnet_bench.campaign.trial import Outcome
from midnet_bench.errors import MidnetBenchError
from tests.campaign import coin_experiments as coins
from tests.campaign.campaign_process import children_of, exported, finish, start, wait_for

FORTY = {"grid": {"coins": [1, 2], "table": ["wood", "glass"]}, "trials": 10, "parameters": {"work_s": 0.05}}
LONG = {"trials": 400, "parameters": {"work_s": 0.2}}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    directory = tmp_path_factory.mktemp("undisturbed")
    run_here(directory, FORTY)
    return exported(directory)


def run_here(directory: Path, campaign: dict[str, object], jobs: int = 2) -> CampaignOutcome:
    """The campaign in this process: its worker processes stay for the next one."""
    resolved = resolve(Campaign.model_validate({"experiment": "coins", **campaign}), coins)
    return run_campaign(resolved, directory, jobs=jobs)


def kill(process: subprocess.Popen[str]) -> None:
    """The parent alone, as the kernel would; its workers are left to find out."""
    process.kill()
    process.communicate()


def stored_in(directory: Path) -> int:
    with open_store(directory / "campaign.sqlite") as store:
        return sum(store.counts())


@pytest.mark.slow
def test_a_killed_worker_and_a_kill_while_trials_are_stored_change_nothing_and_the_workers_go_away(
    tmp_path: Path, undisturbed: dict[str, bytes]
) -> None:
    process = start(tmp_path, FORTY, jobs=2)
    wait_for(process, "stored", 3)
    os.kill(max(children_of(process.pid), key=processor_time), signal.SIGKILL)
    wait_for(process, "stored", 10)  # more than were under way
    workers = children_of(process.pid)
    kill(process)
    before = stored_in(tmp_path)
    outcome = run_here(tmp_path, FORTY)

    assert 13 <= before < 40
    assert (outcome.finished, outcome.failed, outcome.ran) == (40, 0, 40 - before)
    assert exported(tmp_path) == undisturbed
    assert len(workers) == 2
    assert all_end(workers)


@pytest.mark.slow
def test_workers_leave_with_their_parent_in_the_middle_of_a_trial(tmp_path: Path) -> None:
    process = start(tmp_path, {"trials": 4, "parameters": {"work_s": 600.0}}, jobs=2)
    wait_for(process, "begin")
    deadline_s = time.monotonic() + 60
    while len(workers := children_of(process.pid)) < 2 and time.monotonic() < deadline_s:
        time.sleep(0.05)
    kill(process)
    assert len(workers) == 2
    assert all_end(workers)


def all_end(pids: list[int]) -> bool:
    """Whether no process is there any more, at the latest after some seconds."""
    deadline_s = time.monotonic() + 30
    while any(Path(f"/proc/{pid}").exists() for pid in pids) and time.monotonic() < deadline_s:
        time.sleep(0.05)
    return not any(Path(f"/proc/{pid}").exists() for pid in pids)


@pytest.mark.slow
def test_a_worker_that_grows_is_replaced_without_a_word_and_nothing_waits_for_it(tmp_path: Path) -> None:
    campaign = {"trials": 10, "parameters": {"work_s": 0.3, "trouble": "grow", "trouble_seed": 6}}
    code, out, err = finish(start(tmp_path, campaign, jobs=2))

    assert (code, err) == (0, "")
    assert "done 10 0 10" in out


@pytest.mark.slow
def test_what_a_trial_prints_does_not_reach_the_output_of_the_command(tmp_path: Path) -> None:
    campaign = {"trials": 1, "parameters": {"trouble": "print", "trouble_seed": 1}}
    code, out, err = finish(start(tmp_path, campaign, jobs=1))

    assert code == 0
    assert [line.split()[0] for line in out.splitlines()] == ["begin", "stored", "done"]
    assert sorted(err.splitlines()) == ["heads or tails?", "tails"]


@pytest.mark.slow
def test_a_worker_that_is_stopped_costs_a_repetition_and_then_its_trial(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pools, "STALLED_S", 0.5)
    campaign = {"trials": 4, "trial_timeout_s": 1.0, "parameters": {"work_s": 0.4}}
    stopped: list[Group] = []
    run = pools.Child.run

    def run_stopped(child: pools.Child, run_trials: bytes, specs: Group, limit_s: float) -> list[Outcome]:
        if len(stopped) < 2:
            os.kill(child.process.pid, signal.SIGSTOP)
            stopped.append(specs)
        return run(child, run_trials, specs, limit_s)

    monkeypatch.setattr(pools.Child, "run", run_stopped)
    outcome = run_here(tmp_path, campaign, jobs=1)

    assert len(stopped) == 2
    assert stopped[0] == stopped[1]  # it was repeated after the first
    assert (outcome.finished, outcome.failed) == (3, 1)
    with open_store(tmp_path / "campaign.sqlite") as store:
        assert ["its worker died twice" in line for line in store.failures()] == [True]


def processor_time(pid: int) -> int:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return int(fields[11]) + int(fields[12])


def test_one_interrupt_keeps_what_is_finished_and_says_how_to_go_on(tmp_path: Path) -> None:
    process = start(tmp_path, LONG, jobs=2)
    wait_for(process, "stored", 3)
    os.killpg(process.pid, signal.SIGINT)  # as terminals and schedulers do: workers get it too
    code, _, err = finish(process)

    assert code == 128 + signal.SIGINT
    stored = stored_in(tmp_path)
    assert stored >= 3
    assert err.splitlines() == [
        f"error: interrupted; {stored} of 400 trials are stored in {tmp_path / 'campaign.sqlite'}:"
        " run the same command again to continue"
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("after_s", "number"), [(0.1, signal.SIGTERM), (0.5, signal.SIGHUP)])
def test_an_interrupt_while_workers_start_is_one_line_too(
    tmp_path: Path, after_s: float, number: signal.Signals
) -> None:
    process = start(tmp_path, LONG, jobs=2)
    wait_for(process, "begin")
    time.sleep(after_s)
    os.killpg(process.pid, number)
    code, _, err = finish(process)

    assert code == 128 + number
    assert err.startswith("error: interrupted; ")
    assert len(err.splitlines()) == 1


@pytest.mark.slow
def test_two_interrupts_end_at_once(tmp_path: Path) -> None:
    process = start(tmp_path, LONG, jobs=2)
    wait_for(process, "stored", 3)
    workers = children_of(process.pid)
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGINT)
    code, _, _ = finish(process)

    assert code in (130, -signal.SIGINT)
    assert stored_in(tmp_path) >= 3
    assert len(workers) == 2
    assert all_end(workers)


@pytest.mark.slow
def test_a_process_is_refused_while_another_one_writes(tmp_path: Path) -> None:
    with only_writer(tmp_path):
        code, _, err = finish(start(tmp_path, FORTY, jobs=2))

    assert code == 2
    assert "another midnet-bench is running this campaign" in err
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "campaign.sqlite").exists()


NOISY = {"trials": 40, "parameters": {"noise_bytes": 20_000}}


def make_room(disk: Path) -> None:
    subprocess.run(["mount", "-o", "remount,size=8m", str(disk)], check=True)


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_keeps_what_was_stored_and_the_rest_runs_when_there_is_room(
    tmp_path: Path, small_disk: Path
) -> None:
    code, out, err = finish(start(small_disk, NOISY, jobs=2))
    assert code == 1
    (line,) = err.splitlines()
    assert "campaign.sqlite: cannot be written (database or disk is full)" in line
    assert "make room" in line
    stored = stored_in(small_disk)
    assert 2 <= stored < 40
    assert out.count("stored") == stored

    with pytest.raises(StoreFull, match=r"cannot be written \(.*full\).*make room") as caught:
        run_here(small_disk, NOISY)
    assert caught.value.exit_code == 1
    assert stored <= (now := stored_in(small_disk)) < 40

    make_room(small_disk)
    assert run_here(small_disk, NOISY).ran == 40 - now
    run_here(tmp_path / "roomy", NOISY)
    assert exported(small_disk) == exported(tmp_path / "roomy")


def test_a_campaign_cannot_start_on_a_full_disk(full_disk: Path) -> None:
    with pytest.raises(MidnetBenchError) as caught:
        run_here(full_disk / "results", FORTY)
    assert caught.value.exit_code in (1, 2)
    assert "\n" not in str(caught.value)
