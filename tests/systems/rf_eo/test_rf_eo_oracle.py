"""The RF/EO loop against plain NumPy, its algebra to 80 digits, at documented states and over whole steps; its laws.

Documented test states: the published start, a mid-run state, one just inside each edge of the first platform's field
of view under the proposed fixed setting, behind a platform, azimuth next to +-pi, and nearly on top of a platform.
"""

from __future__ import annotations

import numpy as np
import oracles
import pytest
import rf_eo_oracle as plain
from hypothesis import given
from hypothesis import strategies as st

from wavegym.sensors import fov_penalty, platform_jacobian, platform_measurement, platform_view
from wavegym.systems.rf_eo.system import RfEo

KINDS = ("logistic", "hard", "deadzone", "huber", "log-barrier")
FIXED = np.array([[60e3, 10e6, 1e-3], [40e3, 5e6, 1e-3]])
SYSTEM = RfEo()
WAVELENGTH = plain.LIGHT / SYSTEM.carrier_hz
ONE = ((0.0, 1.0, 0.0, 1.0),)  # one target; its belief is set by each test
WIDE = np.diag([1e6, 25.0, 1e6, 25.0])
NARROW = np.array([[1.2, 0.3, -0.4, 0.0], [0.3, 0.2, 0.0, 0.05], [-0.4, 0.0, 2.0, 0.2], [0.0, 0.05, 0.2, 0.15]])


def at(j, r, azimuth, rdot=0.0, across=0.0):
    """The state that platform ``j`` sees so, looking along +y."""
    (x, y), u = SYSTEM.platforms[j], np.array([np.sin(azimuth), np.cos(azimuth)])
    v = rdot * u + across * np.array([u[1], -u[0]])
    return np.array([x + r * u[0], v[0], y + r * u[1], v[1]])


EDGE = plain.field_of_view(SYSTEM, FIXED[0])[1]
STATES = {
    "published start": (np.array([-500.0, 0.0, 500.0, 0.0]), WIDE),
    "mid-run": (np.array([-870.0, 0.8, 1210.0, -0.6]), NARROW),
    "range edge": (at(0, 0.999 * EDGE[0], 0.3, 5.0, 2.0), NARROW),
    "range-rate edge": (at(0, 1500.0, 0.3, 0.999 * EDGE[1], 7.0), NARROW),
    "azimuth edge": (at(0, 1500.0, 0.999 * EDGE[2], -3.0, 1.0), NARROW),
    "behind": (at(0, 900.0, 2.5, -20.0, 10.0), NARROW),
    "azimuth near pi": (at(0, 1500.0, np.pi - 1e-5, 10.0, 30.0), NARROW),
    "azimuth near -pi": (at(1, 1500.0, -np.pi + 1e-5, 10.0, 30.0), NARROW),
    "nearly on top": (at(0, 1.5, 0.7, 3.0, 1.0), NARROW / 100),
}


@pytest.mark.parametrize("as_printed", [False, True])
@pytest.mark.parametrize("name", STATES)
def test_measurement_and_jacobian(name, as_printed):
    """The stencil is good to 1e-14 of a row; 1e-6 is what a plain difference would give."""
    system, x = RfEo(as_printed=as_printed, looks=(0.2, -3.0)), STATES[name][0]
    seats = np.column_stack([system.platforms, system.looks])
    h, C = plain.stacked(system, x)
    np.testing.assert_allclose(platform_measurement(x, seats, as_printed), h, rtol=1e-13, atol=1e-13)
    row = np.abs(C).max(axis=-1, keepdims=True)
    np.testing.assert_allclose(platform_jacobian(x, seats, as_printed) / row, C / row, rtol=0, atol=1e-12)


def test_the_arcsine_folds_what_is_behind_and_the_printed_rate_is_wrong():
    """Behind and in front look alike to (5) and eta as printed; the mended ones tell the truth of a circling target."""
    front, behind = at(0, 900.0, 0.5), at(0, 900.0, np.pi - 0.5)
    printed = RfEo(as_printed=True)
    assert plain.measure(printed, front, 0)[2] == pytest.approx(plain.measure(printed, behind, 0)[2])
    circling = at(0, 900.0, 0.5, across=20.0)
    assert platform_measurement(circling, (-1e3, -1e3, 0.0))[1] == pytest.approx(0.0, abs=1e-12)
    assert platform_measurement(circling, (-1e3, -1e3, 0.0), True)[1] == pytest.approx(20 * np.sin(1.0))


@pytest.mark.parametrize("as_printed", [False, True])
def test_variances_and_edges(as_printed):
    p = 10 ** np.random.default_rng(1).uniform([3, 6, -5], [5, 7.3, -2.2], (20, 3))
    system = RfEo(as_printed=as_printed)
    view = platform_view(*p.T, WAVELENGTH, 128, 1000, as_printed)
    np.testing.assert_allclose(view.variance, [plain.plain_variances(system, q) for q in p], rtol=1e-14)
    edges = np.stack([view.low, view.high], axis=1)
    np.testing.assert_allclose(edges, [plain.field_of_view(system, q) for q in p], rtol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
@given(share=st.floats(-3, 3), low=st.sampled_from([-np.inf, -1.0, 0.0]), sharpness=st.sampled_from([100.0, 1e8]))
def test_penalties(kind, share, low, sharpness):
    got = fov_penalty(kind, 450 * share, 450 * low, 450.0, sharpness, 1e6)
    want = plain.penalty(kind, 450 * share, 450 * low, 450.0, sharpness, 1e6)
    # 1 - (x / high)^2 rounds by 1e-16 of 1 and by its inverse of what is left at the edge
    assert got == pytest.approx(want, rel=1e-9, abs=1e-15 * 1e6)


def belief_of(system, x, P):
    """A belief of one environment with the targets' states (target, 4) and covariances."""
    belief = system.initial(oracles.worlds(system, 1)).belief
    return belief._replace(mean=np.array(x)[None], covariance=np.array(P)[None])


def before(x):
    """The state a step earlier."""
    return np.linalg.solve(SYSTEM.motion.F, x)


def chosen(system, settings):
    """An action (1, ...) of the box for settings (platform, 3), and exactly what it decodes to."""
    action = system.action_set.encode(np.asarray(settings)[None])
    return action, system.action_set.settings(action)[0]


def tolerance(system, x, P, settings):
    """1e-10, or what rank-one updates lose: of the prior's h'Ph only the share R is left, its rounding stays whole."""
    x, P = plain.predict(system, x, P)
    C = plain.stacked(system, x)[1]
    R = np.array([plain.plain_variances(system, p) for p in settings])
    return max(1e-10, 4e-16 * (np.einsum("jqa,ab,jqb->jq", C, P, C) / R).max())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("margin", [0.0, 2.0])
@pytest.mark.parametrize("name", STATES)
def test_prediction_is_the_batch_information_form(name, margin, kind):
    """P_{k+1|k+1} and tr(P C' R~^-1 C) in 80 digits."""
    x, P = STATES[name]
    system = RfEo(penalty=kind, margin=margin, starts=ONE)
    belief, (action, settings) = belief_of(system, [before(x)], [P]), chosen(system, FIXED)
    want, got = plain.predict_ahead(system, before(x), P, settings), system.predict(belief, action)
    assert oracles.covariance_distance(got.covariance[0, 0], want.covariance) < 1e-10
    np.testing.assert_allclose(got.mean[0, 0], want.mean, rtol=1e-15)
    np.testing.assert_allclose(system.information(belief, action)[0, 0], want.share, rtol=1e-10)


PAIR = ((-1e3, 0.0, 1e3, 0.0), (1e3, 0.0, 1e3, 0.0))
CLOSED = [
    {"penalty": "logistic"},
    {"penalty": "logistic", "out_of_view": "inflated", "iterations": 1},
    {"penalty": "hard", "out_of_view": "inflated", "margin": 1.0},
    {"penalty": "deadzone", "out_of_view": "inflated", "sharpness": (30.0, 50.0, 20.0)},
    {"penalty": "log-barrier", "out_of_view": "inflated", "height": (1e7, 1e5, 3.0)},
    {"platforms": ((-1e3, -1e3),), "starts": PAIR[:1], "iterations": 1, "looks": (-0.3,)},
    {"platforms": ((-1e3, -1e3), (1e3, -1e3), (0.0, 3e3)), "looks": (0.0, 0.5, 3.1), "q": 3.0, "weights": (1, 2, 3, 4)},
    {"starts": (*PAIR, (200.0, 300.0, -900.0, -150.0)), "first_estimate": "drawn", "margin": 2.0, "dt": 0.5},
    # next to a platform, estimated there, and out of view
    {"nearest_range": 600.0, "starts": ((-1e3, 90.0, -9e2, 30.0), (2.1e3, 0.0, -1.8e3, 0.0), (-9e4, 0.0, -6e4, 0.0))},
    {"as_printed": True, "first_estimate": "drawn", "prior_variance": (1e4, 25.0, 1e4, 25.0)},
]


@pytest.mark.slow
@pytest.mark.parametrize("settings", CLOSED, ids=str)
def test_transition_is_the_plain_step(settings):
    """From each state of the system's own episode; random settings of the whole box, so that much is out of view.

    Repeated regressions converge slowly: they end within 0.01 deviations of each other.
    """
    system, rng = RfEo(horizon=8, **settings), np.random.default_rng(3)
    worlds = oracles.worlds(system, 2, seed=4)
    state = system.initial(worlds)
    for k in range(system.horizon):
        actions = rng.uniform(-1, 1, (2, 3 * len(system.platforms)))
        chosen, (truth, *_), (_, mean, P, *_) = system.action_set.settings(actions), *state
        state = system.transition(state, actions, worlds)
        for e in range(2):
            predicted = [plain.predict_ahead(system, *of, chosen[e]) for of in zip(mean[e], P[e], strict=True)]
            np.testing.assert_allclose(state.truth.share[e], min(f.share for f in predicted), rtol=1e-9)
            for t in range(len(system.starts)):
                draws = worlds.process[e, k, t], worlds.error[e, k, :, t]
                want = plain.step(system, truth[e, t], mean[e, t], P[e, t], chosen[e], *draws)
                limit = 0.01 if want.regressed else 10 * tolerance(system, mean[e, t], P[e, t], chosen[e])
                sigma, got = np.sqrt(np.diag(want.covariance)), state.belief.covariance[e, t]
                np.testing.assert_allclose(state.truth.targets[e, t], want.truth, rtol=1e-13, atol=1e-12)
                assert state.truth.received[e, t] == want.received
                assert oracles.covariance_distance(got, want.covariance) < limit, (k, e, t)
                assert np.abs((state.belief.mean[e, t] - want.mean) / sigma).max() < limit, (k, e, t)
    of = list(zip(*(a.reshape(-1, *a.shape[2:]) for a in (state.truth.targets, *state.belief[1:3])), strict=True))
    np.testing.assert_allclose(system.state_info(state)["nees"].ravel(), [plain.nees(*a) for a in of], rtol=1e-6)
    np.testing.assert_allclose(system.cost(state.belief), [plain.cost(system, P) for P in state.belief.covariance])


def test_the_finest_pixels_meet_the_widest_prior():
    """Straight ahead 1e-5 rad leave 1e-10 of the prior's variance: rank-one updates keep six digits of what is left."""
    ahead = at(0, 1500.0, 0.3)
    system = RfEo(starts=ONE, looks=tuple(np.arctan2(*(ahead[[0, 2]] - place)) for place in SYSTEM.platforms))
    action, settings = chosen(system, [[1e3, 20e6, 1e-5]] * 2)
    want = plain.predict_ahead(system, before(ahead), WIDE, settings).covariance
    got = system.predict(belief_of(system, [before(ahead)], [WIDE]), action).covariance[0, 0]
    limit = tolerance(system, before(ahead), WIDE, settings)
    assert 1e-6 < limit < 1e-4
    assert oracles.covariance_distance(got, want) < limit


def test_the_episode_begins_as_documented():
    worlds = oracles.worlds(RfEo(horizon=1), 3)
    halfway, drawn = RfEo(horizon=1).initial(worlds), RfEo(horizon=1, first_estimate="drawn").initial(worlds)
    np.testing.assert_array_equal(halfway.truth.targets, np.tile(SYSTEM.starts, (3, 1, 1)))
    np.testing.assert_array_equal(halfway.belief.mean, np.tile(SYSTEM.starts, (3, 1, 1)) / 2)
    error = (drawn.belief.mean - drawn.truth.targets) / np.sqrt(np.diag(WIDE))
    np.testing.assert_allclose(error, worlds.start, rtol=1e-12)
    np.testing.assert_array_equal(drawn.belief.covariance, np.tile(WIDE, (3, 2, 1, 1)))


def predicted(system, x, P, settings):
    """Weighted information (candidate, target) and covariances (candidate, target, 4, 4) of beliefs (target, ...)."""
    belief, actions = belief_of(system, x, P), system.action_set.encode(np.asarray(settings))[None]
    return system.information(belief, actions)[0], system.predict(belief, actions).covariance[0]


@pytest.mark.parametrize(("name", "total"), [("published start", 4.87e6), ("mid-run", 5.29), ("behind", 0.33)])
def test_the_weighted_information_is_no_small_number(name, total):
    """log |P^-1 + M| - log |P^-1| = sum log(1 + t), t the eigenvalues of PM; sum t is its Taylor series."""
    x, P = before(STATES[name][0]), STATES[name][1]
    t = plain.weighted_eigenvalues(SYSTEM, x, P, FIXED)
    share, covariance = predicted(SYSTEM, [x] * 2, [P] * 2, [FIXED])
    determinants = np.linalg.det([plain.predict(SYSTEM, x, P)[1], covariance[0, 0]])
    assert np.log1p(t).sum() == pytest.approx(np.log(determinants[0] / determinants[1]), rel=1e-8)
    assert t.sum() == pytest.approx(share[0, 0], rel=1e-8)
    assert t.sum() == pytest.approx(total, rel=0.01)


def test_the_two_objectives_differ_for_a_fine_and_a_coarse_image():
    """A fine image of the one target ahead has the greater trace, a coarse one of both the greater determinant.

    The constraint of 0.5 on the smallest share does not mend it: range and range-rate alone are worth more than that.
    """
    x, P = [before(at(0, 1500.0, azimuth)) for azimuth in (0.0, 0.5)], [WIDE, WIDE]
    system = RfEo(platforms=SYSTEM.platforms[:1])
    share, covariance = predicted(system, x, P, [[[20e3, 20e6, 1e-5]], [[20e3, 20e6, 2e-3]]])
    assert share[0].sum() > 1e3 * share[1].sum()
    assert np.linalg.slogdet(covariance).logabsdet.sum(axis=-1) @ [1, -1] > 2.0
    assert system.cost(belief_of(system, x, covariance[0])) > 1e3 * system.cost(belief_of(system, x, covariance[1]))
    assert share.min() > 1e3 * system.threshold


def loewner(A, B):
    """Eigenvalues of B^-1/2 A B^-1/2, from least to greatest: all at least 1 where A >= B."""
    root = np.linalg.inv(np.linalg.cholesky(B))
    return np.linalg.eigvalsh(root @ A @ root.T)


@given(seed=st.integers(0, 10_000), kind=st.sampled_from(KINDS))
def test_more_bandwidth_is_never_worse(seed, kind):
    """In Loewner's order, whatever W: B has no field of view to pay with."""
    rng = np.random.default_rng(seed)
    x, system = rng.normal(size=4) * [3e3, 50, 3e3, 50], RfEo(penalty=kind, starts=ONE)
    narrow = 10 ** rng.uniform([3, 6, -5], [5, 7, -2.21], (2, 3))
    share, covariance = predicted(system, [x], [NARROW], [narrow, narrow * [1, 2, 1]])
    assert share[1, 0] >= share[0, 0]
    assert loewner(covariance[0, 0], covariance[1, 0])[0] > 1 - 1e-9


LIMIT = plain.LIGHT * WAVELENGTH / 8  # of r |rdot|
PRFS = np.geomspace(1e3, 1e5, 60)


@given(r=st.floats(200.0, 2e5), rdot=st.floats(10.0, 700.0))
def test_prf_is_a_trade_off_only_beyond_the_limit(r, rdot):
    """Below it the least PRF that shows the range-rate is the best of all in Loewner's order, above it nothing is."""
    x = before(at(0, r, 0.4, rdot))
    system = RfEo(penalty="hard", platforms=SYSTEM.platforms[:1], starts=ONE)
    least = 4 * rdot / WAVELENGTH * (1 + 1e-9)
    prfs = np.append(PRFS, least) if 1e3 <= least <= 1e5 else PRFS
    _, low, high = platform_view(prfs, 20e6, 1e-3, WAVELENGTH, 128, 1000)
    both = ((low <= [r, rdot, 0.4]) & (high >= [r, rdot, 0.4])).all(axis=-1)
    if r * rdot > LIMIT:
        assert not both.any()
    if r * rdot < LIMIT * 0.999 and least in prfs:
        assert both[-1]
        covariance = predicted(system, [x], [NARROW], [[[f, 20e6, 1e-3]] for f in prfs])[1][:, 0]
        assert min(loewner(other, covariance[-1])[0] for other in covariance) > 1 - 1e-9


def test_far_targets_and_pairs_are_beyond_the_limit():
    """A low PRF measures the range, a high one the range-rate, neither posterior contains the other.

    Of several targets the greatest range and the greatest range-rate count, also where each target by itself is below.
    """
    system = RfEo(penalty="hard", platforms=SYSTEM.platforms[:1], starts=ONE)
    settings = [[[f, 20e6, 1e-3]] for f in (3e3, 32e3)]
    low, high = predicted(system, [before(at(0, 35e3, 0.4, 230.0))], [10 * NARROW], settings)[1][:, 0]
    eig = loewner(low, high)
    assert eig[0] < 0.95 < 1.05 < eig[-1]
    distant, fast = (30e3, 10.0), (3e3, 230.0)
    assert max(r * v for r, v in (distant, fast)) < LIMIT < distant[0] * fast[1]
    edges = platform_view(PRFS, 20e6, 1e-3, WAVELENGTH, 128, 1000).high
    assert not ((edges[:, 0] >= distant[0]) & (edges[:, 1] >= fast[1])).any()


@pytest.mark.parametrize("kind", KINDS)
def test_penalties_inside_the_field_of_view(kind):
    """Hard, deadzone, Huber: exactly 0. Logistic: 1e-3 of the plain variance up to 0.85 of the edge, of azimuth from
    1.1e-4 rad on (finer pixels leave 1e-5 rad 11 %). Log-barrier: 0 at the centre only, capped outside."""
    settings = np.array([(f, 20e6, a) for f in np.geomspace(1e3, 1e5, 9) for a in np.geomspace(1e-5, 6e-3, 9)])
    plainly, low, high = platform_view(*settings.T, WAVELENGTH, 128, 1000)
    of = (100.0 if kind != "log-barrier" else 1e8, np.array(SYSTEM.height))
    at_share = {s: fov_penalty(kind, s * high, low, high, *of) for s in (0.0, 0.85, 1 - 1e-9, 1 + 1e-9, 2.0)}
    if kind in ("hard", "deadzone", "huber"):
        assert not any(at_share[s].any() for s in (0.0, 0.85, 1 - 1e-9))
    if kind == "logistic":
        worth = at_share[0.85] / plainly
        assert worth[:, :2].max() < 1e-3
        assert worth[settings[:, 2] > 1.1e-4, 2].max() < 1e-3
        assert worth[settings[:, 2] == settings[0, 2], 2] == pytest.approx(0.112, rel=0.01)
    if kind == "log-barrier":
        assert not at_share[0.0].any()
        assert (at_share[0.85] > 0).all()
    beyond = {"deadzone": 100.0, "huber": 99.5}.get(kind, 1.0)  # 100 / nu outside
    assert at_share[2.0] == pytest.approx(np.broadcast_to(of[1], high.shape) * beyond)
