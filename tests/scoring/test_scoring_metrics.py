"""Further metrics: by hand, by their properties, and what is said of those that break the rules."""

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.errors import InputError
from midnet_bench.geometry import Box
from midnet_bench.plugins import PluginError, code_in
from midnet_bench.scoring.frame_counts import TruthObject
from midnet_bench.scoring.metric import METRICS, NONE, MetricFrame, TrialMetrics, pinned_metrics
from midnet_bench.scoring.metrics import FirstDetection, Idleness, Ospa

Place = tuple[float, float]
SIDE_M = 0.4


def seen(
    boxes: list[Place],
    intruders: list[Place],
    in_range: list[bool] | None = None,
    guards: list[Place] | None = None,
    time_s: float = 0.2,
) -> MetricFrame:
    """A frame of squares; patrol points are a metre apart from x = 0 to 9."""
    squares = [Box.square(*place, SIDE_M) for place in intruders]
    return MetricFrame(
        time_s,
        np.array([Box.square(*place, SIDE_M) for place in boxes]).reshape(-1, 4),
        tuple(TruthObject(f"intruder {i}", box, box.center) for i, box in enumerate(squares)),
        tuple([True] * len(intruders) if in_range is None else in_range),
        np.array(guards or [], dtype=np.float64).reshape(-1, 2),
        np.column_stack((np.arange(10.0), np.zeros(10))),
    )


@pytest.mark.parametrize(
    ("boxes", "intruders", "ospa_m"),
    [
        ([], [], 0.0),
        ([(0.0, 0.0)], [], 1.0),
        ([], [(0.0, 0.0)], 1.0),
        ([(0.0, 0.3)], [(0.0, 0.0)], 0.3),
        ([(5.0, 0.0)], [(0.0, 0.0)], 1.0),
        # 0.1 m off and one too many
        ([(0.0, 0.1), (3.0, 0.0)], [(0.0, 0.0)], 0.55),
        # the pairs of least sum: 0.1 and 0.1, and not 0.0 and 0.2
        ([(0.1, 0.0), (0.2, 0.0)], [(0.0, 0.0), (0.1, 0.0)], 0.1),
    ],
)
def test_ospa_by_hand(boxes: list[Place], intruders: list[Place], ospa_m: float) -> None:
    assert Ospa().frame(seen(boxes, intruders)) == {"ospa_m": pytest.approx(ospa_m)}


def test_an_intruder_out_of_range_and_a_box_on_it_cost_nothing() -> None:
    assert Ospa().frame(seen([(0.1, 0.0)], [(0.0, 0.0)], [False])) == {"ospa_m": 0.0}
    # a box on both counts for the one in range
    both = seen([(0.1, 0.0)], [(0.0, 0.0), (0.2, 0.0)], [False, True])
    assert Ospa().frame(both) == {"ospa_m": pytest.approx(0.1)}


PLACES = st.lists(
    st.tuples(st.integers(0, 12), st.integers(0, 12)).map(lambda xy: (xy[0] / 4, xy[1] / 4)), max_size=4
)


@given(some=PLACES, others=PLACES, third=PLACES)
def test_ospa_is_a_metric(some: list[Place], others: list[Place], third: list[Place]) -> None:
    def gap_m(one: list[Place], other: list[Place]) -> float:
        return Ospa().frame(seen(one, other))["ospa_m"]

    assert gap_m(some, some) == 0.0
    assert gap_m(some, others) == pytest.approx(gap_m(others, some))
    assert gap_m(some, others) <= gap_m(some, third) + gap_m(third, others) + 1e-9


def test_first_detection_counts_from_the_start_and_from_being_in_range() -> None:
    metric = FirstDetection()
    two: list[Place] = [(0.0, 0.0), (5.0, 0.0)]
    assert metric.frame(seen([], two, [False, False], time_s=1.0)) == {}
    metric.frame(seen([], two, [True, False], time_s=2.0))
    metric.frame(seen([(0.1, 0.0)], two, [True, True], time_s=5.0))
    metric.frame(seen([(0.1, 0.0)], two, [True, True], time_s=6.0))
    assert metric.trial() == {"never_detected": 1.0, "first_detection_s": 5.0, "detection_delay_s": 3.0}


def test_a_box_on_an_intruder_out_of_range_detects_it_without_delay() -> None:
    metric = FirstDetection()
    metric.frame(seen([(0.1, 0.0)], [(0.0, 0.0)], [False], time_s=4.0))
    assert metric.trial() == {"never_detected": 0.0, "first_detection_s": 4.0, "detection_delay_s": 0.0}


def test_where_nobody_is_found_there_is_no_time_of_it() -> None:
    assert FirstDetection().trial() == {"never_detected": 0.0}


def test_idleness_of_ten_places_and_a_guard_that_visits_three_of_them() -> None:
    metric = Idleness(reach_m=1.0)
    assert metric.frame(seen([], [], guards=[(1.0, 0.0)], time_s=10.0)) == {"idleness_s": 7.0}
    # places 0 to 2 have now waited for 4 s, 3 to 6 and 9 for 14 s, 7 and 8 are visited
    assert metric.frame(seen([], [], guards=[(7.5, 0.0)], time_s=14.0)) == {
        "idleness_s": pytest.approx((3 * 4 + 5 * 14) / 10)
    }
    assert metric.trial() == {"longest_idleness_s": 14.0}


def test_the_longest_idleness_stays_when_the_place_is_visited_at_last() -> None:
    metric = Idleness(reach_m=20.0)
    metric.frame(seen([], [], guards=[(-100.0, 0.0)], time_s=10.0))
    metric.frame(seen([], [], guards=[(5.0, 0.0)], time_s=12.0))
    metric.frame(seen([], [], guards=[(5.0, 0.0)], time_s=13.0))
    assert metric.trial() == {"longest_idleness_s": 10.0}


def test_places_nearer_than_the_spacing_count_once() -> None:
    # visited from x = 0 to 0.5: one of five places if there is one in two metres
    metric = Idleness(reach_m=0.5, spacing_m=2.0)
    assert metric.frame(seen([], [], guards=[(0.0, 0.0)], time_s=10.0)) == {"idleness_s": 8.0}


def test_a_trial_s_value_is_the_mean_over_the_frames_that_have_one() -> None:
    metrics = TrialMetrics(pinned_metrics("ospa; first_detection"))
    metrics.update(seen([(0.0, 0.3)], [(0.0, 0.0)]))
    metrics.update(seen([], [(0.0, 0.0)]))
    assert metrics.values()["ospa_m"] == pytest.approx(0.65)
    assert list(metrics.values()) == ["detection_delay_s", "first_detection_s", "never_detected", "ospa_m"]
    assert not TrialMetrics(NONE)
    assert TrialMetrics(NONE).values() == {}


def test_a_list_has_one_spelling() -> None:
    assert pinned_metrics("ospa ;first_detection;") == "first_detection; ospa"
    assert pinned_metrics("") == pinned_metrics("none") == NONE
    with pytest.raises(InputError, match="one of them is there twice"):
        pinned_metrics("ospa; ospa")
    with pytest.raises(InputError, match="unknown name 'opsa'; did you mean 'ospa'"):
        pinned_metrics("idleness; opsa")


HEAD = "class Mine:\n    def __init__(self, word='a'): self.word = word\n    def frame(self, seen): return "


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("1.0", "frame gave float; give a dict"),
        ("{'Mine': 1.0}", "frame gave the name 'Mine'; small letters"),
        ("{'a,b': 1.0}", "frame gave the name 'a,b'; small letters"),
        ("{1: 1.0}", "frame gave the name 1; small letters"),
        ("{'x' * 41: 1.0}", "small letters"),
        ("{'mine': float('nan')}", "frame gave nan for 'mine'; a finite number"),
        ("{'mine': 10.0**13}", "for 'mine'; a finite number"),
        ("{'mine': '1'}", "frame gave '1' for 'mine'; a finite number"),
        ("{'ospa_m': 1.0}", "'ospa_m', as "),
        ("seen.boxes.sort()", "ValueError"),
        ("{}\n    def trial(self): return {'mine': None}", "trial gave None for 'mine'"),
        (
            "{'mine': 1}\n    def trial(self): return {'mine': 2}",
            "trial gave 'mine', which frame gives already",
        ),
        ("{}\n    def trial(self): return 1 / 0", "ZeroDivisionError"),
    ],
)
def test_what_comes_from_outside_is_watched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str, says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(HEAD + body + "\n")
    metrics = TrialMetrics(pinned_metrics("mine.py:Mine; ospa"))

    def measure() -> None:
        metrics.update(seen([(0.0, 0.0), (1.0, 0.0)], [(0.0, 0.0)]))
        metrics.values()

    with pytest.raises(PluginError) as caught:
        measure()
    assert says in str(caught.value)
    assert str(caught.value).startswith("metrics ")
    assert len(str(caught.value)) < 300


@pytest.mark.slow
def test_every_file_of_a_list_goes_along_with_a_trial(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(HEAD + "{'mine': 1.0}\n")
    (tmp_path / "other.py").write_text(HEAD + "{self.word: 1.0}\n")
    pinned = pinned_metrics("mine.py:Mine; ospa; other.py:Mine(word=b)")
    assert {source.name for source in code_in([pinned]).values()} == {"mine.py", "other.py"}
    with pytest.raises(InputError, match="expected a class with a method 'frame'"):
        METRICS.pinned("midnet_bench.detectors.fusions:NoFusion")


def test_identities_that_are_exchanged_are_counted() -> None:
    pytest.importorskip("motmetrics", reason="the extra midnet-bench[mot] is not installed")
    from midnet_bench.scoring.metrics import ClearMot

    metric = ClearMot()
    # the boxes' tracks go straight on while the intruders under them change places
    for step in range(10):
        places: list[Place] = [(0.1 * step, 0.0), (0.1 * step, 5.0)]
        assert metric.frame(seen(places, places[:: 1 if step < 5 else -1], time_s=0.2 * step)) == {}
    found = metric.trial()
    assert found == {"mota": 1.0 - 2 / 20, "motp_m": 0.0, "idf1": 0.5, "id_switches": 2.0}


def test_mot_takes_misses_and_false_boxes_off_and_leaves_out_who_is_out_of_range() -> None:
    pytest.importorskip("motmetrics", reason="the extra midnet-bench[mot] is not installed")
    from midnet_bench.scoring.metrics import ClearMot

    metric = ClearMot()
    metric.frame(seen([(0.0, 0.1), (5.0, 0.0)], [(0.0, 0.0), (5.0, 0.0)], [True, False], time_s=0.2))
    metric.frame(seen([], [(0.0, 0.0), (5.0, 0.0)], [True, False], time_s=0.4))
    metric.frame(seen([(0.0, 0.1), (9.0, 9.0)], [(0.0, 0.0)], time_s=0.6))
    found = metric.trial()
    # one miss and one false box, three times an intruder
    assert (found["mota"], found["motp_m"]) == (pytest.approx(1 / 3), pytest.approx(0.1))
    assert found["id_switches"] == 0.0
    assert ClearMot().trial().keys() <= {"id_switches", "idf1"}


def test_without_motmetrics_one_line_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "motmetrics", None)
    with pytest.raises(InputError, match=r"mot needs motmetrics: pip install 'midnet-bench\[mot\]'"):
        pinned_metrics("ospa; mot(cutoff_m=2)")
