"""Validation gates against solved quadratic forms, areas by Monte Carlo and SciPy's chi-square distribution."""

from __future__ import annotations

import numpy as np
import oracles
import pytest
from scipy import stats

from wavegym.core.errors import InputError
from wavegym.sensors import gate_probability, gate_volume, inside_gate


def quadratic_form(v, S):
    return v @ np.linalg.solve(S, v)


@pytest.mark.parametrize("gate", [0.5, 2.0, 4.0])
def test_probability_is_chi_squares(gate):
    assert gate_probability(gate) == pytest.approx(stats.chi2.cdf(gate**2, df=2), rel=1e-13)
    S, rng = oracles.random_covariance(np.random.default_rng(1), 2), np.random.default_rng(0)
    inside = inside_gate(rng.multivariate_normal([0, 0], S, 100_000), S, gate).mean()
    pg = gate_probability(gate)
    assert inside == pytest.approx(pg, abs=5 * np.sqrt(pg * (1 - pg) / 100_000))


def test_volume_of_an_upright_ellipse():
    assert gate_volume(np.diag([9.0, 25.0]), 2.0) == pytest.approx(np.pi * 6 * 10, rel=1e-14)


def test_volume_by_counting_points():
    rng, count = np.random.default_rng(2), 200_000
    for S in oracles.random_covariance(rng, 2, (5,)):
        box = 3.0 * np.sqrt(np.diag(S))  # the gate's bounding box has these half widths
        share = inside_gate(rng.uniform(-box, box, (count, 2)), S, 3.0).mean()
        area = share * 4 * box.prod()
        spread = np.sqrt(share * (1 - share) / count) * 4 * box.prod()
        assert gate_volume(S, 3.0) == pytest.approx(area, abs=5 * spread)


def test_volume_of_a_nearly_singular_covariance():
    """1 - rho^2 = 7e-6, as of a long LFM pulse."""
    sigma, rho = np.array([2289.7, 33024.7]), np.sqrt(1 - 7e-6)
    S = np.array([[1, rho], [rho, 1]]) * np.outer(sigma, sigma)
    assert gate_volume(S, 4.0) == pytest.approx(np.pi * 16 * sigma.prod() * np.sqrt(7e-6), rel=1e-9)


def test_inside_means_a_small_quadratic_form():
    rng = np.random.default_rng(3)
    S = oracles.random_covariance(rng, 2, (200,))
    v = rng.standard_normal((200, 2)) * 3 * np.sqrt(np.diagonal(S, axis1=1, axis2=2))
    inside = inside_gate(v, S, 2.5)
    assert list(inside) == [bool(quadratic_form(*pair) <= 2.5**2) for pair in zip(v, S, strict=True)]
    assert 20 < inside.sum() < 180


def test_batches_broadcast_and_equal_their_elements_bit_for_bit():
    rng = np.random.default_rng(4)
    S, v = oracles.random_covariance(rng, 2, (6, 1)), 5 * rng.standard_normal((3, 2))
    gates = np.array([1.0, 2.0, 4.0])
    volume, inside = gate_volume(S, gates), inside_gate(v, S, gates)
    assert volume.shape == inside.shape == (6, 3)
    for i, j in np.ndindex(6, 3):
        assert gate_volume(S[i, 0], gates[j]) == volume[i, j]
        assert inside_gate(v[j], S[i, 0], gates[j]) == inside[i, j]


@pytest.mark.parametrize("gate", [0.0, -1.0, np.inf, np.nan])
def test_gate_outside_its_range(gate):
    for call in (lambda: gate_probability(gate), lambda: gate_volume(np.eye(2), gate)):
        with pytest.raises(InputError, match=r"gate is .*, expected a finite number > 0"):
            call()


@pytest.mark.parametrize(
    "S", [[[1, 2], [2, 1]], [[0, 0], [0, 1]], [[1, 0.5], [0, 1]], [[1, np.nan], [np.nan, 1]], [[np.inf, 0], [0, 1]]]
)
def test_no_covariance(S):
    """The error is one line and names the wrong matrix of a batch."""
    batch = np.stack([np.eye(2), S])
    for call in (lambda: gate_volume(batch, 4.0), lambda: inside_gate(np.zeros(2), batch, 4.0)):
        with pytest.raises(InputError, match=r"^S\[1(, 0, 1|, 0, 0)?\] (has|is) .* expected (a|finite)") as error:
            call()
        assert "\n" not in str(error.value)


def test_shapes_that_do_not_fit():
    with pytest.raises(InputError, match=r"S has shape \(3, 3\), expected \(\.\.\., 2, 2\)"):
        gate_volume(np.eye(3), 4.0)
    with pytest.raises(InputError, match=r"innovation has shape \(3,\), expected \(\.\.\., 2\)"):
        inside_gate(np.zeros(3), np.eye(2), 4.0)
    with pytest.raises(InputError, match="leading axes that broadcast"):
        inside_gate(np.zeros((3, 2)), np.stack([np.eye(2)] * 2), 4.0)
