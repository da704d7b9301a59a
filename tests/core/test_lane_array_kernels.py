"""Arrays of lanes against NumPy, bit for bit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba.core.errors import TypingError

from wavegym.core.kernels import kernel
from wavegym.core.lane_array_kernels import empty_lanes, gather_part, gathered, prefetch, scatter, scatter_part
from wavegym.core.lane_kernels import LANES, rows_from

RNG = np.random.default_rng(0)
PAIR, FOUR = (0, 0), (0, 0, 0, 0)


@kernel
def matrices(a, out, nn):
    """out = a a + a[0] in every row, by scratch arrays and their parts."""
    for first in range(0, len(a), LANES):
        rows = rows_from(first, len(a))
        x, row = empty_lanes((nn, nn)), empty_lanes((nn,))
        for i in range(x.shape[0]):
            row[i] = 0.0
            for j in range(x.shape[1]):
                x[i, j] = gathered(a, (rows, i, j))
        for j in range(len(row)):
            row[j] += x[0][j]
        for i in range(len(nn)):
            for j in range(len(nn)):
                total = row[j]
                for k in range(len(nn)):
                    total += x[i, k] * x[k, j]
                scatter(out, (rows, i, j), total)


@pytest.mark.parametrize("count", range(1, 2 * LANES + 2))
def test_any_number_of_rows_has_the_bits_of_each_alone(count):
    a = RNG.standard_normal((count, 2, 2))
    out, alone = np.empty(a.shape), np.empty(a.shape)
    matrices(a, out, PAIR)
    for i in range(count):
        matrices(a[i : i + 1], alone[i : i + 1], PAIR)
    assert (out == alone).all()
    assert np.abs(out - (a @ a + a[:, :1])).max() <= 1e-14 * np.abs(a).max() ** 2


@kernel
def parts(a, out, columns, nn, mm):
    """out = a + its part's number, column by column and part by part; columns: as many as the second axis has."""
    x = empty_lanes((columns, nn, mm))
    for first in range(0, len(a), LANES):
        rows = rows_from(first, len(a))
        for c in range(columns):
            prefetch(a, (rows_from(first + LANES, len(a)), c, 0, 0))
            gather_part(a, (rows, c), x[c])
        for c in range(columns):
            for i in range(len(nn)):
                for j in range(len(mm)):
                    x[c, i, j] += c
            scatter_part(out, (rows, c), x[c])


@pytest.mark.parametrize("sizes", [((0,), FOUR), (PAIR, PAIR), (FOUR, (0, 0, 0)), ((0,), PAIR), ((0, 0, 0), (0, 0, 0))])
def test_parts_are_gathered_and_scattered_for_any_number_of_rows(sizes):
    for count in range(1, 2 * LANES + 2):
        a = RNG.standard_normal((count, 3, *map(len, sizes)))
        out = np.full((count + 2, *a.shape[1:]), np.nan)
        parts(a, out[1:-1], 3, *sizes)
        assert (out[1:-1] == a + np.arange(3.0)[:, None, None]).all()
        assert np.isnan(out[[0, -1]]).all()


@pytest.mark.parametrize("sizes", [(FOUR, FOUR), (PAIR, (0, 0, 0))])
def test_parts_are_gathered_from_any_layout_and_integers(sizes):
    shape = 9, 3, *map(len, sizes)
    for a in (
        RNG.standard_normal((9, 6, *shape[2:]))[:, ::2],
        RNG.standard_normal(shape[::-1]).T,
        np.arange(math.prod(shape))[::-1].reshape(shape),
    ):
        out = np.empty(shape)
        parts(a, out, 3, *sizes)
        assert (out == a + np.arange(3.0)[:, None, None]).all()


@pytest.mark.parametrize(
    "out", [np.zeros((9, 6, 4, 4))[:, ::2], np.zeros((9, 3, 4, 4), np.int64)], ids=["gaps", "integers"]
)
def test_parts_are_scattered_to_contiguous_float64(out):
    with pytest.raises(TypingError):
        parts(np.zeros((9, 3, 4, 4)), out, 3, FOUR, FOUR)


def test_gather_and_scatter_take_any_layout_and_integers():
    a = np.arange(10 * 2 * 2)[::-1].reshape(10, 2, 2)
    out = np.zeros((4, 20), np.int64)[:, ::2].T.reshape(10, 2, 2)
    matrices(a, out, PAIR)
    assert (out == a @ a + a[:, :1]).all()


@kernel
def written_to_one_place(out):
    rows = rows_from(0, LANES)
    scatter(out, (0.0 * rows,), rows)


def test_of_lanes_with_one_place_the_first_counts():
    """The last environment is repeated in lanes that nobody needs; what those hold must not replace its own."""
    out = np.full(1, np.nan)
    written_to_one_place(out)
    assert out[0] == 0.0
