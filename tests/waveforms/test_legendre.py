import numpy as np
import pytest
from scipy.special import spherical_jn

from wavegym.waveforms.legendre import NODES, legendre_moments, resolve


def test_moments_are_spherical_bessel_functions():
    z = np.concatenate([[0.0, 1e-12, -1e-3], np.linspace(-80, 80, 321), [1e3, -1e5]])[None]
    order = np.arange(NODES)[:, None]
    expected = 2 * (-1j) ** order * spherical_jn(order, z)
    np.testing.assert_allclose(legendre_moments(z)[0], expected, atol=5e-14)


def test_a_resolved_function_is_integrated_and_differentiated_to_rounding():
    def wave(t):
        return np.stack([np.sin(40 * t), np.exp(-t)])

    expansion = resolve(wave, np.array([0.0, 2.0]), np.array([1.0, 2.5]), np.ones(2), "wave")
    area = (expansion.values * expansion.weights).sum(axis=(1, 2, 3))
    sine = (1 - np.cos(40) + np.cos(80) - np.cos(100)) / 40
    decay = 1 - np.exp(-1) + np.exp(-2) - np.exp(-2.5)
    np.testing.assert_allclose(area, [sine, decay], atol=1e-14)
    slopes = [40 * np.cos(40 * expansion.times), -np.exp(-expansion.times)]
    np.testing.assert_allclose(expansion.derivative(), slopes, atol=1e-9)


@pytest.mark.parametrize("omega", [0.0, 3.0, -50.0, 4e4])
def test_fourier_integral(omega):
    expansion = resolve(lambda t: np.exp(-t)[None], np.array([-1.0, 1.0]), np.array([0.5, 2.0]), np.ones(1), "decay")
    exponent = -(1 + 1j * omega)
    exact = sum((np.exp(exponent * b) - np.exp(exponent * a)) / exponent for a, b in ((-1, 0.5), (1, 2)))
    assert expansion.fourier(np.array([omega]))[0, 0] == pytest.approx(exact, abs=2e-14)
