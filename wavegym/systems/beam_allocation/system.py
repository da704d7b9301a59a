"""One beam a radar: whom to look at now, and whom before it hides."""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from wavegym.core.arrays import Array
from wavegym.core.system import ObservationField, State
from wavegym.systems.agile_clutter.search import NN
from wavegym.systems.agile_clutter.state import Pulse, drawn_around, target_fields
from wavegym.systems.agile_clutter.system import AgileClutter
from wavegym.systems.beam_allocation import kernels
from wavegym.systems.beam_allocation.state import SOON, BeamActions, Belief, Quad, World, check_beams, window_elements
from wavegym.systems.visibility_windows import Window, coming, visibility, window_draws
from wavegym.trackers.information_reduction import reduction_table


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class BeamAllocation(AgileClutter):
    """Two radars with one beam each share three targets, which hide at times that are known.

    Description
        Motion, measurements, clutter and tracker are those of wavegym/AgileClutter-v0. A beam lights one target: only
        the target in a sensor's beam can be detected by it, and only that one's gate is opened. The radars stand at
        right angles, so that each of them resolves another direction, and a target wants both. The receivers' memory
        limits the time-bandwidth product: a short, wide chirp measures range well, a long, narrow one range-rate.
        Targets come into sight and go out of it at times known from the beginning, as they fly behind hills that are on
        the map; in a hidden target's beam there is neither a return nor a gate. One step ahead the range of the target
        known worst comes first; over several steps it is the velocity, and the target that is about to hide.

    Rewards
        -trace(Lambda P) summed over the targets, hidden ones included, Lambda = diag(weights): m^2, with 1 s^2 on the
        velocities.

    Starting state
        True targets start uniformly within ``spread`` of ``starts``; the first estimates are drawn around the truth
        with covariance P0 = diag(prior_variance).

    Episode end
        Terminates after ``horizon`` steps; the time left is observed.

    Arguments
        spread: greatest distance of a true start [x y xdot ydot] from that in ``starts``, component by component (m,
        m/s). shown, hidden: least and greatest number of steps in sight and out of it, by turns. windows: (target,
        first, last), steps in which a target is hidden, in place of drawn ones. action: "joint": a target and a chirp
        for every sensor, in one index. tracker: "jpda". births: 0 for every target, lifetime: at least ``horizon``: all
        are there throughout. All others are those of wavegym/AgileClutter-v0: q: process noise density (m^2/s^3).
        carrier_hz: fc. reference_range: r0 in metres, where eta = 1. nearest_range: the SNR grows no further below it.
        sensors: positions (x, y) in metres. starts: [x y xdot ydot] in the middle of where each target may start.
        prior_variance: diagonal of P0. false_alarm: Pf. clutter_density: false returns per m (m/s). gate: radius in
        standard deviations. weights: diagonal of Lambda. laws: phase functions, "lfm", "pfm:KAPPA", "hfm:SHAPE",
        "efm:SHAPE". durations, sweeps: in s and Hz, of a chirp each: the first of the one goes with the first of the
        other; every law with every pair, rising, can be sent at every target. particles: not used.

    References
        S. P. Sira, A. Papandreou-Suppappola, D. Morrell and D. Cochran, "Waveform-agile sensing for tracking multiple
        targets in clutter" (motion, measurements, tracker). The beams and the delayed cost are this suite's own.
    """

    gain_by_target: ClassVar[bool] = True  # ``gain`` takes steps of each target

    horizon: int = 60
    dt: float = 1.0
    q: float = 3.0
    sensors: tuple[tuple[float, float], ...] = ((0.0, -20e3), (-20e3, 0.0))
    starts: tuple[Quad, ...] = ((0.0, 4e3, 0.0, 0.0), (-3.5e3, -2e3, 0.0, 0.0), (3.5e3, -2e3, 0.0, 0.0))
    births: tuple[int, ...] = (0, 0, 0)
    lifetime: int = 60
    prior_variance: Quad = (100.0, 100.0, 25.0, 25.0)
    clutter_density: float = 1e-5
    laws: tuple[str, ...] = ("pfm:3",)
    durations: tuple[float, ...] = (50e-6, 2e-3)
    sweeps: tuple[float, ...] = (40e6, 1e6)
    action: Literal["joint"] = "joint"
    tracker: Literal["jpda"] = "jpda"
    spread: Quad = (1e3, 1e3, 100.0, 100.0)
    shown: tuple[int, int] = (6, 14)
    hidden: tuple[int, int] = (4, 10)
    windows: tuple[Window, ...] = ()

    def __post_init__(self) -> None:
        """Check what single types cannot say."""
        super().__post_init__()
        check_beams(self)

    @cached_property
    def action_set(self) -> BeamActions:
        """Whom each sensor may look at, and with what."""
        chirps = (self.laws, self.durations, self.sweeps, self.carrier_hz)
        return BeamActions(*chirps, len(self.sensors), self.action, len(self.starts))

    def draw_world(self, rng: np.random.Generator) -> World:  # type: ignore[override]
        """All draws of one episode."""
        targets = len(self.starts)
        draws = window_draws(self.horizon, self.shown, self.hidden)
        return World(*super().draw_world(rng), rng.random((targets, 4)), rng.random((targets, draws)))

    def initial(self, world: Any) -> State:
        """The true paths, the first estimates drawn around their starts, and the windows of visibility."""
        truth, base = super().initial(world)
        step, mean, covariance = base[:3]
        return State(truth, Belief(step, mean, covariance, None, visibility(self, world.window, len(self.starts))))

    def first_places(self, world: Any) -> Array:
        """Drawn around ``starts``."""
        return drawn_around(self.starts, self.spread, world.place)

    def pulse(self, belief: Any, actions: Array) -> Pulse:
        """Every sensor lights one target, with chance 1 where that can be seen."""
        seen = coming(belief.visible, belief.step, 1)[:, :, None]
        return Pulse(
            self.action_set.unit_covariance(actions), self._everywhere[0], self.action_set.looks.take(actions, 0) * seen
        )

    def transition(self, state: State, action: Array, world: Any) -> State:
        """One step: predict, transmit, detect, associate, update, sensor after sensor."""
        ahead = super().transition(state, action, world)
        step, mean, covariance = ahead.belief[:3]
        return State(ahead.truth, Belief(step, mean, covariance, None, state.belief.visible))

    def predict(self, belief: Any, actions: Array, outcome: Array | None = None) -> Any:
        """The belief after one pulse of every sensor; see ``AgileClutter``."""
        ahead = super().predict(belief, actions, outcome)
        visible = belief.visible
        if ahead.step.ndim == 2:
            visible = np.broadcast_to(visible[:, None], ahead.step.shape + visible.shape[1:])
        return Belief(*ahead[:3], None, visible)

    def best_action(self, belief: Any) -> Array:
        """Sensor after sensor is no shortcut here. Raises NotImplementedError: all joint actions are tried."""
        raise NotImplementedError

    def delay(self, belief: Belief) -> Array:
        """Steps before each candidate's pulse does its work, (env, candidate): none, beams turn at once."""
        return np.zeros((len(belief.step), len(self.action_set.joint)), np.int64)

    @property
    def target_of_action(self) -> Array:
        """The target of each radar's beam, (candidate, radar)."""
        return self.action_set.looks.argmax(axis=2)

    def gain(self, belief: Belief, wait: Array | int, ahead: Array | int) -> Array:
        """By how much each candidate's pulses lower the summed cost of the ``ahead`` steps from the look on.

        Args:
            belief: the belief.
            wait: steps before the look in which nothing is measured, int or (env or 1, candidate or 1).
            ahead: steps counted, the look's own included, int or (env or 1, target), of each target's; those beyond the
                horizon count nothing.

        Returns:
            Expected over detections, (env, candidate); 0 where the targets are hidden then or the episode over.
        """
        out = np.empty((len(belief.step), len(self.action_set.joint)))
        waits, counted = np.empty(out.shape, np.int64), np.empty(belief.mean.shape[:2], np.int64)
        waits[...], counted[...] = wait, ahead
        M, visible = self.weights_ahead(int(counted.max())), np.require(belief.visible, requirements=["C", "W"])
        kernels.gain(
            *belief[:3], visible, waits, counted, *self.action_set.ways, self.action_set.chirp_covariances, M,
            *self._model, self._radar, reduction_table(), out, NN
        )  # fmt: skip
        return out

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """As the parent's, then of every target when it can be seen."""
        targets = len(self.starts)
        return target_fields(targets, len(self.sensors)) + window_elements(targets)

    def observe(self, belief: Any) -> Array:
        """See ``observation_fields``."""
        out = super().observe(belief)
        soon = coming(belief.visible, belief.step, SOON + 1)
        changes = soon != soon[:, :1]
        until = np.where(changes.any(axis=1), changes.argmax(axis=1), SOON)
        share = np.ascontiguousarray(np.swapaxes(soon[:, :SOON], 1, 2)).mean(axis=2)
        windows = np.stack([soon[:, 0], until, share], axis=2)  # (env, target, 3)
        out[:, -windows[0].size :] = windows.reshape(len(out), -1)
        return out
