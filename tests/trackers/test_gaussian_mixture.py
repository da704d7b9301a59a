"""The Gaussian-mixture tracker against every history of associations, and its reduction against its moments."""

from __future__ import annotations

import numpy as np
import pytest

from tests.trackers.test_rbpf import (
    DENSITY,
    NOISE,
    PG,
    SCENES,
    SENSORS,
    F,
    Q,
    every_history,
    exact,
    predict_ahead,
    scene,
)
from wavegym.core.errors import InputError
from wavegym.trackers import GaussianMixture, jpda_update, mixture_update, predict, single_gaussian
from wavegym.trackers import gaussian_mixture_kernels as kernels
from wavegym.trackers.ukf_kernels import predict_measurement_one

EVERY = {"negligible": 0.0}  # no hypothesis is merged while places are free
NN = (0,) * 4


def ahead(mixture):
    """All components one step on."""
    return GaussianMixture(mixture.weight, *predict(mixture.mean, mixture.covariance, F, Q))


def filtered(s, components, **settings):
    """Each step's ``MixtureUpdate``."""
    mixture = single_gaussian(s.mean, s.covariance, components)
    for k, scans in enumerate(s.scans):
        mixture = mixture if k == 0 else ahead(mixture)
        done = mixture_update(mixture, scans, s.pd, s.noise, SENSORS, DENSITY, gate_probability=PG, **settings)
        yield done
        mixture = done.mixture


def far_apart(seed):
    """Two targets that share no return in three steps: their histories factorise."""
    steps = [[(0, 1, "clutter"), (0, 1)], [(1, "clutter"), (0, 1)], [(0, 1), (0,)]]
    return scene(steps, apart=9000.0, seed=seed)


def sigmas(covariance):
    return np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))


def assert_equal_moments(ours, mean, covariance, tolerance=1e-9):
    """Errors in standard deviations."""
    sigma = sigmas(covariance)
    assert np.abs((ours.mean - mean) / sigma).max() < tolerance
    assert np.abs((ours.covariance - covariance) / (sigma[..., None] * sigma[..., None, :])).max() < tolerance


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_one_target_keeps_every_history(seed):
    steps = [[(0, "clutter"), ("clutter",)], [(), (0, "clutter")], [(0,), (0,)]]
    s = scene(steps, targets=1, seed=seed)
    *_, last = done = list(filtered(s, 200, **EVERY))
    log_weight, x, P = every_history(s)
    used = last.mixture.weight[0] > 0.0
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    here = weight > 1e-30  # farther histories underflow beside the others
    assert used.sum() >= here.sum()
    order, wanted = np.argsort(-last.mixture.weight[0][used]), np.argsort(-weight)
    count = here.sum()
    np.testing.assert_allclose(last.mixture.weight[0][used][order][:count], weight[wanted][:count], rtol=1e-6)
    first = wanted[0], order[0]
    np.testing.assert_allclose(last.mixture.mean[0, first[1]], x[first[0], 0], rtol=1e-9)
    np.testing.assert_allclose(last.mixture.covariance[0, first[1]], P[first[0], 0], rtol=1e-6, atol=1e-9)
    mean, covariance, log_evidence = exact(s)
    assert_equal_moments(last, mean, covariance)
    assert sum(d.log_evidence for d in done) == pytest.approx(log_evidence, rel=1e-9)


@pytest.mark.parametrize("seed", [1, 2])
def test_targets_without_a_common_return_keep_every_history(seed):
    s = far_apart(seed)
    *_, last = list(filtered(s, 300, **EVERY))
    mean, covariance = (np.concatenate(each) for each in zip(*(alone(s, t) for t in range(2)), strict=True))
    assert_equal_moments(last, mean, covariance)


def alone(s, t):
    """The exact moments of target t where the other one's returns are clutter: far away, they weigh nothing."""
    part = s._replace(mean=s.mean[t : t + 1], covariance=s.covariance[t : t + 1], pd=s.pd[:, t : t + 1])
    return exact(part._replace(noise=s.noise[:, t : t + 1]))[:2]


@pytest.mark.parametrize("targets", [2, 3])
def test_targets_that_share_returns_have_the_exact_marginals_of_a_scan(targets):
    s = scene([[(0, 1, "clutter"), ()]], targets=targets)
    one = s._replace(scans=[s.scans[0][:1]])
    done = mixture_update(
        single_gaussian(s.mean, s.covariance, 10), one.scans[0], s.pd[:1], s.noise[:1], SENSORS[:1], DENSITY,
        gate_probability=PG, **EVERY,
    )  # fmt: skip
    mean, covariance, log_evidence = exact(one)
    assert_equal_moments(done, mean, covariance)
    assert done.log_evidence == pytest.approx(log_evidence, rel=1e-9)


@pytest.mark.parametrize("name", ["one target, three steps", "two targets that stay apart"])
def test_few_components_are_close_to_every_history(name):
    """Sixteen components and the default limits: a twentieth of a standard deviation."""
    s = SCENES[name]
    *_, last = filtered(s, 16)
    mean, covariance, _ = exact(s)
    assert_equal_moments(last, mean, covariance, 0.05)


def test_one_component_is_jpda():
    s = SCENES["two targets, two steps"]
    z, noise = s.scans[0][1], s.noise[1]
    done = mixture_update(
        single_gaussian(s.mean, s.covariance, 1), [z], s.pd[1:], noise[None], SENSORS[1:], DENSITY, 6.0, PG
    )
    centre, S, G = np.empty((2, 2)), np.empty((2, 2, 2)), np.empty((2, 4, 2))
    for t in range(2):
        predict_measurement_one(t, t, s.mean, s.covariance, *SENSORS[1], np.empty((2, 4, 4)), centre, S, G, NN)
    x, P = jpda_update(s.mean, s.covariance, z, centre, S + noise, G, s.pd[1], DENSITY, 6.0, PG)[:2]
    assert_equal_moments(done, x, P, 1e-12)


def random_mixture(rng, count):
    """Weights (count,), means (count, 4), covariances (count, 4, 4)."""
    A = rng.standard_normal((count, 4, 4))
    return rng.dirichlet(np.ones(count)), 3.0 * rng.standard_normal((count, 4)), A @ A.swapaxes(1, 2) + np.eye(4)


def reduced(w, x, P, components, similar=0.0):
    mixture = GaussianMixture(np.empty(components), np.zeros((components, 4)), np.zeros((components, 4, 4)))
    kernels.reduce(w, x, P, len(w), similar, *mixture, NN)
    return mixture


def moments(w, x, P):
    mean = w @ x
    d = x - mean
    return mean, np.einsum("c,cij->ij", w, P + d[:, :, None] * d[:, None])


@pytest.mark.parametrize("components", [1, 2, 7, 30])
def test_reduction_preserves_mean_and_covariance(components):
    rng = np.random.default_rng(components)
    w, x, P = random_mixture(rng, 30)
    ours = reduced(w, x, P, components)
    assert (ours.weight > 0.0).sum() == components
    np.testing.assert_allclose(ours.weight.sum(), 1.0, rtol=1e-12)
    for value, wanted in zip(moments(*ours), moments(w, x, P), strict=True):
        np.testing.assert_allclose(value, wanted, atol=1e-12)


def merging_cost(w, x, P, i, j):
    """Runnalls's bound, written out."""
    pair = [i, j]
    both = w[pair] / w[pair].sum()
    logs = np.linalg.slogdet(np.array([moments(both, x[pair], P[pair])[1], P[i], P[j]]))[1]
    return 0.5 * (w[pair].sum() * logs[0] - w[i] * logs[1] - w[j] * logs[2])


def test_the_lightest_joins_the_component_that_costs_least():
    rng = np.random.default_rng(5)
    for _ in range(20):
        w, x, P = random_mixture(rng, 5)
        last = w.argmin()
        others = [i for i in range(5) if i != last]
        best = min(others, key=lambda i: merging_cost(w, x, P, i, last))
        ours = reduced(w, x, P, 4)
        both = [best, last]
        wanted = moments(w[both] / w[both].sum(), x[both], P[both])
        at = np.abs(ours.mean - wanted[0]).sum(axis=1).argmin()
        np.testing.assert_allclose(ours.weight[at], w[both].sum(), rtol=1e-12)
        np.testing.assert_allclose(ours.covariance[at], wanted[1], rtol=1e-12)


def searched(w, x, P, components, similar):
    """``reduce`` with the cost of every merger by NumPy."""
    mixture = []
    for i in np.argsort(-w, kind="stable"):
        all_of = [np.array([w[i], *(m[0] for m in mixture)]), np.array([x[i], *(m[1] for m in mixture)])]
        all_of.append(np.array([P[i], *(m[2] for m in mixture)]))
        costs = [merging_cost(*all_of, 0, c + 1) for c in range(len(mixture))]
        if len(mixture) < components and not min(costs, default=np.inf) <= similar:
            mixture.append((w[i], x[i], P[i]))
        else:
            c = int(np.argmin(costs))
            pair = [0, c + 1]
            both = all_of[0][pair].sum()
            mixture[c] = (both, *moments(all_of[0][pair] / both, all_of[1][pair], all_of[2][pair]))
    return [np.array(each) for each in zip(*mixture, strict=True)]


def branched(rng, spread):
    """A mixture as branching makes it: few covariances, thin ones and wide ones, and many means."""
    w, x, P = random_mixture(rng, 40)
    scale = np.exp(3.0 * rng.standard_normal(4))
    of = rng.integers(4, size=40)
    return w, spread * scale * x, scale[:, None] * scale * (P[of] * np.exp(rng.standard_normal(4))[of, None, None])


@pytest.mark.parametrize("similar", [0.0, 0.006, 0.1])
@pytest.mark.parametrize("spread", [0.03, 0.3, 3.0])
def test_no_cheaper_merger_is_left_out(spread, similar):
    """Reduction skips mergers by a lower bound of their cost; a search through all of them finds the same mixture."""
    for seed in range(5):
        w, x, P = branched(np.random.default_rng(seed), spread)
        for components in (3, 16):
            ours, wanted = reduced(w, x, P, components, similar), searched(w, x, P, components, similar)
            used = len(wanted[0])
            assert (ours.weight > 0.0).sum() == used
            for value, each in zip(ours, wanted, strict=True):
                np.testing.assert_allclose(value[:used], each, rtol=1e-9, atol=1e-9 * np.abs(each).max())


def test_a_floor_is_not_above_its_cost():
    rng, shares = np.random.default_rng(3), []
    for spread in (0.01, 0.1, 1.0, 10.0):
        w, x, P = branched(rng, spread)
        areas, floor, planar = np.empty(40), np.empty(40), np.log(np.linalg.det(P[:, :2, :2]))
        for i in range(40):
            first = kernels.merger_floors(
                w[i], i, x, P, planar[i], w, x, P, planar, 40, areas, areas.view(np.int64), floor
            )  # fmt: skip
            costs = np.array([merging_cost(w, x, P, i, c) for c in range(40)])
            assert (floor <= costs).all()
            assert first == floor.argmin()
            shares.append((floor > costs.min()).mean())
    assert np.mean(shares) > 0.5  # the bound is of use


def test_similar_components_are_merged_where_places_are_free():
    w, x = np.array([0.6, 0.4]), np.array([[0.0] * 4, [0.1, 0.0, 0.0, 0.0]])
    P = np.tile(np.diag([0.5, 0.5, 2.0, 3.0]), (2, 1, 1))
    cost = merging_cost(w, x, P, 0, 1)
    assert cost == pytest.approx(0.5 * np.log1p(0.24 * 0.02))
    assert (reduced(w, x, P, 3, 1.01 * cost).weight > 0.0).sum() == 1
    assert (reduced(w, x, P, 3, 0.99 * cost).weight > 0.0).sum() == 2


def test_light_hypotheses_are_merged_into_their_parents():
    """Where every weight is negligible each component is updated by PDA, and no moment is lost."""
    s = SCENES["one target, three steps"]
    z, mixture = s.scans[0][:1], single_gaussian(s.mean, s.covariance, 10)
    done = mixture_update(mixture, z, s.pd[:1], s.noise[:1], SENSORS[:1], DENSITY, gate_probability=PG, negligible=20.0)
    assert (done.mixture.weight > 0.0).sum() == 1
    mean, covariance, log_evidence = exact(s._replace(scans=[z]))
    assert_equal_moments(done, mean, covariance)
    assert done.log_evidence == pytest.approx(log_evidence, rel=1e-9)


def test_gates_are_those_of_the_components():
    """A return in no component's gate is clutter, though the gate of the mixture's moments holds it."""
    s = scene([[(), ()]], targets=1)
    mean = s.mean + np.array([[0.0, -600.0, 0.0, 0.0], [0.0, 600.0, 0.0, 0.0]])
    covariance = np.tile(s.covariance[0], (2, 1, 1))
    mixture = GaussianMixture(np.array([[0.5, 0.5]]), mean[None], covariance[None])
    centre, S, _ = predict_ahead(mean[0], covariance[0], NOISE, SENSORS[0])
    outside = centre + np.linalg.cholesky(S) @ [5.0, 0.0]  # 5 standard deviations away
    done = mixture_update(mixture, [outside[None]], s.pd[:1], s.noise[:1], SENSORS[:1], DENSITY, 4.0, PG)
    assert_equal_moments(done, *(a[None] for a in moments(mixture.weight[0], mean, covariance)), 1e-12)
    assert done.log_evidence == pytest.approx(np.log(1.0 - s.pd[0, 0] * PG))
    wider = mixture_update(mixture, [outside[None]], s.pd[:1], s.noise[:1], SENSORS[:1], DENSITY, 5.1, PG)
    assert wider.log_evidence > done.log_evidence


def test_no_sensor_and_no_return_are_fine():
    s = scene([[(), ()]], targets=2)
    mixture = single_gaussian(s.mean, s.covariance, 3)
    nothing = mixture_update(mixture, [], np.empty((0, 2)), np.empty((0, 2, 2, 2)), np.empty((0, 2)), DENSITY)
    assert nothing.log_evidence == 0.0
    assert (nothing.mean == s.mean).all()
    missed = mixture_update(mixture, [[], []], s.pd, s.noise, SENSORS, DENSITY, gate_probability=PG)
    assert missed.log_evidence == pytest.approx(np.log(1.0 - s.pd * PG).sum())


def good():
    s = scene([[(0,), (0,)]], targets=2)
    return {
        "mixture": single_gaussian(s.mean, s.covariance, 2), "measurements": s.scans[0], "pd": s.pd, "noise": s.noise,
        "sensors": SENSORS, "clutter_density": DENSITY,
    }  # fmt: skip


MIXTURE = good()["mixture"]
BAD = {
    "clutter_density": (0.0, "clutter_density is 0.0, expected finite numbers > 0"),
    "clutter_density too small": (1e-320, "expected more: the evidence of sensor 0 overflows"),
    "pd": (np.ones((2, 2)), r"pd\[0, 0\] is 1.0, expected probabilities in \(0, 1\)"),
    "noise": (-good()["noise"], r"noise\[0, 0\] has the eigenvalue"),
    "gate": (0.0, r"gate is 0.0, expected a number > 0"),
    "gate not a number": (np.nan, r"gate is nan, expected a number > 0"),
    "gate_probability": (0.0, "gate_probability is 0.0"),
    "negligible": (-1.0, "negligible is -1.0, expected a finite number >= 0"),
    "negligible not finite": (np.inf, "negligible is inf, expected a finite number >= 0"),
    "mixture of half weight": (MIXTURE._replace(weight=0.5 * MIXTURE.weight), "the sum of a row of weight"),
    "mixture with a gap": (
        MIXTURE._replace(weight=MIXTURE.weight[:, ::-1]),
        "weight has a component after a free place, expected the components in use first",
    ),
    "mixture without a covariance": (
        MIXTURE._replace(covariance=0.0 * MIXTURE.covariance),
        r"covariance\[0\] has the eigenvalue 0",
    ),
    "mixture of another shape": (MIXTURE._replace(mean=MIXTURE.mean[..., :3]), r"mean has the shape \(2, 2, 3\)"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_named(name):
    value, message = BAD[name]
    with pytest.raises(InputError, match=message) as caught:
        mixture_update(**(good() | {name.split()[0]: value}))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("mean", "components", "message"),
    [
        (np.zeros((2, 4)), 0, "components is 0, expected an integer >= 1"),
        (np.zeros((3, 4)), 2, r"mean and covariance have the shapes \(3, 4\) and \(2, 4, 4\)"),
    ],
)
def test_a_bad_start_is_named(mean, components, message):
    with pytest.raises(InputError, match=message):
        single_gaussian(mean, np.zeros((2, 4, 4)), components)
