"""Lanes against NumPy, lane by lane and bit for bit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba.core.errors import TypingError

from wavegym.core.kernels import kernel
from wavegym.core.lane_kernels import (
    LANES,
    each_lane,
    empty_lanes,
    gather_part,
    gathered,
    lane,
    prefetch,
    rows_from,
    scatter,
    scatter_part,
    somewhere,
    where,
    width,
    with_lane,
)

RNG = np.random.default_rng(0)
PAIR, FOUR = (0, 0), (0, 0, 0, 0)
SPECIAL = np.array([0.0, -0.0, 1.0, -1.5, 2.5, np.inf, -np.inf, np.nan, 1e-310])
A, B = (part.reshape(-1) for part in np.meshgrid(SPECIAL, SPECIAL))


@kernel
def binary(a, b, out):
    for first in range(0, len(a), LANES):
        rows = rows_from(first, len(a))
        x, y = gathered(a, (rows,)), gathered(b, (rows,))
        listed = (x + y, x - y, x * y, x / y, np.copysign(x, y), where((x < y) | (x == y), x, y), min(x, y), max(x, y))
        for i in range(8):
            scatter(out, (i, rows), listed[i])


@kernel
def unary(a, out):
    for first in range(0, len(a), LANES):
        rows = rows_from(first, len(a))
        x = gathered(a, (rows,))
        listed = (-x, abs(x), np.sqrt(abs(x)), np.rint(x), np.arctan(x), np.arcsin(x))
        for i in range(6):
            scatter(out, (i, rows), listed[i])


def bits(values):
    """Bits of float64, where all NaN are one."""
    return np.where(np.isnan(values), np.nan, values).view(np.int64)


def test_arithmetic_of_lanes_has_the_bits_of_numpys():
    out = np.empty((8, len(A)))
    binary(A, B, out)
    with np.errstate(all="ignore"):
        expected = [A + B, A - B, A * B, A / B, np.copysign(A, B), np.where(A <= B, A, B)]
        expected += [np.where(A < B, A, B), np.where(A > B, A, B)]
    for found, wanted in zip(out, expected, strict=True):
        assert (bits(found) == bits(wanted)).all()


def test_functions_of_lanes_have_the_bits_of_numpys():
    out = np.empty((6, len(SPECIAL)))
    unary(SPECIAL, out)
    for found, wanted in zip(out[:4], [-SPECIAL, abs(SPECIAL), np.sqrt(abs(SPECIAL)), np.rint(SPECIAL)], strict=True):
        assert (bits(found) == bits(wanted)).all()


def test_inverse_tangent_and_sine_have_the_bits_of_the_c_librarys():
    x = np.concatenate([np.linspace(-1.0, 1.0, 401), 10.0 ** -RNG.uniform(0, 300, 50)])
    out = np.empty((6, len(x)))
    unary(x, out)
    assert out[4].tolist() == [math.atan(value) for value in x]
    assert out[5].tolist() == [math.asin(value) for value in x]


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
def steps_down(x):
    """Not for Lanes: it branches."""
    while x > 1.0:
        x -= 1.0
    return x


down = each_lane(steps_down)


@kernel
def by_lanes(a, out, found):
    """out = steps_down(a) + 1 where a > 3; found: whether any is, the width, and that of a single number."""
    rows = rows_from(0, len(a))
    x = gathered(a, (rows,))
    y = down(x)
    for number in range(width(x)):
        if lane(x > 3.0, number):
            y = with_lane(y, number, lane(y, number) + 1.0)
    scatter(out, (rows,), y)
    found[0], found[1], found[2] = somewhere(x > 3.0), width(x), width(down(a[0]))


def test_lanes_can_go_alone():
    a, out, found = np.arange(LANES) + 0.5, np.empty(LANES), np.empty(3)
    by_lanes(a, out, found)
    assert (out == np.where(a > 3.0, 1.5, 0.5)).all()
    assert found.tolist() == [1.0, LANES, 1.0]
    by_lanes(a[:3], out[:3], found)
    assert found[0] == 0.0


@kernel
def written_to_one_place(out):
    rows = rows_from(0, LANES)
    scatter(out, (0.0 * rows,), rows)


def test_of_lanes_with_one_place_the_first_counts():
    """The last environment is repeated in lanes that nobody needs; what those hold must not replace its own."""
    out = np.full(1, np.nan)
    written_to_one_place(out)
    assert out[0] == 0.0
