import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from midnet_bench.midnet.detection import binary_map

COSTS = hnp.arrays(
    np.int8, hnp.array_shapes(min_dims=2, max_dims=2, max_side=6), elements=st.integers(-1, 100)
)


def test_costs_below_thresh_are_free_and_from_thresh_on_occupied() -> None:
    costs = np.array([[-1, 0, 1, 29], [30, 31, 99, 100]], np.int8)
    binary = binary_map(costs, thresh=30)
    assert binary.dtype == np.uint8
    assert binary.tolist() == [[255, 255, 255, 255], [0, 0, 0, 0]]


def test_unknown_can_count_as_occupied() -> None:
    costs = np.array([[-1, 0, 29, 30]], np.int8)
    assert binary_map(costs, thresh=30, unknown="occupied").tolist() == [[0, 255, 255, 0]]


@given(COSTS, st.integers(1, 100), st.sampled_from(["free", "occupied"]))
def test_each_cell_follows_eq_1(costs: np.ndarray, thresh: int, unknown: str) -> None:
    before = costs.copy()
    binary = binary_map(costs, thresh, unknown)
    for x, e in zip(costs.ravel().tolist(), binary.ravel().tolist(), strict=True):
        if x == -1:
            assert e == (255 if unknown == "free" else 0)
        else:
            assert e == (255 if 0 <= x < thresh else 0)
    np.testing.assert_array_equal(costs, before)


def test_unsigned_costs_are_refused_because_unknown_would_be_255() -> None:
    with pytest.raises(ValueError, match="uint8; int8 is needed"):
        binary_map(np.zeros((2, 2), np.uint8), 50)  # type: ignore[arg-type]
