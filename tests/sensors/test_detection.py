"""Detection of a fluctuating target: a simulated receiver, the limits, the two conventions of SNR."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wavegym.core.errors import InputError
from wavegym.sensors import detection_probability, energy_detection_probability


@pytest.mark.parametrize(("energy_ratio", "false_alarm"), [(0.5, 0.1), (3.0, 0.01), (20.0, 1e-3)])
def test_equals_a_simulated_receiver(energy_ratio, false_alarm):
    """Echo sqrt(E) a with Rayleigh |a| in complex noise of power N0 = 1, threshold set on noise alone."""
    rng, count = np.random.default_rng(0), 400_000
    a, noise = (rng.standard_normal((2, count, 2)) / np.sqrt(2)) @ [1, 1j]
    threshold = -np.log(false_alarm)  # |noise|^2 is exponential with unit mean
    detected = np.mean(np.abs(np.sqrt(energy_ratio) * a + noise) ** 2 > threshold)
    pd = energy_detection_probability(energy_ratio, false_alarm)
    assert detected == pytest.approx(pd, abs=5 * np.sqrt(pd * (1 - pd) / count))


def test_values():
    assert energy_detection_probability(1.0, 0.01) == pytest.approx(0.1, rel=1e-14)
    assert energy_detection_probability(3.0, 1e-4) == pytest.approx(0.1, rel=1e-14)
    assert detection_probability(2.0, 0.01) == pytest.approx(0.1, rel=1e-14)  # eta = 2 E/N0


def test_limits():
    assert detection_probability(1e-12, 0.01) == pytest.approx(0.01, rel=1e-10)
    assert detection_probability(1e12, 0.01) == pytest.approx(1.0, abs=1e-11)


@given(st.floats(1e-6, 1e6), st.floats(1e-12, 0.99))
def test_between_false_alarm_and_one_and_growing(snr, false_alarm):
    pd = detection_probability(snr, false_alarm)
    assert false_alarm * (1 - 1e-12) <= pd <= 1
    assert detection_probability(2 * snr, false_alarm) >= pd
    assert energy_detection_probability(snr / 2, false_alarm) == pd


def test_a_batch_broadcasts_and_equals_its_elements_bit_for_bit():
    snr, false_alarm = np.geomspace(0.1, 1e4, 37)[:, None], np.array([1e-6, 1e-2, 0.3])
    together = detection_probability(snr, false_alarm)
    assert together.shape == (37, 3)
    for i, j in np.ndindex(37, 3):
        assert detection_probability(snr[i, 0], false_alarm[j]) == together[i, j]
    assert detection_probability(np.empty(0), 0.1).shape == (0,)


@pytest.mark.parametrize("snr", [0.0, -3.0, np.inf, np.nan, [1.0, -2.0]])
def test_snr_outside_its_range(snr):
    with pytest.raises(InputError, match=r"snr is (0\.0|-3\.0|inf|nan|-2\.0), expected a finite number > 0"):
        detection_probability(snr, 0.01)
    with pytest.raises(InputError, match="energy_ratio is"):
        energy_detection_probability(snr, 0.01)


@pytest.mark.parametrize("false_alarm", [0.0, 1.0, -0.1, 1.5, np.nan, [0.5, 1.0]])
def test_false_alarm_outside_its_range(false_alarm):
    with pytest.raises(InputError, match=r"false_alarm is .*, expected a probability above 0 and below 1"):
        detection_probability(10.0, false_alarm)
