"""The beam of the multifunction radar, and its targets, against simulations in plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from wavegym.systems.multifunction_radar import beam_kernels as beams
from wavegym.systems.multifunction_radar import step_kernels as targets

WIDTH = np.radians(1.0)
BEAM = beams.Beam(WIDTH, 40e3, 10e-3, 90.0, WIDTH / 1.6, 150.0, 5e3, 40e3, 25.0)
FLIGHT = targets.Flight(0.05, (10.0, 2000.0), (0.05, 0.2), 5e3, 40e3, np.pi / 3)
T = -np.log(1e-4)
MANY = 40_000


def test_energy_at_the_reference_and_at_half_a_beam_width():
    """E/N0 = 1 at the reference range and dwell, and 6 dB less (3 dB each way) half a width off the axis."""
    assert beams.energy(40e3, 0.0, 10e-3, BEAM) == pytest.approx(1.0, rel=1e-12)
    assert beams.energy(20e3, 0.0, 20e-3, BEAM) == pytest.approx(32.0, rel=1e-12)
    assert beams.energy(40e3, 0.5 * WIDTH, 10e-3, BEAM) == pytest.approx(0.25, rel=1e-12)


@pytest.mark.parametrize(("r", "off"), [(15e3, 0.0), (20e3, 0.3), (25e3, 0.0)])
def test_detections_and_errors_are_those_of_echo_plus_noise(r, off):
    """Complex normal echoes and noise, drawn here: Pd, mean power beyond the threshold, and errors by power."""
    axis, dwell, rng = 0.4, 10e-3, np.random.default_rng(0)
    azimuth = axis + off * WIDTH
    x = np.tile([r * np.sin(azimuth), 0.0, r * np.cos(azimuth), 0.0], (MANY, 1))
    found = np.empty((MANY, 3))
    count = beams.echoes(np.uint64(7), x, np.ones(MANY, np.bool_), 0.0, axis, dwell, T, BEAM, found)
    found, S = found[:count], (40e3 / r) ** 4 * np.exp(-8 * np.log(2) * off**2)
    draws = rng.standard_normal((2, MANY, 2)) @ [1.0, 1j] * np.sqrt(0.5)
    z = np.abs(np.sqrt(S) * draws[0] + draws[1]) ** 2
    pd = (z > T).mean()
    assert abs(count / MANY - pd) < 5 * np.sqrt(2 * pd * (1 - pd) / MANY)
    seen = z[z > T]
    assert abs(found[:, 2].mean() - seen.mean()) < 5 * seen.std() * np.sqrt(2 / count)
    for column, true, error in ((0, r, 90.0), (1, azimuth, WIDTH / 1.6)):
        normalised = (found[:, column] - true) / (error * np.sqrt(0.5 / found[:, 2]))
        assert abs((normalised**2).mean() - 1.0) < 5 * np.sqrt(2 / count)
        assert abs(normalised.mean()) < 5 / np.sqrt(count)


def test_no_echo_from_beside_the_beam_or_of_an_absent_target():
    x = np.array([[8e3 * np.sin(a), 0.0, 8e3 * np.cos(a), 0.0] for a in (0.0, 1.6 * WIDTH)])
    found = np.empty((4, 4))
    assert beams.echoes(np.uint64(1), x, np.array([True, True]), 0.0, 0.0, 10e-3, T, BEAM, found) == 1
    assert beams.echoes(np.uint64(1), x, np.array([False, True]), 0.0, 0.0, 10e-3, T, BEAM, found) == 0


@pytest.mark.parametrize("share", [0.02, 0.1, 0.25, 0.4, 1.0, 3.0])
@pytest.mark.parametrize("off", [0.0, 0.4 * WIDTH])
def test_expected_detection_is_the_integral_over_the_pointing_error(share, off):
    """Both quadratures against an adaptive one, from narrow distributions to those of three beam widths."""
    sigma, r = share * WIDTH, 15e3

    def over(f):
        return quad(lambda u: norm.pdf(u) * f(u), -9.0, 9.0, epsabs=1e-12, limit=200, points=np.linspace(-8, 8, 17))[0]

    def chance(u):
        return float(beams.detection(beams.energy(r, off + u * sigma, 10e-3, BEAM), T))

    pd, ratio = beams.expected_detection(r, off, sigma**2, 10e-3, T, BEAM)
    assert pd == pytest.approx(over(chance), abs=0.02)
    assert ratio == pytest.approx(over(lambda u: u * u * (1 - chance(u))) / over(lambda u: 1 - chance(u)), rel=0.1)


@pytest.mark.parametrize("S", [0.5, 5.0, 50.0, 500.0])
def test_the_mean_inverse_power_is_that_of_detections(S):
    want = quad(lambda u: np.exp(-u) / (T + (1 + S) * u), 0.0, 60.0)[0]
    assert beams.mean_inverse_power(S, T) == pytest.approx(want, rel=0.05)


def test_coverage_is_the_integral_over_the_azimuth():
    def chance(u):
        return float(beams.detection(beams.energy(15e3, u * WIDTH, 10e-3, BEAM), T))

    assert beams.coverage(15e3, 10e-3, T, BEAM) == pytest.approx(quad(chance, -4.0, 4.0)[0], rel=0.01)
    nothing = 2 * beams.REACH * np.exp(-T)  # false alarms
    assert beams.coverage(1e7, 10e-3, T, BEAM) == pytest.approx(nothing * 13 / 12, rel=1e-6)


def test_false_alarms_are_as_many_as_cells_pass_the_threshold():
    found, counts, places = np.empty((32, 4)), [], []
    for i in range(4000):
        count = beams.false_alarms(np.uint64(i), 0.3, 5e3, 40e3, T, BEAM, found, 0)
        counts.append(count)
        places.append(found[:count].copy())
    expected = 1e-4 * 35e3 / 150.0
    assert abs(np.mean(counts) - expected) < 5 * np.sqrt(expected / 4000)
    r, azimuth, z, origin = np.concatenate(places).T
    assert ((r >= 5e3) & (r <= 40e3) & (np.abs(azimuth - 0.3) <= 0.5 * WIDTH) & (z > T) & (origin == -1)).all()
    assert beams.false_density(T, BEAM) * 35e3 * WIDTH == pytest.approx(expected, rel=1e-12)


def test_targets_fly_with_the_density_of_their_mode():
    """Without changes of mode: mean and covariance after 2 s against the exact discretisation."""
    flight = FLIGHT._replace(leave=(0.0, 0.0))
    for mode, q in enumerate(flight.density):
        x = np.tile([0.0, 100.0, 20e3, -50.0], (4000, 1))
        arrival = np.full(4000, -1.0)
        here = np.ones(4000, np.bool_)
        targets.fly(np.uint64(3), arrival, 0, 40, x, np.full(4000, mode), here, flight)
        assert here.all()
        h = 2.0
        Q = q * np.kron(np.eye(2), [[h**3 / 3, h**2 / 2], [h**2 / 2, h]])
        off = x - [200.0, 100.0, 19.9e3, -50.0]
        assert (np.abs(off.mean(axis=0)) < 5 * np.sqrt(np.diag(Q) / 4000)).all()
        scale = np.sqrt(np.outer(np.diag(Q), np.diag(Q)))
        assert (np.abs(off.T @ off / 4000 - Q) < 5 * scale * np.sqrt(2 / 4000)).all()


def test_modes_settle_at_their_shares():
    mode, x = np.zeros(4000, np.int64), np.tile([0.0, 0.0, 20e3, 0.0], (4000, 1))
    targets.fly(np.uint64(5), np.full(4000, -1.0), 0, 800, x, mode, np.ones(4000, np.bool_), FLIGHT)
    assert abs(mode.mean() - 0.2) < 5 * np.sqrt(0.16 / 4000)


def test_targets_come_when_they_arrive_and_leave_at_the_edge():
    x = np.array([[0.0, 0.0, 39.9e3, 400.0], [0.0, 0.0, 20e3, 0.0], [0.0, 0.0, 20e3, 0.0]])
    here, flight = np.array([True, False, False]), FLIGHT._replace(density=(0.0, 0.0))
    targets.fly(np.uint64(1), np.array([-1.0, 0.31, 2.0]), 0, 20, x, np.zeros(3, np.int64), here, flight)
    np.testing.assert_array_equal(here, [False, True, False])
    assert x[0, 2] == pytest.approx(39.9e3 + 400.0 * 0.3, abs=1e-6)  # it stops in the cell in which it leaves
