"""A discount per second: returns and advantages by their definition, and a run that uses it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from gymnasium import spaces
from runs_for_tests import SMALL

from wavegym.core.errors import InputError
from wavegym.learning.curve import LearningCurve
from wavegym.learning.models import build_model
from wavegym.learning.settings import load_settings
from wavegym.learning.time_discount import (
    CENTRING,
    NoteDurations,
    TimedMaskableRolloutBuffer,
    TimedRolloutBuffer,
)
from wavegym.learning.train import train
from wavegym.learning.training_run import TrainingRun
from wavegym.policies.runs import CURVE, POLICY

STEPS, ENVS, GAMMA, LAMBDA = 7, 3, 0.6, 0.8
RADAR = "wavegym/MultifunctionRadar-v1"


def small_run(**changes):
    """Two environments of few slots, in rollouts of six steps."""
    sizes = {"network": (8,), "n_steps": 6, "num_envs": 2, "batch_size": 4, "teacher": "", "variants": ()}
    parameters = {"slots": 4, "targets": 3.0, "horizon": 200}
    settings = load_settings(RADAR, "ppo", {**SMALL["ppo"], **sizes, **changes}, parameters)
    return TrainingRun(RADAR, "ppo", 0, settings)


def filled(kind, rng):
    """A buffer with random content and episodes that end within it."""
    space = spaces.Box(-1.0, 1.0, (2,), np.float32), spaces.Discrete(4)
    buffer = kind(STEPS, *space, device="cpu", gamma=1.0, gae_lambda=LAMBDA, n_envs=ENVS, gamma_per_second=GAMMA)
    buffer.rewards[:], buffer.values[:] = rng.normal(size=(2, STEPS, ENVS))
    buffer.episode_starts[:] = rng.random((STEPS, ENVS)) < 0.3
    buffer.durations[:] = rng.random((STEPS, ENVS))
    return buffer


@pytest.mark.parametrize("kind", [TimedRolloutBuffer, TimedMaskableRolloutBuffer])
def test_advantages_are_sums_of_errors_discounted_by_time(kind):
    """From the definition: lambda-weighted temporal differences, each discounted by the time until it."""
    rng = np.random.default_rng(0)
    buffer = filled(kind, rng)
    last, dones = rng.normal(size=ENVS), np.array([True, False, False])
    centred = buffer.rewards - buffer.rewards.sum(axis=0) / buffer.durations.sum(axis=0) * buffer.durations
    buffer.compute_returns_and_advantage(torch.as_tensor(last, dtype=torch.float32), dones)
    ends = np.concatenate([buffer.episode_starts[1:], dones[None]]).astype(bool)
    following = np.concatenate([buffer.values[1:], last[None]])
    for e in range(ENVS):
        for t in range(STEPS):
            want, weight = 0.0, 1.0
            for k in range(t, STEPS):
                factor = GAMMA ** buffer.durations[k, e]
                ahead = 0.0 if ends[k, e] else factor * following[k, e]
                want += weight * (centred[k, e] + ahead - buffer.values[k, e])
                weight *= LAMBDA * factor
                if ends[k, e]:
                    break
            assert buffer.advantages[t, e] == pytest.approx(want, rel=1e-5, abs=1e-6)
    np.testing.assert_allclose(buffer.returns, buffer.advantages + buffer.values, rtol=1e-6)


def test_the_centre_follows_each_environments_mean_reward_per_second():
    rng, rates = np.random.default_rng(1), []
    buffer = filled(TimedRolloutBuffer, rng)
    for _ in range(3):
        buffer.rewards[:], buffer.durations[:] = rng.normal(-3.0, 1.0, (STEPS, ENVS)), rng.random((STEPS, ENVS))
        rates.append(buffer.rewards.sum(axis=0) / buffer.durations.sum(axis=0))
        buffer.compute_returns_and_advantage(torch.zeros(ENVS), np.zeros(ENVS))
    want = rates[0].copy()
    for rate in rates[1:]:
        want += CENTRING * (rate - want)
    assert buffer.mean_rate == pytest.approx(want, rel=1e-6)


def test_a_run_notes_the_durations_of_its_steps():
    run = small_run()
    model = build_model(run)
    assert (model.gamma, model.rollout_buffer.gamma_per_second) == (1.0, run.settings.gamma)
    model.learn(12, callback=NoteDurations())
    durations = model.get_env().get_attr("system")[0].dwells.menu[3]
    taken = model.rollout_buffer.actions.reshape(2, 6).T.astype(int)  # flattened environment by environment
    np.testing.assert_allclose(model.rollout_buffer.durations, durations[taken], rtol=1e-12)


@pytest.mark.slow
def test_a_run_that_is_resumed_keeps_its_centre(tmp_path, monkeypatch):
    """The weights of a run that was stopped in its third rollout are those of one that was not."""
    run = small_run(steps=60)
    train(run, tmp_path / "whole", 12, progress=False)
    add, calls = LearningCurve.add, []

    def stopping(self, cost, ended):
        calls.append(0)
        if len(calls) == 15:
            raise KeyboardInterrupt
        add(self, cost, ended)

    with monkeypatch.context() as patch:
        patch.setattr(LearningCurve, "add", stopping)
        with pytest.raises(KeyboardInterrupt):
            train(run, tmp_path / "broken", 12, progress=False)
    train(run, tmp_path / "broken", 12, resume=True, progress=False)
    for name in (POLICY, CURVE):
        assert (tmp_path / "broken" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_where_steps_are_of_one_length_it_is_refused():
    settings = load_settings("wavegym/KershawEvansPosition-v0", "ppo", {**SMALL["ppo"], "discount": "second"})
    with pytest.raises(InputError, match="discount is 'second', expected 'step'"):
        build_model(TrainingRun("wavegym/KershawEvansPosition-v0", "ppo", 0, settings))
