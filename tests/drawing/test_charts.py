"""Charts of estimates: what their intervals are drawn from."""

import math

import pytest

from midnet_bench.analysis.statistics import Estimate
from midnet_bench.drawing.charts import STYLES, add_estimates, chart, chart_files, counted


def test_times_that_are_all_equal_have_a_bar_of_no_length() -> None:
    """Each intruder takes 239.8 s, and yet the interval lies above the value: by their last digits."""
    alike = Estimate(239.79999999999995, 239.8, 239.8, 5)
    figure = chart(3.0, 3.0)
    axes = figure.add_subplot()

    add_estimates(axes, [0.0, 1.0], [alike, Estimate(2.0, math.nan, math.nan, 1)], STYLES[0], "times")

    (bars,) = axes.containers[0].lines[2]  # type: ignore[attr-defined]
    ends = [segment[:, 1].tolist() for segment in bars.get_segments() if len(segment)]
    assert ends == [[alike.value, pytest.approx(239.8, abs=1e-12)]]  # and none for the undefined one
    assert chart_files(figure)


@pytest.mark.parametrize(
    ("low", "trials", "said"),
    [
        (math.nan, 1, "one trial each, without intervals"),
        (math.nan, 2, "mean of 2 trials, without intervals"),
        (0.4, 3, "mean of 3 trials; how"),
    ],
)
def test_a_figure_says_what_its_points_are_made_of(low: float, trials: int, said: str) -> None:
    assert counted([Estimate(0.5, low, 0.6, trials)], "how") == said
