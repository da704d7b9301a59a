"""The weighting matrix W of the objective: its diagonal, or the whole matrix."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
from pydantic import WrapValidator

from wavegym.core.arrays import Array
from wavegym.core.covariance_checks import check_covariance
from wavegym.core.errors import InputError, check_positive
from wavegym.core.parameters import NonNegative

StateWeights = tuple[NonNegative, NonNegative, NonNegative, NonNegative]
SEQUENCES = (tuple, list, np.ndarray)
SIZE = 4  # elements of the state [x xdot y ydot]


def _diagonal_or_rows(given: Any, as_diagonal: Callable[[Any], Any]) -> Any:
    """Four numbers as they are, or four rows as a tuple of tuples; InputError for rows that are no weighting matrix."""
    if not (isinstance(given, SEQUENCES) and any(isinstance(row, SEQUENCES) for row in given)):
        return as_diagonal(given)
    sizes = [np.size(row) for row in given]
    if sizes != [SIZE] * SIZE:
        raise InputError(f"weights has rows of {sizes} elements, expected 4 numbers, or 4 rows of 4")
    return tuple(map(tuple, check_covariance("weights", np.array(given, np.float64)).tolist()))


Weights = Annotated[StateWeights, WrapValidator(_diagonal_or_rows)]


def weighting_matrix(weights: Weights) -> Array:
    """W, (4, 4). InputError if its trace is 0."""
    given = np.array(weights)
    matrix = np.diag(given) if given.ndim == 1 else given
    check_positive("sum of weights", float(np.trace(matrix)))
    return matrix
