"""The parameter ``truth``: a world that differs from what the tracker and the schedulers assume."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pytest

from wavegym.core import shortcuts
from wavegym.core.action_sets import Library
from wavegym.core.errors import InputError
from wavegym.core.system import State, System
from wavegym.envs.vector import WaveformVectorEnv
from wavegym.schedulers.tuned_constants import recorded
from wavegym.systems.kershaw_evans.system import KershawEvansPosition
from wavegym.testing.shortcut_check import shortcut_defect


class Drift(NamedTuple):
    place: np.ndarray  # (env,)


class Belief(NamedTuple):
    step: np.ndarray
    place: np.ndarray


class Report(NamedTuple):
    z: np.ndarray  # (env,)


@dataclass(frozen=True)
class Walk(System):
    """A target that drifts at a known speed; the tracker averages its prediction and the report."""

    speed: float = field(default=1.0, metadata={"description": "speed", "unit": "m/s", "truth": True})
    horizon: int = 5
    dt: float = 1.0

    @property
    def actions(self) -> Library:
        return Library(("a", "b"))

    @property
    def observation_fields(self) -> tuple:
        return ()

    def draw_world(self, rng: np.random.Generator) -> Any:
        return Drift(rng.standard_normal())

    def initial(self, world: Any) -> State:
        zero = np.zeros(len(world.place))
        return State(Drift(zero), Belief(np.zeros(len(zero), np.int64), zero.copy()))

    def move(self, truth: Drift, step: np.ndarray, world: Any) -> Drift:
        return Drift(truth.place + self.truth_model.speed)

    def measure(self, truth: Drift, belief: Belief, action: np.ndarray, world: Any) -> Report:
        return Report(truth.place + 0.01 * world.place)

    def track(self, belief: Belief, action: np.ndarray, measurements: Report) -> Belief:
        return Belief(belief.step + 1, 0.5 * (belief.place + self.speed + measurements.z))

    def predict(self, belief: Belief, actions: np.ndarray, outcome: Any = None) -> Belief:
        shape = np.broadcast_shapes(actions.shape, belief.step.shape[:1] + (1,) * (actions.ndim - 1))
        spread = belief.step.reshape(-1, *[1] * (actions.ndim - 1))
        place = belief.place.reshape(spread.shape) + self.speed
        return Belief(np.broadcast_to(spread + 1, shape), np.broadcast_to(place, shape))

    def cost(self, belief: Belief) -> np.ndarray:
        return 1.0 + np.abs(belief.place)

    def observe(self, belief: Belief) -> np.ndarray:
        return np.zeros((len(belief.step), 0))


class Fused(Walk):
    """Walk with a step of its own."""


class Wrong(Fused):
    """A step that forgets the report."""


@shortcuts.fused_transition.register(Fused)
def fused(system: Fused, state: State, action: np.ndarray, world: Any) -> State:
    return system.composed_transition(state, action, world)


@shortcuts.fused_transition.register(Wrong)
def wrong(system: Wrong, state: State, action: np.ndarray, world: Any) -> State:
    truth = system.move(state.truth, state.belief.step, world)
    return State(truth, Belief(state.belief.step + 1, state.belief.place + system.speed))


class Louder(Fused):
    """Another measurement, which the inherited step does not know."""

    def measure(self, truth: Drift, belief: Belief, action: np.ndarray, world: Any) -> Report:
        return Report(truth.place + world.place)


def one_step(system: System) -> State:
    world = Drift(np.array([2.0]))
    return system.transition(system.initial(world), np.array([0]), world)


def test_the_world_moves_by_the_truth_and_the_tracker_predicts_by_its_own_parameters() -> None:
    after = one_step(Walk(truth={"speed": 3.0}))
    assert after.truth.place == 3.0
    assert after.belief.place == 0.5 * (1.0 + 3.02)
    assert one_step(Walk(speed=3.0)).belief.place == 0.5 * (3.0 + 3.02)


def test_without_a_difference_both_models_are_the_system() -> None:
    walk = Walk()
    assert walk.truth_model is walk
    assert walk.belief_model is walk
    other = Walk(truth={"speed": 3.0})
    assert other.truth_model == Walk(speed=3.0)
    assert other.belief_model == walk
    assert replace(other, horizon=7).truth_model == Walk(speed=3.0, horizon=7)


@pytest.mark.parametrize(
    ("truth", "message"),
    [
        ({"sped": 1.0}, "truth has 'sped', expected one of speed; did you mean 'speed'?"),
        ({"horizon": 9}, "truth has 'horizon', expected one of speed"),
    ],
)
def test_only_parameters_of_the_world_may_differ(truth, message) -> None:
    with pytest.raises(InputError) as error:
        WaveformVectorEnv(Walk, 1, truth=truth)
    assert str(error.value) == message


def test_a_value_out_of_range_is_named() -> None:
    with pytest.raises(InputError, match="q is -1"):
        gym.make("wavegym/KershawEvans-v0", truth={"q": -1.0})


def test_constants_recorded_for_a_system_hold_in_another_world() -> None:
    assert recorded(KershawEvansPosition(truth={"q": 1.0})) == recorded(KershawEvansPosition()) != {}
    assert recorded(KershawEvansPosition(q=1.0)) == {}


def test_the_check_finds_a_compiled_step_that_differs_from_its_parts() -> None:
    assert shortcut_defect(Fused()) is None
    assert "place of the belief differs" in str(shortcut_defect(Wrong()))


def test_another_measurement_withdraws_the_inherited_step() -> None:
    assert one_step(Louder()).belief.place == 0.5 * (1.0 + 3.0)


def test_the_info_of_a_step_holds_the_measurements() -> None:
    env = WaveformVectorEnv(Walk, 2, measurements=True)
    _, info = env.reset(seed=1)
    assert "measured_z" not in info
    info = env.step(np.array([0, 1]))[-1]
    np.testing.assert_array_equal(info["measured_z"], 1.0 + 0.01 * env.world.place)
    assert "measured_z" not in WaveformVectorEnv(Walk, 2).reset(seed=1)[1]


def test_measurements_of_a_system_without_that_part_are_an_error() -> None:
    @dataclass(frozen=True)
    class Whole(Walk):
        measure = System.measure

    with pytest.raises(InputError, match="Whole has no method measure"):
        WaveformVectorEnv(Whole, 1, measurements=True)
