import numpy as np
import pytest
from hypothesis import given, settings
from waveform_cases import KinkedChirp, trains

from wavegym.core.errors import InputError
from wavegym.waveforms import GaussianChirp, PulseTrain, ambiguity

PULSE = GaussianChirp(duration=1e-6, chirp_rate=2e12, direction="down")


@given(trains())
def test_doppler_moment_grows_by_the_dwell(train):
    pulse_J, J = train.pulse.fisher_information(), train.fisher_information()
    dwell = 4 * np.pi**2 * train.interval**2 * (train.count**2 - 1) / 12
    assert J[1, 1] == pytest.approx(pulse_J[1, 1] + dwell, rel=1e-13)
    assert J[0, 0] == pytest.approx(pulse_J[0, 0], rel=1e-12)
    assert J[0, 1] == pytest.approx(pulse_J[0, 1], rel=1e-12)


def test_a_train_of_one_is_its_pulse():
    train = PulseTrain(PULSE, count=1, interval=1e-9)  # one pulse cannot overlap
    t = np.linspace(-1e-5, 1e-5, 101)
    assert np.array_equal(train.signal(t), PULSE.signal(t))
    assert np.array_equal(train.measurement_covariance(1e10, 2.0), PULSE.measurement_covariance(1e10, 2.0))
    assert (train.support, train.pieces) == (PULSE.support, PULSE.pieces)


def test_signal_is_the_sum_of_the_pulses():
    train = PulseTrain(PULSE, count=4, interval=20e-6)
    t = np.linspace(*train.support, 5003)
    expected = sum(PULSE.signal(t - (m - 1.5) * 20e-6) for m in range(4)) / 2
    np.testing.assert_allclose(train.signal(t), expected, atol=1e-12 * abs(expected).max())


@settings(max_examples=30)
@given(trains(largest_product=10))
def test_energy_is_one(train):
    low, high = train.support
    t = np.linspace(low, high, 1 + int(20 * (high - low) / train.pulse.duration))
    # Where neighbours meet (interval 9.7 durations) 1e-11 of the energy is lost.
    assert np.trapezoid(np.abs(train.signal(t)) ** 2, t) == pytest.approx(1, abs=3e-11)


def test_works_for_any_pulse_and_for_trains_of_trains():
    kinked = KinkedChirp("hfm", 1e-6, 5e6)
    train = PulseTrain(kinked, count=3, interval=1e-6)  # back to back: the envelope is exactly zero at its ends
    assert len(train.pieces) == 9
    burst = PulseTrain(PulseTrain(PULSE, count=2, interval=20e-6), count=3, interval=100e-6)
    centres = np.add.outer(100e-6 * np.array([-1, 0, 1]), [-10e-6, 10e-6]).ravel()
    spread = np.var(centres) + PULSE.fisher_information()[1, 1] / (4 * np.pi**2)
    assert burst.fisher_information()[1, 1] == pytest.approx(4 * np.pi**2 * spread, rel=1e-12)


@pytest.mark.parametrize(
    "train", [PulseTrain(PULSE, count=5, interval=16e-6), PulseTrain(PULSE, count=2, interval=3e-4)]
)
def test_ambiguity_is_the_integral_over_all_pulses(train):
    T1, k = train.interval, train.pulse.duration
    t = np.linspace(train.support[0] - 2 * T1, train.support[1] + 2 * T1, 200_001)
    delays = np.array([0, 0.7 * k, T1 - 0.4 * k, -T1, T1 / 2, 2 * T1, 9 * T1])
    dopplers = np.array([0, 1 / T1, 0.37 / T1, -1.5 / T1, 40 / T1])
    chi = ambiguity(train, delays, dopplers)
    for i, tau in enumerate(delays):
        product = train.signal(t) * train.signal(t - tau).conj()
        for j, nu in enumerate(dopplers):
            direct = np.trapezoid(product * np.exp(-2j * np.pi * nu * t), t)
            assert chi[i, j] == pytest.approx(direct, abs=1e-11)


def test_label():
    assert (
        PulseTrain(GaussianChirp(duration=1e-6), count=16, interval=1e-3).label == "16 x (unmodulated 1 us) every 1 ms"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"count": 0, "interval": 1e-3}, "count is 0, expected an integer >= 1"),
        ({"count": 2.5, "interval": 1e-3}, "count is 2.5, expected an integer"),
        ({"count": True, "interval": 1e-3}, "count is True, expected an integer"),
        ({"count": 4, "interval": -1e-3}, "interval is -0.001 s, expected a finite number > 0"),
        ({"count": 4, "interval": 5e-6}, r"interval is 5e-06 s, expected one in which the pulse falls by 100 dB"),
    ],
)
def test_bad_parameters(arguments, message):
    with pytest.raises(InputError, match=message):
        PulseTrain(PULSE, **arguments)


def test_the_interval_named_as_nearest_is_accepted_and_not_generous():
    with pytest.raises(InputError) as error:
        PulseTrain(PULSE, count=4, interval=5e-6)
    nearest = float(str(error.value).split("nearest: ")[1].rstrip(")"))
    assert PulseTrain(PULSE, count=4, interval=nearest).interval == nearest
    assert nearest == pytest.approx(2 * np.sqrt(2 * np.log(1e5)) * 1e-6, rel=0.05)  # -100 dB of a Gaussian


def test_pulse_must_be_a_waveform():
    with pytest.raises(InputError, match="pulse is 'chirp', expected a Waveform"):
        PulseTrain("chirp", count=2, interval=1e-3)
