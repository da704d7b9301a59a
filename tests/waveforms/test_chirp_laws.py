"""Frequency laws, their moments with a trapezoid envelope, and their names."""

import re
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from waveform_cases import FREQUENCY_LAWS as OTHER_LAWS

from wavegym.core.errors import InputError
from wavegym.waveforms import chirp_law, parse_law
from wavegym.waveforms.chirp_laws import FREQUENCY_LAWS

CASES = [("lfm", None), ("pfm", 2.0), ("pfm", 2.5), ("pfm", 3.0), ("pfm", 64.0)]
CASES += [(kind, g) for kind in ("hfm", "efm") for g in (0.01, 0.3, 0.5, 5.0, 100.0)]


@pytest.mark.parametrize(("kind", "shape"), CASES)
def test_the_frequency_rises_from_0_to_1_and_the_phase_is_its_integral(kind, shape):
    law = FREQUENCY_LAWS[kind]
    u = np.linspace(0, 1, 1001)
    f = law.frequency(u, shape)
    assert f[0] == 0
    assert f[-1] == pytest.approx(1, abs=1e-15)
    assert (np.diff(f) >= 0).all()
    for low, high in pairwise([0.0, 0.02, 0.1, 0.4, 1.0]):
        area = quad(lambda x: law.frequency(x, shape), low, high, epsabs=1e-14, epsrel=1e-13)[0]
        assert law.phase(high, shape) - law.phase(low, shape) == pytest.approx(area, abs=1e-13)


@pytest.mark.parametrize(("kind", "shape"), CASES)
def test_a_law_is_the_published_one_up_to_a_constant(kind, shape):
    u = np.linspace(0, 1, 101)
    difference = FREQUENCY_LAWS[kind].frequency(u, shape) - OTHER_LAWS[kind](u, shape)[0]
    assert np.ptp(difference) < 1e-12


def exact_moments(kappa, rise):
    """Spread, slope, residual and bandwidth of a power law in rational numbers; kappa whole."""
    e, square = rise, 1 / (1 - 4 * rise / 3)

    def power(low, high, n):
        return (high ** (n + 1) - low ** (n + 1)) / (n + 1)

    def mean(n):  # of u^n over a^2: (u/e)^2, 1, ((1 - u)/e)^2
        rising = power(0, e, n + 2) / e**2
        falling = (power(1 - e, 1, n) - 2 * power(1 - e, 1, n + 1) + power(1 - e, 1, n + 2)) / e**2
        return square * (rising + power(e, 1 - e, n) + falling)

    p = kappa - 1
    assert mean(0) == 1
    spread = mean(2) - mean(1) ** 2
    shared = mean(p + 1) - mean(1) * mean(p)
    return spread, shared / spread, mean(2 * p) - mean(p) ** 2 - shared**2 / spread, 2 * square / e


@pytest.mark.parametrize("rise", [Fraction(1, 1000), Fraction(1, 20), Fraction(3, 10), Fraction(1, 2)])
@pytest.mark.parametrize("kappa", [2, 3, 4, 9, 40])
def test_moments_of_power_laws_are_rational_numbers(kappa, rise):
    exact = [float(value) for value in exact_moments(kappa, rise)]
    np.testing.assert_allclose(chirp_law("pfm", kappa, float(rise)).moments, exact, rtol=1e-12, atol=1e-30)


curved = st.tuples(st.sampled_from(["hfm", "efm"]), st.floats(-1.5, 1).map(lambda e: 10.0**e))
powers = st.tuples(st.just("pfm"), st.floats(2.01, 20))


@settings(max_examples=25)
@given(st.one_of(curved, powers), st.floats(0.01, 0.499))
@example(("pfm", 2.03125), 0.499)  # the bend of this law has no second derivative where the pulse begins
def test_moments_by_an_adaptive_quadrature(law, rise):
    kind, g = law

    def envelope_squared(u):
        return min(u / rise, (1 - u) / rise, 1) ** 2 / (1 - 4 * rise / 3)

    def mean(function):
        ends = (0, rise, 1 - rise, 1)
        parts = [
            quad(lambda u: envelope_squared(u) * function(u), *p, epsabs=1e-15, epsrel=1e-10)[0] for p in pairwise(ends)
        ]
        return sum(parts)

    offset = OTHER_LAWS[kind](0.0, g)[0]

    def f(u):
        return OTHER_LAWS[kind](u, g)[0] - offset

    mean_f = mean(f)
    spread = mean(lambda u: (u - 0.5) ** 2)
    slope = mean(lambda u: (u - 0.5) * f(u)) / spread
    residual = mean(lambda u: (f(u) - mean_f - slope * (u - 0.5)) ** 2)
    np.testing.assert_allclose(chirp_law(kind, g, rise).moments[:3], [spread, slope, residual], rtol=1e-9)


def test_a_linear_law_leaves_nothing_to_the_regression():
    for rise in (1e-6, 0.05, 0.2, 0.5):
        law = chirp_law("lfm", rise_fraction=rise)
        assert law.slope == 1.0
        assert law.residual == 0.0


def test_each_law_is_computed_once():
    assert chirp_law("hfm") is chirp_law("hfm", 0.5, 0.05)
    assert chirp_law("hfm") is not chirp_law("hfm", 0.4)


@pytest.mark.parametrize(
    ("text", "law", "name"),
    [
        ("lfm", ("lfm", None), "LFM"),
        ("pfm", ("pfm", None), "PFM3"),
        ("pfm:2.5", ("pfm", 2.5), "PFM2.5"),
        ("hfm", ("hfm", None), "HFM"),
        ("hfm:0.5", ("hfm", 0.5), "HFM"),
        (" efm:0.3", ("efm", 0.3), "EFM0.3"),
    ],
)
def test_laws_are_written_as_kind_and_shape(text, law, name):
    assert parse_law(text) == law
    assert chirp_law(*law).name == name


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: parse_law("hfn"),
            "law is 'hfn', expected one of 'lfm', 'pfm', 'hfm', 'efm'; did you mean 'hfm'?",
        ),
        (lambda: parse_law(3), "law is 3, expected a string such as 'hfm' or 'pfm:2.5'"),
        (lambda: parse_law("pfm:x"), "shape in 'pfm:x' is 'x', expected a number, as in 'pfm:3'"),
        (lambda: parse_law("lfm:"), "shape in 'lfm:' is '', expected a number, as in 'lfm'"),
        (lambda: parse_law("lfm:2"), "shape is 2.0, expected None for 'lfm'"),
        (lambda: parse_law("pfm:1"), "shape kappa of 'pfm' is 1.0, expected a number in [2, 64] (nearest: 2): below 2"),
        (lambda: chirp_law("pfm", 1.5), "the chirp rate is infinite where the pulse begins"),
        (lambda: chirp_law("pfm", 65), "shape kappa of 'pfm' is 65, expected a number in [2, 64] (nearest: 64)"),
        (lambda: chirp_law("hfm", 0), "shape g of 'hfm' is 0, expected a number in [0.01, 100] (nearest: 0.01)"),
        (lambda: chirp_law("efm", -0.5), "shape g of 'efm' is -0.5, expected a number in [0.01, 100] (nearest: 0.01)"),
        (lambda: chirp_law("efm", float("nan")), "shape g of 'efm' is nan, expected a number in [0.01, 100]:"),
        (
            lambda: chirp_law("lfm", rise_fraction=0.6),
            "rise_fraction is 0.6, expected a fraction of the pulse in (0, 0.5]",
        ),
        (lambda: chirp_law("lfm", rise_fraction=0), "(0, 0.5] (nearest: 0.05)"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(InputError, match=re.escape(message)) as error:
        make()
    assert "\n" not in str(error.value)
