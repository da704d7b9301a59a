"""Time on the transmitter, blind ranges and speeds, unambiguous intervals and time budgets."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from waveform_cases import KinkedChirp

from wavegym.core.errors import InputError
from wavegym.waveforms import (
    GaussianChirp,
    PulseTiming,
    PulseTrain,
    TrapezoidChirp,
    Waveform,
    check_dwells,
    check_range_folds,
    check_time_on_target,
    time_left,
    transmitted_interval,
)

C = 299792458.0
K = 300e-6
GAUSS = GaussianChirp(duration=K, chirp_rate=1e8)
CHIRP = TrapezoidChirp(kind="hfm", duration=100e-6, sweep=1e6)
shares, durations = st.floats(0.01, 0.9999), st.floats(1e-7, 1e-3)


def timing(**changed):
    return PulseTiming(**({"duration": 1e-5, "carrier_hz": 10e9, "interval": 1e-3, "count": 16} | changed))


class Lopsided(Waveform):
    """The asymmetric pulse t exp(-t), whose energy up to T is 1 - exp(-2 T)(1 + 2 T + 2 T^2)."""

    label, support = "lopsided", (0.0, 45.0)

    def envelope(self, t):
        t = np.asarray(t)
        return np.where(t < 0, 0.0, 2 * t * np.exp(-np.abs(t)))

    def phase(self, t):
        return 0.0 * np.asarray(t)


def length(waveform, **definition):
    first, last = transmitted_interval(waveform, **definition)
    return last - first


def test_the_figures_of_a_gaussian_pulse():
    """Rounded figures known beforehand: 3.64 k and 164 km at 99 %, 7.43 k and 334 km at -60 dB, for k = 300 us."""
    assert length(GAUSS) / K == pytest.approx(3.643, abs=5e-4)
    assert length(GAUSS, level_db=-60.0) == pytest.approx(GAUSS.effective_length, rel=1e-14)
    assert PulseTiming.of(GAUSS, 1e10).blind_range == pytest.approx(164e3, abs=500)
    assert PulseTiming.of(GAUSS, 1e10, level_db=-60).blind_range == pytest.approx(334e3, abs=500)


@given(share=shares, k=durations, kind=st.sampled_from(["gauss", "trapezoid"]), rise=st.floats(0.01, 0.5))
def test_the_interval_holds_its_share_and_leaves_as_much_on_each_side(share, k, kind, rise):
    pulse = (
        GaussianChirp(duration=k)
        if kind == "gauss"
        else TrapezoidChirp(kind="lfm", duration=k, sweep=0.0, rise=rise * k)
    )
    first, last = transmitted_interval(pulse, energy=share)
    edges = np.unique(np.clip([first, *np.ravel(pulse.pieces), last], first, last))
    inside = sum(quad(lambda t: pulse.envelope(t) ** 2, a, b)[0] for a, b in itertools.pairwise(edges))
    assert inside == pytest.approx(share, rel=1e-9)
    assert first == -last


@given(share=shares)
def test_an_asymmetric_pulse_by_quadrature(share):
    first, last = transmitted_interval(Lopsided(), energy=share)
    for end, want in ((first, 0.5 * (1 - share)), (last, 0.5 * (1 + share))):
        energy = 1 - math.exp(-2 * end) * (1 + 2 * end + 2 * end * end)
        assert energy == pytest.approx(want, abs=1e-12)


def test_an_asymmetric_pulse_by_level():
    """Ends of t exp(1 - t) > 0.1, by the equation itself."""
    for end in transmitted_interval(Lopsided(), level_db=-20.0):
        assert end * math.exp(1 - end) == pytest.approx(0.1, rel=1e-5)  # the peak is that of 4097 times


@pytest.mark.parametrize("definition", [{"energy": 0.9}, {"energy": 1.0}, {"level_db": -6.0}, {"level_db": -60.0}])
@pytest.mark.parametrize(
    ("closed", "numeric"),
    [
        (TrapezoidChirp(kind="lfm", duration=1e-4, sweep=1e6), KinkedChirp("lfm", 1e-4, 1e6)),
        (TrapezoidChirp(kind="efm", duration=1e-6, sweep=1e6), KinkedChirp("efm", 1e-6, 1e6)),
    ],
)
def test_closed_forms_equal_quadrature(closed, numeric, definition):
    want = transmitted_interval(closed, **definition)
    assert transmitted_interval(numeric, **definition) == pytest.approx(want, rel=1e-10)


def test_a_trapezoid_chirp_occupies_its_whole_duration():
    assert transmitted_interval(CHIRP, energy=1.0) == (-50e-6, 50e-6)
    assert length(CHIRP, level_db=-300.0) == pytest.approx(100e-6, rel=1e-14)
    assert transmitted_interval(GAUSS, energy=1.0) == GAUSS.support


def test_a_train_has_the_interval_of_its_pulse():
    train = PulseTrain(CHIRP, count=8, interval=1e-3)
    assert transmitted_interval(train) == transmitted_interval(CHIRP)
    own = PulseTiming.of(train, 1e10, energy=1.0, max_duty=0.1)
    assert own == PulseTiming(duration=1e-4, carrier_hz=1e10, interval=1e-3, count=8, max_duty=0.1)


def test_numbers_of_a_textbook_radar():
    """10 GHz, PRF 1 kHz, 10 us: 150 km, +-7.5 m/s, blind to 1.5 km, duty 1 %."""
    own = timing()
    assert own.wavelength == pytest.approx(0.0299792458)
    assert (own.prf, own.duty_cycle) == pytest.approx((1e3, 0.01))
    assert own.unambiguous_range == pytest.approx(149896.229)
    assert own.unambiguous_velocity == pytest.approx(14.9896229)
    assert own.blind_range == pytest.approx(1498.96229)
    assert own.coherent_processing_interval == pytest.approx(0.016)
    assert own.blind_speeds(3) == pytest.approx([14.9896229, 29.9792458, 44.9688687])
    assert own.time_on_target(0.0) == pytest.approx(15e-3 + 1e-5)
    assert own.time_on_target(C * 1e-3) == pytest.approx(17e-3 + 1e-5)
    assert timing(recovery=2e-6).blind_range == pytest.approx(1.2 * 1498.96229)


@given(prf=st.floats(100, 1e5), duty=st.floats(0.001, 0.5), carrier=st.floats(1e8, 1e11))
def test_unambiguous_range_and_velocity_have_one_product(prf, duty, carrier):
    """Range x velocity is c lambda/4, whatever the PRF (velocity: full interval)."""
    own = PulseTiming(duration=duty / prf, carrier_hz=carrier, interval=1 / prf, count=8)
    assert own.unambiguous_range * own.unambiguous_velocity == pytest.approx(C * C / carrier / 4, rel=1e-12)
    assert own.duty_cycle == pytest.approx(duty)


def test_one_pulse_folds_nothing():
    own = PulseTiming(duration=1e-5, carrier_hz=1e10)
    assert (own.prf, own.duty_cycle, own.unambiguous_range, own.unambiguous_velocity) == (0, 0, math.inf, math.inf)
    assert own.coherent_processing_interval == own.duration
    assert own.range_blind_zones(1e9) == pytest.approx(np.array([[0.0, own.blind_range]]))
    assert own.velocity_blind_zones(5.0, 100.0) == pytest.approx(np.array([[-5.0, 5.0]]))
    repeated = timing(count=1)
    assert repeated.unambiguous_range < math.inf
    assert repeated.unambiguous_velocity == math.inf


@given(
    echo=st.floats(0, 5e-3), interval=st.floats(5e-5, 1e-3), duration=st.floats(1e-6, 2e-5), recovery=st.floats(0, 1e-5)
)
def test_range_blind_zones_are_the_echoes_that_meet_a_closed_receiver(echo, interval, duration, recovery):
    """Brute force over the pulses: does [echo, echo + duration] meet [m PRI, m PRI + duration + recovery]?"""
    own = timing(interval=interval, duration=duration, recovery=recovery)
    starts = interval * np.arange(-2, 150)
    overlap = np.minimum(echo + duration, starts + duration + recovery) - np.maximum(echo, starts)
    if np.abs(overlap).min() < 1e-12:
        return
    zones = own.range_blind_zones(C / 2 * 5e-3 + 1)
    r = C / 2 * echo
    assert ((zones[:, 0] <= r) & (r < zones[:, 1])).any() == (overlap > 0).any()


@given(v=st.floats(-300, 300), notch=st.floats(0.1, 7.0))
def test_velocity_blind_zones_are_those_that_fold_into_the_notch(v, notch):
    own = timing()
    zones = own.velocity_blind_zones(notch, 300.0)
    phase = np.angle(np.exp(2j * np.pi * v / own.unambiguous_velocity)) / (2 * np.pi) * own.unambiguous_velocity
    if abs(abs(phase) - notch) > 1e-9:
        assert ((zones[:, 0] < v) & (v < zones[:, 1])).any() == (abs(phase) < notch)


def test_a_pulse_longer_than_the_step_is_refused():
    single = PulseTiming(duration=0.2, carrier_hz=1e10)
    train = PulseTiming(duration=1e-5, carrier_hz=1e10, interval=1e-3, count=900)
    check_time_on_target({"a": single, "b": train}, 1.0)
    check_time_on_target({"a": single}, 0.2 + 1.0, farthest=0.5 * C)  # an echo after 1 s
    with pytest.raises(InputError, match=r"^a takes 0\.2 s, .* the step, 0\.1 s \(nearest: 0\.1 s of transmission\)$"):
        check_time_on_target({"a": single}, 0.1)
    with pytest.raises(InputError, match=r"^b takes 0\.89901 s, .* \(nearest: 500 pulses\)$"):
        check_time_on_target({"b": train}, 0.5)
    check_time_on_target({"b": PulseTiming(duration=1e-5, carrier_hz=1e10, interval=1e-3, count=500)}, 0.5)
    with pytest.raises(InputError, match="nearest: 0 s"):
        check_time_on_target({"a": single}, 0.1, farthest=0.5 * C)


def test_a_range_that_folds_is_refused():
    train = PulseTiming(duration=1e-5, carrier_hz=1e10, interval=1e-3, count=9)
    check_range_folds({"a": PulseTiming(duration=1e-5, carrier_hz=1e10), "b": train}, 0.5e-3 * C)
    with pytest.raises(InputError, match=r"^range of b folds at 149896 m, .* 299792 m \(nearest: interval 0.002\)$"):
        check_range_folds({"b": train}, 1e-3 * C)
    with pytest.raises(InputError, match="farthest"):
        check_range_folds({"b": train}, -1.0)


def test_a_time_budget():
    assert time_left([[0.1, 0.2], [0.4, 0.4]], step=1.0, switching=0.05) == pytest.approx([0.6, 0.1])
    assert check_dwells([0.5, 0.5], 1.0) == 0.0
    with pytest.raises(InputError, match=r"dwells take 1\.4 s, expected at most the step, 1\.0 s \(nearest: the first "
                       r"2 of 3, or a step of 1\.4 s\)"):  # fmt: skip
        check_dwells([0.3, 0.3, 0.8], 1.0)
    with pytest.raises(InputError, match=r"dwells take 1\.2 s, .*the first 1 of 2"):
        check_dwells([0.5, 0.5], 1.0, switching=0.1)
    with pytest.raises(InputError, match=r"dwells is 0\.5, expected an axis"):
        check_dwells(0.5, 1.0)
    with pytest.raises(InputError, match="expected one axis"):
        check_dwells(np.ones((2, 2)), 9.0)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"interval": 1e-5}, r"interval \(PRI\) is 1e-05 s, PRF 100000 Hz, expected room .*nearest: interval > 1e-05"),
        ({"interval": 1.2e-5, "recovery": 4e-6}, r"1\.4e-05 s, .* PRF < 71428\.6\)"),
        (
            {"interval": 5e-5, "max_duty": 0.1},
            r"duty cycle is 0\.2 \(10 us every 50 us\), expected at most max_duty, 0\.1 \(nearest: interval 0\.0001 or",
        ),
        ({"count": 0}, r"count is 0, expected an integer >= 1 \(nearest: 1\)"),
        ({"interval": None}, r"interval is None, expected the time between the 16 pulses"),
        ({"max_duty": 1.5}, r"max_duty is 1\.5, .*nearest: 1"),
    ],
)
def test_impossible_pulses_are_refused_with_the_nearest_valid_value(wrong, message):
    with pytest.raises(InputError, match=message) as caught:
        timing(**wrong)
    assert "\n" not in str(caught.value)


def test_definitions_that_are_none():
    for wrong, message in (
        ({"energy": 0.9, "level_db": -60}, "expected one of them"),
        ({"energy": 1.2}, r"energy is 1\.2, expected a share in \(0, 1\] \(nearest: 1\)"),
        ({"level_db": 3.0}, r"level_db is 3\.0 dB, expected a level below the peak, < 0 \(nearest: -60\)"),
        ({"level_db": math.nan}, "level_db is nan"),
    ):
        with pytest.raises(InputError, match=message):
            transmitted_interval(GAUSS, **wrong)
    with pytest.raises(InputError, match="expected a Waveform"):
        transmitted_interval("chirp")
    with pytest.raises(InputError, match=r"notch is 8 m/s, expected less than half .* \(nearest: 7\.4"):
        timing().velocity_blind_zones(8, 100)
