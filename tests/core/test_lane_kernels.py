"""Lanes against NumPy, lane by lane and bit for bit."""

from __future__ import annotations

import math

import numpy as np

from wavegym.core.kernels import kernel
from wavegym.core.lane_array_kernels import gathered, scatter
from wavegym.core.lane_kernels import LANES, each_lane, lane, rows_from, somewhere, where, width, with_lane

RNG = np.random.default_rng(0)
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
