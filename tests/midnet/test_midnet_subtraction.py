import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from midnet_bench.midnet.detection import common_occupancy, foreground
from tests.midnet.ascii_maps import binary, draw


def binary_pairs() -> st.SearchStrategy[tuple[np.ndarray, np.ndarray]]:
    shapes = hnp.array_shapes(min_dims=2, max_dims=2, max_side=9)
    cells = st.sampled_from([0, 255])
    return shapes.flatmap(
        lambda shape: st.tuples(
            hnp.arrays(np.uint8, shape, elements=cells), hnp.arrays(np.uint8, shape, elements=cells)
        )
    )


def test_wall_stays_common_and_the_intruder_is_left() -> None:
    local = binary(
        """
        ########
        ...##...
        ...##...
        """
    )
    prior = binary(
        """
        ########
        ########
        #.......
        """
    )
    c = common_occupancy(local, prior)
    assert draw(c) == [
        "########",
        "...##...",
        "........",
    ]
    assert draw(foreground(local, c), mark=255) == [
        "........",
        "........",
        "...##...",
    ]


@given(binary_pairs())
def test_eqs_5_and_6_are_occupied_in_a_and_free_in_b(pair: tuple[np.ndarray, np.ndarray]) -> None:
    a, b = pair
    c = common_occupancy(a, b)
    d = foreground(a, c)
    for array in (c, d):
        assert array.shape == a.shape
        assert array.dtype == np.uint8
    np.testing.assert_array_equal(c == 0, (a == 0) & (b == 0))
    np.testing.assert_array_equal(d, np.where((a == 0) & (b == 255), 255, 0))
    assert set(np.unique(d)) <= {0, 255}


def test_difference_does_not_wrap() -> None:
    a = np.array([[0, 255]], np.uint8)
    c = np.array([[255, 255]], np.uint8)
    assert (a - c).tolist() == [[1, 0]]  # what bytes do
    assert foreground(a, c).tolist() == [[255, 0]]
