"""Two radars with one beam each: which target to illuminate now, and which before it is hidden."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import Any, Literal

import numpy as np
from pydantic import NonNegativeInt

from wavegym.core.action_sets import JointLibrary, Library
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_within
from wavegym.core.parameters import Count, Positive, changed_default, parameter, system_parameters
from wavegym.core.system import ObservationField, State
from wavegym.systems.agile_clutter.actions import ChirpActions, numbered
from wavegym.systems.agile_clutter.state import (
    NonNegativeState,
    PlanarState,
    PositiveState,
    Pulse,
    corners,
    drawn_around,
    target_fields,
)
from wavegym.systems.agile_clutter.system import AgileClutter
from wavegym.systems.beam_allocation.state import Belief, World
from wavegym.systems.visibility_windows import (
    SOON,
    Window,
    coming,
    given_windows,
    visibility,
    window_draws,
    window_fields,
)
from wavegym.waveforms import PulseTrain, measurement_covariances, trapezoid_chirp_library
from wavegym.waveforms.waveform import Waveform

MOST_ACTIONS = 10_000


@dataclass(frozen=True)
class BeamActions(ChirpActions):
    """A target to illuminate and a chirp for every sensor; an action is one index for all sensors.

    Args:
        targets: number of targets.
        counts: number of pulses of each chirp's train; 1 is the chirp alone.
        intervals: time between the pulses of each chirp's train, s; not used for a chirp alone.
    """

    targets: int
    counts: tuple[int, ...] = field(kw_only=True)
    intervals: tuple[float, ...] = field(kw_only=True)

    @cached_property
    def library(self) -> Library:
        """Every law with each duration, sweep, number of pulses and interval, rising.

        InputError for unequal numbers of them, or for an interval without room for a pulse.
        """
        given = {"durations": self.durations, "sweeps": self.sweeps, "counts": self.counts, "intervals": self.intervals}
        if len({len(values) for values in given.values()}) > 1:
            listed = ", ".join(f"{name} is {values}" for name, values in given.items())
            raise InputError(f"{listed}, expected one of each for every chirp")
        trains = zip(*given.values(), strict=True)
        return Library(tuple(self._sent(law, *train) for law, train in product(self.laws, trains)))

    def _sent(self, law: str, duration: float, sweep: float, count: int, interval: float) -> Waveform:
        """A chirp, or a train of it."""
        chirp = trapezoid_chirp_library((law,), (duration,), (sweep,))[0]
        return chirp if count == 1 else PulseTrain(chirp, count=count, interval=interval)

    @cached_property
    def joint(self) -> JointLibrary:
        """Every target with every chirp, in all combinations of the sensors."""
        labels = (f"target {t}: {chirp}" for t in range(1, self.targets + 1) for chirp in self.library.labels)
        return JointLibrary(Library(tuple(labels)), self.sensors)

    @property
    def sensor_library(self) -> tuple[Waveform | None, ...]:
        """The chirp of each of a sensor's choices."""
        return self.library.entries * self.targets

    @cached_property
    def chirp_covariances(self) -> Array:
        """C (chirp, 2, 2) at unit SNR."""
        return measurement_covariances(self.library, self.carrier_hz)

    @property
    def waveforms(self) -> Library:
        """The chirps, each once."""
        return self.library

    @cached_property
    def numbered_windows(self) -> Array:
        """The receive windows of the chirps, (chirp, 11)."""
        return numbered(self.library_windows)

    @cached_property
    def sensor_windows(self) -> Array:
        """The receive windows of each of a sensor's choices, (choice, 11)."""
        return np.tile(self.numbered_windows, (self.targets, 1))

    @cached_property
    def sensor_covariances(self) -> Array:
        """C (choice, 2, 2) at unit SNR."""
        return np.tile(self.chirp_covariances, (self.targets, 1, 1))

    @cached_property
    def candidates(self) -> Array:
        """All joint actions."""
        return np.arange(len(self.joint))

    @cached_property
    def constants(self) -> Array:
        """All joint actions."""
        return self.candidates

    @cached_property
    def illuminated(self) -> Array:
        """Whether a sensor's beam illuminates a target, (action, sensor, target) bool."""
        return self.joint.indices[..., None] // len(self.library) == np.arange(self.targets)

    @cached_property
    def chirp_codes(self) -> tuple[Array, int]:
        """The chirps that an action sends at each target as one number, (action, target); how many numbers there are.

        The number has one digit for every sensor, the last sensor's digit the lowest: 0 for a beam that points
        elsewhere, d > 0 for chirp d - 1.
        """
        base, digits = len(self.library) + 1, self.joint.indices % len(self.library) + 1
        weights = base ** np.arange(self.sensors)[::-1]
        return (self.illuminated * (digits * weights)[..., None]).sum(axis=1), base**self.sensors


@system_parameters
class BeamAllocation(AgileClutter):
    """Two radars with one beam each share three targets, which are hidden at times known in advance.

    Description
        Motion, measurements, clutter and tracker are those of wavegym/AgileClutter-v0. A beam illuminates one target: a
        sensor can detect only the target in its beam, and opens only that target's gate. The radars see the targets at
        right angles. Each resolves a different direction, so a target needs both.

        The receivers' memory limits the product of bandwidth and dwell. A single wide chirp measures range well; a
        coherent train of eight narrow pulses of the same energy measures range-rate well. The train's range-rates fold,
        but every fold lies outside the gates. A return therefore has one meaning, and the tracker needs no fold
        hypotheses. Every pulse ends before the nearest echo arrives. Echoes fluctuate and noise has false returns as in
        wavegym/AgileClutter-v0; a train is one look at one realised SNR.

        Hills on the map hide targets at times known in advance. A beam at a hidden target receives no return and opens
        no gate. For the cost one step ahead, the range of the least certain target matters most. Over several steps,
        velocities matter, and the target that will be hidden soon.

    Rewards
        -trace(Lambda P) summed over the targets, including hidden ones, Lambda = diag(weights): m^2, with 1 s^2 on the
        velocities. P is the covariance of the mixture, as in wavegym/AgileClutter-v0: a lost track costs more. Every
        target exists throughout, so the cost needs no probability of existence.

    Starting state
        True targets start uniformly within ``spread`` of ``starts``. The first estimates are drawn around the truth
        with covariance P0 = diag(prior_variance).

    Episode end
        Terminates after ``horizon`` steps. The remaining time is observed.

    References
        S. P. Sira, A. Papandreou-Suppappola, D. Morrell and D. Cochran, "Waveform-agile sensing for tracking multiple
        targets in clutter" (motion, measurements, tracker). This suite adds the beams and the delayed cost.
    """

    horizon: int = changed_default(AgileClutter, "horizon", 60)
    dt: float = changed_default(AgileClutter, "dt", 1.0)
    q: float = changed_default(AgileClutter, "q", 3.0)
    sensors: tuple[tuple[float, float], ...] = changed_default(AgileClutter, "sensors", ((0.0, -20e3), (-20e3, 0.0)))
    starts: tuple[PlanarState, ...] = parameter(
        ((0.0, 4e3, 0.0, 0.0), (-3.5e3, -2e3, 0.0, 0.0), (3.5e3, -2e3, 0.0, 0.0)),
        "centre of the first [x y xdot ydot] of each target",
        unit="m, m/s",
        truth=True,
    )
    births: tuple[NonNegativeInt, ...] = parameter((0, 0, 0), "0 for every target: all are always present")
    lifetime: int = parameter(60, "at least horizon: all targets are always present", ge=1, le=100_000)
    prior_variance: PositiveState = changed_default(AgileClutter, "prior_variance", (100.0, 100.0, 25.0, 25.0))
    clutter_density: float = changed_default(AgileClutter, "clutter_density", 1e-5)
    laws: tuple[str, ...] = changed_default(AgileClutter, "laws", ("pfm:3",))
    durations: tuple[Positive, ...] = parameter((50e-6, 6.25e-6), "duration of each pulse", unit="s")
    sweeps: tuple[Positive, ...] = parameter(
        (40e6, 1e6),
        "sweep of each chirp, as many as durations; the chirps are every law with every pair, rising",
        unit="Hz",
    )
    counts: tuple[Count, ...] = parameter((1, 8), "number of coherent pulses of each chirp, as many as durations")
    intervals: tuple[Positive, ...] = parameter(
        (250e-6, 250e-6), "time between the pulses of each chirp's train, as many as durations", unit="s"
    )
    library: None = parameter(None, "not used", unit="")
    false_alarms: tuple[()] = parameter((), "not used", unit="")
    alarm_density: None = parameter(None, "not used", unit="")
    action: Literal["joint"] = parameter("joint", "a target and a chirp for every sensor, in one index", unit="")
    spread: NonNegativeState = parameter(
        (1e3, 1e3, 100.0, 100.0),
        "maximum distance of a first [x y xdot ydot] from its centre",
        unit="m, m/s",
        truth=True,
    )
    shown: tuple[Count, Count] = parameter(
        (6, 14), "minimum and maximum number of steps in which a target stays visible"
    )
    hidden: tuple[NonNegativeInt, NonNegativeInt] = parameter(
        (4, 10), "minimum and maximum number of steps in which it stays hidden"
    )
    windows: tuple[Window, ...] = parameter(
        (), "(target, first step, last step) in which a target is hidden; () draws the windows", unit=""
    )

    def __post_init__(self) -> None:
        """Check several fields together."""
        super().__post_init__()
        if any(self.births):
            raise InputError(f"births is {self.births}, expected 0 for every target: all are present throughout")
        count = (len(self.action_set.library) * len(self.starts)) ** len(self.sensors)
        check_within("number of joint actions", count, 1, MOST_ACTIONS)
        window_draws(self.horizon, self.shown, self.hidden)
        given_windows(self.windows, len(self.starts), self.horizon)

    @cached_property
    def action_set(self) -> BeamActions:
        """The target and the chirp of every sensor."""
        chirps = (self.laws, self.durations, self.sweeps, self.carrier_hz)
        return BeamActions(
            *chirps,
            len(self.sensors),
            self.action,
            len(self.starts),
            counts=self.counts,
            intervals=self.intervals,
            eclipsing=self.eclipsing,
            false_alarms=(self.false_alarm,),
        )

    def draw_world(self, rng: np.random.Generator) -> World:  # type: ignore[override]
        """All draws of one episode."""
        targets = len(self.starts)
        draws = window_draws(self.horizon, self.shown, self.hidden)
        return World(*super().draw_world(rng), rng.random((targets, 4)), rng.random((targets, draws)))

    def initial(self, world: Any) -> State:
        """The true paths, the first estimates drawn around their starts, and the windows of visibility."""
        truth, base = super().initial(world)
        visible = visibility(self, world.window, len(self.starts))
        return State(truth, Belief(base.step, base.mean, base.covariance, base.hypotheses, visible))

    def farthest_starts(self) -> Array:
        """The corners of the boxes in which targets start, (state, 4)."""
        return corners(self.starts, self.spread)

    def first_states(self, world: Any) -> Array:
        """The true states at birth, drawn around ``starts``."""
        return drawn_around(self.starts, self.spread, world.place)

    def pulse(self, belief: Any, actions: Array) -> Pulse:
        """Every sensor illuminates one target, with chance 1 if that target is visible."""
        seen = coming(belief.visible, belief.step, 1).now[:, None, None]
        chance = np.where(self.action_set.illuminated.take(actions, 0) & seen, 1.0, 0.0)
        pulses = self.action_set
        strength = self._full_illumination[0]
        return Pulse(
            pulses.unit_covariance(actions), strength, chance, pulses.alarms(actions), *pulses.windows(actions)
        )

    def predict(self, belief: Any, actions: Array, outcome: Array | None = None) -> Any:
        """The belief after one pulse of every sensor; see ``AgileClutter``."""
        after = super().predict(belief, actions, outcome)
        visible = belief.visible
        if after.step.ndim == 2:
            visible = np.broadcast_to(visible[:, None], after.step.shape + visible.shape[1:])
        return Belief(*after[:3], None, visible)

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The observation: AgileClutter's, then the visibility of every target."""
        targets = len(self.starts)
        windows = (field for t in range(1, targets + 1) for field in window_fields(t))
        return (*target_fields(targets, len(self.sensors)), *windows)

    def observe(self, belief: Any) -> Array:
        """See ``observation_fields``."""
        out = super().observe(belief)
        own = out[:, out.shape[1] - 3 * len(self.starts) :]  # three fields of each target's window
        own[:, 0::3], own[:, 1::3], own[:, 2::3] = coming(belief.visible, belief.step, SOON)
        return out
