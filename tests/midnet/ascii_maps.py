"""Small worlds drawn as text: the top line has the highest y, as on paper; ``#`` is occupied."""

import numpy as np
import numpy.typing as npt


def characters(drawing: str) -> npt.NDArray[np.str_]:
    """(rows, columns) of single characters, row 0 the lowest line; short lines end in blanks."""
    lines = [line for line in drawing.split("\n") if line.strip()]
    indent = min(len(line) - len(line.lstrip()) for line in lines)
    lines = [line[indent:].rstrip() for line in lines]
    width = max(len(line) for line in lines)
    return np.array([list(line.ljust(width)) for line in reversed(lines)])


def side_by_side(drawings: str) -> list[str]:
    """The drawings that stand beside each other, blanks between them."""
    lines = [line.split() for line in drawings.split("\n") if line.strip()]
    return ["\n".join(rows) for rows in zip(*lines, strict=True)]


def binary(drawing: str) -> npt.NDArray[np.uint8]:
    """A binary grid: ``#`` is 0, all else 255."""
    return np.where(characters(drawing) == "#", 0, 255).astype(np.uint8)


def costs(drawing: str) -> npt.NDArray[np.int8]:
    """A published costmap: ``#`` is 100, ``?`` is -1, all else 0."""
    drawn = characters(drawing)
    return np.where(drawn == "#", 100, np.where(drawn == "?", -1, 0)).astype(np.int8)


def draw(grid: npt.NDArray[np.uint8], mark: int = 0) -> list[str]:
    """Lines, the highest y first; cells equal to ``mark`` are ``#``, all else ``.``."""
    return ["".join("#" if cell == mark else "." for cell in row) for row in grid[::-1]]
