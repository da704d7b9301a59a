"""Eclipsed pulses: the information in a gate fixed in time against inner products, laws, tables and folding."""

from __future__ import annotations

import math

import eclipsing_oracle as oracle
import numpy as np
import oracles
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from wavegym.core.errors import InputError
from wavegym.sensors import EclipsedLibrary, EclipsedPulse, eclipse_tables
from wavegym.sensors import eclipsing_kernels as kernels
from wavegym.sensors.eclipsing import NEVER_CUT
from wavegym.waveforms import FisherFactors, GaussianChirp, PulseTrain, TrapezoidChirp, Waveform

C, CARRIER = 299792458.0, 10e9
UP = GaussianChirp(duration=10e-6, chirp_rate=2e10)
LFM = TrapezoidChirp(kind="lfm", duration=50e-6, sweep=2e6)
HFM = TrapezoidChirp(kind="hfm", duration=50e-6, sweep=2e6, direction="down")
STEEP = TrapezoidChirp(kind="pfm", shape=2.5, duration=20e-6, sweep=5e6, rise=6e-6)


class Lopsided(Waveform):
    """The asymmetric pulse t exp(-t) with a bent phase, without a closed form: t in 1e-5 s."""

    label, support = "lopsided", (0.0, 45e-5)

    def envelope(self, t):
        x = np.asarray(t) * 1e5
        return np.sqrt(1e5) * 2 * x * np.exp(-np.abs(x))

    def phase(self, t):
        x = np.asarray(t) * 1e5
        return 3 * x + 0.5 * x * x - 0.02 * x**3


PULSES = {"gauss": UP, "lfm": LFM, "hfm": HFM, "steep": STEEP, "lopsided": Lopsided()}
FULL = {name: EclipsedPulse(pulse, interval=500e-6, energy=0.999) for name, pulse in PULSES.items()}
ranges = st.floats(0.0, 4e5)


def factors(J):
    """(residual, slope, spread) of an information of (delay, angular Doppler)."""
    return np.linalg.det(J) / J[1, 1], -J[0, 1] / J[1, 1], J[1, 1]


@settings(max_examples=25, deadline=None)
@pytest.mark.parametrize("recovery", [0.0, 5e-6])
@pytest.mark.parametrize("name", PULSES)
@given(range_m=st.floats(0.0, 1e5))
def test_equals_the_inner_products_of_the_gated_derivatives(name, recovery, range_m):
    """Both ends of the window, tails, folds. The share to 1e-10; information to 1e-8/f of the whole pulse's."""
    pulse = EclipsedPulse(PULSES[name], interval=500e-6, recovery=recovery, energy=0.999)
    share, J = oracle.information(PULSES[name], range_m / (C / 2), 500e-6, recovery, energy=0.999)
    assert pulse.visible_share(range_m) == pytest.approx(share if share > 1e-6 else 0.0, abs=1e-10)
    if share > 1e-3:
        got = pulse.fisher_factors(range_m)
        whole = pulse.waveform.fisher_factors()
        residual, slope, spread = factors(J / share)
        assert got.residual == pytest.approx(residual, rel=1e-7, abs=1e-9 * float(whole.residual) / share)
        assert got.spread == pytest.approx(spread, rel=1e-8, abs=1e-10 * float(whole.spread) / share)
        scale = abs(float(whole.slope)) + math.sqrt(float(whole.residual) / float(whole.spread))
        assert got.slope == pytest.approx(slope, rel=1e-8, abs=1e-8 * scale / share)


@pytest.mark.parametrize("range_m", [0.0, 3e3, 6e3, 7.4e3, 3e4, 1.42e5, 1.48e5, 1.53e5, 4.55e5])
@pytest.mark.parametrize("pulse", [UP, HFM])
def test_a_train_equals_its_inner_products(pulse, range_m):
    train = PulseTrain(pulse, count=5, interval=1e-3)
    want = oracle.covariance(train, range_m, CARRIER)
    got = EclipsedPulse(train).measurement_covariance(range_m, CARRIER)
    np.testing.assert_allclose(got / np.sqrt(np.outer(np.diag(want), np.diag(want))), want /
                               np.sqrt(np.outer(np.diag(want), np.diag(want))), atol=1e-6)  # fmt: skip


@given(share_of_length=st.floats(0.0, 1.5), k=st.floats(1e-7, 1e-3), product=st.floats(0.0, 1e4))
def test_a_gaussian_pulse_has_a_closed_form(share_of_length, k, product):
    """Both derivatives are t s(t) times a constant: a cut scales the whole information by Q(a)(1 + a m - m^2).

    a = sqrt(2)(T/2 - tau)/k with T/2 the half length, Q the normal distribution's upper tail, m = phi(a)/Q(a).
    """
    chirp = GaussianChirp(duration=k, chirp_rate=product / (k * k))
    eclipsed = EclipsedPulse(chirp)
    half = eclipsed.transmitted[1]
    tau = 2.0 * half * share_of_length
    a = math.sqrt(2.0) * (half - tau) / k
    m = norm.pdf(a) / norm.sf(a)
    left = norm.sf(a) * (1.0 + a * m - m * m)
    assert eclipsed.visible_share(C / 2 * tau) == pytest.approx(norm.sf(a), abs=1e-11)
    want = chirp.measurement_covariance(CARRIER, left)
    assert oracles.covariance_distance(eclipsed.measurement_covariance(C / 2 * tau, CARRIER), want) < 1e-7


@pytest.mark.slow
def test_the_error_of_the_tables():
    """Largest error over 400 gates of the share and, relative to the inner products, of the variances at f > 0.01."""
    worst_share, worst_variance = 0.0, 0.0
    for pulse in PULSES.values():
        eclipsed = EclipsedPulse(pulse, interval=500e-6, energy=0.999)
        for range_m in np.linspace(0, 2e4, 80):
            share, _ = oracle.information(pulse, range_m / (C / 2), 500e-6, energy=0.999)
            worst_share = max(worst_share, abs(eclipsed.visible_share(range_m) - share))
            if share > 0.01:
                want = np.diag(oracle.covariance(pulse, range_m, CARRIER, interval=500e-6, energy=0.999))
                got = np.diag(eclipsed.measurement_covariance(range_m, CARRIER))
                worst_variance = max(worst_variance, np.abs(got / want - 1).max())
    print(f"share {worst_share:.1e}, variance {worst_variance:.1e}")
    assert worst_share < 1e-11
    assert worst_variance < 1e-7


@pytest.mark.parametrize("pulse", [UP, LFM, HFM, STEEP, Lopsided(), PulseTrain(HFM, count=8, interval=1e-3)])
def test_an_open_gate_gives_the_whole_pulse(pulse):
    eclipsed = EclipsedPulse(pulse)
    assert eclipsed.visible_share(7e4) == pytest.approx(1.0, abs=1e-14)
    whole = pulse.measurement_covariance(CARRIER, 1.0)
    np.testing.assert_allclose(eclipsed.measurement_covariance(7e4, CARRIER), whole, rtol=1e-9)


def test_a_long_chirp_keeps_its_digits():
    """Time-bandwidth product 1e8: 1 - rho^2 is 1e-15, J itself would lose everything."""
    chirp = TrapezoidChirp(kind="lfm", duration=1e-2, sweep=1e10)
    plain = TrapezoidChirp(kind="lfm", duration=1e-2, sweep=0.0)
    for r in (4e5, 8e5, 2e6):
        bare, swept = EclipsedPulse(plain).fisher_factors(r), EclipsedPulse(chirp).fisher_factors(r)
        assert swept.residual == bare.residual  # linear FM moves no delay information out of the ridge
        assert swept.slope == pytest.approx(2 * np.pi * 1e12, rel=1e-14)


@pytest.mark.parametrize("name", PULSES)
@given(low=ranges, high=ranges)
def test_the_share_is_a_share_and_grows_at_the_near_edge(name, low, high):
    single = EclipsedPulse(PULSES[name])
    f = single.visible_share(sorted((low, high)))
    assert 0 <= f[0] <= 1
    assert f[1] >= f[0] - 1e-14


@pytest.mark.parametrize("name", PULSES)
@given(range_m=ranges)
def test_a_gate_never_adds_information(name, range_m):
    """J_gate <= J_full: R_gate - R_full is positive semidefinite, up to the tables' error."""
    pulse = FULL[name]
    gated, whole = pulse.measurement_covariance(range_m, CARRIER), pulse.waveform.measurement_covariance(CARRIER, 1.0)
    L = np.linalg.cholesky(gated)
    inside = np.linalg.solve(L, np.linalg.solve(L, whole).T)
    assert np.linalg.eigvalsh(inside).max() <= 1 + 1e-7


@pytest.mark.parametrize("name", PULSES)
@given(range_m=st.floats(0.0, 7e4), folds=st.integers(1, 9))
def test_echoes_fold(name, range_m, folds):
    """The periodic receiver does not know which pulse an echo belongs to."""
    pulse = FULL[name]
    far = range_m + folds * C / 2 * 500e-6
    assert pulse.visible_share(far) == pytest.approx(pulse.visible_share(range_m), abs=1e-9)


def test_a_cut_pulse_has_no_new_edge():
    """Delay information of a gate in the flat top is no more than the whole pulse's, however steep the pulse's edges.

    A pulse of that shape with an edge of its own as steep as the sampling allows would have a thousand times as much.
    """
    pulse = TrapezoidChirp(kind="lfm", duration=50e-6, sweep=0.0, rise=0.5e-6)
    half = EclipsedPulse(pulse, energy=1.0).fisher_factors(C / 2 * 25e-6)
    recomputed = TrapezoidChirp(kind="lfm", duration=25e-6, sweep=0.0, rise=1e-9).fisher_factors()
    assert 0.5 * float(half.residual) < float(pulse.fisher_factors().residual)
    assert recomputed.residual > 400 * half.residual


def test_an_invisible_pulse():
    """Inside the blind zone: no energy, and a covariance without weight, but finite and positive definite."""
    blind = EclipsedPulse(LFM, energy=1.0)
    assert blind.visible_share(0.0) == 0.0
    np.testing.assert_array_equal(blind.snr_factor([0.0, 0.0], "full"), [0.0, 0.0])
    np.testing.assert_allclose(
        blind.measurement_covariance(0.0, CARRIER), 1e6 * LFM.measurement_covariance(CARRIER, 1.0), rtol=1e-9
    )


def test_a_window_in_the_flat_top_of_a_linear_chirp():
    """A duty of 96 %: the ridge keeps its slope, the position on it is unknown, the covariance stays finite."""
    long = EclipsedPulse(LFM, interval=52e-6, energy=1.0)
    R = long.measurement_covariance(C / 2 * 26e-6, CARRIER)
    assert np.linalg.eigvalsh(R / np.sqrt(np.outer(np.diag(R), np.diag(R)))).min() > 0
    assert R[0, 0] > 1e6 * LFM.measurement_covariance(CARRIER, 1.0)[0, 0]
    assert np.isfinite(R).all()


def test_both_laws_of_the_snr():
    pulse = EclipsedPulse(LFM)
    f = pulse.visible_share(4e3)
    assert 0.4 < f < 0.6
    assert pulse.snr_factor(4e3) == f
    assert pulse.snr_factor(4e3, "full") == f * f
    with pytest.raises(InputError, match=r"replica is 'half', expected one of 'visible', 'full'"):
        pulse.snr_factor(4e3, "half")


def test_the_blind_range_of_the_timing_is_where_the_pulse_is_whole():
    for name, pulse in FULL.items():
        timing = pulse.timing(CARRIER)
        assert pulse.visible_share(timing.blind_range) == pytest.approx(0.9995, abs=1e-9), name
        assert pulse.visible_share(timing.unambiguous_range - timing.duration * C / 2) == pytest.approx(
            0.9995, abs=1e-7
        )


def test_recovery_moves_the_near_edge_alone():
    late, prompt = EclipsedPulse(LFM, interval=500e-6, recovery=10e-6), EclipsedPulse(LFM, interval=500e-6)
    shift = C / 2 * 10e-6
    assert late.visible_share(6e3 + shift) == pytest.approx(prompt.visible_share(6e3), rel=1e-12)
    assert late.visible_share(7.2e4) == prompt.visible_share(7.2e4)


def test_a_library_shares_tables_and_equals_its_elements_bit_for_bit():
    entries = [
        EclipsedPulse(p) for p in (UP, LFM, GaussianChirp(duration=3e-6), HFM, PulseTrain(LFM, count=3, interval=1e-3))
    ]
    library = EclipsedLibrary(entries)
    assert len(library.tables.nodes) == 3
    r = np.linspace(0, 4e4, 23)[:, None]
    together = library.measurement_covariance(np.arange(5), r, CARRIER)
    share = library.visible_share(np.arange(5), r)
    assert together.shape == (23, 5, 2, 2)
    for i, w in np.ndindex(23, 5):
        assert np.array_equal(together[i, w], entries[w].measurement_covariance(r[i, 0], CARRIER))
        assert share[i, w] == entries[w].visible_share(r[i, 0])
        assert library.snr_factor(w, r[i, 0], "full") == share[i, w] ** 2
    assert library.visible_share(0, np.empty(0)).shape == (0,)


def test_kernels_take_continuous_parameters():
    """``gated_factors`` with the table of one chirp of the shape equals the chirp's own object."""
    tables = eclipse_tables([GaussianChirp(duration=1.0), TrapezoidChirp(kind="hfm", duration=1.0, sweep=1.0)])
    first, last = EclipsedPulse(UP).transmitted
    got = kernels.gated_factors(
        tables, 0, UP.duration, 2 * UP.signed_chirp_rate * UP.duration, 2e-5, first, last, 0.0, np.inf, 1.0
    )
    want = EclipsedPulse(UP).fisher_factors(C / 2 * 2e-5)
    assert got[1:] == pytest.approx((float(want.residual), float(want.slope), float(want.spread)), rel=1e-12)
    got = kernels.gated_factors(
        tables, 1, HFM.duration, 2 * np.pi * HFM.signed_sweep, 2e-5, *EclipsedPulse(HFM).transmitted, 0.0, np.inf, 1.0
    )
    want = EclipsedPulse(HFM).fisher_factors(C / 2 * 2e-5)
    assert got[1:] == pytest.approx((float(want.residual), float(want.slope), float(want.spread)), rel=1e-12)
    assert isinstance(want, FisherFactors)


def test_windows_say_where_the_pulse_is_whole():
    """Of single pulses and trains, near and folded: whole exactly where no energy is missing."""
    train = PulseTrain(TrapezoidChirp(kind="pfm", duration=20e-6, sweep=1e6), count=8, interval=150e-6)
    entries = [EclipsedPulse(TrapezoidChirp(kind="lfm", duration=50e-6, sweep=4e6)), EclipsedPulse(train)]
    library, r = EclipsedLibrary(entries), np.linspace(0.0, 60e3, 1999)
    for w in range(2):
        share = library.visible_share(w, r)
        whole = np.array([kernels.is_whole(library.windows, w, 2.0 * x / C) for x in r])
        assert 100 < whole.sum() < 1999
        assert (share[whole] > 1.0 - 1e-12).all()
        assert (share[~whole] < 1.0).all()
        x = r[~whole][5]
        got = kernels.windowed_covariance(library.tables, library.windows, w, x, 10e9)
        want = library.measurement_covariance(w, x, 10e9)
        np.testing.assert_array_equal(got, [library.visible_share(w, x), want[0, 0], want[0, 1], want[1, 1]])
    assert all(kernels.is_whole(NEVER_CUT, 0, delay) for delay in (0.0, 1e-6, 1.0))


@given(range_m=st.floats(0, 2e4))
def test_a_pulse_without_closed_form_equals_its_twin(range_m):
    """The same chirp by quadrature of its envelope and phase."""

    class Twin(Waveform):
        label, support, pieces = "twin", HFM.support, HFM.pieces
        envelope, phase = HFM.envelope, HFM.phase

    assume(EclipsedPulse(HFM).visible_share(range_m) > 1e-3)
    twin, own = EclipsedPulse(_twin(Twin)), EclipsedPulse(HFM)
    assert twin.visible_share(range_m) == pytest.approx(own.visible_share(range_m), abs=1e-11)
    np.testing.assert_allclose(
        twin.measurement_covariance(range_m, CARRIER), own.measurement_covariance(range_m, CARRIER), rtol=1e-6
    )


_TWINS: dict[str, Waveform] = {}


def _twin(kind):
    """One object, so that its interval is found once."""
    return _TWINS.setdefault("hfm", kind())


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: EclipsedPulse(LFM, interval=4e-5), r"interval \(PRI\) is 4e-05 s, .* expected room for the pulse"),
        (
            lambda: EclipsedPulse(PulseTrain(LFM, count=2, interval=1e-3), interval=2e-3),
            r"interval is 0\.002 s, expected None or that of the train \(nearest: 0\.001\)",
        ),
        (lambda: EclipsedPulse("chirp"), "expected a Waveform"),
        (lambda: EclipsedPulse(LFM, recovery=-1.0), "recovery is -1.0"),
        (lambda: EclipsedLibrary([]), "expected at least one EclipsedPulse"),
        (lambda: EclipsedLibrary([LFM]), "expected EclipsedPulse"),
        (lambda: eclipse_tables([]), "expected at least one waveform"),
        (lambda: EclipsedLibrary([EclipsedPulse(LFM)]).visible_share(1, 5.0), r"waveform is 1, .* indices in \[0, 0\]"),
        (lambda: EclipsedLibrary([EclipsedPulse(LFM)]).visible_share(0.5, 5.0), r"waveform is 0\.5"),
        (lambda: EclipsedPulse(LFM).visible_share(-1.0), "range_m is -1.0"),
        (lambda: EclipsedPulse(LFM).measurement_covariance(1.0, math.nan), "carrier_hz is nan"),
        (lambda: EclipsedPulse(LFM).measurement_covariance(np.ones(2), np.ones(3)), "expected shapes that broadcast"),
    ],
)  # fmt: skip
def test_bad_input_is_refused_in_one_line(wrong, message):
    with pytest.raises(InputError, match=message) as caught:
        wrong()
    assert "\n" not in str(caught.value)
