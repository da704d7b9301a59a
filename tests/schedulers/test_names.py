from __future__ import annotations

import numpy as np
import pytest

from wavegym.envs import WaveformVectorEnv
from wavegym.errors import InputError
from wavegym.evaluation.worlds import draw_worlds, world_seeds
from wavegym.schedulers import Fixed, Lookahead, Myopic, RandomChoice, RoundRobin
from wavegym.schedulers.myopic import OBJECTIVES
from wavegym.schedulers.names import FORMS, is_scheduler, make_policy
from wavegym.systems.contract import State, System
from wavegym.systems.kershaw_evans import KershawEvans, KershawEvansPosition, World

SYSTEM = KershawEvans(horizon=3)
WORLDS = World(*(np.stack([a, a]) for a in SYSTEM.draw_world(np.random.default_rng(0))))


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("random", RandomChoice),
        ("round-robin", RoundRobin),
        ("fixed:7", Fixed),
        ("best-fixed", Fixed),
        ("myopic", Myopic),
        ("myopic:exhaustive", Myopic),
        ("myopic:determinant", Myopic),
        ("myopic:gate", Myopic),
        ("lookahead:3", Lookahead),
    ],
)
def test_every_name_makes_its_policy(name, kind):
    policy = make_policy(name, SYSTEM, WORLDS)
    assert type(policy) is kind
    assert is_scheduler(name)


def test_numbers_and_objectives_arrive():
    assert make_policy("fixed:7", SYSTEM, WORLDS).index == 7
    assert make_policy("lookahead:3", SYSTEM, WORLDS).depth == 3
    for name, objective in [("myopic", "trace"), ("myopic:determinant", "determinant"), ("myopic:gate", "gate")]:
        assert make_policy(name, SYSTEM, WORLDS).objective is OBJECTIVES[objective]
    assert make_policy("myopic", SYSTEM, WORLDS).fused
    assert not make_policy("myopic:exhaustive", SYSTEM, WORLDS).fused


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("myopc", "did you mean 'myopic'"),
        ("Random", "did you mean 'random'"),
        ("bestfixed", "did you mean 'best-fixed'"),
        ("lookahed:2", "did you mean 'lookahead:H'"),
        ("myopic:gates", "did you mean 'myopic:gate'"),
        ("", "policy is '', expected one of"),
        ("fixed", "nearest: 'fixed:2'"),
        ("fixed:K", "expected fixed: and an integer"),
        ("fixed:4.2", "nearest: 'fixed:4'"),
        ("lookahead:two", "expected lookahead: and an integer"),
        ("lookahead:0", "lookahead depth is 0, expected at least 1"),
    ],
)
def test_unknown_names_and_numbers_are_answered_with_the_nearest(name, words):
    with pytest.raises(InputError, match=words):
        make_policy(name, SYSTEM, WORLDS)


@pytest.mark.parametrize("index", [-1, 88])
def test_a_candidate_that_does_not_exist_is_refused(index):
    policy = make_policy(f"fixed:{index}", SYSTEM, WORLDS)
    with pytest.raises(InputError, match="expected 0 to 87"):
        policy.begin(SYSTEM, 1, np.random.default_rng(0))


class Belief(System):
    """Neither covariance nor gate."""

    def begin(self, world):
        return State(None, None)


@pytest.mark.parametrize("name", ["myopic:determinant", "myopic:gate"])
def test_objectives_that_a_system_cannot_have_are_refused(name):
    with pytest.raises(InputError, match=f"'{name}' cannot be computed for Belief"):
        make_policy(name, Belief(), WORLDS)


PLAIN = [name for name in FORMS if name[-2] != ":" and name != "myopic:progressive"]  # that one needs another system


@pytest.mark.parametrize("name", [*PLAIN, "fixed:3", "lookahead:1", "lookahead:3"])
def test_every_scheduler_gets_through_gymnasiums_loop(name):
    """In the default autoreset mode a policy is also asked at the step that only resets, when its episode is over."""
    action = "box" if name == "myopic:closed-form" else "library"
    envs = WaveformVectorEnv(KershawEvansPosition, 2, horizon=4, action=action)
    policy = make_policy(name, envs.system, draw_worlds(envs.system, world_seeds(0, "tune", 3)))
    observation, _ = envs.reset(seed=0)
    policy.begin(envs.system, 2, np.random.default_rng(0))
    if hasattr(policy, "foresee"):
        policy.foresee(envs.world)
    ends = 0
    for _ in range(12):
        observation, _, terminated, _, _ = envs.step(policy.act(envs.public, observation, None))
        ends += int(terminated.sum())
    assert ends == 4


def test_folders_are_no_schedulers():
    assert not any(is_scheduler(name) for name in ("ppo", "runs/ppo", "myopic2", ""))
    assert set(FORMS) > {"optimum", "fixed:K", "lookahead:H"}
