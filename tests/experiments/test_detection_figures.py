"""The figure of the detection test: scores by team size with intervals, beside the paper's."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.container import ErrorbarContainer

from midnet_bench.analysis.frames import load_results
from midnet_bench.analysis.statistics import Estimate, mean
from midnet_bench.drawing.charts import Panel, axis_label, panel_figure
from midnet_bench.experiments.figures import detection_figures as figures
from midnet_bench.experiments.registry import tables_of
from tests.stores import detection_store

SCORES = {size: {seed: (0.97, 0.1 * size + 0.02 * seed, 0.5) for seed in (1, 2, 3)} for size in (1, 5)}


def series_of(axes: Axes) -> dict[str, ErrorbarContainer]:
    return {str(one.get_label()): one for one in axes.containers if isinstance(one, ErrorbarContainer)}


def test_each_score_has_a_panel_with_intervals_and_the_papers_points(tmp_path: Path) -> None:
    (figure,) = figures(load_results(detection_store(tmp_path, SCORES), tables_of)).values()
    assert [axes.get_ylabel() for axes in figure.axes] == ["precision", "recall", "F1", "F1, one-to-one"]
    assert {axes.get_ylim() for axes in figure.axes} == {(0.0, 1.03)}
    assert figure.get_suptitle() == "Detection by size of the team"
    recall = series_of(figure.axes[1])
    for label, by_team in {"ours": {1: 0.14, 5: 0.54}, "paper": {1: 0.787, 5: 0.96}}.items():
        x, y = np.transpose(recall[label].lines[0].get_xydata())
        assert np.rint(x).tolist() == list(by_team)
        assert y == pytest.approx(list(by_team.values()))
    expected = mean([0.12, 0.14, 0.16], within=(0.0, 1.0))
    first = recall["ours"].lines[2][0].get_segments()[0]
    assert first[:, 1] == pytest.approx([expected.low, expected.high])
    assert "paper" not in series_of(figure.axes[3])


def test_another_arena_has_no_points_of_the_paper(tmp_path: Path) -> None:
    folder = detection_store(tmp_path, SCORES, parameters={"arena": "office"})
    (figure,) = figures(load_results(folder, tables_of)).values()
    assert list(series_of(figure.axes[0])) == ["ours"]


def test_many_settings_stand_side_by_side_instead_of_over_each_other() -> None:
    estimate = Estimate(0.5, 0.4, 0.6, 3)
    panel = Panel("recall", {"ours": {f"5 robots, thresh={k}": estimate for k in range(9)}})
    (axes,) = panel_figure([panel], "", "", "").axes
    assert list(series_of(axes)["ours"].lines[0].get_xdata()) == list(range(9))
    assert [text.get_text() for text in axes.get_xticklabels()][2] == "5 robots, thresh=2"


def test_axes_are_labelled_in_words_with_units() -> None:
    assert axis_label("f1_one_to_one") == "F1, one-to-one"
    assert axis_label("gospa_per_frame_m") == "GOSPA, m per frame"
    assert axis_label("dying_after_s", "Time at which guards die.") == "time at which guards die, s"
    assert axis_label("iou_x", "IoU of boxes that overlap, t of Algorithm 2.") == "IoU of boxes that overlap"
    long = "A robot that has stayed within half a metre for this long gives up."
    assert axis_label("goal_timeout_s", long) == "goal timeout, s"
