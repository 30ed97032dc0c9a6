"""Settings: ranges, nesting and flat keys, on a small tree; pydantic's model is a second opinion."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.io.parameters import Parameters, flat_model
from midnet_bench.settings import Settings, group, leaves, like, option, without_effect


@dataclass(frozen=True)
class Wheel(Settings):
    concern: ClassVar[str] = "wheel"

    radius_m: float = option(0.1, "Radius of the wheel.", gt=0, le=1)
    spokes: int = option(8, "Number of spokes.", ge=2, le=40, multiple_of=2)
    tyre: Literal["solid", "air"] = option("solid", "What the tyre is filled with.")
    pressure_bar: float | None = option(None, "Pressure of the tyre; null: what suits it.", ge=0)
    is_spare: bool = option(False, "Whether the wheel is a spare one.")
    maker: str = option("unknown", "Who made the wheel.", key="wheel_maker")


@dataclass(frozen=True)
class Cart(Parameters):
    concern: ClassVar[str] = "cart"

    load_kg: float = option(10.0, "Load of the cart.", ge=0)
    front: Wheel = group(Wheel(), "front wheel", prefix="front_", keys={"spokes": None})
    rear: Wheel = group(Wheel(radius_m=0.3), "rear wheel", prefix="rear_", keys={"tyre": "tyre"})


@dataclass(frozen=True)
class HeavyCart(Cart):
    load_kg: float = like(Cart, "load_kg", 500.0)


ANYTHING = st.one_of(
    st.none(), st.booleans(), st.integers(-100, 100), st.floats(), st.sampled_from(["air", "solid", "wood"])
)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"radius_m": 0.0}, "wheel: radius_m: 0.0 is out of range; allowed: above 0 and at most 1"),
        ({"radius_m": float("nan")}, "wheel: radius_m: nan is out of range"),
        ({"spokes": 42}, "wheel: spokes: 42 is out of range; allowed: 2 to 40, a multiple of 2"),
        ({"spokes": 3}, "wheel: spokes: 3 is out of range"),
        ({"spokes": 8.5}, "wheel: spokes: "),
        ({"spokes": True}, "wheel: spokes: a whole number is needed (got True)"),
        ({"tyre": "ari"}, "wheel: tyre: no such choice 'ari'; did you mean 'air'?"),
        ({"pressure_bar": -1}, "wheel: pressure_bar: -1 is out of range; allowed: 0 or more"),
        ({"pressure_bar": float("inf")}, "wheel: pressure_bar: inf is out of range"),
        ({"is_spare": 1}, "wheel: is_spare: true or false is needed (got 1)"),
        ({"maker": 3}, "wheel: maker: a text is needed (got 3)"),
    ],
)
def test_no_settings_hold_what_is_out_of_range(changes: dict[str, Any], complaint: str) -> None:
    with pytest.raises(InputError) as caught:
        Wheel(**changes)
    assert str(caught.value).startswith(complaint)
    with pytest.raises(InputError):
        replace(Wheel(), **changes)


def test_a_number_takes_the_type_of_its_option() -> None:
    taken = Wheel(radius_m=1, spokes=np.int64(4), pressure_bar=np.float32(2.0))  # type: ignore[arg-type]
    assert [type(value) for value in (taken.radius_m, taken.spokes, taken.pressure_bar)] == [
        float,
        int,
        float,
    ]


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
        "front_pressure_bar",
        "front_is_spare",
        "front_wheel_maker",
        "rear_radius_m",
        "rear_spokes",
        "tyre",
        "rear_pressure_bar",
        "rear_is_spare",
        "rear_wheel_maker",
    ]
    assert known["rear_radius_m"].default == 0.3
    assert known["rear_radius_m"].group == "rear wheel"
    assert known["tyre"].allowed == "solid | air"
    assert known["rear_pressure_bar"].allowed == "0 or more, or null"
    assert leaves(HeavyCart)["load_kg"].default == 500.0
    assert leaves(HeavyCart)["load_kg"].option == known["load_kg"].option


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
    plain = {key: leaf.option.source for key, leaf in leaves(Trailer).items()}
    assert plain["load_kg"] == "paper: IV"
    assert (plain["spokes"], plain["wheel_maker"]) == ("paper: III", "")
    found = {key: leaf.option.source for key, leaf in leaves(Train).items()}
    assert found["front_load_kg"] == "package: catalogue, radius"
    assert (found["front_tyre"], found["front_spokes"]) == ("ours: softer", "paper: III")
    assert (found["rear_load_kg"], found["rear_tyre"]) == ("ours: stronger", "paper: II")


@pytest.mark.parametrize("source", ["somewhere", "ourselves: why not", "paper", "Paper: II"])
def test_a_source_of_no_known_kind_is_a_fault_of_the_class(source: str) -> None:
    with pytest.raises(ValueError, match="a source begins with one of: paper, turtlebot3, "):
        option(1.0, "Load of the cart.", source=source)


def test_an_option_without_effect_under_the_others_is_named() -> None:
    usual = DetectionParameters.defaults()
    given = ["wheel_slip", "nav_local_decay_s", "solver_iterations", "frames", "gyro_bias_radps"]
    told = without_effect(DetectionParameters, given, [usual])
    assert told == [
        "wheel_slip has no effect unless odometry is encoder",
        "nav_local_decay_s has no effect unless nav_local_memory is decay",
    ]
    mujoco = {**usual, "engine": "mujoco", "odometry": "encoder", "imu_noise": "none"}
    assert [line.split()[0] for line in without_effect(DetectionParameters, given, [mujoco])] == [
        "nav_local_decay_s",
        "solver_iterations",
        "gyro_bias_radps",
    ]
    assert "wheel_slip" not in str(without_effect(DetectionParameters, given, [usual, mujoco]))
    rollout = [key for key in usual if key.startswith("rollout_")]
    assert rollout
    assert len(without_effect(DetectionParameters, rollout, [usual])) == len(rollout)


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
        "tyre": st.sampled_from(["solid", "air"]),
        "rear_pressure_bar": st.none() | st.floats(0, 10),
        "front_is_spare": st.booleans(),
        "rear_wheel_maker": st.text(),
    },
)


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
        ({"tyre": "wood"}, "f.yaml: tyre: Input should be 'solid' or 'air' (got 'wood')"),
    ],
)
def test_what_a_user_wrote_wrong_is_told_by_its_flat_key(values: dict[str, Any], complaint: str) -> None:
    with pytest.raises(InputError) as caught:
        Cart.parse(values, "f.yaml")
    assert str(caught.value).startswith(complaint)


def test_an_unknown_key_of_a_trial_is_refused() -> None:
    with pytest.raises(InputError, match="lod_kg: unknown key; did you mean 'load_kg'"):
        Cart.from_flat({"lod_kg": 3})


def test_a_number_among_choices_is_of_its_kind() -> None:
    scans_per_second = leaves(DetectionParameters)["lidar_hz"]
    assert scans_per_second.is_of_its_kind(5)
    assert not scans_per_second.is_of_its_kind(3)
