"""The composed loop: equal to the compiled one of the same parts, and open to parts of one's own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import gymnasium as gym
import numpy as np
import oracles
import pytest

import wavegym
from wavegym.core.action_sets import Library
from wavegym.core.errors import InputError
from wavegym.envs.vector import WaveformVectorEnv
from wavegym.evaluation import compare, summarise
from wavegym.systems.composed import (
    LinearTargets,
    LineOfSightRadar,
    Loop,
    PlanarRadar,
    Pulses,
    Quantity,
    Sensor,
    WeightedTrace,
)
from wavegym.systems.composed.parts import Errors
from wavegym.systems.composed.system import World
from wavegym.systems.kershaw_evans.system import KershawEvans
from wavegym.targets import constant_velocity
from wavegym.targets.motion import constant_turn
from wavegym.testing import check_vector_env
from wavegym.waveforms import gaussian_chirp_library

ID = "tests/Composed-v0"
NARROW = gaussian_chirp_library((30e-6, 100e-6), (0.0, 1e5))
PLANE = constant_velocity(1.0, 2.0, ("x", "y"), order="derivative")


def planar(**changed) -> Loop:
    """Two targets in the plane and a radar that may miss them."""
    low, high = ((10e3, -5e3, -50.0, -50.0), (0.0, 10e3, 0.0, 0.0)), ((15e3, 5e3, 50.0, 50.0), (5e3, 15e3, 100.0, 50.0))
    parts = {
        "targets": LinearTargets(PLANE, low, high, (1e4, 1e4, 100.0, 100.0)),
        "sensor": PlanarRadar((0.0, 0.0), 20e3, false_alarm=1e-3),
        "waveforms": Pulses(NARROW, 10.4e9),
        "objective": WeightedTrace((1.0, 1.0, 1.0, 1.0)),
        "horizon": 12,
    }
    return Loop(**{**parts, **changed})


def line_of_sight() -> tuple[KershawEvans, Loop]:
    """The Kershaw-Evans loop, and the composition of its parts."""
    own = KershawEvans(durations=(30e-6, 100e-6), sweeps=(0.0, 1e5), start_covariance="random", horizon=20)
    low, high = zip(own.start_range, own.start_speed, strict=True)
    targets = LinearTargets(own.motion, (low,), (high,), own.prior_variance)
    sensor, pulses = LineOfSightRadar(own.reference_range, own.nearest_range), Pulses(NARROW, own.carrier_hz)
    return own, Loop(targets=targets, sensor=sensor, waveforms=pulses, objective=WeightedTrace((1, 1)), horizon=20)


def test_the_compiled_kershaw_evans_loop_is_the_composition_of_its_parts() -> None:
    """But for rounding: the same worlds, whose tapes are laid out differently."""
    own, loop = line_of_sight()
    tape = oracles.worlds(own, 6)
    draws = LinearTargets.Draws(tape.uniform[:, :1], tape.normal[:, :1, :2], tape.normal[:, 1:, None, :2])
    world = World(draws, Errors(np.zeros((6, 20, 1)), tape.normal[:, 1:, None, 2:]))
    ours, theirs = own.initial(tape), loop.initial(world)
    start = own.first_covariance(tape)[:, None]
    mean = theirs.truth.targets + np.sqrt(np.diagonal(start, axis1=-2, axis2=-1)) * draws.error
    theirs = theirs._replace(belief=theirs.belief._replace(mean=mean, covariance=start))
    np.testing.assert_allclose(mean[:, 0], ours.belief.mean, rtol=1e-12)
    rng = np.random.default_rng(5)
    for _ in range(20):
        action = rng.integers(4, size=6)
        every = np.arange(4)[None]
        np.testing.assert_allclose(
            loop.cost(loop.predict(theirs.belief, every)), own.cost(own.predict(ours.belief, every)), rtol=1e-9
        )
        ours, theirs = own.transition(ours, action, tape), loop.transition(theirs, action, world)
        np.testing.assert_allclose(theirs.truth.targets[:, 0], ours.truth.targets, rtol=1e-12)
        np.testing.assert_allclose(theirs.belief.mean[:, 0], ours.belief.mean, rtol=1e-9)
        np.testing.assert_allclose(theirs.belief.covariance[:, 0], ours.belief.covariance, rtol=1e-9)


@pytest.fixture
def registered():
    wavegym.register(ID, planar())
    yield ID
    del gym.registry[ID]


@pytest.mark.slow
def test_a_composed_loop_conforms_and_is_compared_like_any_other(registered) -> None:
    check_vector_env(registered)
    comparison = compare(registered, ["random", "lookahead:2", "rollout:2"], worlds=4, jobs=1)
    assert set(comparison.played) == {"random", "lookahead:2", "rollout:2", "myopic"}
    assert comparison.cost("myopic").mean() < comparison.cost("random").mean()
    assert "log10_sigma_xdot_2" in wavegym.describe(registered)
    env = gym.make(registered, render_mode="rgb_array")
    env.reset(seed=1)
    assert env.render().ndim == 3


def test_the_tracker_is_consistent_in_its_own_world() -> None:
    """NEES of 4 states: 400 worlds x 2 targets have a standard error of sqrt(8 / 800) = 0.1; linearisation adds."""
    env = WaveformVectorEnv(planar(), 400)
    env.reset(seed=2)
    nees = np.array([env.step(np.full(400, 1))[-1]["nees"].mean() for _ in range(11)])
    assert (abs(nees - 4.0) < 0.5).all()


def test_another_truth_fools_the_tracker() -> None:
    system = planar()
    turning = replace(system.targets, motion=constant_turn(1.0, 2.0, 0.1, order="derivative"))
    env = WaveformVectorEnv(system, 200, truth={"targets": turning})
    env.reset(seed=2)
    nees = [env.step(np.full(200, 1))[-1]["nees"].mean() for _ in range(11)]
    assert nees[-1] > 8.0


@pytest.mark.parametrize(("turn_rate", "flag"), [(0.0, ""), (0.1, "high")])
def test_a_report_flags_a_tracker_that_is_fooled_and_no_other(registered, turn_rate, flag) -> None:
    motion = planar().targets.motion if not turn_rate else constant_turn(1.0, 2.0, turn_rate, order="derivative")
    truth = {"targets": replace(planar().targets, motion=motion)}
    summary = summarise(compare(registered, [], worlds=100, jobs=1, progress=False, truth=truth))
    assert summary["nees_dimension"] == 4
    played = summary["policies"]["myopic"]
    assert played["nees"]["flag"] == flag
    low, high = played["true_over_believed"]["ci"]
    assert (low > 1.2) == bool(flag)
    assert (low < 1.0 < high) == (not flag)


@dataclass(frozen=True)
class Theodolite(Sensor):
    """A sensor of one's own: the bearing of a target, better with more energy, from the origin."""

    quantities = (Quantity("bearing", "rad", 0.0, 1.0),)

    def measure(self, states):
        return np.arctan2(states[..., 1], states[..., 0])[..., None]

    def jacobian(self, states):
        x, y = states[..., 0], states[..., 1]
        square = x * x + y * y
        return np.stack([-y / square, x / square, 0.0 * x, 0.0 * x], axis=-1)[..., None, :]

    def covariance(self, states, pulse):
        return (pulse + 0.0 * states[..., 0])[..., None, None]


class Energies:
    """Waveforms of one's own: the variance of a bearing."""

    actions = Library(("weak", "strong"))

    def pulse(self, actions):
        return np.array([1e-4, 1e-6]).take(actions)


def test_a_sensor_and_waveforms_of_ones_own() -> None:
    loop = planar(sensor=Theodolite(), waveforms=Energies())
    env = WaveformVectorEnv(loop, 300, measurements=True)
    env.reset(seed=4)
    costs = {}
    for action in (0, 1):
        env.reset(seed=4)
        for _ in range(6):
            info = env.step(np.full(300, action))[-1]
        costs[action] = info["cost"].mean()
        assert info["measured_z"].shape == (300, 2, 1)
        assert abs(info["nees"].mean() - 4.0) < 0.7
    assert costs[1] < costs[0]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"tracker": 3}, "tracker is 3, expected an object with predict(estimate, motion) and update(estimate, scan)"),
        ({"tracker": "no_module:thing"}, "tracker is 'no_module:thing', which cannot be loaded"),
        ({"sensor": PlanarRadar}, "expected an object of wavegym.systems.composed.parts.Sensor"),
        ({"objective": 1}, "objective is 1, expected an object of wavegym.systems.composed.parts.Objective"),
        ({"horizon": 0}, "horizon is 0, expected an integer >= 1"),
    ],
)
def test_what_is_no_part_is_refused(changed, message) -> None:
    with pytest.raises(InputError) as error:
        planar(**changed)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"low": ((1.0, 2.0),)}, "expected 4 numbers for each target"),
        ({"low": ((0.0,) * 4,)}, "low and high are of 1 and 2 targets"),
        ({"high": ((0.0,) * 4,) * 2}, "bounds of the first x"),
        ({"prior_variance": (1.0, 1.0, 0.0, 1.0)}, "prior_variance is 0.0"),
    ],
)
def test_targets_without_a_scenario_are_refused(changed, message) -> None:
    with pytest.raises(InputError, match=message):
        replace(planar().targets, **changed)


@pytest.mark.parametrize("changed", [{"fluctuation": "swerling3"}, {"searched": 2}])
def test_a_law_of_echoes_without_a_threshold_is_refused(changed) -> None:
    PlanarRadar(false_alarm=1e-3, **changed)
    with pytest.raises(InputError, match="without a threshold, expected a false_alarm"):
        PlanarRadar(**changed)
