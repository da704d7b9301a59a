"""Each ingredient of training that a recipe names changes what is trained."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from runs_for_tests import SMALL, small_run

from wavegym.core.worlds import draw_worlds
from wavegym.evaluation import make_task, training_seeds
from wavegym.learning import imitation
from wavegym.learning.export import export
from wavegym.learning.models import build_model
from wavegym.learning.settings import load_settings
from wavegym.learning.training_run import TrainingRun
from wavegym.policies.networks import LearnedPolicy
from wavegym.schedulers.planners import RolloutPlanner
from wavegym.schedulers.registry import make_policy

ID = "wavegym/SectorSetup-v0"
SYSTEM = make_task(ID, {}).system


def taught(**changes: Any) -> tuple[Any, Any]:
    """An untrained model that is to learn from a teacher, and its settings."""
    own = {"policy": "scorer", "network": (8,), "forecasts": True, "masks": False, "teacher": "cost-of-delay"}
    few = {"teacher_episodes": 4, "imitation_epochs": 1}
    run = TrainingRun(ID, "ppo", 3, load_settings(ID, "ppo", {**SMALL["ppo"], **own, **few, **changes}))
    return build_model(run), run.settings


def test_after_the_first_round_the_learner_itself_acts(monkeypatch: pytest.MonkeyPatch) -> None:
    model, settings = taught(imitation_rounds=3)
    actors: list[Any] = []
    weights: list[bytes] = []
    given = imitation.demonstrations

    def noted(system: Any, teacher: Any, actor: Any, *rest: Any) -> Any:
        actors.append(actor)
        weights.append(export(model.policy).to_bytes())
        return given(system, teacher, actor, *rest)

    monkeypatch.setattr(imitation, "demonstrations", noted)
    imitation.pretrain(model, settings, [SYSTEM], 3)
    assert [isinstance(actor, LearnedPolicy) for actor in actors] == [False, True, True]
    assert [actor.network.to_bytes() for actor in actors[1:]] == weights[1:], "with its weights of then"


def test_each_round_learns_from_the_lessons_of_all_rounds_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    model, settings = taught(imitation_rounds=3)
    rounds, learned = iter([np.arange(2), np.arange(2, 5), np.arange(5, 6)]), list[Any]()
    lessons = ((decisions[:, None], -decisions) for decisions in rounds)
    monkeypatch.setattr(imitation, "demonstrations", lambda *given: next(lessons))
    monkeypatch.setattr(imitation, "imitate", lambda model, *given: learned.append(given[:2]))
    imitation.pretrain(model, settings, [SYSTEM], 3)
    assert [labels.tolist() for _, labels in learned] == [[0, -1], [0, -1, -2, -3, -4], [0, -1, -2, -3, -4, -5]]
    assert all((observations[:, 0] == -labels).all() for observations, labels in learned)


def test_each_round_plays_worlds_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    model, settings = taught(imitation_rounds=3)
    given, played = draw_worlds, list[Any]()

    def noted(system: Any, seeds: Any) -> Any:
        played.append(seeds)
        return given(system, seeds)

    monkeypatch.setattr(imitation, "draw_worlds", noted)
    monkeypatch.setattr(imitation, "demonstrations", lambda *given: (np.zeros((1, 1)), np.zeros(1)))
    monkeypatch.setattr(imitation, "imitate", lambda *given: None)
    imitation.pretrain(model, settings, [SYSTEM], 3)
    assert [len(seeds) for seeds in played[-3:]] == [4, 4, 4]
    assert len({seed for seeds in played[-3:] for seed in seeds}) == 12


def test_labels_are_twenty_times_the_advantages_up_to_ten(monkeypatch: pytest.MonkeyPatch) -> None:
    planner = make_policy("rollout:6", SYSTEM, None)
    advantages = np.array([[0.0, -0.1, 0.3, -2.0, 2.0, 0.01, np.nan, 0.0]])
    monkeypatch.setattr(
        RolloutPlanner, "advantages", lambda self, belief, mask: np.repeat(advantages, len(belief.step), axis=0)
    )
    worlds = draw_worlds(SYSTEM, training_seeds(9, 0, 2))
    guide = make_policy("cost-of-delay", SYSTEM, None)
    _, labels = imitation.demonstrations(SYSTEM, planner, guide, worlds, True, np.random.default_rng(0))
    np.testing.assert_allclose(
        labels, np.tile([0.0, -2.0, 6.0, -10.0, 10.0, 0.2, np.nan, 0.0], (len(labels), 1)), rtol=1e-6
    )


@pytest.mark.parametrize("algo", ["ppo", "dqn"])
def test_the_learning_rate_falls_to_nearly_nothing(algo: str) -> None:
    run = small_run(algo)
    model: Any = build_model(run)
    assert [model.lr_schedule(left) for left in (1.0, 0.25, 0.0)] == pytest.approx(
        [run.settings.learning_rate, 0.25 * run.settings.learning_rate, 0.0]
    )
    model.learn(run.settings.steps)
    assert model.policy.optimizer.param_groups[0]["lr"] <= 0.11 * run.settings.learning_rate


def test_dqn_takes_its_gradient_steps_after_each_step_of_the_batch() -> None:
    run = small_run("dqn")
    settings: Any = run.settings
    model: Any = build_model(run)
    model.learn(settings.steps)
    batches = (settings.steps - settings.learning_starts) / settings.num_envs
    assert model._n_updates == pytest.approx(settings.gradient_steps * batches, abs=2 * settings.gradient_steps)
