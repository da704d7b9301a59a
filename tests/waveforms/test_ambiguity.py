from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from matplotlib.figure import Figure
from waveform_cases import FREQUENCY_LAWS, KinkedChirp, chirps, trains

from wavegym.core.errors import InputError
from wavegym.waveforms import GaussianChirp, PulseTrain, ambiguity, plot_ambiguity, zero_delay_cut, zero_doppler_cut
from wavegym.waveforms.numeric import correlate

UP = GaussianChirp(duration=100e-6, chirp_rate=1e9)
DOWN = GaussianChirp(duration=100e-6, chirp_rate=1e9, direction="down")


def gaussian_ambiguity(chirp, delays, dopplers):
    """Closed form. With z = 1/(2 k^2) - j d g the exponent of s(t) s*(t - tau) exp(-j w t), w = 2 pi nu, is

      -z t^2 - z* (t - tau)^2 - j w t = -t^2/k^2 + (2 z* tau - j w) t - z* tau^2,

    since z + z* = 1/k^2. The integral of exp(-t^2/k^2 + b t) is sqrt(pi) k exp(k^2 b^2/4), and |s(0)|^2 is
    1/(sqrt(pi) k).
    """
    k = chirp.duration
    z_conj = 1 / (2 * k * k) + 1j * chirp.signed_chirp_rate
    tau, w = np.asarray(delays)[:, None], 2 * np.pi * np.asarray(dopplers)
    return np.exp(k * k * (2 * z_conj * tau - 1j * w) ** 2 / 4 - z_conj * tau**2)


def grid(chirp, points=23):
    """Delays and Dopplers beyond the pulse and its bandwidth, on and off the ridge."""
    delays = chirp.duration * np.linspace(-9, 9, points)
    widest = 3 * np.sqrt(chirp.fisher_information()[0, 0]) / (2 * np.pi)
    near = np.linspace(-2, 2, points) / chirp.duration
    return delays, np.concatenate([near, widest * np.linspace(-3, 3, points)])


@given(chirps(largest_product=1e3))
def test_equals_the_gaussian_closed_form(chirp):
    delays, dopplers = grid(chirp)
    exact = gaussian_ambiguity(chirp, delays, dopplers)
    assert np.abs(ambiguity(chirp, delays, dopplers) - exact).max() <= 1e-12


@given(chirps())
def test_magnitude_equals_the_gaussian_closed_form_at_any_time_bandwidth_product(chirp):
    """|chi| = exp(-tau^2/(4 k^2) - k^2 (2 g tau - w)^2/4): the ridge w = 2 g tau rises for an up-chirp."""
    k = chirp.duration
    delays = k * np.linspace(-2, 2, 9)
    ridge = chirp.signed_chirp_rate * delays / np.pi
    for tau, nu in zip(delays, ridge, strict=True):
        off = np.linspace(-1, 1, 9) / k
        exact = np.exp(-((tau / k) ** 2) / 4 - (np.pi * k * off) ** 2)
        # nu = ridge + off is rounded, worth eps * nu * k in the exponent
        assert np.abs(np.abs(ambiguity(chirp, tau, nu + off)[0]) - exact).max() <= 1e-11


@settings(max_examples=30)
@given(trains(largest_product=30))
def test_laws_of_every_ambiguity_function(train):
    J = train.fisher_information()
    delays = np.linspace(-6, 6, 13) / np.sqrt(J[0, 0])
    dopplers = np.linspace(-6, 6, 11) / np.sqrt(J[1, 1])
    chi = ambiguity(train, delays, dopplers)
    # Gaussian pulses T1 apart overlap by exp(-T1^2/(4 k^2)), and each has two neighbours.
    overlap = 2 * np.exp(-((train.interval / train.pulse.duration) ** 2) / 4) + 1e-12
    assert chi[6, 5] == pytest.approx(1, abs=overlap)
    assert np.abs(chi).max() <= 1 + overlap
    turned = np.exp(-2j * np.pi * delays[:, None] * dopplers) * chi.conj()
    np.testing.assert_allclose(chi[::-1, ::-1], turned, atol=1e-11)


@pytest.mark.parametrize("law", FREQUENCY_LAWS)
def test_a_pulse_with_kinks_equals_brute_force(law):
    chirp = KinkedChirp(law, 10e-6, 2e6, shape=3 if law == "pfm" else 0.5)
    # Midpoint rule on cells that end at every kink of either copy (delays are multiples of lam/40): error h^2.
    cells = 400_000
    step = 2 * chirp.duration / cells
    t = -chirp.duration + step * (np.arange(cells) + 0.5)
    inside = lambda x: (np.abs(x) < chirp.duration / 2) * chirp.signal(np.clip(x, *chirp.support))  # noqa: E731
    delays, dopplers = chirp.duration * np.array([0, 0.025, -0.3, 0.95, 1.5]), np.array([0, 3e5, -2e6])
    chi = ambiguity(chirp, delays, dopplers)
    for i, tau in enumerate(delays):
        product = inside(t) * inside(t - tau).conj() * step
        direct = np.exp(-2j * np.pi * dopplers[:, None] * t) @ product
        np.testing.assert_allclose(chi[i], direct, atol=1e-8)
    assert chi[0, 0] == pytest.approx(1, abs=1e-13)
    assert np.all(chi[4] == 0)


def test_ridge_slopes():
    delays, dopplers = np.linspace(-1e-4, 1e-4, 21), np.linspace(-1e5, 1e5, 401)
    for chirp, sign in ((UP, 1), (DOWN, -1)):
        peaks = dopplers[np.abs(ambiguity(chirp, delays, dopplers)).argmax(axis=1)]
        slope = np.polyfit(delays, peaks, 1)[0]
        assert slope == pytest.approx(sign * chirp.chirp_rate / np.pi, rel=0.01)


def test_a_down_chirp_mirrors_the_up_chirp():
    delays, dopplers = grid(UP)
    mirrored = ambiguity(UP, delays, -dopplers).conj()
    np.testing.assert_allclose(ambiguity(DOWN, delays, dopplers), mirrored, atol=1e-13)


@pytest.mark.parametrize(
    ("waveform", "delay", "doppler"),
    [
        (UP, 9e-4, 3.2e5),
        (GaussianChirp(duration=2e-6), 2e-5, 1e6),
        (PulseTrain(GaussianChirp(duration=1e-6, chirp_rate=5e11), count=3, interval=10e-6), 3.2e-5, 2.2e6),
    ],
    ids=["up", "unmodulated", "train"],
)
@pytest.mark.slow
def test_volume_is_one(waveform, delay, doppler):
    """The ambiguity volume int int |chi|^2 = |chi(0, 0)|^2 for any waveform."""
    delays, dopplers = np.linspace(-delay, delay, 301), np.linspace(-doppler, doppler, 401)
    power = np.abs(ambiguity(waveform, delays, dopplers)) ** 2
    # The rectangle rule is spectrally exact for a smooth function that vanishes at the border.
    assert power.sum() * (delays[1] - delays[0]) * (dopplers[1] - dopplers[0]) == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize("waveform", [UP, PulseTrain(UP, count=3, interval=2e-3)], ids=["chirp", "train"])
def test_cuts_are_the_axes_of_the_surface(waveform):
    delays, dopplers = np.linspace(-3e-4, 3e-4, 7), np.linspace(-2e4, 2e4, 9)
    surface = ambiguity(waveform, delays, dopplers)
    np.testing.assert_allclose(zero_doppler_cut(waveform, delays), surface[:, 4], atol=1e-14)
    np.testing.assert_allclose(zero_delay_cut(waveform, dopplers), surface[3], atol=1e-14)


def test_train_by_quadrature_over_all_its_pieces_equals_the_sum_over_pulse_pairs():
    train = PulseTrain(GaussianChirp(duration=1e-6, chirp_rate=3e12), count=6, interval=20e-6)
    dopplers = np.linspace(-3e6, 3e6, 57)
    for delay in (0.0, 0.4e-6, -20.3e-6, 40e-6):
        np.testing.assert_allclose(correlate(train, delay, dopplers), train.ambiguity_row(delay, dopplers), atol=1e-12)


def test_many_dopplers_do_not_depend_on_the_chunk(monkeypatch):
    dopplers = np.linspace(-1e5, 1e5, 301)
    whole = zero_delay_cut(UP, dopplers)
    monkeypatch.setattr("wavegym.waveforms.numeric._CHUNK", 1000)
    np.testing.assert_allclose(zero_delay_cut(UP, dopplers), whole, atol=1e-15)


@pytest.mark.parametrize(
    ("delays", "dopplers", "message"),
    [
        ([0.0, np.nan], [0.0], r"delays\[1\] is nan, expected finite"),
        ([0.0], [np.inf], r"dopplers\[0\] is inf"),
        (np.zeros((2, 2)), [0.0], r"delays has shape \(2, 2\), expected one axis"),
    ],
)
def test_bad_axes(delays, dopplers, message):
    with pytest.raises(InputError, match=message):
        ambiguity(UP, delays, dopplers)


def test_numbers_and_empty_axes():
    assert ambiguity(UP, 0.0, 0.0).shape == (1, 1)
    assert ambiguity(UP, [0.0, 1e-5], []).shape == (2, 0)


CHIRP = GaussianChirp(duration=100e-6, chirp_rate=1e8)


def test_the_figure_shows_the_plane_and_both_cuts(tmp_path):
    delays, dopplers = np.linspace(-2e-4, 2e-4, 21), np.linspace(-8e3, 8e3, 17)
    figure = plot_ambiguity(CHIRP, delays=delays, dopplers=dopplers)
    plane, _, above, beside = figure.axes
    assert (plane.get_xlabel(), plane.get_ylabel()) == ("delay τ [µs]", "Doppler ν [kHz]")
    magnitude = np.abs(ambiguity(CHIRP, delays, dopplers))
    np.testing.assert_allclose(plane.images[0].get_array(), magnitude.T)
    np.testing.assert_allclose(plane.images[0].get_extent(), [-210, 210, -8.5, 8.5])  # pixel centres on the samples
    np.testing.assert_allclose(above.lines[0].get_xydata(), np.stack([delays * 1e6, magnitude[:, 8]], axis=1))
    np.testing.assert_allclose(beside.lines[0].get_xydata(), np.stack([magnitude[10], dopplers / 1e3], axis=1))
    assert "up 100 us" in figure.get_suptitle()
    figure.savefig(tmp_path / "chirp.png")
    assert (tmp_path / "chirp.png").stat().st_size > 5000


def test_default_window_holds_the_main_peak():
    figure = plot_ambiguity(CHIRP)
    values = figure.axes[0].images[0].get_array()
    assert values.max() == pytest.approx(1, abs=1e-12)
    assert values.min() < 1e-3


def test_given_axes_get_the_plane_alone():
    figure = Figure()
    axes = figure.add_subplot()
    assert plot_ambiguity(CHIRP, axes, delays=[-1e-6, 0, 1e-6], dopplers=[-10, 0, 10]) is figure
    assert figure.axes == [axes]
    assert len(axes.images) == 1


def test_decibels():
    figure = plot_ambiguity(CHIRP, floor_db=-40)
    values = figure.axes[0].images[0].get_array()
    assert values.min() == pytest.approx(-40)
    assert values.max() == pytest.approx(0, abs=1e-10)


def test_matplotlib_is_not_loaded_by_the_import():
    script = "import sys, wavegym.waveforms; sys.exit(any(m in sys.modules for m in ('matplotlib', 'scipy', 'numba')))"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"delays": [0.0]}, r"delays has shape \(1,\), expected at least two numbers"),
        (
            {"dopplers": [0.0, 1.0, 3.0]},
            "dopplers has steps from 1 to 2, expected at least two numbers, rising and evenly spaced",
        ),
        ({"delays": [1e-6, 0.0]}, "rising and evenly spaced"),
        ({"floor_db": 0.0}, "floor_db is 0.0, expected a number < 0"),
    ],
)
def test_bad_input(arguments, message):
    with pytest.raises(InputError, match=message):
        plot_ambiguity(CHIRP, **arguments)
