"""The RF/EO loop's episodes: what is in view, targets on top of platforms, tracks lost, consistency."""

from __future__ import annotations

import numpy as np
import oracles
import pytest
import rf_eo_oracle as plain
from scipy.stats import chi2

from wavegym.core import shortcuts, trees
from wavegym.sensors import platform_measurement
from wavegym.systems.rf_eo.system import RfEo, RfEoFar

MODES = ("missing", "inflated")
PLATFORMS, STARTS = ((-1e3, -1e3), (1e3, -1e3), (0.0, 4e3)), ((-1e3, 5, 1e3, 0), (1e3, 0, 1e3, -7), (300, 20, -2e3, 9))


def at_random(system, seed=0):
    rng = np.random.default_rng(seed)
    if system.action == "box":
        return lambda belief: rng.uniform(-1, 1, (len(belief.step), len(system.actions)))
    shape = () if system.action == "joint" else (len(system.platforms),)
    return lambda belief: rng.integers(len(system.actions), size=(len(belief.step), *shape))


def play(system, worlds, choose, steps=None):
    """States at k = 0, 1, ... and the actions between them."""
    states, actions = [system.initial(worlds)], []
    for _ in range(steps or system.horizon):
        actions.append(choose(states[-1].belief))
        states.append(system.transition(states[-1], actions[-1], worlds))
    return states, actions


def fixed(system, settings):
    """The same settings (platform, 3) at every step."""
    return lambda belief: np.repeat(system.action_set.encode(np.array(settings)[None]), len(belief.step), axis=0)


def finite(tree):
    seen = []
    trees.tree_map(lambda a: seen.append(np.isfinite(a).all()), tree)
    return all(seen)


def same(a, b):
    unequal = []
    trees.tree_map(lambda x, y: unequal.append(not np.array_equal(x, y)), a, b)
    return not any(unequal)


def all_finite(system, state):
    """Whether the state, its figures and all values that schedulers and agents compute from it are finite."""
    belief, some = state.belief, system.candidates()[None, :5]
    asked = [
        system.cost(belief),
        system.observe(belief),
        system.information(belief, some),
        shortcuts.best_action(system, belief),
    ]
    asked += [
        *system.state_info(state).values(),
        shortcuts.most_information(system, belief)[0],
        *shortcuts.plan(system, belief, 2),
    ]
    return finite(state) and finite(system.predict(belief, some)) and all(np.isfinite(a).all() for a in asked)


@pytest.mark.parametrize("platforms", [1, 2, 3])
@pytest.mark.parametrize("targets", [1, 2, 3])
def test_what_is_in_view_is_received(platforms, targets):
    """Each quantity of each target by itself, at the truth."""
    looks = (0.3, -0.5, 3.0)[:platforms]
    system = RfEo(horizon=30, platforms=PLATFORMS[:platforms], starts=STARTS[:targets], looks=looks, q=50.0)
    states, actions = play(system, oracles.worlds(system, 4), at_random(system))
    seats = np.column_stack([system.platforms, looks])
    counts = np.zeros(3 * platforms + 1, int)
    for state, action in zip(states[1:], actions, strict=True):
        view = system.action_set.view(system.action_set.settings(action)[:, None])
        q = platform_measurement(state.truth.targets[:, :, None], seats)
        inside = ((view.low <= q) & (q <= view.high)).sum(axis=(-2, -1))
        np.testing.assert_array_equal(system.state_info(state)["received"], inside)
        counts += np.bincount(inside.ravel(), minlength=len(counts))
    assert (counts > 0).sum() >= 3  # different numbers of quantities were in view
    inflated = RfEo(**{**vars_of(system), "out_of_view": "inflated"})
    states, _ = play(inflated, oracles.worlds(inflated, 4), at_random(inflated))
    assert (states[-1].truth.received == 3 * platforms).all()


def vars_of(system):
    return {name: getattr(system, name) for name in ("horizon", "platforms", "starts", "looks", "q")}


@pytest.mark.parametrize("kind", ["logistic", "hard", "deadzone", "huber", "log-barrier"])
def test_inflated_errors_have_the_predicted_covariance_where_the_truth_is_predicted(kind):
    system = RfEo(out_of_view="inflated", penalty=kind, q=0.0, iterations=1, horizon=4)
    worlds, choose = oracles.worlds(system, 3), at_random(system)
    state = system.initial(worlds)
    for _ in range(4):
        belief = state.belief._replace(mean=state.truth.targets)
        action = choose(belief)
        after = system.transition(state._replace(belief=belief), action, worlds)
        predicted = system.predict(belief, action)
        assert oracles.covariance_distance(after.belief.covariance, predicted.covariance) < 1e-9
        state = after


@pytest.mark.parametrize("kind", ["logistic", "hard"])
def test_inflated_draws_have_the_penaltys_spread(kind):
    """One platform, a range 20 % beyond Rmax: innovation over its predicted spread, gain known, is standard normal."""
    system = RfEo(
        horizon=1, q=0.0, iterations=1, out_of_view="inflated", penalty=kind, platforms=((0.0, 0.0),),
        starts=((0.0, 0.0, 3e3, 0.0),), prior_variance=(1e-6, 1e-6, 1e6, 1e-6)
    )  # fmt: skip
    worlds = oracles.worlds(system, 2000)
    state = system.initial(worlds)
    state = state._replace(belief=state.belief._replace(mean=state.truth.targets))
    after = system.transition(state, fixed(system, [[60e3, 10e6, 1e-3]])(state.belief), worlds)
    moved, variance = after.belief.mean[:, 0, 2] - 3e3, after.belief.covariance[0, 0, 2, 2]
    gain = variance / 1e8
    assert variance == pytest.approx(1 / (1 / 1e6 + 1 / 1e8), rel=1e-3)  # R~ is gamma
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 2000)
    assert low < np.square(moved / (gain * 1e4)).sum() < high


@pytest.mark.parametrize("as_printed", [False, True])
@pytest.mark.parametrize("mode", MODES)
def test_a_target_on_top_of_a_platform_is_not_measured_by_it(mode, as_printed):
    """The target rests on the first platform: the episode is the one without that platform."""
    rest = {"q": 0.0, "starts": ((0.0,) * 4,), "horizon": 12, "out_of_view": mode, "as_printed": as_printed}
    both, far = RfEo(platforms=((0, 0), (2e3, 0)), **rest), RfEo(platforms=((2e3, 0),), **rest)
    worlds = oracles.worlds(both, 3)
    states, actions = play(both, worlds, at_random(both))
    others = [action[:, 3:] for action in actions]
    alone, _ = play(far, worlds._replace(error=worlds.error[:, :, 1:].copy()), lambda belief: others.pop(0))
    for one, other in zip(states, alone, strict=True):
        assert all_finite(both, one)
        assert same(one.belief._replace(looks=other.belief.looks), other.belief)
        np.testing.assert_array_equal(one.truth.received, other.truth.received)
    assert 0 < max(state.truth.received.max() for state in states) <= 3


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    ("true_states", "estimate"),
    [((0.0, 0.0), (0.0, 0.0)), ((0.5, 0.2), (300.0, 9.0)), ((300.0, 9.0), (0.2, -0.9)), ((0.9, 0.0), (0.0, 0.9))],
)
def test_the_only_platform_measures_nothing_within_a_metre(mode, true_states, estimate):
    """Within a metre of truth or prediction the belief is the prediction; at 1.1 m it is updated."""
    system = RfEo(platforms=((0.0, 0.0),), starts=((0.0,) * 4,), horizon=3, q=0.0, out_of_view=mode)
    worlds = oracles.worlds(system, 2)

    def placed(where, estimate):
        state = system.initial(worlds)
        truth, belief = state.truth, state.belief
        truth.targets[..., ::2], belief.mean[..., ::2] = where, estimate
        assert all_finite(system, state)
        return system.transition(state, fixed(system, [[60e3, 10e6, 6e-3]])(belief), worlds), belief

    after, before = placed(true_states, estimate)
    want = [plain.predict(system, *b) for b in zip(before.mean[:, 0], before.covariance[:, 0], strict=True)]
    np.testing.assert_allclose(after.belief.mean[:, 0], [x for x, _ in want], rtol=1e-14)
    np.testing.assert_allclose(after.belief.covariance[:, 0], [P for _, P in want], rtol=1e-14)
    assert (after.truth.received == 0).all()
    assert (after.truth.unseen == 1).all()
    assert all_finite(system, after)
    after, _ = placed((1.1, 0.0), (0.0, 1.1))
    assert (after.truth.received == 3).all()


def test_a_target_out_of_view_is_not_received():
    """Far beyond Rmax, too fast and out of the image; then a low PRF shows its range."""
    system = RfEo(horizon=30, starts=((0.0, 0.0, 9e4, 1e3), *STARTS[:1]), looks=(1.0, 1.0))
    blind, low = ([[f, 10e6, 1e-4]] * 2 for f in (60e3, 1.2e3))
    worlds = oracles.worlds(system, 2)
    state = system.initial(worlds)
    for k in range(1, 16):
        state = system.transition(state, fixed(system, low if k > 13 else blind)(state.belief), worlds)
        figures = system.state_info(state)
        assert (figures["received"][:, 0] == (2 if k > 13 else 0)).all()
        assert (state.truth.unseen[:, 0] == (0 if k > 13 else k)).all()


def test_state_info_is_errors_and_the_least_information():
    system = RfEo(horizon=5, threshold=3.0)
    (*_, before, state), (*_, action) = play(system, oracles.worlds(system, 40), at_random(system))
    figures, first = system.state_info(state), system.state_info(system.initial(oracles.worlds(system, 2)))
    d = state.belief.mean - state.truth.targets
    np.testing.assert_allclose(figures["position_error"], np.hypot(d[..., 0], d[..., 2]), rtol=1e-12)
    np.testing.assert_allclose(figures["information"], system.information(before.belief, action).min(axis=1), rtol=1e-9)
    np.testing.assert_array_equal(figures["below_threshold"], figures["information"] < 3.0)
    assert 0 < figures["below_threshold"].mean() < 1
    assert not first["below_threshold"].any()
    assert not first["information"].any()


def mean_nees(system, steps=5, seed=1):
    """Means over 200 worlds of each step under the system's own choice, and how many values are in one."""
    states, _ = play(system, oracles.worlds(system, 200, seed), shortcuts.best_action.of(system), steps)
    values = np.array([system.state_info(state)["nees"] for state in states[1:]])
    return values.mean(axis=(1, 2)), values[0].size


@pytest.mark.slow
@pytest.mark.parametrize("system", [RfEo(horizon=5), RfEo(horizon=5, first_estimate="drawn"), RfEoFar(horizon=5)])
def test_the_iterated_filter_is_consistent_from_the_first_step(system):
    """Mean NEES of 200 worlds: each step inside its 99.9 % bounds, all five together inside the 95 % ones of one."""
    means, count = mean_nees(system)
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 4 * count) / count
    assert ((means > low) & (means < high)).all()
    low, high = chi2.ppf([0.025, 0.975], 4 * count) / count
    assert low < means.mean() < high


@pytest.mark.slow
def test_after_a_range_alone_the_belief_is_as_wide_as_the_posterior():
    """One platform measures a range of 35 km to 2 m over a prior of 1 km: the posterior bends by 14 m.

    Oracle: a million draws of the prior, weighted. Mean to 0.2 standard deviations; no direction is too narrow by more
    than 15 % of the variance, and none too wide by more than 80 % (sigma points count half as much again of the bend).
    """
    system = RfEo(
        horizon=1, q=0.0, platforms=((0.0, 0.0),), starts=((0.0, 0.0, 35e3, 0.0),), first_estimate="drawn",
        prior_variance=(1e6, 25.0, 1e6, 25.0)
    )  # fmt: skip
    worlds, rng = oracles.worlds(system, 4, 2), np.random.default_rng(1)
    state = system.initial(worlds)
    action = np.repeat(system.action_set.encode(np.array([[[3e3, 20e6, 1e-5]]])), 4, axis=0)
    report = system.measure(system.move(state.truth, state.belief.step, worlds), state.belief, action, worlds)
    report.variance[..., 1:] = np.inf
    after, F = system.track(state.belief, action, report), system.motion.F
    for e in range(4):
        spread = np.linalg.cholesky(F @ state.belief.covariance[e, 0] @ F.T)
        drawn = F @ state.belief.mean[e, 0] + rng.standard_normal((1_000_000, 4)) @ spread.T
        miss = report.z[e, 0, 0] - np.hypot(drawn[:, 0], drawn[:, 2])
        weight = np.exp(-0.5 * miss * miss / report.variance[e, 0, 0])
        assert weight.sum() ** 2 > 1000 * np.square(weight).sum()  # effective draws
        mean = np.average(drawn, axis=0, weights=weight)
        P = np.cov(drawn.T, aweights=weight)
        ratios = np.linalg.eigvals(np.linalg.solve(P, after.covariance[e, 0])).real
        off = np.linalg.solve(np.linalg.cholesky(P), after.mean[e, 0] - mean)
        assert np.abs(off).max() < 0.2
        assert ratios.min() > 0.85
        assert ratios.max() < 1.8


def test_the_plain_extended_filter_is_not_consistent():
    """One linearisation at the halfway estimate: a NEES of thousands where 4 is right, and no better four steps on."""
    means, _ = mean_nees(RfEo(horizon=5, iterations=1))
    assert means[0] > 1000
    assert means.min() > 100
