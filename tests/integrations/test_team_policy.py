"""The agents' policies as one policy."""

from __future__ import annotations

import numpy as np
import oracles
import pytest
from two_sensors import TwoSensors

from wavegym.core.errors import InputError
from wavegym.core.policy import Policy
from wavegym.evaluation import compare
from wavegym.integrations.pettingzoo import TeamPolicy, parallel_env


class Choose:
    """Always the same waveform; keeps the shapes that it was shown."""

    def __init__(self, index):
        self.index, self.shapes = index, []

    def __call__(self, observation):
        self.shapes.append(observation.shape)
        return np.full(len(observation), self.index)


class Counting:
    """A policy with a memory: how many steps the episodes have taken, as a waveform."""

    def predict(self, observation, state=None, deterministic=False):
        state = 0 if state is None else state + 1
        return np.full(len(observation), state), state


@pytest.mark.parametrize("settings", [{}, {"action": "joint"}])
def test_a_team_of_constants_is_the_constant_policy(settings):
    """Joint action 3 * 8 + 6 sends waveform 3 from the first sensor and waveform 6 from the second."""
    members = {"sensor_1": Choose(3), "sensor_2": Choose(6)}
    action = 3 * 8 + 6 if settings else [3, 6]
    fixed = lambda observation: np.array([action] * len(observation))  # noqa: E731
    policies = {"team": TeamPolicy(members), "fixed": fixed}
    comparison = compare("AgileClutter-v0", policies, worlds=6, jobs=1, progress=False, horizon=5, **settings)
    np.testing.assert_array_equal(comparison.cost("team"), comparison.cost("fixed"))
    assert {shape[1] for shape in members["sensor_1"].shapes} == {15}


def test_a_team_plays_as_in_its_environment():
    """Observations of the policy are those of the parallel environment, with and without a shell."""
    env = parallel_env("RfEoFar-v0", action="library", sees="own")
    observations, _ = env.reset(seed=0)
    first = {name: lambda own, name=name: (own[:, 0] > observations[name][0]) * 5 for name in env.possible_agents}
    team = TeamPolicy(first)
    team.begin(env.system, 1, np.random.default_rng(0))
    belief = env._env.unwrapped.belief
    np.testing.assert_array_equal(team.act(belief, env.state()[None], None), team.act(belief, None, None))
    assert team.act(belief, None, None).tolist() == [[0, 0]]
    assert isinstance(team, Policy)


def test_members_with_a_memory_begin_anew():
    team = TeamPolicy({"sensor_1": Counting(), "sensor_2": Counting()}, sees="all")
    system = TwoSensors()
    belief = system.initial(oracles.worlds(system, 2)).belief
    for _ in range(2):
        team.begin(system, 2, np.random.default_rng(0))
        played = [team.act(belief, np.zeros((2, 5), np.float32), None).tolist() for _ in range(3)]
        assert played == [[[k, k], [k, k]] for k in range(3)]


def test_mistakes_are_named():
    with pytest.raises(InputError, match="member 'sensor_2' is 'myopic', expected a function"):
        TeamPolicy({"sensor_1": Choose(0), "sensor_2": "myopic"})
    with pytest.raises(InputError, match="member 'sensor_1' is <"):
        TeamPolicy({"sensor_1": TeamPolicy({})})
    rng = np.random.default_rng(0)
    with pytest.raises(
        InputError, match=r"members are \['radar'\], expected one for each of \['sensor_1', 'sensor_2'\]"
    ):
        TeamPolicy({"radar": Choose(0)}).begin(TwoSensors(), 1, rng)
    with pytest.raises(InputError, match="sees is 'mine'"):
        TeamPolicy({}, sees="mine").begin(TwoSensors(), 1, rng)
    wrong = TeamPolicy({"sensor_1": Choose(0), "sensor_2": Choose(3)})
    wrong.begin(TwoSensors(), 1, rng)
    with pytest.raises(InputError, match="action of sensor_2 is 3"):
        wrong.act(None, np.zeros((1, 5), np.float32), None)
