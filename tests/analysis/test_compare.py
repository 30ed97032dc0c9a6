"""Differences seed by seed of a frame of scores."""

import math
from functools import partial

import pandas as pd
import pytest

from midnet_bench.analysis.compare import BETTER, IDENTICAL, UNCLEAR, WORSE, Compared, joined, paired, tidy
from midnet_bench.analysis.statistics import mean, p_value

SEEDS = range(1, 9)
BASE = [0.5 + 0.01 * (seed % 3) for seed in SEEDS]
NOISE = [0.01 * ((seed * 5) % 7 - 3) for seed in SEEDS]
CHANGES = {
    "first": ([0.0] * 8, [0.0] * 8),
    "slightly": ([0.003 + each for each in NOISE], [0.0] * 8),
    "clearly": ([0.1 + each for each in NOISE], [0.1 + each for each in NOISE]),
}
"""method -> what its scores ``up`` and ``down`` have more than the first one's, seed by seed"""


def compared(*measures: str) -> list[Compared]:
    """All methods beside the first, in cells of one and of two robots; less of ``down`` is better."""
    parts = {}
    for name, (up, down) in CHANGES.items():
        rows = [
            {"robots": robots, "seed": seed, "up": base + more, "down": base + less}
            for robots in (1, 2)
            for seed, base, more, less in zip(SEEDS, BASE, up, down, strict=True)
        ]
        parts[(name,)] = tidy(pd.DataFrame(rows), ["robots"], ["up", "down"])
    frame = joined(parts, ["method"])
    return paired(frame, ["method"], lambda _: (-math.inf, math.inf), lambda one: one == "down", measures)


def p_alone(name: str) -> float:
    return p_value(partial(mean, CHANGES[name][0]), 0.0, math.inf)


def test_a_difference_is_the_contestant_s_less_the_first_one_s_seed_by_seed() -> None:
    one, two = (each for each in compared("up") if each.contestant == ("clearly",))
    assert (one.cell, two.cell) == ("1-robot", "2-robot")
    changes = CHANGES["clearly"][0]
    assert one.before == pytest.approx(sum(BASE) / 8)
    assert one.after == pytest.approx((sum(BASE) + sum(changes)) / 8)
    assert one.change[:3] == pytest.approx(mean(changes)[:3])
    assert one.seeds == 8


def test_holm_goes_over_all_contestants_cells_and_measures() -> None:
    of_one = {one.contestant[0]: one.p_holm for one in compared("up")}
    assert of_one["clearly"] == pytest.approx(4.0 * p_alone("clearly"))
    assert of_one["slightly"] == pytest.approx(min(1.0, 2.0 * p_alone("slightly")))
    # two more with the other measure; those without any difference have no interval and do not count
    of_both = {one.contestant[0]: one.p_holm for one in compared() if one.measure == "up"}
    assert of_both["clearly"] == pytest.approx(6.0 * p_alone("clearly"))


def test_verdicts_go_by_what_is_wanted() -> None:
    verdicts = {(one.contestant[0], one.measure): one.verdict for one in compared()}
    assert verdicts == {
        ("slightly", "up"): UNCLEAR,
        ("slightly", "down"): IDENTICAL,
        ("clearly", "up"): BETTER,
        ("clearly", "down"): WORSE,
    }
