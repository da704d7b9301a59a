import subprocess
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure

from wavegym.core.errors import InputError
from wavegym.waveforms import GaussianChirp, ambiguity, plot_ambiguity

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
