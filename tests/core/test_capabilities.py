"""Capabilities are declared, and a shortcut is dropped below an override of what it computes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import oracles
import pytest
from delay_systems import DelaySystem

from wavegym.core.capabilities import (
    CAPABILITIES,
    BestAction,
    BestSequence,
    DeterministicRecursion,
    Gain,
    LinearCost,
    MostInformation,
    SequencePlan,
    offers,
    why_not,
)
from wavegym.core.errors import InputError
from wavegym.evaluation.task import make_task
from wavegym.registration import SYSTEMS
from wavegym.schedulers.lookahead import Lookahead
from wavegym.schedulers.registry import make_policy
from wavegym.schedulers.rollout import rollout
from wavegym.systems.kershaw_evans import KershawEvansPosition
from wavegym.testing.capability_check import capability_defect


@dataclass(frozen=True)
class VelocityMatters(KershawEvansPosition):
    """What a user writes: another cost, and nothing else."""

    horizon: int = 12
    durations: tuple[float, ...] = (10e-6, 60e-6, 300e-6)

    def cost(self, belief):
        return np.sqrt(belief.covariance[..., 1, 1])


def test_a_cost_of_ones_own_is_searched_by_the_generic_functions():
    """The trap: a search for the inherited cost, in the compiled lookahead and in the optimum."""
    system = VelocityMatters()
    assert not any(offers(system, kind) for kind in (BestSequence, DeterministicRecursion, LinearCost))
    worlds = oracles.worlds(system, 10)
    myopic = rollout(system, make_policy("myopic", system, worlds), worlds).mean_cost
    ahead = rollout(system, make_policy("lookahead:2", system, worlds), worlds)
    generic = rollout(system, Lookahead(2, fused=False), worlds)
    np.testing.assert_array_equal(ahead.actions, generic.actions)
    assert ahead.mean_cost.mean() < 1.05 * myopic.mean()
    with pytest.raises(
        InputError, match="'optimum' cannot be computed for VelocityMatters: it overrides cost, but inherits"
    ):
        make_policy("optimum", system, worlds).begin(system, 10, np.random.default_rng(0))


def test_a_prediction_of_ones_own_has_no_inherited_gate():
    class Drifting(KershawEvansPosition):
        def predict(self, belief, actions, outcome=None):
            return super().predict(belief, actions)

    with pytest.raises(
        InputError, match="'myopic:gate' cannot be computed for Drifting: it overrides predict, but inherits"
    ):
        make_policy("myopic:gate", Drifting(), None)


def test_the_checker_names_the_override():
    wanted = "it overrides cost, but inherits best_sequence from KershawEvans, which knows nothing of it"
    assert capability_defect(VelocityMatters()) == f"BestSequence: {wanted}"


def test_a_withdrawn_capability_is_no_defect():
    class Honest(VelocityMatters):
        best_sequence = deterministic_recursion = weights = predicted = None

    assert capability_defect(Honest()) is None
    assert why_not(Honest(), BestSequence) == "it withdraws best_sequence"


def test_a_search_of_ones_own_beside_a_cost_of_ones_own_counts():
    class Both(VelocityMatters):
        def best_sequence(self, belief, depth):
            search = Lookahead(depth, fused=False)
            search.begin(self, len(belief.step), np.random.default_rng(0))
            values = search.values(belief)
            return values.argmin(axis=1), values.min(axis=1)

        deterministic_recursion = weights = predicted = None

    assert offers(Both(), BestSequence)
    assert capability_defect(Both()) is None

    class Wrong(Both):
        def best_sequence(self, belief, depth):
            first, cost = super().best_sequence(belief, depth)
            return first, 0.99 * cost

    assert "BestSequence at step 0: best_sequence(depth 2) costs" in capability_defect(Wrong())


def test_a_method_that_is_not_declared_is_named():
    class Silent(VelocityMatters):
        best_sequence = deterministic_recursion = weights = predicted = None

        def best_action(self, belief):
            return np.zeros(len(belief.step), int)

    message = "it has best_action but does not declare it, expected class Silent(System, BestAction)"
    assert capability_defect(Silent()) == f"BestAction: {message}"
    assert not offers(Silent(), BestAction)


def test_a_member_that_is_missing_is_named():
    class Bare(VelocityMatters, SequencePlan):
        plan = None

    assert why_not(Bare(), SequencePlan) == "it withdraws plan"
    assert why_not(Bare(), Gain) == "it has no gain"


def test_wrong_gains_are_found():
    class Greedy(DelaySystem):
        def gain(self, belief, wait, ahead):
            return 1.1 * super().gain(belief, wait, ahead)

    assert capability_defect(DelaySystem()) is None
    assert "Gain at step" in capability_defect(Greedy())


def test_too_little_information_in_one_environment_is_found():
    class Informed(DelaySystem, MostInformation):
        threshold = 2.0

        def information(self, belief, actions):
            return np.repeat(1.0 + np.asarray(actions, float)[..., None], 2, axis=-1)

        def most_information(self, belief, threshold=None):
            return np.ones(len(belief.step), int), np.ones(len(belief.step), bool)

    class Wanting(Informed):
        def most_information(self, belief, threshold=None):
            actions, feasible = super().most_information(belief)
            actions[-1] = 0
            return actions, feasible

    class Honest(Wanting):
        def most_information(self, belief, threshold=None):
            actions, _ = super().most_information(belief)
            return actions, actions > 0

    assert capability_defect(Informed()) is None
    assert capability_defect(Honest()) is None
    wanted = "most_information() gives [2.0, 2.0, 1.0], less than the threshold 2"
    assert capability_defect(Wanting()) == f"MostInformation at step 0: {wanted}"


@pytest.mark.parametrize("name", [name for name in SYSTEMS if "Signal" not in name])
def test_every_capability_of_the_suite_holds(name):
    assert capability_defect(make_task(name, {}).system) is None


KALMAN = (
    "BestSequence ClosedForm DeterministicRecursion FusedTransition InnovationCovariance LinearCost "
    "MeasurementObservation RecordedTargets TimedPulses"
)
RF_EO = (
    "BestAction DecisionMakers FusedTransition LinearCost Margin MeasurementObservation MostInformation "
    "RecordedTargets SequencePlan TimedPulses"
)
OFFERED = {
    "KershawEvans": KALMAN,
    "KershawEvansPosition": KALMAN,
    "AgileClutter": "BestAction DecisionMakers FusedTransition LinearCost RecordedTargets SensorBySensor TimedPulses",
    "RfEo": RF_EO,
    "RfEoFar": RF_EO,
    "Urban": "DecisionMakers TimedPulses",
    "UrbanSignal": "DecisionMakers TimedPulses",
    "CameraSlew": "Delay FusedTransition Gain LinearCost MeasurementObservation RecordedTargets TimedPulses",
    "SectorSetup": "Delay FusedTransition Gain LinearCost MeasurementObservation RecordedTargets",
    "SectorSetupCity": "Delay FusedTransition Gain LinearCost MeasurementObservation",
    "BeamAllocation": "DecisionMakers Delay FusedTransition Gain GainByTarget LinearCost RecordedTargets TimedPulses",
    "EnergyBudget": "DecisionMakers Delay FusedTransition Gain LinearCost RecordedTargets Spending TimedPulses",
    "EnergyBudgetKnown": "DecisionMakers Delay FusedTransition Gain LinearCost RecordedTargets Spending TimedPulses",
    "MultifunctionRadar": "SimulatedFutures TimedPulses TrackSlots UnequalSteps",
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_what_the_suite_offers(name):
    system = make_task(name, {}).system
    offered = sorted(kind.__name__ for kind in CAPABILITIES if offers(system, kind))
    assert " ".join(offered) == OFFERED[type(system).__name__]
