"""A trial that is over leaves nothing behind: a worker runs thousands of them."""

import gc
from collections.abc import Iterator
from typing import Any

import pytest

from midnet_bench.experiments import registry
from midnet_bench.experiments.registry import experiment


@pytest.fixture(autouse=True)
def _no_collections() -> Iterator[None]:
    """What is freed is freed by its last reference."""
    gc.disable()
    yield
    gc.enable()


def left_by(name: str, **values: Any) -> list[str]:
    """The classes of this package of which a trial leaves objects that only a garbage collection finds."""
    found = experiment(name)
    parameters = found.parameters.of(engine="fast", **values)
    found.trials.run(parameters, 1)  # what is imported or compiled for the first time may leave some
    gc.collect()
    found.trials.run(parameters, 2)
    gc.set_debug(gc.DEBUG_SAVEALL)
    try:
        gc.collect()
        return sorted({type(each).__name__ for each in gc.garbage if is_own(each)})
    finally:
        gc.set_debug(0)
        gc.garbage.clear()


def is_own(thing: object) -> bool:
    return type(thing).__module__.startswith(registry.__name__.split(".")[0])


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("detection", {"record": True, "frames": 2, "robots": 2}),
        ("detection", {"record": True, "frames": 2, "robots": 2, "oracle": "occlusion", "arena": "people"}),
        ("detection", {"frames": 2, "robots": 2, "message_delay_s": 0.1, "metrics": "ospa"}),
        ("labyrinth", {"record": True, "time_limit_s": 2.0, "robots": 2, "evasion": "flee"}),
        ("labyrinth", {"time_limit_s": 2.0, "robots": 2, "pursuit": "oracle", "escape_at": "doors"}),
        ("mapping", {"time_limit_s": 2.0, "robots": 2}),
    ],
)
def test_a_trial_leaves_no_cycles_of_references(name: str, values: dict[str, Any]) -> None:
    assert left_by(name, **values) == []
