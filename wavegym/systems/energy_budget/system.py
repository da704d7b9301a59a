"""Two radars that share an energy account while a jammer comes and goes."""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import NonNegativeInt

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_within
from wavegym.core.parameters import Positive, changed_default, parameter, system_parameters
from wavegym.core.system import ObservationField, State
from wavegym.sensors.scatterers_kernels import ClutterField
from wavegym.systems.agile_clutter.state import (
    NonNegativeState,
    PlanarState,
    PositiveState,
    Pulse,
    corners,
    drawn_around,
)
from wavegym.systems.agile_clutter.system import AgileClutter
from wavegym.systems.energy_budget.actions import PulseActions
from wavegym.systems.energy_budget.state import Belief, Measurements, Truth, World, account_fields, spells

ROUND = 1.0 + 1e-12  # a budget short of whole quanta by rounding only is not short
WEAK = 8.0  # dB, an ordinary SNR of the longest pulse


@system_parameters
class EnergyBudget(AgileClutter):
    """Two radars share an energy budget for a whole episode while a jammer comes and goes.

    Description
        As wavegym/AgileClutter-v0 with one target, which is weaker and manoeuvres. Each radar is silent or sends one of
        three durations of one chirp at constant peak power. Mean SNR, detection probability and energy grow with the
        duration. Echoes fluctuate and noise has false returns as there, at one threshold for all durations.

        The longest pulse costs 1. Both radars share one energy account of ``budget`` a step, far less than they could
        use; unspent energy is kept. The mask excludes actions that the account cannot pay. If such an action is taken,
        the radars send the most expensive affordable action in which neither exceeds the chosen duration, or stay
        silent (metric ``replaced``). Energy is counted in whole quanta.

        A jammer or a rain cell occludes the target from both radars. Occlusion is a two-state Markov chain with known
        rates of onset and end. Receivers listen between pulses, so the state of the last slot is known without
        transmitting. The state of the next slot is not, so an onset may waste a pulse. In an occluded slot the radars
        receive nothing and lose the energy of their pulses.

    Rewards
        -trace(Lambda P), where P is the covariance of the mixture, as in wavegym/AgileClutter-v0: a lost track costs
        more. Every target exists throughout, so the cost needs no probability of existence.

    Starting state
        Each target starts uniformly within ``spread`` of ``starts``. The first estimate is drawn around the start with
        covariance diag(prior_variance). The account is full and the air is clear. The region lies well off the line
        through both radars, on which both would measure the same.

    Episode end
        Terminates after ``horizon`` steps. The remaining time is observed.

    References
        The loop is that of S. P. Sira, A. Papandreou-Suppappola, D. Morrell and D. Cochran, "Waveform-agile sensing for
        tracking multiple targets in clutter". This suite adds the budget and the occlusions.
    """

    strict: ClassVar[bool] = False

    horizon: int = changed_default(AgileClutter, "horizon", 72)
    dt: float = changed_default(AgileClutter, "dt", 0.25)
    q: float = changed_default(AgileClutter, "q", 10.0)
    reference_range: float = parameter(
        43e3, "r0, the range at which the longest pulse has eta = 1", unit="m", truth=True, gt=0
    )
    sensors: tuple[tuple[float, float], ...] = changed_default(AgileClutter, "sensors", ((-10e3, 0.0), (10e3, 0.0)))
    starts: tuple[PlanarState, ...] = parameter(
        ((0.0, 22e3, 0.0, 0.0),), "centre of the first [x y xdot ydot] of each target", unit="m, m/s", truth=True
    )
    spread: NonNegativeState = parameter(
        (5e3, 4e3, 100.0, 100.0),
        "maximum distance of a first [x y xdot ydot] from its centre",
        unit="m, m/s",
        truth=True,
    )
    births: tuple[NonNegativeInt, ...] = parameter((0,), "0 for every target")
    lifetime: int = changed_default(AgileClutter, "lifetime", 72)
    prior_variance: PositiveState = changed_default(AgileClutter, "prior_variance", (100.0, 100.0, 25.0, 25.0))
    clutter_density: float = changed_default(AgileClutter, "clutter_density", 1e-6)
    laws: tuple[str, ...] = parameter(
        ("pfm:3",), 'one phase function, of the chirp: "lfm", "pfm:KAPPA", "hfm:SHAPE" or "efm:SHAPE"', unit=""
    )
    durations: tuple[Positive, ...] = parameter(
        (25e-6, 50e-6, 100e-6), "durations of the pulses, multiples of a common unit", unit="s"
    )
    sweeps: tuple[Positive, ...] = parameter((15e6,), "one sweep, of the chirp", unit="Hz")
    direction: Literal["up", "down"] = parameter("up", "direction of the sweep", unit="")
    budget: float = parameter(
        0.27,
        "energy per step, in longest pulses of one radar; a full account holds horizon times this, rounded down to "
        "whole quanta",
        gt=0,
    )
    mean_clear: float = parameter(12.0, "mean number of steps of a clear spell", truth=True, ge=1, le=1e6)
    mean_occluded: float = parameter(6.0, "mean number of steps of an occluded spell", truth=True, ge=1, le=1e6)
    library: None = parameter(None, "not used", unit="")
    false_alarms: tuple[()] = parameter((), "not used", unit="")
    alarm_density: None = parameter(None, "not used", unit="")
    action: Literal["joint"] = parameter("joint", "silence or a duration for every sensor, in one index", unit="")

    def __post_init__(self) -> None:
        """Check several fields together."""
        for name in ("laws", "sweeps"):
            if len(getattr(self, name)) != 1:
                raise InputError(f"{name} is {getattr(self, name)}, expected one: pulses differ in duration only")
        if any(self.births):
            raise InputError(f"births is {self.births}, expected 0 for every target")
        super().__post_init__()
        self._check_budget()

    def _check_budget(self) -> None:
        """InputError for a budget that radars cannot spend, or that does not pay for the cheapest pulse."""
        cheapest = float(self.action_set.shares[1])
        least = cheapest / self.horizon
        if self.budget * self.horizon * ROUND < cheapest:
            wanted = f"at least {least:.3g} (nearest), so that an episode's account pays the cheapest pulse once"
            raise InputError(f"budget is {self.budget!r} a step, expected {wanted}")
        check_within("budget", self.budget, least / ROUND, len(self.sensors), "a step")

    @cached_property
    def action_set(self) -> PulseActions:  # type: ignore[override]
        """Silence or a pulse at every sensor, and the account that pays them."""
        (law,), (sweep,) = self.laws, self.sweeps
        chirp = (law, self.durations, sweep, self.direction, self.carrier_hz)
        return PulseActions(*chirp, len(self.sensors), self.eclipsing, self.false_alarm)

    @cached_property
    def total(self) -> float:
        """Energy of a full account."""
        return int(self.budget * self.horizon * self.action_set.quanta * ROUND) / self.action_set.quanta

    @cached_property
    def spending(self) -> Array:
        """Energy that each candidate costs, (candidate,)."""
        return self.action_set.action_quanta / self.action_set.quanta

    def mask(self, belief: Any) -> Array:
        """Which actions the account can pay, (env, actions) bool; silence always."""
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
        return State(truth, self._belief(belief, np.full(count, self.total), self._first_occlusion(world)))

    def farthest_starts(self) -> Array:
        """The corners of the boxes in which targets start, (state, 4)."""
        return corners(self.starts, self.spread)

    def first_states(self, world: Any) -> Array:
        """The true states at birth, drawn around ``starts``."""
        return drawn_around(self.starts, self.spread, world.place)

    def _first_occlusion(self, world: World) -> Array:
        """The belief's field of the occlusion at step 0: clear air."""
        return np.zeros(len(world.occlusion))

    def _belief(self, base: Any, energy: Array, occlusion: Array) -> Any:
        """AgileClutter's belief with the energy left and the field of the occlusion."""
        return Belief(base.step, base.mean, base.covariance, base.hypotheses, energy, occlusion)

    def measure(self, truth: Truth, belief: Any, action: Array, world: Any) -> Measurements:
        """AgileClutter's, of the pulses that the account can pay; none in an occluded slot."""
        used, _, is_clear = self._slot(belief, action, world)
        base = self._receive(truth, belief, self._in_slot(used, is_clear), world)
        return Measurements(*base, self.spending[used], ~is_clear, used != action)

    def track(self, belief: Any, action: Array, measurements: Measurements) -> Any:
        """One step of the tracker, which knows whether the slot was occluded, and of the account."""
        used, left = self.action_set.account.pay(belief.energy, action)
        is_clear = ~measurements.occluded
        after = self._follow(belief, self._in_slot(used, is_clear), measurements)
        return self._belief(after, left, self._occlusion_after(belief, is_clear))

    def annotate(self, truth: Truth, measurements: Measurements) -> Truth:
        """AgileClutter's, with the energy spent, the occlusion and the replacement."""
        own = {name: getattr(measurements, name) for name in ("spent", "occluded", "replaced")}
        annotated: Truth = super().annotate(truth, measurements)._replace(**own)
        return annotated

    def _slot(self, belief: Any, action: Array, world: Any) -> tuple[Array, Array, Array]:
        """The action that the account pays and the energy left, (env,), and whether the slot is clear, (env,) bool."""
        return *self.action_set.account.pay(belief.energy, action), self._is_clear(belief, world)

    def _in_slot(self, used: Array, is_clear: Array) -> Pulse:
        """The pulses of actions (env,) in slots that are clear or not."""
        return self._pulses(used[:, None], is_clear[:, None].astype(np.float64))

    def _is_clear(self, belief: Any, world: World) -> Array:
        """Whether the next slot is clear, (env,) bool."""
        drawn: Array = world.occlusion[np.arange(len(belief.step)), belief.step]
        return drawn < self.truth_model._clear_probability(belief)

    def _occlusion_after(self, belief: Any, is_clear: Array) -> Array:
        """The belief's field of the occlusion after a slot that was clear or not."""
        return (~is_clear).astype(np.float64)

    def _clear_probability(self, belief: Any) -> Array:
        """Probability that the next slot is clear, (env,)."""
        after_clear, after_occluded = self._clear_after
        clear: Array = after_clear + (after_occluded - after_clear) * belief.occluded
        return clear

    def _later_clear_probability(self, belief: Any, wait: Array) -> Array:
        """Probability that the slot after ``wait`` (env, candidate) more steps is clear."""
        usual, memory = self._spells
        return 1.0 - (usual + (belief.occluded[:, None] - usual) * memory[np.minimum(wait, len(memory) - 1)])

    @cached_property
    def _spells(self) -> tuple[float, Array]:
        return spells(self.mean_clear, self.mean_occluded, self.horizon)

    @cached_property
    def _clear_after(self) -> tuple[float, float]:
        """Probability of a clear slot after a clear one, and after an occluded one."""
        return 1.0 - 1.0 / self.mean_clear, 1.0 / self.mean_occluded

    def pulse(self, belief: Any, actions: Array) -> Pulse:
        """The pulses of actions (env, candidate), as far as the account pays, in slots that may be clear."""
        used, _ = self.action_set.account.pay(belief.energy[:, None], actions)
        return self._pulses(used, self._clear_probability(belief)[:, None])

    def _pulses(self, used: Array, clear: Array) -> Pulse:
        """The pulses of actions (...) in slots that are clear with probability ``clear`` (...); shapes broadcast."""
        pulses = self._candidate_pulses
        C, strength, illuminated, alarm, options = (a.take(used, axis=0) for a in pulses[:-1])
        return Pulse(C, strength, clear[..., None, None] * illuminated, alarm, options, pulses.windows)

    @cached_property
    def clutter_field(self) -> ClutterField | None:
        """c(r, v) of every duration, in proportion to its energy."""
        longest = super().clutter_field
        return longest and longest._replace(power=longest.power * self.action_set.strength[1:, None, None])

    @cached_property
    def _candidate_pulses(self) -> Pulse:
        """Every candidate's pulses in clear slots; its fields have no axis for environments."""
        options = self.action_set.actions.indices
        illuminated = np.repeat((options > 0)[..., None], len(self.starts), axis=2).astype(np.float64)
        pulses = self.action_set
        return Pulse(
            pulses.unit_covariances[options], pulses.strength[options], illuminated, np.zeros_like(options), options,
            pulses.sensor_windows,
        )  # fmt: skip

    @property
    def outcome_shape(self) -> tuple[int, ...]:  # type: ignore[override]
        """A draw for every sensor and target, sensor by sensor: a detection. The last draw: a clear slot."""
        return (len(self.sensors) * len(self.starts) + 1,)

    def predict(self, belief: Any, actions: Array, outcome: Array | None = None) -> Any:
        """The belief after one step, and the energy left, which is certain.

        Expected: as AgileClutter, each detection weighted with the probability that the slot is clear. ``outcome``:
        uniform draws (env, *outcome_shape) or (env, candidate, *outcome_shape): detections sensor by sensor, then a
        clear slot; an event happens where its draw is below its probability.
        """
        if actions.ndim == 1:
            return self._predict_one(belief, actions, outcome)
        shape = len(belief.step), actions.shape[1]
        rows = np.broadcast_to(actions, shape).reshape(-1)
        if outcome is not None:
            outcome = np.broadcast_to(outcome, shape + self.outcome_shape).reshape(-1, *self.outcome_shape)
        after = self._predict_one(trees.repeated(belief._replace(hypotheses=None), shape[1]), rows, outcome)
        return trees.tree_map(lambda leaf: leaf.reshape(shape + leaf.shape[1:]), after)

    def _predict_one(self, belief: Any, actions: Array, outcome: Array | None) -> Any:
        """``predict`` of one action for each environment, (env,)."""
        used, left = self.action_set.account.pay(belief.energy, actions)
        clear, occlusion, draws = self._predict_slot(belief, outcome)
        return self._belief(self._predict_pulse(belief, self._pulses(used, clear), draws), left, occlusion)

    def _predict_slot(self, belief: Any, outcome: Array | None) -> tuple[Array, Array, Any]:
        """Probability of a clear slot (env,), the field of the occlusion after it, draws (env, sensor, target)."""
        clear = self._clear_probability(belief)
        if outcome is None:
            return clear, 1.0 - clear, None
        drawn = (outcome[:, -1] < clear).astype(np.float64)
        return drawn, 1.0 - drawn, self._by_sensor(outcome[:, :-1])

    def _by_sensor(self, draws: Array) -> Array:
        """Draws (..., sensor * target) as (..., sensor, target)."""
        return draws.reshape(*draws.shape[:-1], len(self.sensors), len(self.starts))

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The observation: AgileClutter's with the longest pulse's SNR, then the account and the occlusions."""
        base = [e._replace(centre=WEAK) if e.name.startswith("snr") else e for e in super().observation_fields]
        return (*base, *account_fields(self.total / self.horizon, len(self.sensors)), *self._occlusion_fields())

    def _occlusion_fields(self) -> tuple[ObservationField, ...]:
        return (ObservationField("occluded", "1", 0.5, 0.5, "whether the last slot was occluded"),)

    def observe(self, belief: Any) -> Array:
        """See ``observation_fields``."""
        out, occlusion = super().observe(belief), self._observed_occlusion(belief)
        own = out[:, out.shape[1] - 2 - len(occlusion) :]
        own[:, 0] = belief.energy / self.total
        own[:, 1] = np.minimum(belief.energy / np.maximum(self.horizon - belief.step, 1), len(self.sensors))
        own[:, 2:] = np.stack(occlusion, axis=1)
        return out

    def _observed_occlusion(self, belief: Any) -> tuple[Array, ...]:
        """The values of ``_occlusion_fields``, each (env,)."""
        return (belief.occluded,)

    def state_info(self, state: State) -> dict[str, Array]:
        """AgileClutter's, and ``energy`` left. For the step: energy ``spent``, ``occluded``, whether ``replaced``."""
        own = {name: getattr(state.truth, name).copy() for name in ("spent", "occluded", "replaced")}
        return {**super().state_info(state), "energy": state.belief.energy.copy(), **own}
