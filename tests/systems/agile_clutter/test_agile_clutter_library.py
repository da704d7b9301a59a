"""Pulses of the user's own at the agile-clutter sensors."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np
import oracles
import pytest

from wavegym.core import shortcuts
from wavegym.core.action_sets import Library
from wavegym.core.errors import InputError
from wavegym.core.parameters import make_checked
from wavegym.rendering.panels import Moment
from wavegym.systems.agile_clutter import AgileClutter
from wavegym.systems.agile_clutter.scene import TargetScene, transmitted
from wavegym.systems.beam_allocation import BeamAllocation
from wavegym.systems.energy_budget import EnergyBudget
from wavegym.waveforms import TrapezoidChirp, Waveform, measurement_covariances
from wavegym.waveforms import trapezoid_chirp_library as chirps


@dataclass(frozen=True)
class HannChirp(Waveform):
    """Linear chirp with a cos^2 envelope, as in the docs."""

    duration: float  # s
    sweep: float  # Hz

    @property
    def label(self):
        return f"Hann {self.duration * 1e6:g} us {self.sweep / 1e6:g} MHz"

    @property
    def support(self):
        return (-self.duration / 2, self.duration / 2)

    def envelope(self, t):
        u = np.asarray(t) / self.duration
        return np.where(abs(u) < 0.5, np.cos(np.pi * u) ** 2, 0.0) * np.sqrt(8 / (3 * self.duration))

    def phase(self, t):
        return np.pi * self.sweep / self.duration * np.square(t)


OWN = Library((HannChirp(100e-6, 5e6), HannChirp(50e-6, -8e6), TrapezoidChirp(kind="hfm", duration=1e-4, sweep=1e6)))


@pytest.mark.parametrize("form", ["library", "joint"])
def test_own_pulses_are_transmitted_with_their_covariances(form):
    system = AgileClutter(library=OWN, action=form)
    pairs = list(product(range(3), repeat=2))
    C, want = system.action_set.unit_covariance(system.candidates()), measurement_covariances(OWN, system.carrier_hz)
    np.testing.assert_array_equal(C, want[np.array(pairs)])
    np.testing.assert_array_equal(
        system.action_set.unit_covariance(shortcuts.constants(system)), want[np.array([(a, a) for a in range(3)])]
    )
    for index, pair in enumerate(pairs):
        assert transmitted(system, system.candidates()[index : index + 1]) == [OWN[a] for a in pair]


def test_the_built_in_chirps_given_as_own_pulses_play_the_same_episode():
    """All actions are indices of the same pulses, so states agree bit for bit."""
    plain = AgileClutter(laws=("hfm:0.5",), durations=(3e-5,), sweeps=(4e6, 15e6))
    own = AgileClutter(library=chirps(("hfm:0.5",), (3e-5,), (4e6, 15e6)))
    worlds, rng = oracles.worlds(plain, 6), np.random.default_rng(1)
    states = [system.initial(worlds) for system in (plain, own)]
    for _ in range(plain.horizon):
        action = rng.integers(4, size=(6, 2))
        states = [s.transition(state, action, worlds) for s, state in zip((plain, own), states, strict=True)]
        np.testing.assert_array_equal(
            shortcuts.best_action(plain, states[0].belief), shortcuts.best_action(own, states[1].belief)
        )
        np.testing.assert_array_equal(states[0].belief.covariance, states[1].belief.covariance)


@pytest.mark.parametrize("form", ["library", "joint"])
def test_an_environment_of_own_pulses_is_played_and_drawn(form):
    env = gym.make("wavegym/AgileClutter-v0", library=OWN, action=form)
    env.reset(seed=1)
    assert np.isfinite(env.step(env.action_space.sample())[1])
    system = env.unwrapped.system
    worlds = oracles.worlds(system, 1)
    states, action = [system.initial(worlds)], system.candidates()[:1]
    states.append(system.transition(states[0], action, worlds))
    figure = plt.figure()
    TargetScene(system, figure.subfigures()).draw(Moment(system, states, [action], np.zeros(2)))
    plt.close(figure)


@pytest.mark.parametrize(
    ("kind", "settings", "words"),
    [
        (AgileClutter, {"action": "box"}, "library is given with action='box', expected action='library' or 'joint'"),
        (AgileClutter, {"laws": ("lfm",)}, r"laws is \('lfm',\) with library=, expected one of the two"),
        (AgileClutter, {"sweeps": (1e6,)}, r"sweeps is \(1000000.0,\) with library="),
        (AgileClutter, {"library": Library(("a", "b"))}, "library holds 'a', expected waveforms only"),
        (BeamAllocation, {}, "library"),
        (EnergyBudget, {}, "library"),
    ],
)
def test_a_library_that_cannot_be_used_is_refused_in_one_line(kind, settings, words):
    with pytest.raises(InputError, match=words) as error:
        make_checked(kind, {"library": OWN, **settings})
    assert "\n" not in str(error.value)
