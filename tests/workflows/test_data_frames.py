"""Campaigns from a notebook: plug-ins that are classes, results as data frames."""

import subprocess
import sys
from pathlib import Path

import pytest

import midnet_bench as mb
from midnet_bench.workflows.report import write_report
from tests.stores import detection_store

SCORES = {1: {3: (0.9, 0.5, 0.6), 4: (0.7, 0.7, 0.7)}, 5: {3: (0.5, 0.6, 0.7), 4: (0.8, 0.9, 0.8)}}
PROGRAM = """
import sys
import midnet_bench as mb
from midnet_bench.plugins import reference_to

AWAY_M = 0.0


def shifted(box):
    return [box[0] + AWAY_M, box[1], box[2] + AWAY_M, box[3]]


class Mine:
    def __init__(self, prior_map, range_m):
        self.range_m = range_m

    def detect(self, team):
        return [[shifted([one.pose.x, one.pose.y, one.pose.x + 1.0, one.pose.y + 1.0])] for one in team]


def nothing(team):
    return [[] for _ in team]


if __name__ == "__main__":
    made = mb.run("detection", detector=[Mine, nothing], engine="fast", frames=2, jobs=1)
    scores = made.tables["scores"]
    print(made.directory, *scores["detector"], *scores["tp"] + scores["fp"])
    AWAY_M = 0.5
    print(reference_to(Mine), reference_to(nothing))
"""


@pytest.mark.slow
def test_a_class_and_a_function_of_the_program_itself_run_in_the_workers(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(PROGRAM)
    done = subprocess.run([sys.executable, "program.py"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    folder, mine, nothing, *boxes, mine_later, nothing_later = done.stdout.split()
    assert folder.startswith("results/detection-")
    assert mine.startswith("main.py:Mine#")
    assert nothing.startswith("main.py:nothing#")
    assert boxes == ["2", "0"]
    assert mine_later != mine, "another constant makes other trials"
    assert nothing_later == nothing


def test_results_say_what_they_are_and_a_missing_table_lists_the_others(tmp_path: Path) -> None:
    results = mb.results(detection_store(tmp_path, SCORES))
    assert repr(results).startswith("<Results of detection in ")
    assert "4 trials over robots=[1, 5]" in repr(results)
    assert len(repr(results)) < 300
    with pytest.raises(KeyError, match=r"no table 'trial'; there are .*scores"):
        results.tables["trial"]
    assert "trial" not in results.tables


def test_differences_and_verdicts_are_data_frames(tmp_path: Path) -> None:
    first = detection_store(tmp_path / "a", SCORES)
    better = {team: {seed: (0.9, 0.9, 0.9) for seed in cells} for team, cells in SCORES.items()}
    second = mb.results(detection_store(tmp_path / "b", better))
    differences = mb.compare(first, second)
    recall = differences[differences["measure"] == "recall"].set_index("trial")["difference"]
    assert recall["1-robot"] == pytest.approx(0.3)
    assert {"low", "high", "verdict"} <= {*differences}
    verdicts = mb.verify(second)
    assert len(verdicts) > 10
    assert "verdict" in verdicts


@pytest.mark.slow
def test_why_a_recorded_campaign_erred_is_tables_by_name(recorded_campaign: Path) -> None:
    tables = mb.error_causes(mb.results(recorded_campaign))
    assert all(len(table) for table in tables.values())
    with pytest.raises(mb.InputError):
        mb.error_causes(recorded_campaign, seed=9)


def test_a_campaign_with_parameters_beside_it_is_refused(tmp_path: Path) -> None:
    campaign = mb.Campaign(experiment="detection", parameters={"frames": 2})
    with pytest.raises(mb.InputError, match="has its parameters"):
        mb.run(campaign, tmp_path, robots=2)


def test_without_pybullet_the_engine_to_take_is_named_before_the_first_trial(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from midnet_bench.workflows import campaigns

    monkeypatch.setattr(campaigns, "find_spec", lambda name: None)
    with pytest.raises(mb.InputError, match="take 'fast': --engine fast"):
        mb.run("detection", tmp_path / "new")
    assert not (tmp_path / "new").exists()


@pytest.mark.slow
def test_results_have_the_declared_types_also_without_a_store(tmp_path: Path) -> None:
    folder = detection_store(tmp_path / "one", SCORES)
    write_report(folder, drawn_from=9)
    (folder / "campaign.sqlite").unlink()
    (folder / "metrics.csv").write_text("robots,seed,metric,value\n1,3,false,0.5\n")
    assert mb.results(folder).tables["metrics"]["metric"].tolist() == ["false"]
