"""The beam of the multifunction radar against simulations in plain NumPy, and its laws against integrals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import gamma, kstest, norm

from wavegym.sensors.trains import acceleration_loss
from wavegym.systems.multifunction_radar import beam_kernels as beams
from wavegym.systems.multifunction_radar import flight_kernels as targets

WIDTH = np.sin(np.radians(1.5))
WAVE, INTERVAL = 0.05, 300e-6
KEPT = acceleration_loss(1.0, 1.0, beams.FINEST * np.arange(400))
BEAM = beams.Beam(WIDTH, 60e3, 94.0, WAVE / (2 * INTERVAL), KEPT, np.array([0.1, 1.0]), 5e3, 40e3, 25.0)
MANY = 40_000


def look_at(pulses=64, bursts=1, expected=0.05, elevations=1, gain=1.0):
    """A look as the system makes it, in its own arithmetic."""
    cells, burst = pulses * elevations / 150.0, pulses * INTERVAL
    threshold = gamma.isf(expected / (cells * 35e3), bursts)
    error = WAVE * np.sqrt(3) / (2 * np.pi * burst)
    return beams.Look(bursts, gain, threshold, cells, error, burst**2 / WAVE, np.ones(2))


def targets_at(r, sine, velocity=(0.0, 0.0), acceleration=(0.0, 0.0), count=MANY):
    state = [r * sine, velocity[0], r * np.sqrt(1 - sine**2), velocity[1]]
    return targets.Flying(
        np.tile(state, (count, 1)), np.tile(acceleration, (count, 1)), np.zeros(count, np.int64), np.ones(count, bool)
    )


def drawn(flying, axis, look, key=7, section=1):
    """Findings of independent targets, one look each."""
    count = len(flying.here)
    found, looks = np.empty((count, 5)), np.zeros(count, np.int64)
    scene = BEAM, flying, np.full(count, section)
    number = beams.echoes(np.uint64(key), looks, scene, 0.0, axis, look, found)
    assert (looks == 1).all()
    return found[:number]


def simulated(S, off, bursts, rng):
    """Sum and difference channels of bursts of one target: echo and noise complex normal; z and the measured offset."""

    def normals():
        return rng.standard_normal((2, MANY, bursts)).T @ np.array([1.0, 1j]) * np.sqrt(0.5)

    echo = np.sqrt(S) * normals()
    total, difference = echo + normals(), 1.6 * off * echo + normals()
    z = (np.abs(total) ** 2).sum(axis=0)
    return z, (difference * total.conj()).real.sum(axis=0) / z / 1.6


def two_samples(one, other):
    """Five standard errors between the means of two samples."""
    return 5 * np.sqrt(one.var() / len(one) + other.var() / len(other))


@pytest.mark.parametrize(
    ("r", "off", "sine", "bursts"),
    [
        (12e3, 0.0, 0.0, 1), (20e3, 0.3, 0.0, 1), (25e3, 0.0, 0.5, 1), (15e3, 0.6, -0.7, 1), (30e3, 0.5, 0.2, 1),
        (22e3, 0.0, 0.0, 4), (25e3, 0.3, 0.8, 4), (18e3, 0.7, 0.0, 4), (35e3, -0.2, 0.3, 8), (12e3, -0.9, 0.0, 2)
    ],
)  # fmt: skip
def test_detections_power_and_angles_are_those_of_sum_and_difference_channels(r, off, sine, bursts):
    """At ten settings: Pd, power, and the mean and variance of the measured offset, on and off the axis."""
    look, axis = look_at(bursts=bursts), sine - off * WIDTH
    found = drawn(targets_at(r, sine), axis, look)
    S = (60e3 / r) ** 4 * (1 - axis**2) ** 1.5 * np.exp(-8 * np.log(2) * off**2)
    z, offset = simulated(S, off, bursts, np.random.default_rng(0))
    is_seen = z > look.threshold
    pd = is_seen.mean()
    assert pd > 0.02
    assert abs(len(found) / MANY - pd) < 5 * np.sqrt(2 * pd * (1 - pd) / MANY) + 1e-9
    z, offset = z[is_seen], offset[is_seen]
    got = (found[:, 1] - axis) / WIDTH
    for ours, theirs in ((found[:, 3], z), (got, offset), ((got - got.mean()) ** 2, (offset - offset.mean()) ** 2)):
        assert abs(ours.mean() - theirs.mean()) < two_samples(ours, theirs)


def test_range_and_range_rate_have_the_errors_of_a_matched_filter_modulo_the_fold():
    look, velocity = look_at(), (-250.0, 60.0)
    found = drawn(targets_at(20e3, 0.6, velocity), 0.6, look)
    rate = 0.6 * velocity[0] + 0.8 * velocity[1]
    fold = WAVE / (2 * INTERVAL)
    assert (np.abs(found[:, 2]) <= 0.5 * fold + 1e-9).all()
    difference = found[:, 2] - rate
    for error, scale in ((found[:, 0] - 20e3, 94.0), (difference - fold * np.rint(difference / fold), look.rate_error)):
        assert kstest(error / (scale * np.sqrt(0.5 / found[:, 3])), norm.cdf).pvalue > 1e-4


def test_the_energy_falls_with_range_scan_angle_and_offset():
    """E/N0 = 1 at the reference; 9 dB less at 60 degrees (cos^3), and 6 dB half a width off the axis."""
    look = look_at()
    assert beams.on_axis(60e3, 0.0, look, BEAM) == pytest.approx(1.0, rel=1e-12)
    assert beams.on_axis(30e3, 0.0, look, BEAM) == pytest.approx(16.0, rel=1e-12)
    assert beams.on_axis(60e3, np.sin(np.radians(60.0)), look, BEAM) == pytest.approx(0.125, rel=1e-12)
    assert beams.loss(0.5) == pytest.approx(0.25, rel=1e-12)
    rng = np.random.default_rng(0)
    offs = 0.3 + 0.5 * rng.standard_normal(400_000)
    assert beams.mean_loss(0.3, 0.25) == pytest.approx(np.exp(-8 * np.log(2) * offs**2).mean(), rel=0.01)


@pytest.mark.parametrize("beta", [0.0, 0.3, 1.0, 3.0, 10.0])
def test_a_burst_loses_the_energy_that_its_best_doppler_filter_does_not_take(beta):
    """A chirp of 4096 samples through a finely spaced bank of Doppler filters."""
    t = (np.arange(4096) + 0.5) / 4096 - 0.5
    spectrum = np.fft.fft(np.exp(2j * np.pi * beta * t * t), 16 * 4096) / 4096
    want = (np.abs(spectrum) ** 2).max()
    assert float(acceleration_loss(1.0, 1.0, beta)) == pytest.approx(want, rel=2e-3)
    look = look_at()
    assert beams.share_kept(-beta / look.stretch, look, BEAM) == pytest.approx(want, rel=3e-3)


def test_an_accelerating_target_is_seen_less():
    look = look_at(pulses=128, gain=0.2)
    still, turning = (drawn(targets_at(20e3, 0.0, acceleration=(0.0, a)), 0.0, look) for a in (0.0, 40.0))
    share = float(acceleration_loss(1.0, 1.0, 40.0 * look.stretch))
    assert share < 0.8
    for found, kept in ((still, 1.0), (turning, share)):
        pd = np.exp(-look.threshold / (1 + 0.2 * 81 * kept))
        assert abs(len(found) / MANY - pd) < 5 * np.sqrt(pd * (1 - pd) / MANY)


def test_no_echo_from_beside_the_beam_or_of_an_absent_target():
    look, found, looks = look_at(), np.empty((4, 5)), np.zeros(2, np.int64)
    at = targets_at(8e3, 0.0, count=2)
    at.x[1, 0], at.x[1, 2] = 8e3 * 1.1 * WIDTH, 8e3 * np.sqrt(1 - (1.1 * WIDTH) ** 2)
    for here, want in (([True, True], 1), ([False, True], 0)):
        at.here[:] = here
        assert beams.echoes(np.uint64(1), looks, (BEAM, at, np.ones(2, int)), 0.0, 0.0, look, found) == want
    np.testing.assert_array_equal(looks, [1, 0])


def test_the_nth_echo_of_a_target_is_the_same_whatever_the_radar_did_before():
    """The tape of a target: an axis elsewhere, another target and other dwells do not move its draws."""
    look, key = look_at(gain=10.0), np.uint64(5)
    one, two = targets_at(20e3, 0.0, count=1), targets_at(20e3, 0.0, count=2)
    two.x[1, 0] = 100.0
    alone, together = np.empty((4, 5)), np.empty((4, 5))
    looks = np.zeros(1, np.int64)
    beams.echoes(key, looks, (BEAM, one, np.ones(1, int)), 0.0, 0.5, look, alone)  # elsewhere
    beams.echoes(key, looks, (BEAM, one, np.ones(1, int)), 0.0, 0.0, look, alone)
    beams.echoes(key, np.zeros(2, np.int64), (BEAM, two, np.ones(2, int)), 0.0, 0.0, look, together)
    np.testing.assert_array_equal(alone[0], together[0])
    before = alone[0].copy()
    beams.echoes(key, looks, (BEAM, one, np.ones(1, int)), 0.0, 0.0, look, alone)
    assert (alone[0, :4] != before[:4]).all()


@pytest.mark.parametrize("bursts", [1, 4])
@pytest.mark.parametrize("share", [0.02, 0.1, 0.2, 0.4, 1.0, 3.0])
@pytest.mark.parametrize("off", [0.0, 0.4])
def test_expected_detection_is_the_integral_over_the_pointing_error(share, off, bursts):
    """Both quadratures against an adaptive one, from narrow distributions to those of three beam widths."""
    look, S = look_at(bursts=bursts), 200.0

    def over(f):
        return quad(lambda u: norm.pdf(u) * f(u), -9.0, 9.0, epsabs=1e-12, limit=200, points=np.linspace(-8, 8, 17))[0]

    def chance(u):
        return gamma.sf(look.threshold / (1 + S * np.exp(-8 * np.log(2) * (off + u * share) ** 2)), bursts)

    pd, square = beams.expected_detection(S, off, share**2, look)
    assert pd == pytest.approx(over(chance), abs=0.02)
    ratio = over(lambda u: u * u * (1 - chance(u))) / over(lambda u: 1 - chance(u))
    if pd < 0.95:
        assert (1 - square) / (1 - pd) == pytest.approx(ratio, rel=0.1)


@pytest.mark.parametrize("bursts", [1, 2, 4])
@pytest.mark.parametrize("S", [0.5, 5.0, 50.0, 500.0])
def test_powers_of_detections_follow_their_law(S, bursts):
    """Pd, the quantiles that predictions draw, and the ratio of densities."""
    look = look_at(bursts=bursts)
    law = gamma(bursts, scale=1 + S)
    pd = law.sf(look.threshold)
    assert beams.detection(S, look) == pytest.approx(pd, rel=1e-9)
    for share in (1.0, 0.7, 0.1, 1e-3):
        assert beams.power_beyond(share, S, look) == pytest.approx(law.isf(share * pd), rel=1e-6)
    z = 1.7 * look.threshold
    assert beams.log_ratio(z, S, look) == pytest.approx(law.logpdf(z) - gamma(bursts).logpdf(z), rel=1e-9)


@pytest.mark.parametrize(("low", "high"), [(-0.5, 0.5), (0.5, 1.4)])
def test_the_mean_detection_is_that_over_the_offsets(low, high):
    look = look_at()

    def chance(u):
        return np.exp(-look.threshold / (1 + 300.0 * np.exp(-8 * np.log(2) * u * u)))

    want = quad(chance, low, min(high, beams.REACH))[0] / (high - low)
    assert beams.mean_detection(300.0, low, high, look) == pytest.approx(want, rel=0.05)


@pytest.mark.parametrize(("pulses", "bursts", "elevations"), [(16, 1, 1), (64, 1, 8), (32, 4, 1), (200, 1, 1)])
def test_false_alarms_are_those_of_noise_in_every_cell(pulses, bursts, elevations):
    """Their number is as designed, whatever the number of filters; power and angle have the law of noise."""
    look = look_at(pulses, bursts, 0.5, elevations)
    found, counts, places = np.empty((32, 5)), [], []
    for i in range(6000):
        count = beams.false_alarms(np.uint64(i), 0.3, look, BEAM, found, 0)
        counts.append(count)
        places.append(found[:count].copy())
    assert abs(np.mean(counts) - 0.5) < 5 * np.sqrt(0.5 / 6000)
    r, sine, rate, z, origin = np.concatenate(places).T
    assert (origin == -1).all()
    tail = gamma.sf(look.threshold, bursts)
    ratio = (sine - 0.3) / WIDTH * 1.6 * np.sqrt(2 * z)
    fold = WAVE / (2 * INTERVAL)
    for uniform in ((r - 5e3) / 35e3, rate / fold + 0.5, gamma.sf(z, bursts) / tail, norm.cdf(ratio)):
        assert kstest(uniform, "uniform").pvalue > 1e-4
    offs = np.linspace(-0.5, 0.5, 5)
    want = norm.pdf(offs, scale=1 / (1.6 * np.sqrt(2 * 14.0)))
    np.testing.assert_allclose([beams.false_offset_density(off, 14.0) for off in offs], want, rtol=1e-9)


FLIGHT = targets.Flight(0.2, (8.0, 60.0), (0.05, 0.2), 100.0, 300.0, 5e3, 40e3, np.pi / 3)


def flown(flying, cells, flight, key=3, arrival=None):
    arrival = np.full(len(flying.here), -1.0) if arrival is None else arrival
    keys, of_all = np.array([key], np.uint64), targets.Flying(*(leaf[None] for leaf in flying))
    targets.begin_all(keys, np.zeros(1, np.int64), of_all, flight)
    targets.fly(np.uint64(key), arrival, 0, cells, flying, flight)
    return flying


def test_targets_fly_with_accelerations_uniform_in_a_disc():
    """Without changes of mode: mean and covariance after 2 s against sums over cells of the disc's variance."""
    flight = FLIGHT._replace(leave=(0.0, 0.0), slowest=0.0, fastest=1e4)
    steps = np.arange(10)[::-1] * 0.2 + 0.1  # from the middle of each cell to the end
    effect = np.stack([0.2 * steps, np.full(10, 0.2)])
    for mode, limit in enumerate(flight.acceleration):
        at = targets_at(20e3, 0.0, (200.0, -50.0), count=4000)
        at.mode[:] = mode
        flown(at, 10, flight)
        assert at.here.all()
        Q = 0.25 * limit**2 * np.kron(np.eye(2), effect @ effect.T)
        off = at.x - [400.0, 200.0, 19.9e3, -50.0]
        assert (np.abs(off.mean(axis=0)) < 5 * np.sqrt(np.diag(Q) / 4000)).all()
        scale = np.sqrt(np.outer(np.diag(Q), np.diag(Q)))
        assert (np.abs(off.T @ off / 4000 - Q) < 5 * scale * np.sqrt(2 / 4000)).all()
        assert (np.hypot(*at.acceleration.T) <= limit).all()
        assert np.hypot(*at.acceleration.T).max() > 0.95 * limit


def test_speeds_stay_in_their_limits_and_velocities_uniform_between_them():
    rng, count = np.random.default_rng(0), 4000
    speed, heading = np.sqrt(100.0**2 + rng.random(count) * (300.0**2 - 100.0**2)), 2 * np.pi * rng.random(count)
    at = targets_at(20e3, 0.0, count=count)
    at.x[:, 1], at.x[:, 3] = speed * np.sin(heading), speed * np.cos(heading)
    flown(at, 100, FLIGHT._replace(farthest=1e9, nearest=0.0, half_sector=np.pi))
    speed = np.hypot(at.x[:, 1], at.x[:, 3])
    assert ((speed >= 100.0) & (speed <= 300.0)).all()
    assert kstest((speed**2 - 100.0**2) / (300.0**2 - 100.0**2), "uniform").pvalue > 1e-4


def test_modes_settle_at_their_shares():
    at = targets_at(20e3, 0.0, count=4000)
    flown(at, 200, FLIGHT._replace(acceleration=(0.0, 0.0), slowest=0.0), key=5)
    assert abs(at.mode.mean() - 0.2) < 5 * np.sqrt(0.16 / 4000)


def test_targets_come_when_they_arrive_and_leave_at_the_edge():
    at = targets_at(20e3, 0.0, count=3)
    at.x[0, 2:], at.here[:] = (39.9e3, 400.0), [True, False, False]
    flown(at, 5, FLIGHT._replace(acceleration=(0.0, 0.0), slowest=0.0), 1, np.array([-1.0, 0.31, 2.0]))
    np.testing.assert_array_equal(at.here, [False, True, False])
    assert at.x[0, 2] == pytest.approx(39.9e3 + 400.0 * 0.4, abs=1e-6)  # it stops in the cell in which it leaves
