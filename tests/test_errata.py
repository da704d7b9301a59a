"""The numbers in docs/errata.md."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from wavegym.sensors import detection_probability, fov_penalty, mean_inverse_detected_snr, platform_view
from wavegym.systems.urban.system import Urban
from wavegym.waveforms import GaussianChirp

PAGE = (Path(__file__).parents[1] / "docs" / "errata.md").read_text("utf-8")


@pytest.mark.parametrize(("n1", "n2", "n3"), [(0, 0, 2), (0, 0, 5), (1, 2, 3), (4, 0, 1), (2, 3, 0)])
def test_the_pairs_of_sira_eq_11_are_miscounted(n1, n2, n3):
    """All pairs of different returns, one in each gate, counted one by one."""
    first = [("1", i) for i in range(n1)] + [("both", i) for i in range(n3)]
    second = [("2", i) for i in range(n2)] + [("both", i) for i in range(n3)]
    pairs = sum(one != other for one, other in itertools.product(first, second))
    printed = n1 * n2 + n2 * n3 + n1 * n3
    assert pairs == (n1 + n3) * (n2 + n3) - n3 == printed + n3 * (n3 - 1)
    if n1 == n2 == 0 and n3 >= 2:
        assert printed == 0 < pairs


def rise(phase, duration):
    """Instantaneous frequency of a phase function at both ends of the pulse, by differences."""
    ends, h = np.array([-0.5, 0.5]) * duration, 1e-6 * duration
    return (phase(ends + h) - phase(ends - h)) / (2 * h)


@pytest.mark.parametrize(("kappa", "right"), [(2.0, True), (3.0, False)])
def test_the_end_frequency_of_pfm_in_sira_table_1(kappa, right):
    duration, gamma = 0.7, 0.4
    start, end = rise(lambda t: t / gamma + (t + duration / 2 + 0j).real ** kappa / kappa, duration + 1e-9)
    assert end - start == pytest.approx(duration ** (kappa - 1), rel=1e-4)
    assert (end == pytest.approx(1 / gamma + duration, rel=1e-3)) == right


def test_the_sign_of_the_hfm_sweep_in_sira_table_1():
    duration, gamma = 0.7, 0.4
    start, end = rise(lambda t: np.log(t + gamma + duration / 2), duration)
    assert end - start == pytest.approx(-duration / (gamma * (gamma + duration)), rel=1e-6)


def test_as_printed_penalises_a_target_at_rest():
    """gamma / 2 at range-rate 0, and gamma for an approaching target; nothing with the two-sided bound."""
    gamma, sharpness = 1e6, 100.0
    for as_printed, at_rest, approaching in ((True, 0.5, 1.0), (False, 0.0, 0.0)):
        view = platform_view(1e4, 1e7, 1e-3, 0.03, 128, 1000, as_printed)
        low, high = view.low[1], view.high[1]
        speeds = np.array([0.0, -0.5 * high])
        found = fov_penalty("logistic", speeds, low, high, sharpness, gamma) / gamma
        np.testing.assert_allclose(found, [at_rest, approaching], atol=1e-9)


def test_the_trace_does_not_order_as_the_perimeter_does():
    one, other = np.diag([9.0, 0.01]), np.diag([4.0, 4.0])
    half_sides = [np.sqrt(np.diag(P)).sum() for P in (one, other)]
    np.testing.assert_allclose([np.trace(one), np.trace(other), *half_sides], [9.01, 8.0, 3.1, 4.0])
    assert (np.trace(one) > np.trace(other)) != (half_sides[0] > half_sides[1])


def test_detection_in_an_image_and_the_snr_of_what_is_detected():
    """The numbers of the page, at the threshold of UrbanSignal-v0: ln(1 / Pfa) = 7.6."""
    false_alarm = math.exp(-7.6418)
    cases = (("swerling0", 0, ".75"), ("swerling0", 3, ".85"), ("swerling1", 3, ".57"), ("swerling1", 0, ".50"))
    for fluctuation, searched, text in cases:
        pd = detection_probability(20.0, false_alarm, fluctuation, searched=searched)
        assert abs(pd - float(text)) < 0.006
        assert text in PAGE
    eta = np.array([10.0, 20.0, 40.0])
    factor = eta * mean_inverse_detected_snr(eta, false_alarm, searched=3, least=1.0)
    assert "{:.2f}, {:.2f} and {:.2f} at a mean eta of 10, 20 and 40".format(*factor) in PAGE.replace("\n  ", " ")
    assert np.isinf(mean_inverse_detected_snr(eta, false_alarm)).all()


def test_the_readings_of_barbosas_snr():
    """The table of the page: eta of each reading, and where the suite's law has it."""
    system = Urban()
    k, elements = max(system.durations), system.urban_tracker.elements
    t = np.linspace(-8 * k, 8 * k, 20_001)
    chirp = GaussianChirp(duration=k, chirp_rate=1.0)
    power = np.abs(chirp.signal(t)) ** 2
    effective = np.trapezoid(power, t) / power.max()  # energy over peak power
    assert effective == pytest.approx(math.sqrt(math.pi) * k, rel=1e-9)
    per_sample = 2 * 0.2 * effective * system.bandwidth * elements
    per_pulse = 2 * 0.2 * system.pulses * elements
    for eta in (0.2, per_sample, per_pulse):
        place = 100.0 * (system.reference_snr / eta) ** 0.25
        assert f"{eta:.3g} | {place:.0f} m" in PAGE
    assert system.reach < 100.0 * (system.reference_snr / 0.2) ** 0.25
    assert detection_probability(0.2, 1e-3) == pytest.approx(1.9e-3, abs=1e-4)
