"""A receiver that is off while its radar transmits, against inner products over the open gate."""

from __future__ import annotations

import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import erfc, erfcx
from scipy.stats import norm

from wavegym.core import shortcuts
from wavegym.schedulers.registry import make_policy
from wavegym.systems.kershaw_evans.actions import HALF_LENGTH, visible_information
from wavegym.systems.kershaw_evans.kernels import LEAST_VISIBLE
from wavegym.systems.kershaw_evans.system import KershawEvans, KershawEvansPosition
from wavegym.waveforms import GaussianChirp

TIGHT = np.tile(np.diag([100.0, 1e4]), (3, 1, 1))  # the range is known, the range-rate is not: a long pulse pays
K = 100e-6  # s; such a pulse is blind to 54.6 km


def gated_information(chirp, opening):
    """J at SNR 1 over t >= opening, by the trapezoid rule: derivatives by delay and Doppler less their projections."""
    t = np.linspace(opening, chirp.support[1], 200_001)
    s, step = chirp.signal(t), 1e-6 * chirp.duration
    derivatives = (chirp.signal(t - step) - chirp.signal(t + step)) / (2 * step), 2j * np.pi * t * s

    def inner(x, y):
        return np.trapezoid(x * y.conj(), t)

    J = np.empty((2, 2))
    for i, one in enumerate(derivatives):
        for j, other in enumerate(derivatives):
            J[i, j] = (inner(one, other) - inner(one, s) * inner(s, other) / inner(s, s)).real
    return J


@pytest.mark.parametrize("chirp_rate", [1e7, 1e8])
@pytest.mark.parametrize("r", [20e3, 40e3, 54e3, 80e3])
def test_the_whole_information_falls_by_one_share(chirp_rate, r):
    chirp = GaussianChirp(duration=K, chirp_rate=chirp_rate)
    half = norm.ppf(0.995) / np.sqrt(2) * K  # of the interval that holds 99 % of the energy
    whole, seen = chirp.fisher_information(), gated_information(chirp, half - 2 * r / oracles.C)
    share = visible_information(np.array(K), np.array(r))
    np.testing.assert_allclose(seen, whole * share, rtol=1e-6)  # of the differences with step 1e-6


def test_the_share_is_the_formula_to_the_last_bit_where_it_is_one_too():
    """Published tables depend on the bits. From 9 deviations on, the share is 1 without a formula."""
    r = np.linspace(0.0, 400e3, 100_001)
    a = np.sqrt(2.0) * (HALF_LENGTH - (2.0 / oracles.C) * r / K)
    tail = np.sqrt(0.5) * a
    with np.errstate(over="ignore"):
        m = np.sqrt(2.0 / np.pi) / erfcx(tail)
    share = np.maximum(0.5 * erfc(tail) * (1.0 + m * (a - m)), LEAST_VISIBLE)
    np.testing.assert_array_equal(visible_information(np.array(K), r), share)
    assert np.ptp(a) > 20
    assert a.min() < -30


@given(st.floats(-5, 3), st.floats(0, 6))
def test_it_rises_with_the_range_from_nothing_to_all(power, further):
    r = 54.6e3 * 10**power
    near, far = visible_information(np.array(K), np.array([r, r * (1 + further)]))
    assert LEAST_VISIBLE <= near <= far * (1 + 1e-12)
    assert far <= 1 + 1e-12


def test_the_library_can_be_used_at_every_range_of_the_defaults():
    """At the nearest range that a target reaches, the longest pulse keeps 95 % of its information."""
    for system in (KershawEvans(), KershawEvansPosition()):
        nearest = system.start_range[0] + min(system.start_speed[0], 0.0) * system.horizon * system.dt
        assert visible_information(np.array(max(system.durations)), np.array(nearest)) > 0.95


@pytest.mark.parametrize("action", ["library", "box"])
def test_no_scheduler_sends_eclipsed_pulses(action):
    """At 20 km the pulses of 300 us are blind to 164 km: the radar and every scheduler send shorter ones."""
    near = {"start_range": (20e3, 20e3), "start_speed": (0.0, 0.0), "reference_range": 50e3, "action": action}
    system, clear = KershawEvansPosition(**near), KershawEvansPosition(**near, eclipsing=False)
    belief = system.initial(oracles.worlds(system, 3)).belief
    covariance, whole = (s.predict(belief, s.candidates()[None]).covariance for s in (system, clear))
    assert (np.linalg.eigvalsh(covariance - whole) > -1e-6 * whole[..., 0, 0, None]).all()  # P is never better known
    np.testing.assert_allclose(covariance[:, 0], whole[:, 0], rtol=1e-3)  # 10 us: blind to 5 km
    for name in ("myopic", "lookahead:2"):
        policies = make_policy(name, system, None), make_policy(name, clear, None)
        chosen = []
        for policy, of in zip(policies, (system, clear), strict=True):
            policy.begin(of, 3, np.random.default_rng(0))
            chosen.append(of.unit_covariance(policy.act(belief._replace(covariance=TIGHT), None, None))[:, 0, 0])
        assert (chosen[0] < 0.5 * chosen[1]).all()  # c^2 k^2 / 2


def test_pulses_of_ones_own_are_eclipsed_by_their_tables():
    """Gaussian chirps, given as a library, lose what the closed form says, as far as the tables are exact."""
    built_in = KershawEvansPosition(durations=(30e-6, K), start_range=(20e3, 60e3), reference_range=50e3)
    own = KershawEvansPosition(library=built_in.actions, start_range=(20e3, 60e3), reference_range=50e3)
    belief = built_in.initial(oracles.worlds(built_in, 5)).belief
    S, expected = (shortcuts.innovation_covariance(s, belief, s.candidates()[None]) for s in (own, built_in))
    np.testing.assert_allclose(S, expected, rtol=1e-6)
