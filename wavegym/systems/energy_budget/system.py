"""Two radars that share an account of energy, before a jammer that comes and goes."""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.errors import check_within
from wavegym.core.system import ObservationField, State
from wavegym.systems.agile_clutter import state as several_targets
from wavegym.systems.agile_clutter.search import NN
from wavegym.systems.agile_clutter.state import Pulse
from wavegym.systems.agile_clutter.system import AgileClutter
from wavegym.systems.energy_budget import kernels
from wavegym.systems.energy_budget import state as parts
from wavegym.systems.energy_budget.account import PulseActions
from wavegym.systems.energy_budget.state import Belief, Truth, World
from wavegym.trackers.information_reduction import reduction_table


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class EnergyBudget(AgileClutter):
    """Two radars share an energy budget for a whole episode while a jammer comes and goes.

    Description
        As wavegym/AgileClutter-v0 with one target, weaker and manoeuvring. Each radar is silent or sends one of three
        durations of one chirp at constant peak power, so a pulse's SNR, and with it its detection probability, grow
        with its duration, and so does the energy that it takes. The longest pulse takes 1; both radars are paid from
        one account of ``budget`` an step, far less than they could use, and what is not spent is kept. An action that
        the account cannot pay is masked; taken all the same, it becomes the dearest that can be paid in which no radar
        sends longer than asked, silence at the least (metric ``replaced``). Energy is counted in whole quanta.
        A jammer or a rain cell occludes the target from both radars: a two-state Markov chain with onset and end of
        known rates. Receivers listen between pulses, so whether the slot that has just ended was occluded is known
        without transmitting; whether the next one will be is not, so an onset may waste a pulse. In an occluded slot
        nothing is received, and the energy of its pulses is lost.

    Rewards
        As wavegym/AgileClutter-v0: -trace(Lambda P).

    Starting state
        Each target starts uniformly within ``spread`` of its ``starts``, the first estimate is drawn around it with
        covariance diag(prior_variance), the account is full and the air clear. The region lies well off the line
        through both radars, where they would measure the same.

    Episode end
        Terminates after ``horizon`` steps; the time left is observed.

    Arguments
        budget: energy for each step of the episode, in longest pulses of one radar; the account holds horizon times as
        much, rounded down to whole quanta. mean_clear, mean_occluded: mean number of steps of a clear and of an
        occluded spell, at least 1. spread: half the width of the region of starts in [x y xdot ydot] (m, m/s).
        direction: whether the chirp sweeps "up" or "down". durations: of the pulses (s), multiples of a common unit;
        the SNR is that of ``reference_range`` for the longest. laws, sweeps: of the chirp, one each. births: 0
        for every target. tracker, action: "jpda" and "joint" only. All others as wavegym/AgileClutter-v0.

    References
        The loop is that of S. P. Sira, A. Papandreou-Suppappola, D. Morrell and D. Cochran, "Waveform-agile sensing for
        tracking multiple targets in clutter"; budget and occlusions are proposals of ours.
    """

    strict: ClassVar[bool] = False
    horizon: int = 72
    dt: float = 0.25
    q: float = 10.0
    reference_range: float = 36e3
    sensors: tuple[tuple[float, float], ...] = ((-10e3, 0.0), (10e3, 0.0))
    starts: tuple[tuple[float, float, float, float], ...] = ((0.0, 22e3, 0.0, 0.0),)
    spread: tuple[float, float, float, float] = (5e3, 4e3, 100.0, 100.0)
    births: tuple[int, ...] = (0,)
    lifetime: int = 72
    prior_variance: tuple[float, float, float, float] = (100.0, 100.0, 25.0, 25.0)
    clutter_density: float = 1e-6
    laws: tuple[str, ...] = ("pfm:3",)
    durations: tuple[float, ...] = (25e-6, 50e-6, 100e-6)
    sweeps: tuple[float, ...] = (15e6,)
    direction: Literal["up", "down"] = "up"
    budget: float = 0.27
    mean_clear: float = 12.0
    mean_occluded: float = 6.0
    action: Literal["joint"] = "joint"
    tracker: Literal["jpda"] = "jpda"

    def __post_init__(self) -> None:
        """Check what single types cannot say."""
        parts.check_pulses(self)
        super().__post_init__()
        parts.check_budget(self)
        self._check_occlusions()

    def _check_occlusions(self) -> None:
        """InputError for occlusions that cannot be."""
        for name in ("mean_clear", "mean_occluded"):
            check_within(name, getattr(self, name), 1, 1e6, "steps")

    @cached_property
    def action_set(self) -> PulseActions:  # type: ignore[override]
        """What may be transmitted."""
        (law,), (sweep,) = self.laws, self.sweeps
        return PulseActions(law, self.durations, sweep, self.direction, self.carrier_hz, len(self.sensors))

    @cached_property
    def total(self) -> float:
        """Energy of a full account."""
        return int(self.budget * self.horizon * self.action_set.quanta * parts.ROUND) / self.action_set.quanta

    @cached_property
    def spending(self) -> Array:
        """Energy that each candidate takes, (candidate,)."""
        return self.action_set.takes / self.action_set.quanta

    def mask(self, belief: Any) -> Array:
        """The actions that the account can pay, (env, actions); silence always."""
        return self.action_set.account.affordable(belief.energy)

    def draw_world(self, rng: np.random.Generator) -> Any:
        """All draws of one episode."""
        return World(*super().draw_world(rng), rng.random((len(self.starts), 4)), rng.random(self._occlusion_draws))

    @property
    def _occlusion_draws(self) -> int:
        """Uniform draws of one world's occlusions."""
        return self.horizon

    def initial(self, world: Any) -> State:
        """The true paths from drawn starts, the first estimates, a full account and clear air."""
        base, belief = super().initial(world)
        count = len(belief.step)
        none = np.zeros(count, np.bool_)
        truth = Truth(**base._asdict(), spent=np.zeros(count), occluded=none, replaced=none.copy())
        return State(truth, self._public(belief, np.full(count, self.total), self._at_first(world)))

    def first_places(self, world: Any) -> Array:
        """Drawn around ``starts``."""
        return several_targets.drawn_around(self.starts, self.spread, world.place)

    def _at_first(self, world: World) -> Array:
        """What is public of the occlusions at step 0: clear air."""
        return np.zeros(len(world.occlusion))

    def _public(self, base: Any, energy: Array, air: Array) -> Any:
        """The belief of AgileClutter's, the energy left and what is known of the occlusions."""
        return Belief(base.step, base.mean, base.covariance, None, energy, air)

    def transition(self, state: State, action: Array, world: Any) -> State:
        """One step: pay, transmit what was paid for, detect unless the slot is occluded, update."""
        used, left = self.action_set.account.pay(state.belief.energy, action)
        is_clear, air = self._lived(state.belief, world)
        pulse = self._transmitted(used[:, None], is_clear[:, None].astype(np.float64))
        truth, base = self._advance(state, pulse, world)
        own = {"spent": self.spending[used], "occluded": ~is_clear, "replaced": used != action}
        return State(Truth(**truth._asdict(), **own), self._public(base, left, air))

    def _lived(self, belief: Any, world: World) -> tuple[Array, Array]:
        """Whether the slot ahead is clear, (env,) bool, and what is public of the occlusions after it."""
        draw = world.occlusion[np.arange(len(belief.step)), belief.step]
        is_clear = draw < self._clear(belief)
        return is_clear, (~is_clear).astype(np.float64)

    def _clear(self, belief: Any) -> Array:
        """Chance that the slot ahead is clear, (env,)."""
        after_clear, after_occluded = self._onset
        sight: Array = after_clear + (after_occluded - after_clear) * belief.occluded
        return sight

    def _sight(self, belief: Any, wait: Array) -> Array:
        """Chance that the slot after ``wait`` (env, candidate) more steps is clear."""
        usual, memory = self._spells
        return 1.0 - (usual + (belief.occluded[:, None] - usual) * memory[np.minimum(wait, len(memory) - 1)])

    @cached_property
    def _spells(self) -> tuple[float, Array]:
        return parts.spells(self.mean_clear, self.mean_occluded, self.horizon)

    @cached_property
    def _onset(self) -> tuple[float, float]:
        """Chance that a slot after a clear one is clear, and after an occluded one."""
        return 1.0 - 1.0 / self.mean_clear, 1.0 / self.mean_occluded

    def pulse(self, belief: Any, actions: Array) -> Pulse:
        """What actions (env, candidate) transmit, as far as the account pays, in slots that may be clear."""
        used, _ = self.action_set.account.pay(belief.energy[:, None], actions)
        return self._transmitted(used, self._clear(belief)[:, None])

    def _transmitted(self, used: Array, sight: Array) -> Pulse:
        """What actions (...) transmit in slots clear with chance ``sight`` (...), or shapes that broadcast."""
        C, strength, looked = (a.take(used, axis=0) for a in self._everything)
        return Pulse(C, strength, sight[..., None, None] * looked)

    @cached_property
    def _everything(self) -> tuple[Array, ...]:
        """What every candidate transmits in clear slots, each (candidate, ...)."""
        options = self.action_set.actions.indices
        looked = np.repeat((options > 0)[..., None], len(self.starts), axis=2).astype(np.float64)
        return self.action_set.unit_covariances[options], self.action_set.strength[options], looked

    @property
    def outcome_shape(self) -> tuple[int, ...]:  # type: ignore[override]
        """A draw for every sensor and target, sensor by sensor: whether it is detected. The last: clear air."""
        return (len(self.sensors) * len(self.starts) + 1,)

    def predict(self, belief: Any, actions: Array, outcome: Array | None = None) -> Any:
        """The belief after one step and the energy left, which is certain.

        Expected: as AgileClutter, each detection weighed with the chance that the slot is clear. ``outcome``: uniform
        draws (env, *chances) or (env, candidate, *chances), detections sensor by sensor, then whether the slot is
        clear; a draw below its probability makes it happen.
        """
        if actions.ndim == 1:
            return self._imagined(belief, actions, outcome)
        shape = len(belief.step), actions.shape[1]
        rows = np.broadcast_to(actions, shape).reshape(-1)
        if outcome is not None:
            outcome = np.broadcast_to(outcome, shape + self.outcome_shape).reshape(-1, *self.outcome_shape)
        ahead = self._imagined(trees.repeated(belief, shape[1]), rows, outcome)
        return trees.tree_map(lambda leaf: leaf.reshape(shape + leaf.shape[1:]), ahead)

    def _imagined(self, belief: Any, actions: Array, outcome: Array | None) -> Any:
        """``predict`` of one action (env,) each."""
        used, left = self.action_set.account.pay(belief.energy, actions)
        sight, air, draws = self._foreseen(belief, outcome)
        return self._public(self._imagine(belief, self._transmitted(used, sight), draws), left, air)

    def _foreseen(self, belief: Any, outcome: Array | None) -> tuple[Array, Array, Any]:
        """Chance of a clear slot (env,), what is public of it after, draws (env, sensor, target)."""
        sight = self._clear(belief)
        if outcome is None:
            return sight, 1.0 - sight, None
        clear = (outcome[:, -1] < sight).astype(np.float64)
        return clear, 1.0 - clear, self._by_sensor(outcome[:, :-1])

    def _by_sensor(self, draws: Array) -> Array:
        """Draws (..., sensor, target) of draws in a row."""
        return draws.reshape(*draws.shape[:-1], len(self.sensors), len(self.starts))

    def delay(self, belief: Any) -> Array:
        """Steps before a candidate's pulses do their work, (env, candidate): none."""
        return np.zeros((len(belief.step), len(self.action_set.takes)), np.int64)

    def gain(self, belief: Any, wait: Array | int, ahead: int) -> Array:
        """What a candidate's pulses take off the summed cost of ``ahead`` steps from the look on, (env, candidate).

        Expected, against no pulse at all: trace(M (P without - P with)), M of ``horizon_weights``. Steps beyond the
        episode's end count nothing.

        Args:
            belief: the belief.
            wait: steps before the pulses, in which nothing is measured; one number, or (env, candidate).
            ahead: steps.
        """
        later = np.array(np.broadcast_to(wait, (len(belief.step), len(self.action_set.takes))), np.int64)
        left = self.horizon - belief.step[:, None] - later
        sight = np.where(left > 0, self._sight(belief, later), 0.0)
        out = np.empty(later.shape)
        kernels.gain(
            *belief[:3], later, sight, left, self.weights_ahead(ahead), self._everything,
            self.action_set.actions.indices, self._targets, *self._model, self._radar, reduction_table(), out, NN
        )  # fmt: skip
        return out

    def constants(self) -> Array:
        """One option wherever a radar transmits: at both, at one alone, at none."""
        return self.action_set.constants

    def best_action(self, belief: Any) -> Array:
        """Not offered: sensor by sensor cannot see the account. Raises NotImplementedError."""
        raise NotImplementedError

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The observation: AgileClutter's, with the SNR of the longest pulse, the account and the occlusions."""
        base = [e._replace(centre=parts.WEAK) if e.name.startswith("snr") else e for e in super().observation_fields]
        return (*base, *parts.account_elements(self.total / self.horizon, len(self.sensors)), *self._air_elements())

    def _air_elements(self) -> tuple[ObservationField, ...]:
        return (ObservationField("occluded", "1", 0.5, 0.5, "whether the last slot was occluded"),)

    def observe(self, belief: Any) -> Array:
        """See ``observation_fields``."""
        out, air = super().observe(belief), self._air(belief)
        own = out[:, out.shape[1] - 2 - len(air) :]
        own[:, 0] = belief.energy / self.total
        own[:, 1] = np.minimum(belief.energy / np.maximum(self.horizon - belief.step, 1), len(self.sensors))
        own[:, 2:] = np.stack(air, axis=1)
        return out

    def _air(self, belief: Any) -> tuple[Array, ...]:
        """What is shown of the occlusions, each (env,)."""
        return (belief.occluded,)

    def state_info(self, state: State) -> dict[str, Array]:
        """AgileClutter's; ``energy`` left, and of the step: energy ``spent``, ``occluded``, whether ``replaced``."""
        own = {name: getattr(state.truth, name).copy() for name in ("spent", "occluded", "replaced")}
        return {**super().state_info(state), "energy": state.belief.energy.copy(), **own}
