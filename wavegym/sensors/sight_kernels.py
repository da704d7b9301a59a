"""Kernel of a sight table: from which cells of a grid every antenna is visible."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wavegym.core.kernels import inlined


class SightTable(NamedTuple):
    """Cells of a ``wavegym.sensors.visibility.Grid``; beyond its edge a point counts as in the nearest cell."""

    west: float  # m
    south: float  # m
    per_metre: float  # cells
    clear: NDArray[np.bool_]  # (column, row); no column where nothing can hide


@inlined
def is_clear(x, y, table):
    """Whether every antenna is visible from the middle of the cell of (x, y); not finite: of the first cell."""
    column = int((x - table.west) * table.per_metre)
    row = int((y - table.south) * table.per_metre)
    return table.clear[
        min(max(column, 0), table.clear.shape[0] - 1), min(max(row, 0), table.clear.shape[1] - 1)
    ]  # fmt: skip
