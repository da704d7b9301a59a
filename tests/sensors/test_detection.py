"""Detection of steady and fluctuating targets: simulated receivers, quadrature, the limits, two conventions of SNR."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, special, stats

from wavegym.core.counter_rng_kernels import stream
from wavegym.core.errors import InputError
from wavegym.core.kernels import kernel
from wavegym.sensors import (
    FLUCTUATIONS,
    assumed_echo,
    detected_snr,
    detection_probability,
    echo_law,
    energy_detection_probability,
    mean_inverse_detected_snr,
    realised_snr,
    unit_snr_range,
)
from wavegym.sensors.detection_kernels import detection_of, effective_snr, received_snr


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


CASES = [(name, pulses) for name in FLUCTUATIONS for pulses in (1, 2, 7)]


def energy_law(name, pulses, snr):
    """The law of the realised E/N0 of a look, as scipy has it."""
    shape = {"swerling1": 1, "swerling2": pulses, "swerling3": 2, "swerling4": 2 * pulses}[name]
    return stats.gamma(shape, scale=0.5 * pulses * snr / shape)


@pytest.mark.parametrize(("name", "pulses"), CASES)
def test_any_fluctuation_equals_a_simulated_receiver(name, pulses):
    rng, count = np.random.default_rng(1), 200_000
    for snr, false_alarm in ((2.0, 0.05), (20.0, 1e-3)):
        pd = detection_probability(snr, false_alarm, name, pulses)
        detected, _ = oracles.simulated_echoes(name, pulses, snr, false_alarm, count, rng)
        assert abs(detected.mean() - pd) < 5.0 * math.sqrt(pd * (1.0 - pd) / count) + 1e-9


@pytest.mark.parametrize(("name", "pulses"), CASES)
@pytest.mark.parametrize("searched", [0, 3])
def test_equals_the_quadrature_over_the_energy(name, pulses, searched):
    """Marcum's Q by scipy's noncentral chi-square, averaged over the law of the energy."""
    for snr, false_alarm in ((0.3, 0.1), (8.0, 1e-4), (300.0, 1e-6)):
        twice, freedom = 2.0 * oracles.echo_threshold(false_alarm, pulses), 2 * pulses + searched

        def given_energy(energy, twice=twice, freedom=freedom):
            return stats.ncx2.sf(twice, freedom, 2.0 * energy) if energy > 0.0 else stats.chi2.sf(twice, freedom)

        if name == "swerling0":
            wanted = given_energy(0.5 * pulses * snr)
        else:
            law = energy_law(name, pulses, snr)
            edges = law.ppf([0.0, 0.1, 0.5, 0.9, 0.999, 1.0 - 1e-14])
            wanted = sum(
                integrate.quad(lambda s, law=law, f=given_energy: law.pdf(s) * f(s), low, high, epsabs=1e-13)[0]
                for low, high in pairwise(edges)
            )
        assert detection_probability(snr, false_alarm, name, pulses, searched) == pytest.approx(wanted, rel=1e-7)


def test_closed_forms():
    """Swerling 1 of one pulse; Swerling 2, a gamma variable; Swerling 3 of one pulse (Meyer and Mayer, 1973)."""
    snr, false_alarm = np.geomspace(1e-3, 1e6, 40), 1e-5
    one = detection_probability(snr, false_alarm)
    np.testing.assert_allclose(detection_probability(snr, false_alarm, "swerling2"), one, rtol=1e-11)
    limit = oracles.echo_threshold(false_alarm, 6)
    six = stats.gamma.sf(limit / (1.0 + snr / 2.0), 6)
    np.testing.assert_allclose(detection_probability(snr, false_alarm, "swerling2", 6), six, rtol=1e-10)
    x, limit = snr / 2.0, -math.log(false_alarm)
    third = (1.0 + 2.0 * x * limit / (2.0 + x) ** 2) * np.exp(-2.0 * limit / (2.0 + x))
    np.testing.assert_allclose(detection_probability(snr, false_alarm, "swerling3"), third, rtol=1e-10)
    np.testing.assert_allclose(detection_probability(snr, false_alarm, "swerling4"), third, rtol=1e-10)


def test_the_default_is_todays_formula_bit_for_bit():
    snr = np.geomspace(0.01, 1e5, 50)
    np.testing.assert_array_equal(
        detection_probability(snr, 1e-3, "swerling1"), detection_probability(snr, false_alarm=1e-3)
    )


@pytest.mark.parametrize(("name", "pulses"), CASES)
def test_limits_of_fluctuations(name, pulses):
    assert detection_probability(1e-9, 1e-6, name, pulses) == pytest.approx(1e-6, rel=1e-6)
    assert detection_probability(1e9, 1e-6, name, pulses) == pytest.approx(1.0, abs=1e-7)


@settings(deadline=None)
@given(st.floats(1e-3, 1e5), st.floats(1e-9, 0.5), st.integers(1, 40))
def test_less_fluctuation_detects_more_of_a_strong_echo(snr, false_alarm, pulses):
    """Between false alarm and 1; where every law detects 90 %, the steadier echo is detected more often."""
    pd = {name: float(detection_probability(snr, false_alarm, name, pulses)) for name in FLUCTUATIONS}
    for value in pd.values():
        assert false_alarm * (1.0 - 1e-9) <= value <= 1.0 + 1e-12
    if pd["swerling1"] > 0.9:
        assert pd["swerling1"] <= pd["swerling3"] + 1e-9 <= pd["swerling0"] + 2e-9
        assert pd["swerling2"] <= pd["swerling4"] + 1e-9


@pytest.mark.parametrize(("name", "pulses"), CASES)
def test_snr_of_detected_echoes(name, pulses):
    """Quantiles against the echoes that a simulated receiver detects: Kolmogorov and Smirnov's distance."""
    rng, snr, false_alarm = np.random.default_rng(2), 6.0, 0.02
    detected, own = oracles.simulated_echoes(name, pulses, snr, false_alarm, 60_000, rng)
    draws = (np.arange(200) + 0.5) / 200
    if name == "swerling0":
        assert (detected_snr(draws, snr, false_alarm, name, pulses) == snr).all()
        return
    found = detected_snr(draws, snr, false_alarm, name, pulses)
    empirical = np.searchsorted(np.sort(own[detected]), found) / detected.sum()
    assert np.abs(empirical - draws).max() < 1.95 / math.sqrt(detected.sum())  # level 1e-3
    plain = np.searchsorted(np.sort(own), realised_snr(draws, snr, name, pulses)) / len(own)
    assert np.abs(plain - draws).max() < 1.95 / math.sqrt(len(own))
    assert (found > realised_snr(draws, snr, name, pulses)).all()  # detection prefers strong echoes


@pytest.mark.parametrize(("name", "pulses"), [case for case in CASES if case[0] != "swerling0"])
@pytest.mark.parametrize("searched", [0, 3])
def test_mean_inverse_of_detected_echoes(name, pulses, searched):
    """Against quadrature of pdf x Marcum's Q / max(eta, least), Pd by the same."""
    snr, false_alarm, least = 12.0, 1e-3, 1.0
    law, twice = energy_law(name, pulses, snr), 2.0 * oracles.echo_threshold(false_alarm, pulses)

    def part(energy, inverse):
        weight = law.pdf(energy) * stats.ncx2.sf(twice, 2 * pulses + searched, 2.0 * energy)
        return weight / max(2.0 * energy / pulses, least) if inverse else weight

    edges = [1e-12, 0.5 * pulses * least, *law.ppf([0.5, 0.9, 0.999, 1.0 - 1e-13])]
    edges = sorted(edge for edge in edges if edge >= 1e-12)
    whole = [
        sum(integrate.quad(part, *ends, args=(inverse,))[0] for ends in pairwise(edges)) for inverse in (True, False)
    ]
    found = mean_inverse_detected_snr(snr, false_alarm, name, pulses, searched, least)
    assert found == pytest.approx(whole[0] / whole[1], rel=1e-6)
    draws = (np.arange(200) + 0.5) / 200
    sampled = 1.0 / np.maximum(detected_snr(draws, snr, false_alarm, name, pulses, searched), least)
    assert found == pytest.approx(sampled.mean(), rel=0.02)


def test_the_mean_inverse_of_a_rayleigh_echo_diverges_even_given_a_detection():
    """pdf(0) Q(0) = Pf / eta > 0, so each decade of eta towards 0 adds the same amount, ln 10 Pf / (eta Pd)."""
    snr, false_alarm = 20.0, 1e-3
    assert mean_inverse_detected_snr(snr, false_alarm) == np.inf
    assert mean_inverse_detected_snr(snr, false_alarm, "swerling2", 1) == np.inf
    means = [mean_inverse_detected_snr(snr, false_alarm, least=10.0**-k) for k in (5, 6, 7)]
    decade = math.log(10.0) * false_alarm / (snr * detection_probability(snr, false_alarm))
    np.testing.assert_allclose(np.diff(means), decade, rtol=1e-3)
    for name, pulses in (("swerling2", 2), ("swerling3", 1), ("swerling4", 1)):
        finite = mean_inverse_detected_snr(snr, false_alarm, name, pulses)
        assert finite == pytest.approx(mean_inverse_detected_snr(snr, false_alarm, name, pulses, least=1e-9), rel=1e-6)
        assert finite < np.inf
    assert mean_inverse_detected_snr(snr, false_alarm, "swerling0") == 1.0 / snr
    assert mean_inverse_detected_snr(snr, false_alarm, "swerling0", least=50.0) == 1.0 / 50.0


@pytest.mark.slow
def test_one_draw_decides_on_detection_and_on_the_snr():
    """A draw below Pd, divided by Pd, gives the law of the detected echoes: a tape needs one number a look."""
    draws, snr, false_alarm = np.random.default_rng(5).random(100_000), 6.0, 0.02
    pd = detection_probability(snr, false_alarm)
    own = detected_snr(draws[draws < pd][:1000] / pd, snr, false_alarm)
    wanted = detected_snr((np.arange(1000) + 0.5) / 1000, snr, false_alarm)
    assert stats.ks_2samp(own, wanted).pvalue > 1e-3


def test_the_greatest_value_of_an_image_has_half_a_chi_square_more():
    """|a chi(u) + w(u)|^2 over one delay: a sampled pulse, its matched filter, and the peak within the main lobe."""
    rng, count, snr, false_alarm = np.random.default_rng(3), 4000, 20.0, 1e-3
    t = np.arange(-30, 31) / 4.0  # in durations of a Gaussian pulse, four samples each
    pulse = np.exp(-0.5 * t * t)
    pulse /= np.linalg.norm(pulse)
    noise = (rng.standard_normal((count, len(t))) + 1j * rng.standard_normal((count, len(t)))) / math.sqrt(2)
    shifts = np.linspace(-1.5, 1.5, 61)
    filters = np.exp(-0.5 * (t - shifts[:, None]) ** 2)
    filters /= np.linalg.norm(filters, axis=1)[:, None]
    for name in ("swerling0", "swerling1"):
        amplitude = np.sqrt(0.5 * realised_snr(rng.random(count), snr, name))
        power = np.abs((amplitude[:, None] * pulse + noise) @ filters.T) ** 2
        pd = [detection_probability(snr, false_alarm, name, searched=d) for d in (0, 1)]
        for found, wanted in zip((power[:, 30], power.max(axis=1)), pd, strict=True):
            detected = (found > -math.log(false_alarm)).mean()
            assert abs(detected - wanted) < 4.0 * math.sqrt(wanted * (1.0 - wanted) / count) + 0.004
        assert pd[1] - pd[0] > 0.02


@kernel
def looks(eta, row, law, key, found):
    """Fill found (n,) with ``received_snr`` of independent looks."""
    for i in range(len(found)):
        found[i] = received_snr(eta, row, stream(key, i), law)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["swerling0", "swerling1", "swerling3"])
@pytest.mark.parametrize("searched", [0, 2, 3])
def test_a_simulated_look_has_the_laws_of_detection_and_error(name, searched):
    """Detections, and the mean of 1 / max(eta, 1) over them, within four standard errors of sums over the mixture."""
    law, found = echo_law((1e-2, 1e-5), name, searched), np.empty(100_000)
    for row, false_alarm in enumerate((1e-2, 1e-5)):
        for snr in (3.0, 30.0, 300.0):
            looks(snr, row, law, np.uint64(row), found)
            wanted = detection_probability(snr, false_alarm, name, searched=searched)
            detected = found[found > 0.0]
            assert abs(len(detected) / len(found) - wanted) <= 4.0 * math.sqrt(wanted * (1 - wanted) / 1e5) + 1e-6
            inverse = 1.0 / detected
            mean = mean_inverse_detected_snr(snr, false_alarm, name, searched=searched, least=1.0)
            assert abs(inverse.mean() - mean) <= 4.0 * inverse.std() / math.sqrt(len(inverse)) + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("name", FLUCTUATIONS)
@pytest.mark.parametrize(("searched", "false_alarm"), [(0, 1e-8), (0, 1e-2), (3, 1e-3)])
def test_tables_for_compiled_loops(name, searched, false_alarm):
    """Interpolation against the sums behind ``detection_probability`` and ``mean_inverse_detected_snr``."""
    law = echo_law((0.3, false_alarm), name, searched)
    snr = np.exp(np.random.default_rng(4).uniform(math.log(1e-3), math.log(1e6), 300))
    found = np.array([(detection_of(e, 1, law), effective_snr(e, 1, law)) for e in snr]).T
    np.testing.assert_allclose(found[0], detection_probability(snr, false_alarm, name, searched=searched), atol=5e-5)
    wanted = 1.0 / mean_inverse_detected_snr(snr, false_alarm, name, searched=searched, least=1.0)
    np.testing.assert_allclose(found[1], wanted, rtol=1e-4)


@pytest.mark.parametrize("realised", [True, False])
def test_assumptions_in_numpy_are_those_of_compiled_loops(realised):
    law, snr = echo_law((1e-3,), "swerling3", 2, realised=realised), np.geomspace(1e-4, 1e8, 60).reshape(2, 30)
    found = assumed_echo(snr, law)
    wanted = np.array([[(detection_of(e, 0, law), effective_snr(e, 0, law)) for e in row] for row in snr])
    np.testing.assert_allclose(found.detection, wanted[..., 0], rtol=1e-6)
    np.testing.assert_allclose(found.effective, wanted[..., 1], rtol=1e-9)


@pytest.mark.parametrize("cells", [4, 32])
def test_a_cfar_detector_has_the_textbook_probability_and_false_alarms(cells):
    """Swerling 1 at a known cell: Pd = (1 + t / (1 + E/N0))^-N with Pf = (1 + t)^-N (Gandhi and Kassam 1988)."""
    alarm, count = 1e-2, 40_000
    law, t = echo_law((alarm,), "swerling1", cells=cells), alarm ** (-1.0 / cells) - 1.0
    for row, snr in enumerate((1e-3, 5.0, 60.0)):
        wanted, found = (1.0 + t / (1.0 + 0.5 * snr)) ** -cells, np.empty(count)
        assert detection_of(snr, 0, law) == pytest.approx(wanted, abs=5e-5)
        looks(snr, 0, law, np.uint64(row), found)
        detected = found[found > 0.0]
        assert abs(len(detected) / count - wanted) <= 4.0 * math.sqrt(wanted * (1.0 - wanted) / count)
        inverse = 1.0 / detected
        assert (
            abs(inverse.mean() - 1.0 / effective_snr(snr, 0, law))
            <= 4.0 * inverse.std() / math.sqrt(len(inverse)) + 1e-9
        )
    loss = detection_of(60.0, 0, echo_law((alarm,), "swerling1")) - detection_of(60.0, 0, law)
    assert loss > 0.002


def test_many_reference_cells_are_a_known_noise():
    known, many = (echo_law((1e-3,), "swerling3", 2, cells=cells) for cells in (0, 64))
    snr = np.geomspace(1.0, 1e4, 50)
    found = [[detection_of(e, 0, law) for e in snr] for law in (known, many)]
    np.testing.assert_allclose(*found, atol=0.05)
    with pytest.raises(InputError, match=r"cells is 65, expected .*nearest: 64"):
        echo_law((1e-3,), cells=65)
    with pytest.raises(InputError, match=r"cells is 5, expected more cells, .* of 1e-300 \(nearest: 0\)"):
        echo_law((1e-300,), cells=5)


def test_beyond_the_tables():
    law = echo_law((1e-3,), "swerling1", 2)
    assert detection_of(1e-9, 0, law) == law.detection[0, 0]
    assert detection_of(1e12, 0, law) == pytest.approx(law.detection[0, -1], abs=1e-12)
    assert effective_snr(1e-9, 0, law) == 1.0
    snr = np.geomspace(1e-2, 1e9, 400)
    assert (np.diff([effective_snr(e, 0, law) for e in snr]) >= -1e-9).all()


def test_an_echo_law_of_the_mean_snr():
    """Sira et al. print Pd = Pf^(1 / (1 + eta)) and errors C / eta: one eta for E/N0 and 2E/N0."""
    law = echo_law((0.01,), energy=1.0, realised=False)
    assert detection_of(40.0, 0, law) == pytest.approx(0.01 ** (1.0 / 41.0), abs=1e-5)
    assert effective_snr(40.0, 0, law) == 40.0
    found = np.empty(1000)
    looks(40.0, 0, law, np.uint64(1), found)
    assert set(found) == {0.0, 40.0}


def test_a_batch_broadcasts():
    snr, false_alarm = np.geomspace(0.1, 1e4, 5)[:, None], np.array([1e-6, 1e-2, 0.3])
    together = detection_probability(snr, false_alarm, "swerling3", 4)
    for i, j in np.ndindex(5, 3):
        one = detection_probability(snr[i, 0], false_alarm[j], "swerling3", 4)
        assert one == pytest.approx(together[i, j], rel=1e-12)
    assert detected_snr(0.5, snr, false_alarm).shape == (5, 3)
    assert detection_probability(np.empty(0), 0.1, "swerling0").shape == (0,)


def test_the_radar_equation():
    """1 kW for 100 us, 35 dB, 3 cm, 1 m^2 at 290 K: E/N0 by its parts, at the range where it is one half."""
    energy, gain, wavelength = 0.1, 10.0**3.5, 0.03
    r = unit_snr_range(energy, 35.0, wavelength)
    on_target = energy * gain / (4.0 * math.pi * r**2)  # J/m^2
    received = on_target * 1.0 / (4.0 * math.pi * r**2) * gain * wavelength**2 / (4.0 * math.pi)
    assert 2.0 * received / (1.380649e-23 * 290.0) == pytest.approx(1.0, rel=1e-12)
    assert unit_snr_range(16.0 * energy, 35.0, wavelength) == pytest.approx(2.0 * r, rel=1e-12)
    assert unit_snr_range(energy, 35.0, wavelength, losses_db=40.0) == pytest.approx(0.1 * r, rel=1e-12)


def test_mistakes():
    with pytest.raises(InputError, match=r"fluctuation is 'swerling5', expected .*did you mean 'swerling4'"):
        detection_probability(10.0, 0.01, "swerling5")
    with pytest.raises(InputError, match=r"pulses is 0, expected an integer >= 1 \(nearest: 1\)"):
        detection_probability(10.0, 0.01, "swerling0", 0)
    with pytest.raises(InputError, match="pulses is 1001, expected 1 to 1000"):
        detection_probability(10.0, 0.01, "swerling0", 1001)
    with pytest.raises(InputError, match=r"searched is -1, expected an integer >= 0 \(nearest: 0\)"):
        detection_probability(10.0, 0.01, searched=-1)
    with pytest.raises(InputError, match=r"uniform is 1\.0, expected a number in \[0, 1\]"):
        realised_snr(1.0, 10.0)
    with pytest.raises(InputError, match=r"false_alarms has shape \(0,\), expected a sequence"):
        echo_law([])
    with pytest.raises(InputError, match="least is -1"):
        mean_inverse_detected_snr(10.0, 0.01, least=-1.0)


def test_steady_and_marcum():
    """Marcum's Q_1 as an integral of a Bessel function."""
    snr, limit = 20.0, -math.log(1e-3)
    a, b = math.sqrt(snr), math.sqrt(2.0 * limit)
    wanted = integrate.quad(lambda x: x * math.exp(-0.5 * (x - a) ** 2) * special.ive(0, a * x), b, b + 40.0)[0]
    assert detection_probability(snr, 1e-3, "swerling0") == pytest.approx(wanted, rel=1e-9)
