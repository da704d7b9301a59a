"""What a system may offer beyond the contract, as declared types.

A system declares a capability by deriving from it: ``class MySystem(System, BestAction)``. Schedulers ask
``offers(system, BestAction)``. A capability that computes faster, or by itself, what generic functions of the system
compute (``shortcut_for``) counts only as long as none of these is overridden in a class below it: a subclass that
changes ``cost`` alone does not inherit a search for the old cost. A subclass withdraws a capability by setting its
member to None.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import check_int
from wavegym.core.horizon_weights import horizon_weights
from wavegym.core.recursion import Recursion


class Capability(ABC):  # noqa: B024  (what is abstract stands in the capabilities)
    """Base class of all capabilities.

    Attributes:
        members: what a system has that offers it.
        shortcut_for: the functions of the contract with which the members must agree.
    """

    members: ClassVar[tuple[str, ...]] = ()
    shortcut_for: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, members: Iterable[str] = (), shortcut_for: Iterable[str] = (), **others: Any) -> None:
        """A capability names its members; a system that derives from it names none."""
        super().__init_subclass__(**others)
        if members:
            cls.members, cls.shortcut_for = tuple(members), tuple(shortcut_for)


class FusedTransition(Capability, members=("fused_transition",), shortcut_for=("move", "measure", "track", "note")):
    """A whole step in compiled form."""

    @abstractmethod
    def fused_transition(self, state: Any, action: Array, world: Any) -> Any:
        """The state after ``move``, ``measure``, ``track`` and ``note``; see ``System.transition``."""


class BestAction(Capability, members=("best_action",), shortcut_for=("predict", "cost", "candidates")):
    """The one-step choice of least cost, or nearly so, found faster than by trying all candidates."""

    @abstractmethod
    def best_action(self, belief: Any) -> Array:
        """Actions (env, ...). Raises NotImplementedError for a form of the action set that it is not for."""


class BestSequence(Capability, members=("best_sequence",), shortcut_for=("predict", "cost", "candidates", "terminal")):
    """The best sequence of candidates: an exhaustive lookahead in compiled form."""

    @abstractmethod
    def best_sequence(self, belief: Any, depth: int) -> tuple[Array, Array]:
        """Index of the first candidate (env,), and summed cost of the sequence (env,)."""


class SequencePlan(Capability, members=("plan",), shortcut_for=("predict", "cost", "terminal")):
    """A good sequence of any length, found by a local search."""

    @abstractmethod
    def plan(self, belief: Any, depth: int) -> tuple[Array, Array]:
        """First actions (env, ...), and the predicted summed cost of the sequence (env,)."""


class DeterministicRecursion(
    Capability,
    members=("deterministic_recursion",),
    shortcut_for=("transition", "fused_transition", "move", "measure", "track", "cost", "candidates"),
):
    """A covariance that depends on nothing but the actions, so that finite-horizon optima can be computed."""

    @abstractmethod
    def deterministic_recursion(self, world: Any) -> Recursion:
        """The recursion of whole episodes, axis 0 = world."""


class LinearCost(Capability, members=("weights",), shortcut_for=("cost",)):
    """The cost is trace(Lambda P) summed over the targets, and the targets' motion is linear.

    Attributes:
        weights: Lambda (n, n), or its diagonal (n,).
        motion: the motion model, with F (n, n); only ``transition_matrix`` reads it.
    """

    weights: Any
    motion: Any

    @property
    def transition_matrix(self) -> Array:
        """F of the targets' motion, (n, n)."""
        F: Array = self.motion.F
        return F

    def weights_ahead(self, ahead: int) -> Array:
        """``horizon_weights`` of 1, 2, ... ``ahead`` steps, (ahead, n, n); made once."""
        if ahead not in self._made_ahead:
            steps = range(1, check_int("ahead", ahead, 1) + 1)
            self._made_ahead[ahead] = np.stack(
                [horizon_weights(self.transition_matrix, self.weights, k) for k in steps]
            )
        return self._made_ahead[ahead]

    @cached_property
    def _made_ahead(self) -> dict[int, Array]:
        return {}


class Gain(Capability, members=("gain",), shortcut_for=("predict", "cost")):
    """What a look is worth to the steps to come."""

    @abstractmethod
    def gain(self, belief: Any, wait: Array | int, ahead: Any) -> Array:
        """What a candidate's pulse takes off the summed cost of the ``ahead`` steps from it on, (env, candidate).

        Args:
            belief: axis 0 = environment.
            wait: steps until the pulse is sent, with all set-up complete: a number, or (env, candidate).
            ahead: steps over which the cost is summed, the one of the pulse included.
        """


class GainByTarget(Gain):
    """A gain that takes a number of steps ``ahead`` for every target, (env, target)."""


class Delay(Capability, members=("delay",), shortcut_for=("predict",)):
    """Candidates whose pulse can be sent only after some steps."""

    @abstractmethod
    def delay(self, belief: Any) -> Array:
        """Steps until each candidate's pulse can be sent, (env, candidate) int."""


class Spending(Capability, members=("spending",)):
    """Candidates that are paid from an account: the field ``energy`` of the belief, (env,)."""

    @property
    @abstractmethod
    def spending(self) -> Array:
        """What each candidate takes from the account, (candidate,)."""


class UnequalSteps(Capability, members=("duration", "gain_per_second"), shortcut_for=("predict", "cost")):
    """Steps whose lengths the actions choose. The cost of a step is that of its whole duration.

    Evaluation then means by time: the summed cost over the summed duration. The one-step scheduler takes the candidate
    of the greatest gain per second, because the costs of steps of different lengths cannot be compared.
    """

    @abstractmethod
    def duration(self, belief: Any) -> Array:
        """Seconds of the last step, (env,) or (env, candidate)."""

    @abstractmethod
    def gain_per_second(self, belief: Any) -> Array:
        """What each candidate's step takes off the cost of the time after it, over its duration, (env, candidate)."""


CONFIRMED = 0.9  # existence from which a track is confirmed; below it is tentative


class TrackSlots(Capability, members=("slots_now", "dwells", "outlook"), shortcut_for=("predict", "cost")):
    """Tracks in numbered slots, and one beam that updates a track or searches a sector, a dwell at a time.

    ``gain_per_second`` of a system with it takes ``ahead``, the seconds that count after an update (several make a last
    axis), and ``worth``, that of a target which a search finds, as a number of seconds in which it would be charged in
    full.
    """

    @abstractmethod
    def slots_now(self, belief: Any) -> Array:
        """What is known of each slot now, (env, slot, column); all 0 where it is free.

        Columns: probability of existence, range (m), azimuth (rad), standard deviation of the azimuth in beam widths,
        that of the position (m) and of the velocity (m/s), seconds since the last update, expected density of the
        acceleration (m^2/s^3), and E/N0 of a second of transmission.
        """

    @abstractmethod
    def outlook(self, belief: Any, seconds: float) -> Array:
        """Expected cost of the coming ``seconds`` if the beam rested, (env,)."""

    @property
    @abstractmethod
    def dwells(self) -> Any:
        """What each candidate does, a ``wavegym.systems.multifunction_radar.actions.Dwells``."""


class DwellRule(NamedTuple):
    """The constants of a rule for one beam on a time line.

    An update scores ln(G(ahead) + far G(later)) + tentative [if the track is] + long ln(duration), with the gain per
    second G of a number of seconds ahead. A search scores ln(worth x what it finds per second in full cost) +
    long_search ln(duration) + load ln(1 + number of tracks).
    """

    ahead: float
    later: float
    far: float
    tentative: float
    long: float
    worth: float
    long_search: float
    load: float


class SimulatedFutures(Capability, members=("scores", "simulate"), shortcut_for=("predict", "cost")):
    """Scores of a ``DwellRule``, and futures under it, in compiled form."""

    @abstractmethod
    def scores(self, belief: Any, rule: DwellRule) -> Array:
        """The score of every candidate, (env, candidate)."""

    @abstractmethod
    def simulate(self, belief: Any, actions: Array, rule: DwellRule, seconds: float, futures: int) -> Array:
        """Expected cost of the next ``seconds`` that begin with a candidate, and of the time after, (env, candidate).

        Args:
            belief: axis 0 = environment.
            actions: the candidates, (env, candidate).
            rule: what the futures go on with.
            seconds: length of the futures.
            futures: drawn for each candidate; the same draws for all, and others at each step of an episode.
        """


class MostInformation(Capability, members=("most_information",), shortcut_for=("information",)):
    """Fisher information of every target, and the actions of the most of it.

    Attributes:
        threshold: the least information that every target should get.
    """

    threshold: float

    @abstractmethod
    def information(self, belief: Any, actions: Array) -> Array:
        """Weighted information of each target, (env[, candidate], target); the threshold for one that is absent."""

    @abstractmethod
    def most_information(self, belief: Any, threshold: float | None = None) -> tuple[Array, Array]:
        """Actions of the most information of which every target has the threshold, and where there are any, (env,)."""


class Margin(Capability, members=("margin",)):
    """A field of view: ``margin`` says by how many standard deviations a prediction keeps targets inside it."""

    margin: float


class InnovationCovariance(Capability, members=("innovation_covariance",), shortcut_for=("predict",)):
    """One covariance of the innovation for each candidate, whose determinant is the squared volume of the gate."""

    @abstractmethod
    def innovation_covariance(self, belief: Any, actions: Array) -> Array:
        """S one step ahead, (env, candidate, m, m)."""


class ClosedForm(Capability, members=("predicted",), shortcut_for=("predict", "cost")):
    """Kershaw and Evans's loop, of which the best Gaussian chirp is known in closed form.

    Attributes:
        carrier_hz: carrier frequency, Hz.
        eclipsing: whether an echo may lose its first part to the radar's own pulse; there is no closed form then.
    """

    carrier_hz: float
    eclipsing: bool

    @abstractmethod
    def predicted(self, belief: Any) -> tuple[Array, Array]:
        """What the next pulse meets: the predicted covariance (env, n, n) and eta (env,)."""


class SensorBySensor(Capability, members=("sensor_costs",), shortcut_for=("predict", "cost")):
    """The predicted cost of any chirps, one sensor after another.

    Attributes:
        action_set: the chirps of the system, as ``wavegym.systems.agile_clutter.actions.ChirpActions`` has them.
    """

    @abstractmethod
    def predicted_targets(self, belief: Any) -> Any:
        """The belief at the time of the next pulse, before any sensor measures."""

    @abstractmethod
    def sensor_costs(self, predicted: Any, sensor: int, C: Array, windows: Array) -> Array:
        """trace(Lambda P) after one sensor's pulse, (env, candidate), for C (env or 1, candidate, 2, 2) at unit SNR and
        receive windows (env or 1, candidate, 10), as ``action_set`` gives them.
        """

    @abstractmethod
    def after_sensor(self, predicted: Any, sensor: int, C: Array, windows: Array) -> Any:
        """The belief after this sensor's pulse, C (env, 2, 2) and window (env, 10), before the next sensor's pulse."""


class MeasurementObservation(Capability, members=("measurement_fields", "measured"), shortcut_for=("measure",)):
    """Measurements of a step as an observation that holds nothing of the belief."""

    @property
    @abstractmethod
    def measurement_fields(self) -> tuple[Any, ...]:
        """The ``ObservationField`` of each column of ``measured``."""

    @abstractmethod
    def measured(self, measurements: Any) -> Array:
        """What ``measure`` reported, (env, fields); a field of what was not received has its centre."""

    @property
    def setting_fields(self) -> tuple[Any, ...]:
        """The ``ObservationField`` of each column of ``settings_of``; by default none."""
        return ()

    def settings_of(self, belief: Any) -> Array:
        """The sensors' own settings, which they know without a tracker, (env, fields)."""
        return np.zeros((len(belief.step), 0))


class DecisionMaker(NamedTuple):
    """Who chooses a part of the action: a sensor, a platform or a transmitter."""

    name: str
    fields: tuple[str, ...] = ()  # names of the observation fields that are about this sensor alone
    parameters: tuple[str, ...] = ()  # names of its parameters in a ParameterBox; () for a finite action set


class DecisionMakers(Capability, members=("decision_makers",)):
    """Several decision makers, which choose the action together."""

    @property
    @abstractmethod
    def decision_makers(self) -> tuple[DecisionMaker, ...]:
        """Who chooses which part of the action.

        One for each sensor of a PerSensorLibrary or a JointLibrary, in that order; of a ParameterBox, in any order, and
        every parameter belongs to exactly one. An observation field that belongs to none is shared. A single one where
        the parameters of the system leave a single sensor.
        """


class RecordedTargets(Capability, members=("recorded_windows",)):
    """True targets that may follow recordings.

    The system has the parameters ``tracks``, ``radar``, ``farthest_range`` and ``smoothing``.
    """

    @property
    @abstractmethod
    def recorded_windows(self) -> Any:
        """The windows of the recording that worlds draw, a ``wavegym.targets.Windows``; None without a recording."""


class TimedPulses(Capability, members=("timings", "target_ranges")):
    """Pulses with a timing, to be held against the targets' ranges and speeds.

    Attributes:
        bistatic: whether the receivers are antennas of their own, which listen while the transmitter sends.
        chooses_prf: whether the PRF is chosen, so that a target may be ambiguous or hidden at some of them.
        duration_means: the definition of a pulse's duration, a sentence.
    """

    bistatic: ClassVar[bool] = False
    chooses_prf: ClassVar[bool] = False

    @property
    def duration_means(self) -> str:
        """By default that of ``wavegym.waveforms.transmitted_interval``."""
        return "The duration of a pulse holds 99 % of its energy."

    @property
    @abstractmethod
    def timings(self) -> Mapping[str, Any]:
        """The timing of every pulse of one sensor, a ``wavegym.waveforms.PulseTiming``, by the pulse's label."""

    @abstractmethod
    def target_ranges(self, world: Any) -> Array:
        """Range (m) and range-rate (m/s) of every target, at every sensor and step of its presence, (env, ..., 2).

        With separate receivers half of the path's length and of its rate.
        """


CAPABILITIES: tuple[type[Capability], ...] = (
    FusedTransition,
    BestAction,
    BestSequence,
    SequencePlan,
    DeterministicRecursion,
    LinearCost,
    Gain,
    GainByTarget,
    Delay,
    Spending,
    UnequalSteps,
    TrackSlots,
    SimulatedFutures,
    MostInformation,
    Margin,
    InnovationCovariance,
    ClosedForm,
    SensorBySensor,
    MeasurementObservation,
    DecisionMakers,
    RecordedTargets,
    TimedPulses,
)


def offers(system: object, kind: type[Capability]) -> bool:
    """Whether the system declares the capability and has overridden nothing below it that it must agree with."""
    return not why_not(system, kind)


def why_not(system: object, kind: type[Capability]) -> str:
    """Why the system does not offer the capability, for an error; "" where it does."""
    cls = type(system)
    if not isinstance(system, kind):
        have = [member for member in kind.members if hasattr(system, member)]
        if have:
            return f"it has {have[0]} but does not declare it, expected class {cls.__name__}(System, {kind.__name__})"
        return f"it has no {kind.members[0]}"
    if withdrawn(system, kind):
        return f"it withdraws {kind.members[0]}"
    missing = [member for member in kind.members if not hasattr(system, member)]
    if missing:
        return f"it declares {kind.__name__}, but has no {missing[0]}"
    stale = overridden(cls, kind)
    if not stale:
        return ""
    return f"it overrides {stale[0]}, but inherits {stale[1]} from {stale[2]}, which knows nothing of it"


def withdrawn(system: object, kind: type[Capability]) -> bool:
    """Whether the system's class has set a member of the capability to None."""
    return any(getattr(type(system), member, system) is None for member in kind.members)


def overridden(cls: type, kind: type[Capability]) -> tuple[str, str, str] | None:
    """The function that a class overrides below a capability, the member gone stale, and where that is defined."""
    for member in kind.members:
        level = _level(cls, member)
        for generic in kind.shortcut_for:
            if _level(cls, generic) < level:
                return generic, member, cls.__mro__[level].__name__
    return None


def _level(cls: type, name: str) -> int:
    """How far up the method resolution order ``name`` is defined, as an attribute or a field; past its end: nowhere."""
    for level, base in enumerate(cls.__mro__):
        if base not in CAPABILITIES and (name in vars(base) or name in vars(base).get("__annotations__", {})):
            return level
    return len(cls.__mro__)


def delays(system: Any, belief: Any) -> Array:
    """The delay of each candidate, (env, candidate); 0 for a system without delays."""
    if offers(system, Delay):
        delay: Array = system.delay(belief)
        return delay
    return np.zeros((len(belief.step), len(system.actions.labels)), np.int64)
