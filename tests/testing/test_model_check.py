"""The checks of check_vector_env on a system's planning functions."""

from __future__ import annotations

import numpy as np
import pytest

from wavegym.envs import WaveformVectorEnv
from wavegym.systems.kershaw_evans.system import KershawEvans
from wavegym.testing import check_vector_env
from wavegym.testing.check import ConformanceError, prediction_defect


class Stuck(KershawEvans):
    def predict(self, belief, actions, outcome=None):
        return belief


class Frozen(KershawEvans):
    def predict(self, belief, actions, outcome=None):
        predicted = super().predict(belief, actions)
        return predicted._replace(step=predicted.step - 1)


class Careless(KershawEvans):
    def predict(self, belief, actions, outcome=None):
        belief.mean[:] = 0.0
        return super().predict(belief, actions)


class NotANumber(KershawEvans):
    def cost(self, belief):
        return super().cost(belief) * np.nan


class TraceOfEach(KershawEvans):
    def trace(self, belief):
        return super().trace(belief)[..., None]


class FlatMask(KershawEvans):
    def mask(self, belief):
        return np.ones(len(self.actions.labels), bool)


@pytest.mark.parametrize(
    ("system", "words"),
    [
        (Stuck, r"predict\(\) with actions \(env,\): step is not one later"),
        (Frozen, "step is not one later"),
        (Careless, r"predict\(\) changed the belief"),
        (NotANumber, r"cost\(\) is not finite"),
        (TraceOfEach, r"trace\(\) returned shape \(3, 1\), expected \(3,\)"),
        (FlatMask, r"mask\(\) returned shape \(88,\)"),
    ],
)
def test_a_system_with_a_defect_is_rejected(system, words):
    def make(num_envs, autoreset_mode):
        return WaveformVectorEnv(system, num_envs, autoreset_mode=autoreset_mode, horizon=3)

    with pytest.raises(ConformanceError, match=words):
        check_vector_env(make)


@pytest.mark.parametrize("action", ["library", "box"])
def test_a_system_of_the_suite_passes(action):
    assert prediction_defect(KershawEvans(action=action)) is None
