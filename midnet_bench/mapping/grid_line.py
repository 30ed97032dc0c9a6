"""The cells that a laser ray crosses."""

import numpy as np
import numpy.typing as npt
from numba import njit


@njit(cache=True)
def trace_line(column: int, row: int, end_column: int, end_row: int, cells: npt.NDArray[np.int64]) -> int:
    """How many cells Bresenham's line visits before its end cell; ``cells[:count]`` holds them.

    Args:
        column: of the first cell.
        row: of the first cell.
        end_column: of the end cell.
        end_row: of the end cell.
        cells: (M, 2) int64, overwritten with (column, row); M of at least max(|dx|, |dy|).
    """
    dx, dy = abs(end_column - column), abs(end_row - row)
    step_x = 1 if end_column > column else -1
    step_y = 1 if end_row > row else -1
    error = dx - dy
    count = max(dx, dy)
    for k in range(count):
        cells[k, 0] = column
        cells[k, 1] = row
        twice = 2 * error
        if twice > -dy:
            error -= dy
            column += step_x
        if twice < dx:
            error += dx
            row += step_y
    return count
