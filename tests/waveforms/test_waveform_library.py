import doctest

import numpy as np
import pytest

import wavegym.waveforms
from wavegym.core.action_sets import Library
from wavegym.core.errors import InputError
from wavegym.waveforms import (
    GaussianChirp,
    PulseTrain,
    gaussian_chirp_library,
    measurement_covariances,
)

DURATIONS = np.geomspace(10e-6, 300e-6, 8)
SWEEPS = [0, 0.1e6, -0.1e6, 0.3e6, -0.3e6, 1e6, -1e6, 5e6, -5e6, 15e6, -15e6]


def test_the_tutorial_runs():
    result = doctest.testmod(wavegym.waveforms)
    assert result.attempted > 10
    assert result.failed == 0


def test_every_public_name_exists():
    assert all(hasattr(wavegym.waveforms, name) for name in wavegym.waveforms.__all__)


def test_gaussian_chirp_library_is_duration_major_with_signed_sweeps():
    library = gaussian_chirp_library(DURATIONS, SWEEPS)
    assert len(library) == 88
    for a, waveform in enumerate(library):
        k, sweep = DURATIONS[a // 11], SWEEPS[a % 11]
        assert waveform is library[a]
        assert waveform.duration == k
        assert waveform.signed_chirp_rate == pytest.approx(np.pi * sweep / (2 * k), rel=1e-15)
    assert library.labels[1] == "up 10 us 100 kHz"
    assert library.labels[-1] == "down 300 us 15 MHz"


def test_measurement_covariances_are_those_of_the_waveforms():
    train = PulseTrain(GaussianChirp(duration=1e-6), count=4, interval=1e-3)
    library = Library((GaussianChirp(duration=1e-4, chirp_rate=1e8), train))
    covariances = measurement_covariances(library, 10.4e9)
    assert covariances.shape == (2, 2, 2)
    for waveform, covariance in zip(library, covariances, strict=True):
        np.testing.assert_array_equal(covariance, waveform.measurement_covariance(10.4e9, 1.0))


def test_a_list_becomes_a_tuple():
    assert Library([GaussianChirp(duration=1e-6)]).entries == (GaussianChirp(duration=1e-6),)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Library(()), "library is empty"),
        (lambda: gaussian_chirp_library([], [1e6]), "library is empty"),
        (lambda: Library((GaussianChirp(duration=1e-6),) * 2), "holds 'unmodulated 1 us' 2 times"),
        (lambda: gaussian_chirp_library([1e-6], [0, -0.0]), "holds 'unmodulated 1 us' 2 times"),
        (lambda: measurement_covariances(Library(("up",)), 1e9), "library holds 'up', expected waveforms"),
        (lambda: Library((3.0,)), "library holds 3.0, expected waveforms or names"),
        (lambda: gaussian_chirp_library([-1e-6], [0]), "duration is -1e-06 s"),
        (lambda: gaussian_chirp_library([1e-6], [np.nan]), "sweep is nan Hz, expected a finite number"),
        (lambda: measurement_covariances(gaussian_chirp_library([1e-6], [0]), -1.0), "carrier_hz is -1.0 Hz"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(InputError, match=message):
        make()
