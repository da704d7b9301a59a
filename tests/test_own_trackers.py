"""Trackers of other packages and of one's own: the same worlds, the same costs, the shipped agent."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

import gymnasium as gym
import numpy as np
import oracles
import pytest

from wavegym.core import shortcuts
from wavegym.core.action_sets import Library
from wavegym.core.errors import InputError
from wavegym.envs.rewards import REWARDS
from wavegym.envs.vector import WaveformVectorEnv
from wavegym.evaluation import compare
from wavegym.evaluation.play import make_task
from wavegym.registration import full_id
from wavegym.schedulers.registry import SCHEDULERS
from wavegym.systems.composed import LinearTargets, LineOfSightRadar, Loop, Pulses, WeightedTrace
from wavegym.systems.kershaw_evans.system import KershawEvans, KershawEvansPosition
from wavegym.systems.rf_eo.system import RfEo, RfEoFar
from wavegym.targets import constant_velocity
from wavegym.testing import check_vector_env
from wavegym.testing.shortcut_check import shortcut_defect
from wavegym.trackers.polar_kernels import to_polar
from wavegym.trackers.protocol import Estimate, ExtendedKalman, MeasurementModel, OneByOne, Scan
from wavegym.waveforms import TrapezoidChirp
from wavegym.waveforms.chirp_laws import CHIRP_LAWS

EXAMPLE = Path(__file__).parents[1] / "examples" / "own_parts"
ID, WORLDS = "wavegym/KershawEvansPosition-v0", 10


@pytest.fixture(scope="module", autouse=True)
def _on_the_path():
    """The package is imported, and what it registers is forgotten afterwards."""
    known = [(registry, dict(registry.added)) for registry in (SCHEDULERS, REWARDS, CHIRP_LAWS)]
    sys.path.insert(0, str(EXAMPLE))
    yield
    sys.path.remove(str(EXAMPLE))
    for name in [name for name in sys.modules if name.split(".")[0] == EXAMPLE.name]:
        del sys.modules[name]
    for registry, added in known:
        registry.added.clear()
        registry.added.update(added)


@pytest.fixture(scope="module")
def plain():
    return compare(ID, ["myopic", "ppo"], worlds=WORLDS, jobs=1)


@pytest.mark.filterwarnings("ignore:.*parameters that differ")
@pytest.mark.parametrize("name", ["filterpy_ekf", "filterpy_ukf", "stonesoup_kalman"])
@pytest.mark.slow
def test_the_filters_of_other_packages_cost_the_same(plain, name) -> None:
    """The loop is linear, so all are the Kalman filter: only rounding differs. The agent keeps its gain."""
    other = compare(ID, ["myopic", "ppo"], worlds=WORLDS, jobs=1, tracker=f"own_parts.trackers:{name}")
    for policy in ("myopic", "ppo"):
        np.testing.assert_allclose(other.cost(policy), plain.cost(policy), rtol=1e-8)
    assert other.cost("ppo").mean() < 0.9 * other.cost("myopic").mean()


@pytest.mark.filterwarnings("ignore:.*parameters that differ")
def test_a_tracker_of_ones_own_costs_more(plain) -> None:
    """It forgets, so its covariance stays larger than the Kalman filter's, which is the least."""
    from own_parts.trackers import FadingMemory

    other = compare(ID, ["myopic", "ppo"], worlds=WORLDS, jobs=1, tracker=FadingMemory(1.2))
    assert (other.cost("myopic") > plain.cost("myopic")).all()
    assert other.cost("ppo").mean() < other.cost("myopic").mean()
    np.testing.assert_allclose(
        compare(ID, ["myopic"], worlds=WORLDS, jobs=1, tracker=FadingMemory(1.0)).cost("myopic"),
        plain.cost("myopic"),
        rtol=1e-8,
    )


def test_returns_of_one_target_add_their_information() -> None:
    """The information form: P^-1 grows by H' R^-1 H and P^-1 x by H' R^-1 z for each return."""
    rng, H = np.random.default_rng(0), np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 2.0]])
    mean, P = rng.standard_normal((4, 2, 3)), oracles.random_covariance(rng, 3, (4, 2))
    z, R = rng.standard_normal((4, 3, 2)), oracles.random_covariance(rng, 2, (4, 3))
    model = MeasurementModel(lambda x: x @ H.T, lambda x: np.broadcast_to(H, (*x.shape[:-1], 2, 3)))
    scan = Scan(z, np.ones((4, 3), bool), np.ones((4, 3), int), R, model)
    after = ExtendedKalman().update(Estimate(mean, P), scan)
    np.testing.assert_array_equal(after.mean[:, 0], mean[:, 0])
    for e in range(4):
        information, weighted = np.linalg.inv(P[e, 1]), np.linalg.solve(P[e, 1], mean[e, 1])
        for i in range(3):
            information = information + H.T @ np.linalg.solve(R[e, i], H)
            weighted = weighted + H.T @ np.linalg.solve(R[e, i], z[e, i])
        np.testing.assert_allclose(after.covariance[e, 1], np.linalg.inv(information), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(after.mean[e, 1], np.linalg.solve(information, weighted), rtol=1e-9, atol=1e-12)


def test_each_target_is_predicted_with_its_own_process_noise() -> None:
    """All at once, and one by one with a filter that takes one matrix."""
    from own_parts.trackers import filterpy_ekf

    rng, motion = np.random.default_rng(0), constant_velocity(2.0, 1.0, ("x", "y"))
    mean, P, density = rng.standard_normal((3, 2, 4)), oracles.random_covariance(rng, 4, (3, 2)), rng.random((3, 2))
    for tracker in (ExtendedKalman(), filterpy_ekf()):
        after = tracker.predict(Estimate(mean, P), motion.scaled(density))
        for at in np.ndindex(3, 2):
            want = motion.F @ P[at] @ motion.F.T + constant_velocity(2.0, density[at], ("x", "y")).Q
            np.testing.assert_allclose(after.covariance[at], want, rtol=1e-12)
            np.testing.assert_allclose(after.mean[at], motion.F @ mean[at], rtol=1e-12)


ALWAYS_SEEN = {"hidden": (0, 0), "half_field": 1.5, "settle": 0, "detection": 1.0}


def followed(name, worlds, steps, **settings):
    """NEES (step, env, target), and the beliefs, with actions that change every fourth step."""
    system = make_task(name, settings).system
    tapes, rng = oracles.worlds(system, worlds), np.random.default_rng(0)
    states, actions = [system.initial(tapes)], rng.integers(len(system.actions), size=(steps // 4 + 1, worlds))
    for action in np.repeat(actions, 4, axis=0)[:steps]:
        states.append(system.transition(states[-1], action, tapes))
    return np.array([system.state_info(state)["nees"] for state in states]), [state.belief for state in states]


@pytest.mark.parametrize(
    ("name", "settings", "tracker"),
    [
        ("SectorSetup", {"receivers": ((-4e3, 3e3),), "iterations": 1}, "kalman"),  # whose step is an extended filter's
        ("SectorSetup", {}, "own_parts.trackers:filterpy_ekf"),
        pytest.param("SectorSetupCity", {}, "own_parts.trackers:filterpy_ekf", marks=pytest.mark.slow),
        ("CameraSlew", {}, "own_parts.trackers:filterpy_ekf"),
        ("CameraSlew", ALWAYS_SEEN, "own_parts.trackers:stonesoup_kalman"),
    ],
)
def test_extended_filters_are_one_in_systems_that_look(name, settings, tracker) -> None:
    """The built-in one, those of other packages one by one, and all targets at once."""
    one, other = (followed(name, 3, 16, tracker=t, **settings)[1] for t in (ExtendedKalman(), tracker))
    for own, peer in zip(one, other, strict=True):
        np.testing.assert_allclose(own.mean, peer.mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(own.covariance, peer.covariance, rtol=1e-9, atol=1e-9)
        if name == "CameraSlew":  # whose schedulers predict in polar coordinates
            polar = to_polar(own.mean, own.covariance, np.zeros(3))
            np.testing.assert_array_equal(own.polar_mean, polar[0])
            np.testing.assert_array_equal(own.polar_covariance, polar[1])


class Recording(ExtendedKalman):
    """Keeps every scan."""

    def __init__(self) -> None:
        self.scans: list[Scan] = []

    def update(self, estimate, scan):
        self.scans.append(scan)
        return super().update(estimate, scan)


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("CameraSlew", {"platforms": ((0.0, 0.0), (1e3, -2e3))}),
        ("SectorSetup", {}),
        pytest.param("SectorSetupCity", {}, marks=pytest.mark.slow),
    ],
)
def test_a_scan_is_the_true_targets_with_the_stated_error(name, settings) -> None:
    """Squared errors over their covariance have the mean of chi-square; derivatives are those of finite differences.

    The camera's direction is a unit vector, whose error has one dimension of two. A covariance at the predicted range
    is 5 % off.
    """
    tracker = Recording()
    system = make_task(name, {"tracker": tracker, **settings}).system
    tapes, rng = oracles.worlds(system, 200), np.random.default_rng(0)
    state, found = system.initial(tapes), {}
    for action in np.repeat(rng.integers(len(system.actions), size=(3, 200)), 5, axis=0):
        tracker.scans.clear()
        state = system.transition(state, action, tapes)
        for k, scan in enumerate(tracker.scans):
            rows, i = np.nonzero(scan.present)
            truth, R = state.truth.targets[rows, scan.target[rows, i]], scan.R[rows, i]
            error = scan.z[rows, i] - scan.model.measure(truth)
            found.setdefault(k, []).append(np.einsum("ra,rab,rb->r", error, np.linalg.inv(R), error))
            steps = np.array([1e-2, 1e-3, 1e-2, 1e-3])[:, None] * np.eye(4)
            slopes = [(scan.model.measure(truth + d) - scan.model.measure(truth - d)) / (2 * d.sum()) for d in steps]
            np.testing.assert_allclose(scan.model.jacobian(truth), np.stack(slopes, axis=-1), rtol=1e-4, atol=1e-7)
    for k, errors in found.items():
        squared, is_direction = np.concatenate(errors), name == "CameraSlew" and k == len(found) - 1
        n = 1 if is_direction else tracker.scans[k].z.shape[-1]
        assert abs(squared.mean() - n) < 5.0 * np.sqrt(2.0 * n / squared.size) + (0.05 * n if "Sector" in name else 0.0)


def test_an_extended_filter_is_consistent_where_the_camera_always_sees() -> None:
    """Mean NEES over 60 steps within three standard errors of 4; errors are correlated over some ten steps."""
    nees, _ = followed("CameraSlew", 100, 60, tracker=ExtendedKalman(), **ALWAYS_SEEN)
    assert abs(nees.mean() - 4.0) < 3.0 * np.sqrt(2.0 * 4.0 / (nees.size / 10.0))


def test_schedulers_look_with_the_process_noise_that_the_tracker_believes_in() -> None:
    """Twice the noise in a belief is twice the density; the tracker's own model stays."""
    for name in ("CameraSlew", "SectorSetup"):
        system = make_task(name, {}).system
        belief = system.initial(oracles.worlds(system, 2)).belief
        told, doubled = belief._replace(process_noise=system.motion.scaled(2.0 * belief.q).Q), 2.0 * belief.q
        want, every = belief._replace(q=doubled), system.candidates()[None]
        np.testing.assert_allclose(system.observe(told), system.observe(want), rtol=1e-12)
        np.testing.assert_allclose(
            shortcuts.gain(system, told, 2, 5), shortcuts.gain(system, want, 2, 5), rtol=1e-12, atol=1e-12
        )
        ahead = system.predict(told, every)
        np.testing.assert_allclose(ahead.covariance, system.predict(want, every).covariance, rtol=1e-12)
        np.testing.assert_array_equal(ahead.q[:, 0], belief.q)
        np.testing.assert_array_equal(ahead.process_noise[:, -1], told.process_noise)


def test_a_tracker_of_ones_own_passes_the_check_of_shortcuts() -> None:
    assert shortcut_defect(KershawEvans(tracker="own_parts.trackers:filterpy_ekf", horizon=6)) is None


ONE = {"platforms": ((-1e3, -1e3),), "iterations": 1}
NEAR = {"first_estimate": "drawn", "prior_variance": (1e3, 4.0, 1e3, 4.0)}
FAR = {"folding": True, "prf": (2e3, 1e5), "starts": ((-5e3, 0.0, 20e3, 230.0), (0.0, 0.0, 30e3, -210.0))}


@pytest.mark.parametrize(
    "settings",
    [
        {}, {"slew_rate": 0.3}, {"as_printed": True}, {"out_of_view": "inflated"}, {"births": (0, 5), "lifetime": 12},
        FAR, {"looks": (3.0,), "starts": ((-1e3, 0.0, -3e3, 0.0), (-1e3, 3.0, -2e3, 1.0))},
    ],
)  # fmt: skip
def test_a_kalman_filter_of_ones_own_is_that_of_one_platform(settings) -> None:
    """The compiled filter with one linearisation updates by single quantities, this one by all that come together.

    The last case: azimuths on both sides of pi.
    """
    settings = {**ONE, **NEAR, **settings}
    system, own = RfEo(**settings), RfEo(**settings, tracker=ExtendedKalman())
    worlds, rng, received = oracles.worlds(system, 4), np.random.default_rng(3), []
    state, other = system.initial(worlds), own.initial(worlds)
    for _ in range(30):
        action = rng.uniform(-1.0, 1.0, (4, len(system.action_set.box)))
        state, other = system.transition(state, action, worlds), own.transition(other, action, worlds)
        received.append(state.truth.received)
        np.testing.assert_array_equal(other.truth.received, state.truth.received)
        deviation = np.sqrt(np.diagonal(state.belief.covariance, axis1=-2, axis2=-1))
        scale = deviation[..., :, None] * deviation[..., None, :]
        for error in (
            (other.belief.mean - state.belief.mean) / deviation,
            (other.belief.covariance - state.belief.covariance) / scale,
        ):
            assert np.abs(error).max() < 1e-7
    assert "out_of_view" in settings or len(np.unique(received)) > 1


def test_a_filter_for_one_target_plays_with_several_platforms() -> None:
    system, other = (RfEo(**NEAR, tracker=by) for by in (ExtendedKalman(), "own_parts.trackers:filterpy_ekf"))
    worlds, action = oracles.worlds(system, 2), np.zeros((2, 6))
    state, same = system.initial(worlds), other.initial(worlds)
    for _ in range(5):
        state, same = system.transition(state, action, worlds), other.transition(same, action, worlds)
    np.testing.assert_allclose(same.belief.mean, state.belief.mean, rtol=1e-9)
    np.testing.assert_allclose(same.belief.covariance, state.belief.covariance, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_a_tracker_with_a_memory_conforms_in_every_loop() -> None:
    """Resets of single environments, unpickled copies, and schedulers that predict with its own process noise."""
    from own_parts.trackers import AdaptiveNoise

    for id in (ID, "wavegym/RfEo-v0"):
        check_vector_env(id, tracker=AdaptiveNoise(), horizon=6)
    assert shortcut_defect(KershawEvansPosition(tracker=AdaptiveNoise(), horizon=6)) is None
    assert shortcut_defect(RfEo(tracker=AdaptiveNoise(), horizon=6)) is None
    own = KershawEvansPosition()
    targets = LinearTargets(own.motion, ((15e3, 0.0),) * 2, ((25e3, 300.0),) * 2, own.prior_variance)
    parts = {"sensor": LineOfSightRadar(), "waveforms": Pulses(own.actions, own.carrier_hz)}
    loop = Loop(targets=targets, **parts, objective=WeightedTrace((1, 0)), tracker=AdaptiveNoise(), horizon=6)
    check_vector_env(partial(WaveformVectorEnv, loop))


def test_a_memory_follows_the_world_where_the_model_does_not() -> None:
    """The tracker assumes q = 1; the targets manoeuvre with 100, which the size of the innovations tells."""
    from own_parts.trackers import AdaptiveNoise

    nees, noise = {}, {}
    for tracker in (None, AdaptiveNoise()):
        env = gym.make_vec(ID, num_envs=300, q=1.0, truth={"q": 100.0}, tracker=tracker)
        env.reset(seed=3)
        found = [env.step(np.full(300, 12))[-1]["nees"].mean() for _ in range(40)]
        nees[tracker], noise[tracker] = np.mean(found[20:]), env.unwrapped.belief.process_noise
    adaptive = next(name for name in nees if name)
    assert nees[adaptive] < 0.5 * nees[None]
    assert noise[None] is None
    assert np.median(noise[adaptive][:, 1, 1]) > 2.0  # q dt = 1 at first


def test_schedulers_predict_with_the_process_noise_that_the_tracker_believes_in() -> None:
    """A noise that is four times the model's in one environment of two, against a system whose model it is."""
    system, other = (KershawEvansPosition(q=q) for q in (100.0, 400.0))
    belief = system.initial(oracles.worlds(system, 2)).belief
    noise = np.stack([system.motion.Q, other.motion.Q])
    told = belief._replace(process_noise=noise)
    every = system.candidates()[None]
    got = system.predict(told, every)
    for e, model in enumerate((system, other)):
        alone, row = oracles.rows(belief, slice(e, e + 1)), oracles.rows(got, e)
        want = oracles.rows(model.predict(alone, every), 0)
        np.testing.assert_array_equal(row.covariance, want.covariance)
        np.testing.assert_array_equal(row.process_noise, np.broadcast_to(noise[e], row.covariance.shape))
        for depth in (1, 2):
            cost = shortcuts.best_sequence(model, alone, depth)[1]
            np.testing.assert_array_equal(shortcuts.best_sequence(system, told, depth)[1][e], cost[0])
        np.testing.assert_array_equal(
            shortcuts.innovation_covariance(system, told, every)[e],
            shortcuts.innovation_covariance(model, alone, every)[0],
        )


def test_platforms_are_scheduled_with_the_process_noise_of_each_target() -> None:
    """As above; four times the noise of both targets in one environment, and of one target in another."""
    models = [RfEoFar(q=q) for q in (1.0, 4.0)]
    system = models[0]
    belief = system.initial(oracles.worlds(system, 3)).belief
    noise = np.array([[models[m].motion.Q for m in of] for of in ((0, 0), (1, 1), (0, 1))])
    told, every = belief._replace(process_noise=noise), system.candidates()[None, ::60]
    found, observed = system.predict(told, every), system.observe(told)
    assert (found.process_noise == noise[:, None]).all()
    for t, model in enumerate(models):
        mixed = model.predict(oracles.rows(belief, slice(2, 3)), every).covariance[0]
        np.testing.assert_array_equal(found.covariance[2, :, t], mixed[:, t])
    for e, model in enumerate(models):
        alone = oracles.rows(belief, slice(e, e + 1))
        np.testing.assert_array_equal(found.covariance[e], model.predict(alone, every).covariance[0])
        np.testing.assert_array_equal(observed[e], model.observe(alone)[0])
        np.testing.assert_array_equal(system.information(told, every)[e], model.information(alone, every)[0])
        for kind, more in ((shortcuts.best_action, ()), (shortcuts.most_information, ()), (shortcuts.plan, (2,))):
            one, all = (kind.of(s)(b, *more) for s, b in ((model, alone), (system, told)))
            for a, b in zip(*((x if isinstance(x, tuple) else (x,)) for x in (one, all)), strict=True):
                np.testing.assert_array_equal(b[e], a[0])


class Forgetful(ExtendedKalman):
    """A tracker with the given memory, which it drops at the first update."""

    def __init__(self, memory) -> None:
        self.memory = memory

    def begin(self, estimate, motion):
        return estimate._replace(memory=self.memory)

    def update(self, estimate, scan):
        return super().update(estimate, scan)._replace(memory=None)


@pytest.mark.parametrize(
    ("memory", "message"),
    [
        (3.0, r"memory is 3.0, expected a NamedTuple of arrays, or None"),
        (np.zeros(5), r"memory of Forgetful has shape \(5,\), expected axis 0 = environment: \(2, ...\)"),
    ],
)
def test_a_memory_of_another_form_is_refused(memory, message) -> None:
    with pytest.raises(InputError, match=message):
        gym.make_vec(ID, num_envs=2, tracker=Forgetful(memory)).reset(seed=1)


@pytest.mark.parametrize("name", ["KershawEvans", "RfEo", "CameraSlew", "SectorSetup", "SectorSetupCity"])
def test_a_lost_memory_is_refused(name) -> None:
    env = gym.make_vec(full_id(name), num_envs=2, tracker=Forgetful(np.zeros(2)))
    env.reset(seed=1)
    first = np.zeros_like(env.action_space.sample())
    with pytest.raises(InputError, match=r"memory of Forgetful is None, expected an estimate with memory as begin\(\)"):
        [env.step(first) for _ in range(8)]  # a set-up has no measurement in its first steps


class Faulty(ExtendedKalman):
    """A tracker that spoils each estimate of the method ``at`` by ``how``."""

    def __init__(self, at, how) -> None:
        self.at, self.how = at, how

    def predict(self, estimate, motion):
        after = super().predict(estimate, motion)
        return self.how(after) if self.at == "predict" else after

    def update(self, estimate, scan):
        after = super().update(estimate, scan)
        return self.how(after) if self.at == "update" else after


@pytest.mark.parametrize("name", ["KershawEvans", "RfEo", "CameraSlew", "AgileClutter"])
@pytest.mark.parametrize(
    ("how", "message"),
    [
        (lambda after: None, "estimate of Faulty is None, expected an Estimate"),
        (tuple, r"estimate of Faulty is \(array.*, expected an Estimate"),
        (lambda after: after._replace(mean=after.mean[..., :1]), r"Faulty: mean has shape \(2, \d, 1\), expected"),
        (
            lambda after: after._replace(covariance=after.mean),
            r"Faulty: covariance has shape \(2, \d, \d\), expected",
        ),
        (lambda after: after._replace(mean=after.mean * np.nan), r"Faulty: mean\[0, 0, 0\] is nan, expected finite"),
        (lambda after: after._replace(memory=after.mean), r"memory of Faulty is array\(.*, expected an estimate with"),
    ],
)
def test_a_tracker_that_returns_no_estimate_of_the_targets_is_refused(name, how, message) -> None:
    for at in ("predict", "update") if name in ("RfEo", "KershawEvans") else ("predict",):
        env = gym.make_vec(full_id(name), num_envs=2, tracker=Faulty(at, how))
        env.reset(seed=1)
        with pytest.raises(InputError, match=message) as error:  # noqa: PT012
            for _ in range(5):
                env.step(env.action_space.sample())
        assert "\n" not in str(error.value)


class Counted(ExtendedKalman):
    """A tracker that counts its predictions in itself, and trusts each of them less than the one before."""

    count = 0

    def predict(self, estimate, motion):
        self.count += 1
        after = super().predict(estimate, motion)
        return after._replace(covariance=after.covariance * (1.0 + 0.01 * self.count))


def test_a_tracker_that_keeps_something_in_itself_is_a_defect() -> None:
    defect = "mean of the belief differs if the same step is repeated, expected a tracker that keeps nothing in itself"
    assert defect in str(shortcut_defect(make_task("CameraSlew-v0", {"tracker": Counted()}).system))


class Filter:
    """A filter of one target that returns ``found``."""

    def __init__(self, found) -> None:
        self.found = found

    def predict(self, x, P, motion):
        return x, P

    def update(self, x, P, z, R, model):
        return self.found


@pytest.mark.parametrize(
    ("found", "shapes"),
    [
        ((np.zeros(1), np.eye(2)), r"\(\(1,\), \(2, 2\)\)"),
        ((0.0, np.eye(2)), r"\(\(\), \(2, 2\)\)"),
        (np.zeros(2), r"\(2,\)"),
        (None, r"\(\)"),
    ],
)
def test_a_filter_that_returns_other_shapes_is_refused(found, shapes) -> None:
    env = gym.make_vec(ID, num_envs=2, tracker=OneByOne(Filter(found)))
    env.reset(seed=1)
    with pytest.raises(InputError, match=rf"Filter returned shapes {shapes}, expected x, P of \(\(2,\), \(2, 2\)\)"):
        env.step(np.zeros(2, np.int64))


def makes_nothing(argument):
    """A factory that needs an argument."""


MADE = OneByOne(Filter(None))


def test_a_tracker_or_filter_with_other_methods_is_refused() -> None:
    with pytest.raises(InputError, match=r"expected an object with predict\(estimate, motion\).*nearest: OneByOne"):
        gym.make(ID, tracker=Filter(None))
    for place in ("makes_nothing", "MADE"):
        with pytest.raises(InputError, match=rf"tracker is '{__name__}:{place}', expected .* function or class"):
            gym.make(ID, tracker=f"{__name__}:{place}")
    for wrong in (Filter, ExtendedKalman(), 3):
        with pytest.raises(InputError, match=r"expected an object with predict\(x, P, motion\) and update"):
            OneByOne(wrong)


def test_pulses_of_ones_own() -> None:
    """A library of generalised chirps in place of Gaussian ones; schedulers try these. No warning is raised."""
    pulses = tuple(TrapezoidChirp(kind=kind, duration=100e-6, sweep=1e6) for kind in ("lfm", "hfm", "efm"))
    env = gym.make_vec("wavegym/KershawEvans-v0", num_envs=2, library=Library(pulses))
    assert env.single_action_space.n == 3
    assert env.unwrapped.system.actions.labels[1] == pulses[1].label
    env.reset(seed=1)
    env.step(np.array([0, 2]))
    comparison = compare(
        "wavegym/KershawEvans-v0", ["lookahead:2"], worlds=3, jobs=1, library=Library(pulses), horizon=5
    )
    assert np.isfinite(comparison.cost("lookahead:2")).all()


def test_pulses_of_ones_own_span_no_box() -> None:
    with pytest.raises(InputError, match="library is given with action='box', expected action='library'"):
        gym.make("wavegym/KershawEvans-v0", action="box", library=Library(("a",)))
