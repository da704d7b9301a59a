"""Forecasts of each candidate one step ahead, as additional observation fields.

A learner sees the quantities that heuristics use: the expected cost one step ahead, and a pulse's gain, delay and
spending. One network with shared weights can then score every candidate. For tracks in slots (``TrackSlots``) they are
the gains per second of a dwell and the columns of its track.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core import shortcuts
from wavegym.core.action_sets import ParameterBox, PerSensorLibrary
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.system import ObservationField, System
from wavegym.core.traits import TrackSlots
from wavegym.observations.kernels import forecast
from wavegym.observations.scaling import ObservationScaler
from wavegym.observations.shortlist import Shortlist

MOST = 256  # candidates; more take too long to predict at every step
LOOKS = (
    (0, 4),
    (0, 8),
    (0, 16),
    (0, 40),
    (3, 16),
    (6, 16),
    (10, 16),
    (15, 16),
)  # gains: steps waited, summed
SPANS = np.array([steps for _, steps in LOOKS], np.float64)
FLOOR = 1e-4  # added to gains per cost, so that their logarithm is finite


POWERS = (0.0, 0.5, 1.0)  # of the value of a find, in the gains per second
LEAST = 1e-5  # added to gains per second over the largest cost, so that their logarithm is finite
PRESENT = slice(len(POWERS), len(POWERS) + 2)  # forecasts of a dwell whose sum is 1: it updates a track, or it searches


class Forecasts:
    """Forecasts (env, candidate * field) float32 of a belief, candidate after candidate, scaled as observations are.

    Args:
        system: the closed loop.
        listed: the candidates are those of this list. Their forecasts are the cost and the action itself.

    Raises:
        InputError: the action set is not one index for at most MOST candidates, and there is no list.
    """

    def __init__(self, system: System, listed: Shortlist | None = None) -> None:
        self.in_slots = isinstance(system, TrackSlots)
        self.system: Any = system
        self._listed, self._gain, self._spending = listed, None, None
        if listed is None:
            too_many = not self.in_slots and len(system.candidates()) > MOST
            if isinstance(system.actions, (ParameterBox, PerSensorLibrary)) or too_many:
                wanted = f"one index for at most {MOST} actions (nearest: candidates=32)"
                raise InputError(f"forecasts were asked for in {type(system).__name__}, expected {wanted}")
            self.candidates = system.candidates()
            self._gain, self._spending = shortcuts.gain.of(system), shortcuts.spending.of(system)
        self.candidate_fields = self._candidate_fields()
        self._scaler = ObservationScaler(self.observation_fields)

    @property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The fields of every candidate, in order."""
        labels = range(1, self._listed.count + 1) if self._listed else self.system.actions.labels
        return tuple(f._replace(name=f"{f.name}[{label}]") for label in labels for f in self.candidate_fields)

    def __call__(self, belief: Any) -> Array:
        """The forecasts; ``belief`` as policies take it."""
        if self.in_slots:
            return self._scaler(self._of_slots(belief))[0]
        envs = len(belief.step)
        if self._listed:
            actions = self._listed(belief).actions
        else:
            actions = np.broadcast_to(self.candidates, (envs, len(self.candidates)))
        ahead = self.system.cost(self.system.predict(belief, actions))
        mean = ahead.mean(axis=1, keepdims=True)
        ahead, mean = np.where(mean > 0.0, ahead, 1.0), np.where(mean > 0.0, mean, 1.0)  # 0 without targets
        values = np.empty((*ahead.shape, len(self.candidate_fields)))
        values[..., 0] = np.log(ahead / mean)
        if self._listed:
            values[..., 1:] = self._listed.described(actions)
        if self._gain:
            delay = np.broadcast_to(shortcuts.delay(self.system, belief), ahead.shape)
            gains = values[..., 1 : 1 + len(LOOKS)]
            for n, (wait, steps) in enumerate(LOOKS):
                gains[..., n] = self._gain(belief, delay + wait, steps)
            gains /= mean[..., None] * SPANS
            np.maximum(gains, 0.0, out=gains)  # a look that finds nothing may raise the cost
            gains += FLOOR
            np.log10(gains, out=gains)
            values[..., 1 + len(LOOKS)] = np.log1p(delay)
        if self._spending:
            values[..., -1] = self._spending()
        return self._scaler(values.reshape(envs, -1))[0]

    def _of_slots(self, belief: Any) -> Array:
        """The forecasts of dwells, (env, candidate * field)."""
        system, count = self.system, len(belief.step)
        gains, rows = shortcuts.gain_per_second(system, belief, 1.0, POWERS), system.slots_now(belief)
        values = np.empty((count, len(self.candidates), len(self.candidate_fields)))
        forecast(gains, rows, system.dwells.menu[3], system.dwells.each, system.c0, LEAST, values)
        return values.reshape(count, -1)

    def _slot_fields(self) -> tuple[ObservationField, ...]:
        """The forecasts of one dwell."""
        about = "what its dwell saves per second of its duration, over the cost of a target not seen; a find counts as"
        gains = [
            ObservationField(f"log10_gain_{power:g}", "1", -1.0, 1.0, f"{about} its value to the power {power:g}")
            for power in POWERS
        ]
        return (
            *gains,
            ObservationField("update", "1", 0.0, 1.0, "whether it updates a track"),
            ObservationField("search", "1", 0.0, 1.0, "whether it searches"),
            ObservationField("ln_duration", "ln(s)", -4.6, 1.0, "its duration"),
            ObservationField("existence", "1", 0.0, 1.0, "probability of existence of its track"),
            ObservationField("log2_pointing", "1", -3.0, 3.0, "standard deviation of its track's azimuth, beam widths"),
            ObservationField("log2_position", "log2(m)", 5.0, 3.0, "standard deviation of its track's position"),
            ObservationField("age", "s", 0.0, 1.0, "time since its track's last update"),
            ObservationField("ln_tracks", "ln(1 + tracks)", 2.5, 1.0, "number of tracks"),
            ObservationField("log2_value", "log2(s)", 2.0, 2.0, "value of a find at its track's place"),
            ObservationField("log2_velocity", "log2(m/s)", 5.0, 3.0, "standard deviation of its track's velocity"),
            ObservationField("log2_density", "log2(m^2/s^3)", 4.5, 3.0, "density of its track's acceleration"),
            ObservationField("log2_snr", "1", 8.0, 3.0, "expected E/N0 of its look at its track"),
        )

    def _candidate_fields(self) -> tuple[ObservationField, ...]:
        """The forecasts of one candidate."""
        if self.in_slots:
            return self._slot_fields()
        listed = [
            ObservationField("ln_cost_ahead", "1", 0.0, 0.3, "expected cost one step ahead over the candidates' mean")
        ]
        if self._gain:
            for wait, steps in LOOKS:
                late = f" {wait} steps late" if wait else ""
                meaning = f"gain of its pulse{late}: reduction of the cost of {steps} steps, over that mean cost"
                listed.append(ObservationField(f"log10_gain_{wait}_{steps}", "log10(1)", -1.3, 1.3, meaning))
            listed.append(ObservationField("ln_delay", "ln(1 + steps)", 0.0, 1.0, "steps before its pulse can be sent"))
        if self._spending:
            listed.append(ObservationField("spending", "1", 0.0, 1.0, "energy of its pulse, in longest pulses"))
        return (*listed, *(self._listed.fields if self._listed else ()))
