"""Mixtures of Gaussians in a box: densities and draws against SciPy's, imitation of a teacher that switches points."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from gymnasium import spaces
from runs_for_tests import SMALL
from scipy.special import log_softmax, logsumexp, softmax
from scipy.stats import chisquare, kstest, norm, uniform
from stable_baselines3.common.policies import ActorCriticPolicy

from wavegym.core.errors import InputError
from wavegym.learning.imitation import imitate
from wavegym.learning.mixture import Mixture, MixturePolicy, parts
from wavegym.learning.models import build_model
from wavegym.learning.settings import load_settings
from wavegym.learning.training_run import TrainingRun

MODES, PARAMETERS = 3, 2
POSITION = "wavegym/KershawEvansPosition-v0"


@pytest.fixture
def drawn() -> tuple[np.ndarray, np.ndarray, np.ndarray, Mixture]:
    """Logits (env, mode), means (env, mode, parameter), standard deviations, and the mixture that they make."""
    rng = np.random.default_rng(4)
    logits, means = rng.normal(size=(5, MODES)), rng.uniform(-1, 1, (5, MODES, PARAMETERS))
    std = np.array([0.02, 0.05])
    outputs = torch.as_tensor(np.concatenate([logits, means.reshape(5, -1)], axis=1))
    return logits, means, std, Mixture(MODES, PARAMETERS).proba_distribution(outputs, torch.as_tensor(np.log(std)))


def test_the_density_is_the_weighted_sum_of_the_modes(drawn: Any) -> None:
    logits, means, std, mixture = drawn
    actions = means[:, 1] + std * np.array([0.3, -2.0])
    each = norm.logpdf(actions[:, None], means, std).sum(axis=2)
    want = logsumexp(log_softmax(logits, axis=1) + each, axis=1)
    np.testing.assert_allclose(mixture.log_prob(torch.as_tensor(actions)), want, rtol=1e-12)


def test_draws_come_from_the_modes_as_often_as_they_weigh(drawn: Any) -> None:
    logits, means, std, mixture = drawn
    torch.manual_seed(0)
    draws = torch.stack([mixture.sample() for _ in range(4000)]).numpy()
    off = (draws[:, :, None] - means) / std  # (draw, env, mode, parameter)
    nearest = (off**2).sum(axis=3).argmin(axis=2)
    for env in range(5):
        counts = np.bincount(nearest[:, env], minlength=MODES)
        assert chisquare(counts, 4000 * softmax(logits[env])).pvalue > 1e-4
    own = np.take_along_axis(off, nearest[..., None, None], axis=2)[:, :, 0]
    assert own.std(axis=0) == pytest.approx(1.0, abs=5.0 / np.sqrt(2 * 4000))


def test_without_noise_the_likeliest_mode_is_played(drawn: Any) -> None:
    logits, means, _, mixture = drawn
    np.testing.assert_array_equal(mixture.mode(), means[np.arange(5), logits.argmax(axis=1)])
    assert mixture.get_actions(deterministic=True).shape == (5, PARAMETERS)


def policy(kind: type[ActorCriticPolicy], **own: Any) -> ActorCriticPolicy:
    torch.manual_seed(1)
    spot = spaces.Box(-1.0, 1.0, (1,), np.float32)
    return kind(spot, spot, lambda _: 1e-3, net_arch=[32], **own)


def test_a_teacher_that_switches_between_points_is_followed_not_met_halfway() -> None:
    """In two of three cases at -0.6, else at 0.6, for any observation."""
    rng = np.random.default_rng(0)
    seen = rng.uniform(-1, 1, (600, 1)).astype(np.float32)
    labels = np.where(rng.random((600, 1)) < 2 / 3, -0.6, 0.6).astype(np.float32)

    class Model:
        action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        policy = policy(MixturePolicy, modes=4)

    imitate(Model(), seen, labels, 200, np.random.default_rng(0))  # type: ignore[arg-type]
    chosen = Model.policy.predict(seen, deterministic=True)[0]
    assert chosen == pytest.approx(-0.6, abs=0.02)
    with torch.no_grad():
        drawn = Model.policy.get_distribution(torch.as_tensor(seen))
    weights, points = (values.numpy() for values in parts(drawn))  # type: ignore[arg-type]
    high = (np.exp(weights) * (points[..., 0] > 0.5)).sum(axis=1)
    assert high.mean() == pytest.approx(1 / 3, abs=4 * np.sqrt(2 / 9 / 600))


def test_modes_begin_all_over_the_box() -> None:
    points = where(policy(MixturePolicy, modes=200))
    assert kstest(points.flatten(), uniform(-1.0, 2.0).cdf).pvalue > 1e-4


def test_the_policy_is_saved_with_its_modes(tmp_path: Any) -> None:
    made = policy(MixturePolicy, modes=4)
    made.save(str(tmp_path / "policy.pt"))
    assert (where(MixturePolicy.load(str(tmp_path / "policy.pt"))) == where(made)).all()


def where(made: ActorCriticPolicy) -> np.ndarray:
    """The points of its modes when nothing is seen, (mode,)."""
    drawn = made.get_distribution(torch.zeros(1, 1))
    return parts(drawn)[1][0, :, 0].detach().numpy()  # type: ignore[arg-type]


def test_only_a_box_has_several_modes() -> None:
    settings = load_settings(POSITION, "ppo", {**SMALL["ppo"], "modes": 2})
    with pytest.raises(InputError, match=r"modes is 2, expected 1: the actions of .* are Discrete\(56\), no box"):
        build_model(TrainingRun(POSITION, "ppo", 0, settings))
