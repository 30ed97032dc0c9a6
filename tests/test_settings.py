"""Settings: ranges, nesting and flat keys, on a small tree."""

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.io.checked_yaml import Parameters, flat_model
from midnet_bench.settings import (
    Scalar,
    Settings,
    all_values,
    fixed,
    group,
    leaves,
    like,
    option,
    without_effect,
)


@dataclass(frozen=True)
class Wheel(Settings):
    radius_m: float = option(0.1, "Radius of the wheel.", gt=0, le=1)
    spokes: int = option(8, "Number of spokes.", ge=2, le=40, multiple_of=2)
    tyre: Literal["solid", "air"] = option("solid", "What the tyre is filled with.")
    pressure_bar: float | None = option(None, "Pressure of the tyre; null: what suits it.", ge=0)
    is_spare: bool = option(False, "Whether the wheel is a spare one.")
    maker: str = option("unknown", "Who made the wheel.", key="wheel_maker")
    hub_m: float = fixed(0.02, "ours: as wide as the axle")


@dataclass(frozen=True)
class Cart(Parameters):
    load_kg: float = option(10.0, "Load of the cart.", ge=0)
    front: Wheel = group(Wheel(), "front wheel", prefix="front_", only=("radius_m", "tyre", "maker"))
    rear: Wheel = group(Wheel(radius_m=0.3), "rear wheel", prefix="rear_")


@dataclass(frozen=True)
class HeavyCart(Cart):
    load_kg: float = like(Cart, "load_kg", 500.0)


ANYTHING = st.one_of(
    st.none(), st.booleans(), st.integers(-100, 100), st.floats(), st.sampled_from(["air", "solid", "wood"])
)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"radius_m": 0.0}, "Wheel: radius_m: Input should be greater than 0 (got 0.0)"),
        ({"radius_m": float("nan")}, "Wheel: radius_m: Input should be a finite number (got nan)"),
        ({"spokes": 42}, "Wheel: spokes: Input should be less than or equal to 40 (got 42)"),
        ({"spokes": 3}, "Wheel: spokes: Input should be a multiple of 2 (got 3)"),
        ({"spokes": 8.5}, "Wheel: spokes: "),
        ({"spokes": True}, "Wheel: spokes: Input should be a valid integer (got True)"),
        ({"tyre": "ari"}, "Wheel: tyre: Input should be 'solid' or 'air' (got 'ari')"),
        ({"pressure_bar": -1}, "Wheel: pressure_bar: Input should be greater than or equal to 0 (got -1"),
        ({"pressure_bar": float("inf")}, "Wheel: pressure_bar: Input should be a finite number (got inf)"),
        ({"is_spare": 1}, "Wheel: is_spare: Input should be a valid boolean (got 1)"),
        ({"maker": 3}, "Wheel: maker: Input should be a valid string (got 3)"),
    ],
)
def test_no_settings_hold_what_is_out_of_range(changes: dict[str, Any], complaint: str) -> None:
    with pytest.raises(InputError) as caught:
        Wheel(**changes)
    assert str(caught.value).startswith(complaint)
    with pytest.raises(InputError):
        replace(Wheel(), **changes)


def test_a_number_takes_the_type_of_its_option() -> None:
    taken = Wheel(radius_m=1, pressure_bar=np.float64(2.0))
    assert [type(value) for value in (taken.radius_m, taken.pressure_bar)] == [float, float]


@given(value=ANYTHING, name=st.sampled_from(["radius_m", "spokes", "tyre", "pressure_bar", "is_spare"]))
def test_settings_refuse_what_the_model_of_their_keys_refuses(value: Any, name: str) -> None:
    """But for what files may say otherwise: a whole float, a quoted number, 0 or "yes" for a boolean."""
    try:
        Wheel(**{name: value})
    except InputError:
        reads_more = (name == "spokes" and isinstance(value, float)) or name == "is_spare"
        assert reads_more or not _model_takes(name, value)
    else:
        assert _model_takes(name, value)


def _model_takes(name: str, value: Any) -> bool:
    try:
        flat_model(Wheel).model_validate({name: value})
    except ValidationError:
        return False
    return True


def test_flat_keys_come_from_the_tree() -> None:
    known = leaves(Cart)
    assert list(known) == [
        "load_kg",
        "front_radius_m",
        "front_tyre",
        "front_wheel_maker",
        "rear_radius_m",
        "rear_spokes",
        "rear_tyre",
        "rear_pressure_bar",
        "rear_is_spare",
        "rear_wheel_maker",
    ]
    assert known["rear_radius_m"].default == 0.3
    assert known["rear_radius_m"].group == "rear wheel"
    assert known["rear_tyre"].allowed == "solid | air"
    assert known["rear_pressure_bar"].allowed == "0 or more, or null"
    assert leaves(HeavyCart)["load_kg"].default == 500.0
    assert leaves(HeavyCart)["load_kg"].limits == known["load_kg"].limits == {"ge": 0}
    unset = [(".".join(one.path), one.default, one.source) for one in all_values(Cart) if one.key is None]
    assert ("rear.hub_m", 0.02, "ours: as wide as the axle") in unset
    assert [name for name, *_ in unset].count("front.spokes") == 1


@dataclass(frozen=True)
class Axle(Settings):
    load_kg: float = option(20.0, "What the axle bears.", source="package: catalogue, radius")
    wheel: Wheel = group(Wheel(), "wheel", sources={"tyre": "paper: II", "spokes": "paper: III"})


@dataclass(frozen=True)
class Trailer(Axle):
    load_kg: float = like(Axle, "load_kg", 40.0, source="paper: IV")


@dataclass(frozen=True)
class Train(Settings):
    front: Axle = group(Axle(), "front", prefix="front_", sources={"wheel.tyre": "ours: softer"})
    rear: Trailer = group(Trailer(), "rear", prefix="rear_", sources={"load_kg": "ours: stronger"})


def test_a_default_has_the_source_of_its_option_or_of_the_outermost_group_that_names_one() -> None:
    plain = {key: leaf.source for key, leaf in leaves(Trailer).items()}
    assert plain["load_kg"] == "paper: IV"
    assert (plain["spokes"], plain["wheel_maker"]) == ("paper: III", "")
    found = {key: leaf.source for key, leaf in leaves(Train).items()}
    assert found["front_load_kg"] == "package: catalogue, radius"
    assert (found["front_tyre"], found["front_spokes"]) == ("ours: softer", "paper: III")
    assert (found["rear_load_kg"], found["rear_tyre"]) == ("ours: stronger", "paper: II")


@pytest.mark.parametrize("source", ["somewhere", "ourselves: why not", "paper", "Paper: II"])
def test_a_source_of_no_known_kind_is_a_fault_of_the_class(source: str) -> None:
    with pytest.raises(ValueError, match="a source begins with one of: paper, turtlebot3, "):
        option(1.0, "Load of the cart.", source=source)


def test_an_option_without_effect_under_the_others_is_named() -> None:
    usual = DetectionParameters.defaults()
    given = ["wheel_slip", "decay_s", "frames"]
    told = without_effect(DetectionParameters, given, [usual])
    assert told == [
        "wheel_slip has no effect unless odometry is encoder",
        "decay_s has no effect unless local_map is decay",
    ]
    encoder = {**usual, "odometry": "encoder"}
    assert [line.split()[0] for line in without_effect(DetectionParameters, given, [usual, encoder])] == [
        "decay_s"
    ]


def test_two_options_of_one_key_are_a_fault_of_the_class() -> None:
    @dataclass(frozen=True)
    class Twice(Settings):
        first: Wheel = group(Wheel(), "first")
        second: Wheel = group(Wheel(), "second")

    with pytest.raises(ValueError, match="two options have the flat key 'radius_m'"):
        leaves(Twice)


CHANGES = st.fixed_dictionaries(
    {},
    optional={
        "load_kg": st.floats(0, 1e6),
        "front_radius_m": st.floats(0.001, 1),
        "rear_spokes": st.integers(1, 20).map(lambda half: 2 * half),
        "rear_tyre": st.sampled_from(["solid", "air"]),
        "rear_pressure_bar": st.none() | st.floats(0, 10),
        "rear_is_spare": st.booleans(),
        "rear_wheel_maker": st.text('aé \n"='),
    },
)


@settings(max_examples=30)
@given(CHANGES)
def test_flat_values_make_the_same_settings_again(changes: dict[str, Any]) -> None:
    cart = Cart.from_flat(changes)
    assert changes.items() <= cart.flat_values().items()
    assert Cart.from_flat(cart.flat_values()) == cart
    assert Cart.parse(changes, "here") == cart


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"lod_kg": 3}, "f.yaml: lod_kg: unknown key; did you mean 'load_kg'?"),
        ({"load_kg": -3}, "f.yaml: load_kg: Input should be greater than or equal to 0 (got -3)"),
        ({"load_kg": True}, "f.yaml: load_kg: Input should be a valid number (got True)"),
        ({"front_spokes": 4}, "f.yaml: front_spokes: unknown key"),
        ({"rear_tyre": "wood"}, "f.yaml: rear_tyre: Input should be 'solid' or 'air' (got 'wood')"),
    ],
)
def test_what_a_user_wrote_wrong_is_told_by_its_flat_key(values: dict[str, Any], complaint: str) -> None:
    with pytest.raises(InputError) as caught:
        Cart.parse(values, "f.yaml")
    assert str(caught.value).startswith(complaint)


def test_an_unknown_key_of_a_trial_is_refused() -> None:
    with pytest.raises(InputError, match="lod_kg: unknown key; did you mean 'load_kg'"):
        Cart.from_flat({"lod_kg": 3})


@pytest.mark.parametrize(
    ("key", "value", "is_allowed"),
    [
        ("lidar_hz", 5, True),
        ("lidar_hz", 5.5, True),
        ("lidar_hz", 0, False),
        ("lidar_hz", True, False),
        ("align", "as in a later version", True),
        ("frames", "5", False),
        ("frames", 5.0, False),
        ("frames", 0, False),
        ("intruders", None, True),
        ("frames", None, False),
        ("record", True, True),
        ("record", 1, False),
        ("arena", 3, False),
        ("stationary_scale", 1, True),
        ("stationary_scale", 0.0, False),
        ("stationary_scale", math.nan, False),
        ("dying_after_s", math.inf, False),
    ],
)
def test_an_option_has_values_of_its_kind_and_range(key: str, value: Scalar, is_allowed: bool) -> None:
    assert leaves(DetectionParameters)[key].allows(value) == is_allowed
