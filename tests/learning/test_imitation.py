"""Imitation: the labels are the teacher's, the actor learns them, then waits for the critic."""

from __future__ import annotations

from itertools import groupby
from typing import Any

import numpy as np
import pytest
import torch
from runs_for_tests import SMALL
from scipy.special import softmax
from scipy.stats import binomtest, entropy
from stable_baselines3.common.distributions import DiagGaussianDistribution

from wavegym.core.errors import InputError
from wavegym.core.worlds import draw_worlds
from wavegym.evaluation import make_task, training_seeds
from wavegym.learning import imitation
from wavegym.learning.export import export
from wavegym.learning.imitation import (
    INVERSE_TEMPERATURE,
    MARGIN,
    MOST,
    NEAR,
    WarmUp,
    _box_loss,
    _cross_entropy,
    actor_parameters,
    calibrate_temperature,
    demonstrations,
    imitate,
    preferences,
    pretrain,
)
from wavegym.learning.mixture import Mixture
from wavegym.learning.models import build_model, systems_of
from wavegym.learning.settings import load_settings
from wavegym.learning.training_run import TrainingRun
from wavegym.policies.networks import LearnedPolicy
from wavegym.schedulers import Fixed, Myopic
from wavegym.schedulers.planners import RolloutPlanner
from wavegym.schedulers.registry import make_policy
from wavegym.schedulers.tuned_constants import record_key, recorded, records

ID = "wavegym/SectorSetup-v0"
SYSTEM = make_task(ID, {}).system
WORLDS = draw_worlds(SYSTEM, training_seeds(9, 0, 40))
TEACHER = make_policy("cost-of-delay", SYSTEM, None)


def run(**changes: Any) -> TrainingRun:
    own = {"policy": "scorer", "network": (32,), "forecasts": True, "masks": False}
    return TrainingRun(ID, "ppo", 3, load_settings(ID, "ppo", {**SMALL["ppo"], **own, **changes}))


def test_the_dataset_holds_the_teachers_labels_in_the_states_of_the_actor() -> None:
    seen, labels = demonstrations(SYSTEM, TEACHER, TEACHER, WORLDS, forecasts=True, rng=np.random.default_rng(0))
    assert seen.shape == (40 * SYSTEM.horizon, build_model(run()).observation_space.shape[0])
    elsewhere, corrected = demonstrations(
        SYSTEM, TEACHER, Fixed(0), WORLDS, forecasts=True, rng=np.random.default_rng(0)
    )
    assert (seen[:40] == elsewhere[:40]).all()  # the first step is the same for all
    assert not np.allclose(seen[-40:], elsewhere[-40:])
    assert (labels[:40] == corrected[:40]).all()
    assert len(np.unique(corrected)) > 1  # the teacher's choices, not the actor's


class Counting(Fixed):
    """The fixed choice k at its k-th call."""

    calls = 0

    def act(self, belief: Any, observation: Any = None, mask: Any = None) -> Any:
        self.calls += 1
        return np.full(len(belief.step), self.calls % 8)


def test_between_queries_the_teacher_repeats_its_last_action() -> None:
    rng = np.random.default_rng
    played = []

    class Recording(type(SYSTEM)):  # type: ignore[misc]
        def transition(self, state: Any, action: Any, world: Any) -> Any:
            played.append(int(action[0]))
            return super().transition(state, action, world)

    _, labels = demonstrations(
        Recording(), teacher := Counting(0), teacher, WORLDS, forecasts=False, rng=rng(0), every=4
    )
    assert len(played) == SYSTEM.horizon
    assert len(labels) == 40 * teacher.calls
    assert played[:4] == [1, 2, 3, 4]
    assert binomtest(teacher.calls - 4, SYSTEM.horizon - 4, 0.25).pvalue > 1e-3
    assert [k for k, _ in groupby(played)] == [k % 8 for k in range(1, teacher.calls + 1)]
    seen, _ = demonstrations(SYSTEM, asked := Counting(0), TEACHER, WORLDS, forecasts=False, rng=rng(0), every=4)
    every_step, _ = demonstrations(SYSTEM, TEACHER, TEACHER, WORLDS, forecasts=False, rng=rng(0))
    assert asked.calls == teacher.calls
    rows = {row.tobytes() for row in every_step}
    assert all(row.tobytes() in rows for row in seen)  # the actor plays on as if nobody asked


@pytest.mark.slow
def test_imitation_brings_the_actor_to_the_teacher_and_leaves_the_critic() -> None:
    model: Any = build_model(run())
    critic = {n: p.detach().clone() for n, p in model.policy.named_parameters() if "value_net" in n}
    seen, labels = demonstrations(SYSTEM, TEACHER, TEACHER, WORLDS, forecasts=True, rng=np.random.default_rng(0))

    def agreement() -> float:
        return float((LearnedPolicy(export(model.policy)).act(None, seen, None) == labels).mean())

    before = agreement()
    imitate(model, seen, labels, 120, np.random.default_rng(0))
    assert before < 0.5
    assert agreement() > 0.8
    after = dict(model.policy.named_parameters())
    assert critic
    assert all(torch.equal(values, after[name]) for name, values in critic.items())


def test_training_with_a_teacher_starts_from_it_and_the_same_seed_gives_the_same_actor() -> None:
    chosen = run(teacher="cost-of-delay", teacher_episodes=10, imitation_rounds=2, imitation_epochs=3)
    networks = []
    for _ in range(2):
        model: Any = build_model(chosen)
        pretrain(model, chosen.settings, [SYSTEM], chosen.seed)
        networks.append(export(model.policy).to_bytes())
    assert networks[0] == networks[1]
    assert networks[0] != export(build_model(chosen).policy).to_bytes()


def test_a_point_beyond_the_edge_of_a_box_is_at_its_edge() -> None:
    def distance(point: float, wanted: float) -> float:
        chosen = DiagGaussianDistribution(1).proba_distribution(torch.tensor([[point]]), torch.zeros(1))
        return NEAR * float(_box_loss(chosen, torch.tensor([[wanted]])))

    assert distance(1.7, 1.0) == distance(-1.2, -1.0) == 0.0
    assert distance(1.7, -1.0) == pytest.approx(2.7 - NEAR / 2)
    assert distance(1.7, 0.9) == pytest.approx(0.8 - NEAR / 2)
    assert distance(0.9 + NEAR / 2, 0.9) == pytest.approx(NEAR / 8, rel=1e-4)  # Huber's: x^2 / 2 NEAR


def test_of_several_modes_the_likely_one_that_is_near_counts() -> None:
    def distance(wanted: float, modes: Mixture) -> float:
        return float(_box_loss(modes, torch.tensor([[wanted]])))

    outputs = torch.tensor([[np.log(3.0), 0.0, -0.5, 0.5]], dtype=torch.float32)  # at -0.5 with 3/4, else at 0.5
    modes = Mixture(2, 1).proba_distribution(outputs, torch.zeros(1))
    assert distance(-0.5, modes) == pytest.approx(-np.log(0.75), rel=1e-5)
    assert distance(0.5, modes) == pytest.approx(-np.log(0.25), rel=1e-5)
    alone = DiagGaussianDistribution(1).proba_distribution(torch.tensor([[0.3]]), torch.zeros(1))
    twice = Mixture(2, 1).proba_distribution(torch.tensor([[1.0, -2.0, 0.3, 0.3]]), torch.zeros(1))
    assert distance(0.5, twice) == pytest.approx(float(_box_loss(alone, torch.tensor([[0.5]]))), rel=1e-5)


@pytest.mark.slow
def test_imitation_in_a_box() -> None:
    env = "wavegym/RfEoFar-v0"
    own = {
        "candidates": 0,
        "policy": "mlp",
        "teacher": "myopic",
        "teacher_episodes": 20,
        "imitation_rounds": 2,
        "imitation_epochs": 40,
        "network": (64, 64),
    }
    chosen = TrainingRun(env, "ppo", 0, load_settings(env, "ppo", {**SMALL["ppo"], **own}, {"horizon": 20}))
    model: Any = build_model(chosen)
    system = make_task(env, {"horizon": 20}).system
    worlds, teacher = draw_worlds(system, training_seeds(9, 0, 20)), make_policy("myopic", system, None)
    seen, labels = demonstrations(system, teacher, teacher, worlds, forecasts=False, rng=np.random.default_rng(0))

    def distance() -> float:
        return float(np.abs(LearnedPolicy(export(model.policy), False).act(None, seen, None) - labels).mean())

    before = distance()
    pretrain(model, chosen.settings, [system], chosen.seed)
    assert distance() < 0.2 * before
    assert model.policy.log_std.exp().detach().numpy() == pytest.approx(NEAR)


def test_the_actor_waits_for_the_critic() -> None:
    model: Any = build_model(run())
    rollout = model.n_steps * model.n_envs
    before = export(model.policy).to_bytes()
    model.learn(4 * rollout, callback=WarmUp(4 * rollout))
    assert export(model.policy).to_bytes() == before
    model.learn(4 * rollout, callback=WarmUp(2 * rollout))
    assert export(model.policy).to_bytes() != before
    assert all(parameter.requires_grad for parameter in actor_parameters(model))


def test_a_policy_that_reads_the_belief_alone_can_be_a_teacher() -> None:
    seen, labels = demonstrations(SYSTEM, Myopic(), Myopic(), WORLDS, forecasts=False, rng=np.random.default_rng(0))
    assert seen.shape[1] == len(SYSTEM.observation_fields)
    assert labels.shape == (len(seen),)


def test_the_labels_of_a_rollout_are_the_advantages_of_all_candidates() -> None:
    planner = make_policy("rollout:6", SYSTEM, None)
    assert isinstance(planner, RolloutPlanner)
    planner.futures.count = 2
    few = draw_worlds(SYSTEM, training_seeds(9, 0, 6))
    seen, labels = demonstrations(SYSTEM, planner, TEACHER, few, forecasts=True, rng=np.random.default_rng(0))
    again, the_same = demonstrations(SYSTEM, planner, TEACHER, few, forecasts=True, rng=np.random.default_rng(0))
    assert labels.shape == (len(seen), 8)
    assert labels.dtype == np.float32
    assert (labels == the_same).all()
    assert (np.abs(labels) <= MOST).all()
    assert (seen == again).all()  # where the teacher's rule goes, whatever the planner would have done


@pytest.mark.slow
def test_the_actor_learns_a_distribution_over_candidates() -> None:
    model: Any = build_model(run())
    seen, chosen = demonstrations(SYSTEM, TEACHER, TEACHER, WORLDS, forecasts=True, rng=np.random.default_rng(0))
    labels = np.where(np.arange(8) == chosen[:, None], 3.0, 0.0).astype(np.float32)
    labels[:, 5] = np.nan  # not allowed, so nothing is asked of it
    least = cross_entropy(labels, labels)

    def excess() -> float:
        logits = model.policy.get_distribution(torch.as_tensor(seen)).distribution.logits
        return cross_entropy(logits.detach().numpy(), labels) - least

    before = excess()
    imitate(model, seen, labels, 60, np.random.default_rng(0))
    assert 0.0 < excess() < 0.3 * before


@pytest.mark.parametrize("policy", ["scorer", "mlp"])
def test_a_lower_temperature_changes_no_greedy_choice(policy: str) -> None:
    model: Any = build_model(run(policy=policy))
    seen = torch.randn(50, model.observation_space.shape[0])
    before = model.policy.get_distribution(seen).distribution
    calibrate_temperature(model)
    after = model.policy.get_distribution(seen).distribution
    assert (before.probs.argmax(dim=1) == after.probs.argmax(dim=1)).all()
    assert (after.entropy() < before.entropy()).all()
    torch.testing.assert_close(
        after.probs, torch.softmax(INVERSE_TEMPERATURE * before.logits, dim=1), rtol=1e-4, atol=1e-6
    )


def cross_entropy(logits: Any, labels: Any) -> float:
    return float(_cross_entropy(torch.tensor(logits), torch.tensor(labels)))


def test_the_loss_is_the_cross_entropy_over_the_allowed_candidates() -> None:
    labels = np.array([[1.0, 2.0, np.nan]])
    expected = entropy(softmax([1.0, 2.0]))
    assert cross_entropy(np.array([[5.0, 6.0, -70.0]]), labels) == pytest.approx(expected)  # only differences count
    more = entropy(softmax([1.0, 2.0]), softmax([2.0, 0.0]))  # Kullback-Leibler
    assert cross_entropy(np.array([[2.0, 0.0, 90.0]]), labels) == pytest.approx(expected + more)


def test_training_with_a_rollout_for_a_teacher() -> None:
    chosen = run(teacher="rollout:4", teacher_futures=2, teacher_episodes=3, imitation_rounds=2, imitation_epochs=2)
    model: Any = build_model(chosen)
    pretrain(model, chosen.settings, [SYSTEM], chosen.seed)
    assert export(model.policy).to_bytes() != export(build_model(chosen).policy).to_bytes()


@pytest.mark.slow
def test_imitated_actions_have_higher_q_values_by_the_margin() -> None:
    own = {"policy": "scorer", "network": (32,), "forecasts": True}
    model: Any = build_model(TrainingRun(ID, "dqn", 3, load_settings(ID, "dqn", {**SMALL["dqn"], **own})))
    seen, labels = demonstrations(SYSTEM, TEACHER, TEACHER, WORLDS, forecasts=True, rng=np.random.default_rng(0))
    imitate(model, seen, labels, 120, np.random.default_rng(0))
    values = preferences(model, torch.as_tensor(seen)).detach().numpy()
    assert (values.argmax(axis=1) == labels).mean() > 0.8
    first, second = np.sort(values, axis=1)[:, :-3:-1].T
    assert 0.5 * MARGIN < np.median(first - second) < 3 * MARGIN  # no more is asked; a cross-entropy would ask for it


@pytest.mark.parametrize("policy", ["scorer", "mlp"])
@pytest.mark.slow
def test_dqn_imitates_too(policy: str) -> None:
    own = {"policy": policy, "network": (16,), "forecasts": True, "exploration_initial_eps": 0.1, "critic_warm_up": 40}
    imitation = {"teacher": "rollout:4", "teacher_episodes": 4, "imitation_rounds": 2, "imitation_epochs": 2}
    chosen = TrainingRun(ID, "dqn", 3, load_settings(ID, "dqn", {**SMALL["dqn"], **own, **imitation}))
    model: Any = build_model(chosen)
    untrained = export(model.policy).to_bytes()
    pretrain(model, chosen.settings, [SYSTEM], chosen.seed)
    imitated = export(model.policy).to_bytes()
    assert imitated != untrained
    for online, target in zip(model.q_net.parameters(), model.q_net_target.parameters(), strict=True):
        torch.testing.assert_close(online, target)
    model.learn(150, callback=WarmUp(150))
    has_learned = export(model.policy).to_bytes() != imitated
    assert has_learned == (policy == "mlp")  # a dueling network's V learns alone first; here is no other part
    model.learn(150, callback=WarmUp(0))
    assert export(model.policy).to_bytes() != imitated


def test_a_heuristic_teaches_with_the_constants_of_the_defaults_where_the_training_changes_parameters(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """No search for constants in every run: it would take longer than the learning."""
    taught: list[Any] = []

    def note(system: Any, teacher: Any, *others: Any) -> Any:
        taught.append(teacher)
        return demonstrations(system, teacher, *others)

    monkeypatch.setattr(imitation, "demonstrations", note)
    settings = load_settings(
        ID, "ppo", {**SMALL["ppo"], "teacher": "cost-of-delay", "teacher_episodes": 2}, {"dead_steps": 2}
    )
    changed = TrainingRun(ID, "ppo", 3, settings)
    system = make_task(ID, dict(settings.environment)).system
    assert recorded(system) == {}
    pretrain(build_model(changed), settings, [system], 3)
    constants = records()[record_key(system)]["cost-of-delay"]
    assert {name: getattr(taught[0], name) for name in constants} == constants


def test_each_variant_has_an_equal_share_of_the_lessons(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[tuple[Any, int]] = []

    def note(system: Any, teacher: Any, actor: Any, worlds: Any, *others: Any) -> Any:
        given.append((system.reference_range, len(system.initial(worlds).belief.step)))
        return demonstrations(system, teacher, actor, worlds, *others)

    monkeypatch.setattr(imitation, "demonstrations", note)
    changes = {"num_envs": 4, "teacher": "cost-of-delay", "teacher_episodes": 6, "imitation_rounds": 2}
    variants = [{"reference_range": 4e3}, {"reference_range": 5e3}]
    chosen = load_settings(ID, "ppo", {**SMALL["ppo"], **changes, "variants": variants})
    model = build_model(TrainingRun(ID, "ppo", 3, chosen))
    pretrain(model, chosen, systems_of(model.get_env()), 3)
    assert given == [(4e3, 3), (5e3, 3)] * 2


def test_variants_in_which_an_agent_sees_other_things_are_an_error() -> None:
    """The scaling of the delays of looks depends on the dead steps."""
    variants = [{"dead_steps": 2}, {"dead_steps": 3}]
    run = TrainingRun(ID, "ppo", 3, load_settings(ID, "ppo", {**SMALL["ppo"], "num_envs": 4, "variants": variants}))
    wanted = r"variants differ in what an agent sees or does: scaling with \{'dead_steps': 3\}, expected as with"
    with pytest.raises(InputError, match=wanted):
        build_model(run)
