"""The contract between a closed loop (waveform, target, sensor, tracker) and everything that uses it.

A system is data plus a few pure functions of arrays. Environments, schedulers, evaluation and documentation use
nothing else, so your own system is one dataclass in plain NumPy::

    @dataclass(frozen=True)
    class MySystem(System):
        ...parameters...

Axis 0 of every array is the environment. There are three kinds of data, each a NamedTuple of arrays:

* **World**: every random number of one episode, drawn in advance and independent of all actions (a tape);
* **Truth**: the part of the state that no scheduler may see, such as the true targets;
* **Belief**: the tracker's estimates, resources, time and the known map. Its field ``step`` is an int array (env,).

The truth and the belief each have a model. They are equal unless the parameter ``truth`` changes the world; tracker and
schedulers then keep their assumptions. One step has three parts: ``move`` the targets, ``measure``, ``track``.

Traits (``wavegym.core.traits``) change the form of a loop. Shortcuts (``wavegym.core.shortcuts``) make schedulers
faster.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np

from wavegym.core.action_sets import ActionSet, ParameterBox, PerSensorLibrary
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, nearest
from wavegym.core.parameters import make_checked, parameter_infos
from wavegym.core.registry import load_object
from wavegym.core.shortcuts import fused_transition


class State(NamedTuple):
    """The state of a batch of episodes: two NamedTuples of arrays with axis 0 = environment."""

    truth: Any
    belief: Any


class ObservationField(NamedTuple):
    """One field of the observation. Agents see (value - centre) / scale."""

    name: str
    unit: str
    centre: float
    scale: float
    meaning: str


@dataclasses.dataclass(frozen=True)
class System:
    """Base class of all systems: the contract, with defaults for what most systems share.

    A subclass is a frozen dataclass.

    Attributes:
        truth: parameters of the world that differ from the assumption of tracker and schedulers, by name; None for no
            difference. Only parameters that are declared with ``truth=True`` may differ.
        horizon: steps in an episode.
        dt: time step in seconds.
        actions: the action set: a Library or a JointLibrary (an action is an index), a PerSensorLibrary (one index for
            each sensor) or a ParameterBox (a point of [-1, 1]^d).
        observation_fields: the fields of the observation, in order.
        terminates: True for a finite-horizon task, which terminates and observes the time left; False for a
            monitoring task, which is truncated after ``horizon`` steps.
        strict: whether environments refuse a masked action. With False the system replaces a masked action by an
            allowed one, in ``transition`` and ``predict`` alike, and reports ``replaced`` in ``state_info``.
        outcome_shape: the shape of the uniform draws that decide one step's outcome in ``predict``; (0,) for none.
        nees_dimension: the number of elements of the error in ``state_info``'s ``nees``, which is the mean NEES of a
            consistent tracker. Reports flag a mean NEES far from it; None (default) where no mean is expected.
        lost_beyond: the position error in m from which the sensor or the association no longer finds a target; None
            (default) where no target can be lost.
    """

    if TYPE_CHECKING:  # a subclass has them as fields, properties or class attributes
        horizon: int = dataclasses.field(init=False)
        dt: float = dataclasses.field(init=False)
    terminates: ClassVar[bool] = True
    strict: ClassVar[bool] = True

    truth: Mapping[str, Any] | None = dataclasses.field(
        default=None,
        kw_only=True,
        metadata={"description": "parameters in which the world differs from what the tracker assumes", "unit": ""},
    )

    def __getstate__(self) -> dict[str, Any]:
        """A pickle has everything except cached properties, so that it and its hash do not depend on earlier use."""
        kept = vars(self).items()
        return {name: value for name, value in kept if not isinstance(getattr(type(self), name, None), cached_property)}

    @cached_property
    def truth_model(self) -> Self:
        """The system whose parameters the world follows: this one, or its twin with the parameters of ``truth``.

        Raises:
            InputError: ``truth`` names a parameter that may not differ, or a value out of range.
        """
        if not self.truth:
            return self
        allowed = [info.name for info in parameter_infos(type(self)) if info.truth]
        for name in self.truth:
            if name not in allowed:
                listed = f"one of {', '.join(allowed)}" if allowed else "None: no parameter may differ"
                raise InputError(f"truth has {name!r}, expected {listed}{nearest(name, allowed)}")
        own = {field.name: getattr(self, field.name) for field in dataclasses.fields(self) if field.init}
        twin: Self = make_checked(type(self), {**own, "truth": None, **self.truth})
        return twin

    @cached_property
    def belief_model(self) -> Self:
        """The system as the tracker and the schedulers assume it: without ``truth``."""
        return dataclasses.replace(self, truth=None) if self.truth else self

    @property
    def outcome_shape(self) -> tuple[int, ...]:
        """The shape of the draws that decide one step's outcome."""
        return (0,)

    @property
    def nees_dimension(self) -> int | None:
        """The mean NEES of a consistent tracker; None where no mean is expected."""
        return None

    @property
    def lost_beyond(self) -> float | None:
        """The position error, m, from which a target is astray; None where none can be lost."""
        return None

    @property
    def actions(self) -> ActionSet:
        """The action set."""
        raise NotImplementedError

    @property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The fields of the observation, in the order in which ``observe`` returns them."""
        raise NotImplementedError

    def draw_world(self, rng: np.random.Generator) -> Any:
        """Every random number of one episode, arrays without an environment axis. Nothing else draws from ``rng``."""
        raise NotImplementedError

    def initial(self, world: Any) -> State:
        """The state at step 0 of each world; the arrays of ``world`` have the environment axis."""
        raise NotImplementedError

    def transition(self, state: State, action: Array, world: Any) -> State:
        """One step: move the targets, sense with the chosen waveform, track. Returns fresh arrays.

        Reads the tape at [env, belief.step], since environments may be at different steps. ``action`` is (env,),
        (env, sensor) or (env, d). By default ``composed_transition``, or the shortcut ``fused_transition``.
        """
        return self._transition(state, action, world)

    @cached_property
    def _transition(self) -> Callable[[State, Array, Any], State]:
        return fused_transition.of(self) or self.composed_transition

    def composed_transition(self, state: State, action: Array, world: Any) -> State:
        """``transition`` as the sequence of ``move``, ``measure``, ``track`` and ``annotate``."""
        truth = self.move(state.truth, state.belief.step, world)
        measurements = self.measure(truth, state.belief, action, world)
        return State(self.annotate(truth, measurements), self.track(state.belief, action, measurements))

    def move(self, truth: Any, step: Array, world: Any) -> Any:
        """The truth with all targets one step later; ``step`` (env,) is the step before. Returns fresh arrays."""
        raise NotImplementedError

    def measure(self, truth: Any, belief: Any, action: Array, world: Any) -> Any:
        """What the sensors report of one step: a NamedTuple of arrays, axis 0 = environment.

        Args:
            truth: after the targets have moved.
            belief: before the step. A sensor may use it to point: a camera points at an estimate.
            action: as in ``transition``.
            world: the tape, read at [env, belief.step].
        """
        raise NotImplementedError

    def track(self, belief: Any, action: Array, measurements: Any) -> Any:
        """The belief one step later: the tracker predicts, associates the measurements and updates."""
        raise NotImplementedError

    def annotate(self, truth: Any, measurements: Any) -> Any:
        """The truth with the figures of the scan that ``state_info`` reports; by default the truth itself."""
        return truth

    def predict(self, belief: Any, actions: Array, outcome: Any = None) -> Any:
        """The belief after one step, as far as it can be predicted from the belief alone.

        Args:
            belief: axis 0 = environment.
            actions: (env,); or (env, candidate), and then every array of the result has the axis ``candidate`` too.
                Axis 0 may be 1 where all environments share their candidates. A ParameterBox adds its axis d at the
                end, a PerSensorLibrary its axis sensor.
            outcome: None for the expected outcome; or uniform draws in [0, 1], (env, *outcome_shape) or
                (env, candidate, *outcome_shape). An event such as a detection happens where its draw is below its
                predicted probability: with draws of 0 every possible event happens, with draws of 1 none.
        """
        raise NotImplementedError

    def cost(self, belief: Any) -> Array:
        """What schedulers minimise, with the leading axes of ``belief``: (env,) or (env, candidate).

        In a system whose tracks cannot be lost it is trace(Lambda P) summed over the targets. A system with another
        cost, for tracks that may be lost, overrides ``trace``.
        """
        raise NotImplementedError

    def trace(self, belief: Any) -> Array:
        """trace(Lambda P) summed over the targets, shaped as ``cost``, which it is by default."""
        return self.cost(belief)

    def observe(self, belief: Any) -> Array:
        """The observation in the units of ``observation_fields``, (env, fields)."""
        raise NotImplementedError

    def terminal(self, belief: Any) -> Array:
        """Whether the episode is over, (env,) bool."""
        return belief.step >= self.horizon

    def mask(self, belief: Any) -> Array:
        """Which actions are allowed, (env, actions) bool; for finite action sets only.

        A PerSensorLibrary has no mask: limits that couple sensors need a JointLibrary. Agents receive all True for it,
        (env, sensors * waveforms), sensor after sensor.
        """
        actions = self.actions
        if isinstance(actions, PerSensorLibrary):
            count = actions.sensors * len(actions)
        else:
            count = len(self.candidates() if isinstance(actions, ParameterBox) else actions.labels)
        return np.ones((len(belief.step), count), dtype=np.bool_)

    def state_info(self, state: State) -> dict[str, Array]:
        """Key figures of the state, each (env, ...). They may use the truth; agents never observe them.

        Evaluation reads, each (env,) or (env, target):

        * ``position_error`` (m), the distance of the estimate from the target;
        * ``position_variance`` (m^2), its mean square by belief: the trace of the covariance's position part;
        * ``nees``, the normalised estimation error squared, over ``nees_dimension`` elements;
        * ``lost``, the targets lost; the value at the episode's end counts. The environments add it, and ``astray``, by
          the rule of ``wavegym.core.track_loss`` if the system has ``lost_beyond`` and does not report ``lost`` itself.

        Where targets come and go, ``present``, (env, target) bool, marks the present targets. The figures of an absent
        target are 0, because Gymnasium's checker treats NaN as unequal. Where tracks come and go, ``present`` marks the
        targets with a track, and a target that is there without one has a ``position_error`` of ``lost_beyond``.

        ``gospa``, (env,) in m, is the GOSPA distance of order 2 over all targets and tracks. If a system has it, its
        square is the error by truth in evaluations, in place of the squared position error.
        """
        return {}

    def candidates(self) -> Array:
        """The actions that enumerating schedulers try.

        By default all indices (A,), or all combinations (A^sensors, sensors) of a PerSensorLibrary. A system with a
        ParameterBox returns points of the box, (A, d).
        """
        actions = self.actions
        if isinstance(actions, ParameterBox):
            raise NotImplementedError
        return actions.combinations() if isinstance(actions, PerSensorLibrary) else np.arange(len(actions.labels))


def build_system(system: System | type[System] | str, parameters: dict[str, Any], beside: Iterable[str] = ()) -> System:
    """A system with these parameters, built from its class, ``"package.module:Class"`` or another system.

    Args:
        system: what to build.
        parameters: by name.
        beside: other names that are valid in the same place; the error may suggest one of them.

    Raises:
        InputError: no such class, an unknown parameter (nearest named) or a value out of range.
    """
    kind: Any = load_object("system", system) if isinstance(system, str) else system
    if isinstance(system, System):
        if not parameters:
            return system
        kind = type(system)
        own = {field.name: getattr(system, field.name) for field in dataclasses.fields(system) if field.init}
        parameters = {**own, **parameters}
    made: System = make_checked(kind, parameters, beside=beside)
    made.truth_model  # noqa: B018  (an invalid truth is reported here)
    return made
