"""Variants: named changes of parameters, as an axis of cells beside the grid."""

from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from midnet_bench.analysis.frames import Results
from midnet_bench.campaign.definition import (
    Baseline,
    Campaign,
    Definition,
    ResolvedCampaign,
    differences,
    override,
    parse_campaign,
    resolve,
)
from midnet_bench.campaign.trial import VARIANT
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from midnet_bench.experiments.detection.tables import with_boxes

VARIANTS = {
    "none": None,
    "dropout": {"lidar_dropout": 0.2},
    "strict": {"tp_boxes": "surplus_false", "lidar_dropout": 0.2},
}


def campaign(**more: object) -> Campaign:
    values = {"experiment": "detection", "variants": VARIANTS, "grid": {"robots": [1, 5]}, **more}
    return parse_campaign(values, "mine.yaml")


def resolved(**more: object) -> ResolvedCampaign:
    return resolve(campaign(**more), registry)


def test_each_variant_is_a_cell_of_each_cell_of_the_grid() -> None:
    made = resolved()
    assert made.definition.grid == {VARIANT: ["none", "dropout", "strict"], "robots": [1, 5]}
    assert [(cell[VARIANT], cell["robots"], cell["lidar_dropout"]) for cell in made.cells] == [
        ("none", 1, 0.0),
        ("none", 5, 0.0),
        ("dropout", 1, 0.2),
        ("dropout", 5, 0.2),
        ("strict", 1, 0.2),
        ("strict", 5, 0.2),
    ]
    assert made.definition.variants == {
        "none": {"tp_boxes": "every", "lidar_dropout": 0.0},
        "dropout": {"tp_boxes": "every", "lidar_dropout": 0.2},
        "strict": {"tp_boxes": "surplus_false", "lidar_dropout": 0.2},
    }
    assert made.definition.parameters_of({VARIANT: "dropout", "robots": 5})["lidar_dropout"] == 0.2
    assert Definition.from_json(made.definition.to_json()) == made.definition


def test_a_variant_s_trials_are_those_of_its_parameters_alone() -> None:
    made = resolved()
    plain = resolve(
        parse_campaign({"experiment": "detection", "grid": {"robots": [1, 5]}}, "plain"), registry
    )
    settings = [next(iter(one.trials())).settings for one in (made, plain)]
    assert settings[0] == settings[1]
    assert VARIANT not in settings[0]


def test_a_campaign_goes_on_with_more_variants_and_not_with_others() -> None:
    whole = resolved().definition
    fewer = resolve(override(campaign(), {VARIANT: ["none", "dropout"]}), registry).definition
    assert list(fewer.variants) == ["none", "dropout"]
    assert differences(fewer, whole) == []
    changed = resolved(variants={**VARIANTS, "dropout": {"lidar_dropout": 0.3}}).definition
    assert differences(fewer, changed) == ["lidar_dropout 0.2 -> 0.3"]
    assert differences(whole, fewer) != []


def test_the_baseline_is_a_value_of_a_factor() -> None:
    assert resolved(compare={}).definition.compare == Baseline(VARIANT, "none")
    assert resolved(compare={"by": "robots"}).definition.compare == Baseline("robots", 1)
    for compare, key in (({"baseline": "dropuot"}, "compare.baseline"), ({"by": "robot"}, "compare.by")):
        with pytest.raises(InputError, match=f"mine.yaml: {key}: .*; did you mean"):
            resolved(compare=compare)


@pytest.mark.parametrize(
    ("variants", "key"),
    [
        ({"slip": {"wheel_slp": 0.1}}, "variants.slip.wheel_slp"),
        ({"slip": {"robots": 2}}, "variants.slip.robots"),
        ({"slip": {"wheel_slip": -1}}, "wheel_slip"),
        ({"slip": 3}, "variants.slip"),
    ],
)
def test_a_wrong_variant_is_named(variants: dict[str, object], key: str) -> None:
    with pytest.raises(InputError, match=f"mine.yaml: .*{key}"):
        resolved(variants=variants)


def test_a_parameter_of_a_variant_is_found_for_each_row() -> None:
    """One box on an intruder and a second one, counted as no tp, as the variant ``strict`` counts."""
    counts = {"matched": 1, "missed": 0, "duplicates": 1}
    frame = pd.DataFrame(
        [{VARIANT: name, "seed": 1, **counts, "fp": int(name == "strict")} for name in ("none", "strict")]
    )
    definition = replace(resolved().definition, trials=1)
    results = Results(Path("mine"), definition, [], {"scores": frame}, pd.DataFrame(), pd.DataFrame())
    boxes = with_boxes(results, frame)
    assert boxes["boxes"].tolist() == [2, 2]
