"""Who chooses which part of an action: by declaration, or by the form of the action set."""

from __future__ import annotations

import re

import gymnasium as gym
import pytest
from two_sensors import TwoSensors

from wavegym.core.action_sets import JointLibrary, Library, Parameter, ParameterBox, PerSensorLibrary
from wavegym.core.parameters import system_parameters
from wavegym.core.policy import decision_makers, makers_by_form
from wavegym.core.traits import DecisionMaker, DecisionMakers
from wavegym.registration import full_id
from wavegym.testing.shortcut_check import shortcut_defect

LIBRARY = Library(("short", "long"))
OWNED = {"AgileClutter": 8, "BeamAllocation": 12, "EnergyBudget": 4, "EnergyBudgetKnown": 4, "RfEo": 12, "RfEoFar": 12}


def parameters(*names):
    box = ParameterBox(tuple(Parameter(name, "s", 1.0, 2.0) for name in names))
    return [maker.parameters for maker in makers_by_form(box)]


@pytest.mark.parametrize("kind", [PerSensorLibrary, JointLibrary])
def test_a_library_of_several_sensors_has_one_for_each(kind):
    names = [maker.name for maker in makers_by_form(kind(LIBRARY, 3), "platform")]
    assert names == ["platform_1", "platform_2", "platform_3"]
    assert makers_by_form(LIBRARY) == (DecisionMaker("sensor_1"),)


def test_the_numbers_at_the_ends_of_names_tell_the_sensors_of_a_box():
    assert parameters("k_1", "b_1", "k_2", "b_2") == [("k_1", "b_1"), ("k_2", "b_2")]
    assert parameters("k_2", "k_1", "b_2") == [("k_1",), ("k_2", "b_2")]
    ten = [f"k_{i}" for i in range(1, 11)]
    assert parameters(*ten) == [(name,) for name in ten]


@pytest.mark.parametrize("names", [("k", "b"), ("k_1", "b"), ("k_1", "k_3"), ("k_0", "k_1"), ("k_01", "k_2")])
def test_a_box_without_a_number_for_each_sensor_has_one(names):
    assert parameters(*names) == [names]


@pytest.mark.parametrize(("name", "fields"), OWNED.items())
def test_the_suite_declares_whose_fields_are_whose(name, fields):
    """Every field at a sensor names the sensor in its meaning, whatever this sensor is called."""
    system = gym.make(full_id(name)).unwrapped.system
    makers = decision_makers(system)
    assert [len(maker.fields) for maker in makers] == [fields, fields]
    for number, maker in enumerate(makers, 1):
        about = {e.name for e in system.observation_fields if f"{maker.name.replace('_', ' ')}" in e.meaning}
        assert about == set(maker.fields)
        assert maker.name.endswith(f"_{number}")


@pytest.mark.parametrize("form", ["library", "joint", "box"])
@pytest.mark.parametrize("name", ["AgileClutter", "RfEo", "RfEoFar"])
def test_every_form_has_the_same_decision_makers(name, form):
    system = gym.make(full_id(name), action=form).unwrapped.system
    default = gym.make(full_id(name)).unwrapped.system
    assert [m._replace(parameters=()) for m in decision_makers(system)] == [
        m._replace(parameters=()) for m in decision_makers(default)
    ]
    owned = [parameter for maker in decision_makers(system) for parameter in maker.parameters]
    assert owned == (list(system.actions.names) if form == "box" else [])


def test_a_system_that_declares_nothing_shares_every_field():
    makers = decision_makers(TwoSensors(action="box"))
    assert makers == (DecisionMaker("sensor_1", (), ("duration_1",)), DecisionMaker("sensor_2", (), ("duration_2",)))


WRONG = {
    "decision_makers share names": [DecisionMaker("left"), DecisionMaker("left")],
    "decision_makers share fields": [DecisionMaker("left", ("mean_0",)), DecisionMaker("right", ("mean_0",))],
    "decision_makers have fields that the system lacks: .'mean_7'": [
        DecisionMaker("left", ("mean_7",)),
        DecisionMaker("right"),
    ],
    "decision_makers have parameters that the system lacks": [
        DecisionMaker("left", (), ("duration_1",)),
        DecisionMaker("right"),
    ],
    "decision_makers are 1, but the action set is for 2": [DecisionMaker("left")],
}


@pytest.mark.parametrize(("defect", "makers"), WRONG.items())
def test_the_check_of_traits_finds_a_wrong_declaration(defect, makers):
    @system_parameters
    class Declared(TwoSensors, DecisionMakers):
        """Two sensors."""

        @property
        def decision_makers(self):
            return tuple(makers)

    assert re.search(defect, shortcut_defect(Declared()) or "")


def test_the_check_of_traits_finds_a_parameter_that_nobody_chooses():
    @system_parameters
    class Declared(TwoSensors, DecisionMakers):
        """Two sensors."""

        @property
        def decision_makers(self):
            return DecisionMaker("left", (), ("duration_1",)), DecisionMaker("right")

    found = shortcut_defect(Declared(action="box"))
    assert found == "DecisionMakers at step 0: decision_makers leave out the parameters ['duration_2']"
