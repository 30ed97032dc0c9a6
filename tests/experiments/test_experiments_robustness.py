"""The campaign of disturbances: what a disturbance is, its trials, tables and figure."""

from pathlib import Path

import pytest

from midnet_bench.analysis.frames import load_results
from midnet_bench.analysis.statistics import holm, mean
from midnet_bench.campaign.definition import Definition, load_campaign, resolve
from midnet_bench.campaign.payload import encode_tables
from midnet_bench.campaign.provenance import collect
from midnet_bench.campaign.store import open_or_create
from midnet_bench.campaign.trial import Row, Scalar, TrialResult, TrialSpec
from midnet_bench.campaign.worker import Outcome
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from midnet_bench.experiments.detection.parameters import DetectionParameters, effective
from midnet_bench.experiments.detection.trial import run_detection
from midnet_bench.experiments.robustness.figures import figures, panels
from midnet_bench.experiments.robustness.parameters import RobustnessParameters
from midnet_bench.experiments.robustness.tables import tables
from midnet_bench.experiments.robustness.trial import run_robustness

CAMPAIGNS = Path(__file__).parents[2] / "campaigns"
CAMPAIGN = CAMPAIGNS / "robustness.yaml"
SMALL = {"engine": "fast", "robots": 2, "frames": 8}


@pytest.mark.parametrize(
    ("disturbance", "changes"),
    [
        ("none", {}),
        (
            "odometry=encoder wheel_slip=0.02 message_delay_s=0.3",
            {"odometry": "encoder", "wheel_slip": 0.02, "message_delay_s": 0.3},
        ),
    ],
)
def test_a_disturbed_trial_is_the_detection_test_with_those_parameters(
    disturbance: str, changes: dict[str, Scalar]
) -> None:
    ours = run_robustness(RobustnessParameters.of(disturbance=disturbance, **SMALL), 2001)
    theirs = run_detection(DetectionParameters.of(**SMALL, **changes), 2001)
    assert set(ours.tables) == {"scores", "robots"}
    assert all(ours.tables[name] == theirs.tables[name] for name in ours.tables)


def test_a_disturbance_is_written_in_one_form_and_tells_trials_apart() -> None:
    one = RobustnessParameters.resolve({"disturbance": " message_delay_s=1   dying_guards=1 "}, "test")
    assert one["disturbance"] == "message_delay_s=1.0 dying_guards=1"
    assert one == RobustnessParameters.resolve({"disturbance": "message_delay_s=1.0 dying_guards=1"}, "test")
    assert RobustnessParameters.resolve({"disturbance": one["disturbance"]}, "test") == one
    ids = {
        TrialSpec("robustness", RobustnessParameters.resolve({"disturbance": text}, "test"), 1).trial_id
        for text in ("none", "prior_map=exact", "prior_map=explored", "message_timeout_s=null")
    }
    assert len(ids) == 4
    explored = RobustnessParameters.of(disturbance="prior_map=explored")
    assert explored.disturbance == f"prior_map={explored.prior_map}", "with the map's digest"


@pytest.mark.parametrize(
    ("disturbance", "complaint"),
    [
        ("lidar_dropot=0.1", "disturbance: lidar_dropot: unknown key; did you mean 'lidar_dropout'"),
        ("lidar_dropout", "disturbance: lidar_dropout: expected key=value"),
        ("lidar_dropout=2", "disturbance: lidar_dropout: "),
        ("lidar_hz=5 lidar_hz=1", "'lidar_hz' is set twice"),
        ("robots=3", "disturbance: robots: the team is no disturbance"),
        ("disturbance=none", "disturbance: disturbance: unknown key"),
        ("dying_guards=2", "disturbance: dying_guards: 2 of 1 guards"),
        ("prior_map=nowhere.yaml", "disturbance: prior_map: "),
    ],
)
def test_a_disturbance_that_cannot_be_is_refused(disturbance: str, complaint: str) -> None:
    with pytest.raises(InputError) as error:
        RobustnessParameters.of(disturbance=disturbance)
    assert str(error.value).startswith("parameters: ")
    assert complaint in str(error.value)
    assert "\n" not in str(error.value)


def test_the_campaign_disturbs_all_that_it_says_and_fits_in_half_an_hour() -> None:
    resolved = resolve(load_campaign(CAMPAIGN), registry)
    names = [str(name) for name in resolved.definition.grid["disturbance"]]
    assert names[0] == "none"
    assert len(names) == len(resolved.cells) / 2 <= 36
    assert resolved.seeds == range(201, 211)
    drawn = {panel.heading: panel for panel in panels(names, resolved.definition.parameters)}
    assert list(drawn) == [
        "LiDAR noise",
        "beams without return",
        "LiDAR rate (Hz)",
        "odometry",
        "wrong start pose",
        "localization",
        "message delay (s)",
        "messages lost",
        "intruders' size",
        "intruders' speed (m/s)",
        "prior map",
        "a guard dies",
    ]
    rate, noise, dead = (drawn[name] for name in ("LiDAR rate (Hz)", "LiDAR noise", "a guard dies"))
    assert (rate.names, rate.is_scale) == (["1", "2", "5", "10"], True), "the usual rate at its place"
    assert rate.disturbances == ["lidar_hz=1", "lidar_hz=2", "none", "lidar_hz=10"]
    assert (noise.names[0], noise.disturbances[0], noise.is_scale) == ("gazebo", "none", False)
    assert dead.names == ["dead: 0", "dead: 1 after 50 s", "dead: 1 after 50 s\ntime-out 2 s"]
    assert max(name.count("\n") for panel in drawn.values() for name in panel.names) == 1
    assert drawn["prior map"].names == ["explored", "exact", "explored-worst"]
    assert drawn["intruders' size"].names[0] == "default"


def test_each_open_value_of_the_campaign_readings_makes_other_trials_than_the_defaults() -> None:
    definition = load_campaign(CAMPAIGNS / "readings.yaml")
    names = [str(name) for name in definition.grid["disturbance"]]
    given = {**definition.parameters, "robots": 5}
    trials = [effective(RobustnessParameters.of(**given, disturbance=name).disturbed) for name in names]
    assert names[0] == "none"
    assert [name for name, trial in zip(names, trials, strict=True) if trial in trials[:1]] == ["none"]


DROP = "lidar_dropout=0.2"
PRECISION = {"none": [0.90, 0.92, 0.91, 0.93, 0.95], DROP: [0.80, 0.81, 0.83, 0.82, 0.86]}
RECALL = {"none": [0.7, 0.8, 0.6, 0.7, 0.8], DROP: [0.8, 0.7, 0.65, 0.65, 0.8]}


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """Five seeds of two teams, written down; the team of five misses nothing undisturbed."""
    grid: dict[str, list[Scalar]] = {"disturbance": ["none", DROP], "robots": [1, 5]}
    with open_or_create(tmp_path / "campaign.sqlite", Definition("robustness", 201, 5, grid, {})) as store:
        run_id = store.begin_run(collect(201))
        for name in ("none", DROP):
            for robots in (1, 5):
                for place, (precision, recall) in enumerate(zip(PRECISION[name], RECALL[name], strict=True)):
                    row: Row = {"tp": 80, "fp": 5, "fn": 10, "matched": 70 + place, "duplicates": 10 - place}
                    row |= {"missed": 10, "precision": precision, "recall": 1.0 if robots == 5 else recall}
                    spec = TrialSpec("robustness", {"disturbance": name, "robots": robots}, 201 + place)
                    payload = encode_tables(TrialResult({"scores": [row], "robots": []}, 1.0))
                    store.record(run_id, spec, Outcome(spec.trial_id, 1.0, 1.0, payload))
    return tmp_path


def test_differences_are_taken_seed_by_seed_and_judged_by_holm(campaign: Path) -> None:
    scores, differences = tables(load_results(campaign))
    assert [(row["disturbance"], row["trial"]) for row in scores.rows] == [
        ("none", "1-robot"),
        ("none", "5-robot"),
        (DROP, "1-robot"),
        (DROP, "5-robot"),
    ]
    assert scores.rows[2]["precision"] == mean(PRECISION[DROP], within=(0.0, 1.0))
    assert scores.rows[0]["f1_one_to_one"].value == pytest.approx(  # type: ignore[union-attr]
        sum(2 * hit / (2 * hit + 5 + 80 - hit + 10) for hit in range(70, 75)) / 5
    )
    rows = {(row["trial"], row["score"]): row for row in differences.rows}
    assert len(rows) == 6
    precision, recall = rows["1-robot", "precision"], rows["1-robot", "recall"]
    change = [after - before for before, after in zip(PRECISION["none"], PRECISION[DROP], strict=True)]
    assert precision["difference"] == mean(change)
    assert (precision["undisturbed"], precision["disturbed"]) == pytest.approx((0.922, 0.824))
    assert (precision["verdict"], recall["verdict"]) == ("worse", "no clear difference")
    assert precision["seeds"] == 5
    # equal in all seeds: no interval, and none of the comparisons that Holm counts
    assert rows["5-robot", "recall"]["verdict"] == "identical"
    known = [float(str(rows[key]["p_holm"])) for key in rows if str(rows[key]["p_holm"]) != "nan"]
    assert len(known) == 3
    assert known == pytest.approx(holm(known), abs=1.0)
    assert float(str(precision["p_holm"])) < 0.05


def test_the_figure_shows_each_mean_and_the_undisturbed_one_across(campaign: Path) -> None:
    (figure,) = figures(load_results(campaign)).values()
    recall, precision, one_to_one = figure.axes
    assert recall.get_title() == "beams without return"
    assert [axes.get_ylabel() for axes in figure.axes] == ["recall", "precision", "one-to-one F1"]
    lines = {bars.get_label(): bars.lines[0] for bars in precision.containers}  # type: ignore[attr-defined]
    assert list(lines) == ["1-robot", "5-robot"]
    for line in lines.values():
        assert line.get_ydata().tolist() == pytest.approx([0.922, 0.824])
    usual = [line.get_ydata() for line in precision.lines if list(line.get_xdata()) == [0, 1]]
    assert usual[0] == pytest.approx([0.922, 0.922])
    assert [label.get_text() for label in one_to_one.get_xticklabels()] == ["0%", "20%"]
    assert {ours.get_text() for ours in figure.legends[0].get_texts()} == {"1-robot", "5-robot"}


def test_without_trials_there_is_nothing_to_draw(tmp_path: Path) -> None:
    grid: dict[str, list[Scalar]] = {"disturbance": ["none"], "robots": [1]}
    open_or_create(tmp_path / "campaign.sqlite", Definition("robustness", 1, 1, grid, {})).close()
    results = load_results(tmp_path)
    assert figures(results) == {}
    assert all(not table.rows for table in tables(results))
