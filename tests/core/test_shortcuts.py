"""Shortcuts are registered for pairs, do not apply if a subclass overrides what they replace, and keep the contract."""

from __future__ import annotations

import pickle
from dataclasses import dataclass

import numpy as np
import oracles
import pytest
from delay_systems import DelaySystem

from wavegym.core import shortcuts
from wavegym.core.errors import InputError, InputWarning
from wavegym.core.shortcuts import KINDS, why_not
from wavegym.core.traits import TRAITS, lacks_trait
from wavegym.evaluation.play import make_task
from wavegym.registration import SYSTEMS
from wavegym.schedulers.lookahead import Lookahead
from wavegym.schedulers.registry import make_policy
from wavegym.schedulers.rollout import rollout
from wavegym.systems.kershaw_evans import KershawEvansPosition
from wavegym.testing.shortcut_check import CHECKS, shortcut_defect


@dataclass(frozen=True)
class VelocityMatters(KershawEvansPosition):
    """A user's subclass: another cost, and nothing else."""

    horizon: int = 12
    durations: tuple[float, ...] = (10e-6, 60e-6, 300e-6)

    def cost(self, belief):
        return np.sqrt(belief.covariance[..., 1, 1])


def searched(system, belief, depth):
    """The oracle of a compiled search."""
    search = Lookahead(depth, fused=False)
    search.begin(system, len(belief.step), np.random.default_rng(0))
    values = search.values(belief)
    return values.argmin(axis=1), values.min(axis=1)


def test_a_cost_of_ones_own_is_searched_by_the_generic_functions():
    """The trap: a search for the inherited cost, in the compiled lookahead and in the optimum."""
    system = VelocityMatters()
    void = shortcuts.best_sequence, shortcuts.deterministic_recursion, shortcuts.linear_cost
    assert not any(kind.of(system) for kind in void)
    assert all(kind.of(KershawEvansPosition()) for kind in void)
    worlds = oracles.worlds(system, 10)
    myopic = rollout(system, make_policy("myopic", system, worlds), worlds).mean_cost
    ahead = rollout(system, make_policy("lookahead:2", system, worlds), worlds)
    generic = rollout(system, Lookahead(2, fused=False), worlds)
    np.testing.assert_array_equal(ahead.actions, generic.actions)
    assert ahead.mean_cost.mean() < 1.05 * myopic.mean()
    known = "it overrides cost, but deterministic_recursion is registered for KershawEvans"
    with pytest.raises(InputError, match=f"'optimum' cannot be computed for VelocityMatters: {known}"):
        make_policy("optimum", system, worlds).begin(system, 10, np.random.default_rng(0))


def test_a_prediction_of_ones_own_has_no_inherited_gate():
    class Drifting(KershawEvansPosition):
        def predict(self, belief, actions, outcome=None):
            return super().predict(belief, actions)

    with pytest.raises(InputError, match="'myopic:gate' cannot be computed for Drifting: it overrides predict, but"):
        make_policy("myopic:gate", Drifting(), None)


def test_a_void_shortcut_is_named_and_no_defect():
    wanted = "it overrides cost, but best_sequence is registered for KershawEvans, which knows nothing of it"
    assert why_not(VelocityMatters(), shortcuts.best_sequence) == wanted
    with pytest.raises(InputError, match=f"best_sequence cannot be computed for VelocityMatters: {wanted}"):
        shortcuts.best_sequence(VelocityMatters(), None, 2)
    assert shortcut_defect(VelocityMatters()) is None


def test_a_field_of_the_class_below_overrides_too():
    class Renamed(KershawEvansPosition):
        cost: int = 1

    assert "it overrides cost" in shortcuts.best_sequence.why_not(Renamed.__new__(Renamed))


def test_a_shortcut_that_another_one_replaces_voids_it():
    class Stepping(KershawEvansPosition):
        pass

    assert shortcuts.deterministic_recursion.of(Stepping())
    shortcuts.fused_transition.register(Stepping)(KershawEvansPosition.composed_transition)
    assert "it overrides fused_transition, but" in shortcuts.deterministic_recursion.why_not(Stepping())


def test_a_withdrawn_shortcut_is_no_defect():
    class Honest(KershawEvansPosition):
        pass

    shortcuts.best_sequence.withdraw(Honest)
    assert shortcut_defect(Honest(horizon=6)) is None
    assert why_not(Honest(), shortcuts.best_sequence) == "it withdraws best_sequence"
    assert shortcuts.best_sequence.of(Honest()) is None
    assert shortcuts.best_sequence.of(KershawEvansPosition())


def test_a_search_of_ones_own_beside_a_cost_of_ones_own_counts():
    class Both(VelocityMatters):
        pass

    shortcuts.best_sequence.register(Both)(searched)
    assert shortcuts.best_sequence.of(Both())
    assert shortcut_defect(Both()) is None

    class Wrong(Both):
        pass

    @shortcuts.best_sequence.register(Wrong)
    def wrong(system, belief, depth):
        first, cost = searched(system, belief, depth)
        return first, 0.99 * cost

    assert "best_sequence at step 0: best_sequence(depth 2) costs" in shortcut_defect(Wrong())


def test_what_is_registered_later_is_found_and_survives_a_pickle():
    class Late(VelocityMatters):
        pass

    system = Late()
    assert shortcuts.best_sequence.of(system) is None
    shortcuts.best_sequence.register(Late)(searched)
    assert shortcuts.best_sequence.of(system).args == (system,)
    search = shortcuts.best_sequence.of(KershawEvansPosition())
    assert pickle.loads(pickle.dumps(search)).func is search.func
    assert pickle.loads(pickle.dumps(shortcuts.gain)) is shortcuts.gain


def test_a_method_that_is_not_registered_is_named():
    class Silent(VelocityMatters):
        def best_action(self, belief):
            return np.zeros(len(belief.step), int)

    message = "it has best_action but does not register it, expected @best_action.register(Silent)"
    assert shortcut_defect(Silent()) == f"best_action: {message}"
    assert not shortcuts.best_action.of(Silent())
    assert why_not(VelocityMatters(), shortcuts.gain) == "it has no gain"


def test_a_trait_that_is_not_declared_is_named():
    class Silent(DelaySystem):
        def duration(self, belief):
            return np.ones(len(belief.step))

    message = "it has duration but no such trait, expected class Silent(System, UnequalSteps)"
    assert shortcut_defect(Silent()) == f"UnequalSteps: {message}"


def test_only_a_class_can_have_a_shortcut():
    with pytest.raises(InputError, match="gain was registered for 'Mine', expected a class of systems"):
        shortcuts.gain.register("Mine")


def test_a_shortcut_replaces_functions_that_the_system_has(monkeypatch):
    monkeypatch.setattr("wavegym.core.shortcuts.KINDS", dict(KINDS))
    with pytest.raises(InputError, match="expected names of functions: @shortcut"):
        shortcuts.shortcut(named_gain)

    @shortcuts.shortcut("predikt", "gain")
    def misspelt(system, belief):
        """Never void."""

    with pytest.raises(
        InputError, match=r"misspelt replaces 'predikt', expected a function of DelaySystem; .*'predict'"
    ):
        misspelt.register(DelaySystem)


def named_gain(system, belief):
    """Of somebody else."""


named_gain.__name__ = "gain"


def test_a_kind_may_come_from_outside(monkeypatch):
    kinds = dict(KINDS)
    monkeypatch.setattr("wavegym.core.shortcuts.KINDS", kinds)
    monkeypatch.setattr("wavegym.testing.shortcut_check.KINDS", kinds)

    @shortcuts.shortcut("cost")
    def worst_target(system, belief):
        """The target of the greatest share of the cost, (env,)."""

    assert worst_target.__doc__.startswith("The target")

    @worst_target.register(DelaySystem)
    def largest(system, belief):
        return np.trace(belief.covariance, axis1=-2, axis2=-1).argmax(axis=-1)

    with pytest.warns(
        InputWarning, match=r"worst_target of DelaySystem is not checked, expected .*CHECKS\['worst_target"
    ):
        assert shortcut_defect(DelaySystem()) is None
    monkeypatch.setitem(CHECKS, "worst_target", lambda system, at: f"{len(at.belief.step)} environments")
    assert shortcut_defect(DelaySystem()) == "worst_target at step 0: 3 environments"
    with pytest.raises(InputError, match=r"shortcut gain of .* is declared in wavegym.core.shortcuts already"):
        shortcuts.shortcut("cost")(named_gain)

    system = DelaySystem()
    belief = system.initial(oracles.worlds(system, 2)).belief
    assert worst_target(system, belief).tolist() == worst_target.of(system)(belief).tolist() == [0, 0]


def test_wrong_gains_are_found():
    class Greedy(DelaySystem):
        pass

    @shortcuts.gain.register(Greedy)
    def gain(system, belief, wait, ahead):
        return 1.1 * shortcuts.gain.registered[DelaySystem](system, belief, wait, ahead)

    assert shortcut_defect(DelaySystem()) is None
    assert "gain at step" in shortcut_defect(Greedy())


def test_too_little_information_in_one_environment_is_found():
    class Informed(DelaySystem):
        threshold = 2.0

        def information(self, belief, actions):
            return np.repeat(1.0 + np.asarray(actions, float)[..., None], 2, axis=-1)

    class Wanting(Informed):
        pass

    class Honest(Wanting):
        pass

    @shortcuts.most_information.register(Informed)
    def most(system, belief, threshold=None):
        return np.ones(len(belief.step), int), np.ones(len(belief.step), bool)

    @shortcuts.most_information.register(Wanting)
    def short(system, belief, threshold=None):
        actions, feasible = most(system, belief)
        actions[-1] = 0
        return actions, feasible

    @shortcuts.most_information.register(Honest)
    def honest(system, belief, threshold=None):
        actions, _ = short(system, belief)
        return actions, actions > 0

    assert shortcut_defect(Informed()) is None
    assert shortcut_defect(Honest()) is None
    wanted = "most_information() gives [2.0, 2.0, 1.0], less than the threshold 2"
    assert shortcut_defect(Wanting()) == f"most_information at step 0: {wanted}"


@pytest.mark.parametrize("name", [name for name in SYSTEMS if "Signal" not in name])
def test_every_shortcut_of_the_suite_agrees_with_the_contract(name):
    assert shortcut_defect(make_task(name, {}).system) is None


def test_every_kind_has_a_check():
    assert set(CHECKS) == {name for name, kind in KINDS.items() if kind.__module__ == "wavegym.core.shortcuts"}


KALMAN = (
    "RecordedTargets TimedPulses best_sequence deterministic_recursion fused_transition innovation_covariance "
    "linear_cost measured_fields next_pulse"
)
RF_EO = (
    "DecisionMakers RecordedTargets TimedPulses best_action fused_transition linear_cost measured_fields "
    "most_information named_constants plan"
)
SETUP = "delay fused_transition gain linear_cost measured_fields target_of_action"
CLUTTER = "DecisionMakers RecordedTargets TimedPulses"
OFFERED = {
    "KershawEvans": KALMAN,
    "KershawEvansPosition": KALMAN,
    "AgileClutter": f"{CLUTTER} best_action constants fused_transition linear_cost sensor_by_sensor",
    "RfEo": RF_EO,
    "RfEoFar": RF_EO,
    "Urban": "DecisionMakers TimedPulses baselines",
    "UrbanSignal": "DecisionMakers TimedPulses baselines",
    "CameraSlew": f"RecordedTargets TimedPulses {SETUP}",
    "SectorSetup": f"RecordedTargets TimedPulses {SETUP}",
    "SectorSetupCity": f"TimedPulses {SETUP}",
    "BeamAllocation": f"{CLUTTER} constants delay fused_transition gain gain_by_target linear_cost target_of_action",
    "EnergyBudget": f"{CLUTTER} constants delay fused_transition gain linear_cost spending",
    "EnergyBudgetKnown": f"{CLUTTER} constants delay fused_transition gain linear_cost spending",
    "SharedSpectrum": "TimedPulses baselines best_action fused_transition measured_fields named_constants sensed_band",
    "MultifunctionRadar": "TimedPulses TrackSlots UnequalSteps constants cost_to_come gain_per_second scores simulate",
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_what_the_suite_offers(name):
    system = make_task(name, {}).system
    has = [trait.__name__ for trait in TRAITS if not lacks_trait(system, trait)]
    has += [name for name, kind in KINDS.items() if kind.of(system)]
    # A class without a row of its own offers what its base class does.
    assert " ".join(sorted(has)) == next(
        OFFERED[cls.__name__] for cls in type(system).__mro__ if cls.__name__ in OFFERED
    )


def test_every_registration_of_the_suite_is_checked():
    """Each class with a registered shortcut is the class of an id, or a base of one, and the shortcut applies to it."""
    systems = [make_task(name, {}).system for name in SYSTEMS]
    for kind in KINDS.values():
        for cls in kind.registered:
            if cls.__module__.startswith("wavegym."):
                assert any(isinstance(system, cls) and kind.of(system) for system in systems), (kind.name, cls)
