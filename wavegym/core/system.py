"""The contract between a closed loop (waveform, target, sensor, tracker) and everything that uses it.

A system is data plus a handful of pure functions of arrays. Environments, schedulers, evaluation and documentation know
nothing else, so a system of your own is one dataclass in plain NumPy::

    @dataclass(frozen=True)
    class MySystem(System):
        ...parameters...

Every array carries the environments on axis 0. Three kinds of data, each a NamedTuple of arrays:

* **World**: every random number of one episode, drawn in advance and independent of what will be chosen (a tape);
* **Hidden**: what no scheduler may see (true targets);
* **Public**: the belief, resources, time and known map. It has at least the field ``step``: int array (env,).
"""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import numpy as np

from wavegym.core.action_sets import ActionSet, PerSensorLibrary
from wavegym.core.arrays import Array
from wavegym.core.parameter_box import ParameterBox


class State(NamedTuple):
    """All there is to know of a batch of episodes: NamedTuples of arrays with axis 0 = environment."""

    truth: Any
    belief: Any


class ObservationField(NamedTuple):
    """One element of the observation, shown to agents as (value - centre) / scale."""

    name: str
    unit: str
    centre: float
    scale: float
    meaning: str


class System:
    """Base class of all systems: the contract, with defaults for what most systems share.

    Attributes:
        horizon: steps in an episode.
        dt: time step in seconds.
        actions: what may be transmitted: a Library, a JointLibrary or other finite set (action = index), a PerSensor
            (action = one index for each sensor) or a ParameterBox (action in [-1, 1]^d).
        elements: the observation's elements, in order.
        terminates: True for a finite-horizon task (its end is a termination, the time left is observed), False for a
            monitoring task cut off after ``horizon`` steps (its end is a truncation).
        strict: whether the shells refuse an action that is masked. With False the system takes it, transmits something
            allowed in its place, in ``transition`` and ``predict`` alike, and says so in the metric ``replaced``.
        chances: the shape of the uniform draws that the outcome of one step takes in ``predict``; (0,) for none.
    """

    horizon: int
    dt: float
    terminates: ClassVar[bool] = True
    strict: ClassVar[bool] = True

    @property
    def outcome_shape(self) -> tuple[int, ...]:
        """The shape of one step's outcome."""
        return (0,)

    @property
    def target_of_action(self) -> Array | None:
        """Which target each candidate looks at with each of its beams, (candidate, beam) int; None: at all alike."""
        return None

    @property
    def actions(self) -> ActionSet:
        """The action set."""
        raise NotImplementedError

    @property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The observation's elements, in the order in which ``observe`` returns them."""
        raise NotImplementedError

    def draw_world(self, rng: np.random.Generator) -> Any:
        """Draw every random number of one episode. Arrays without an environment axis; ``rng`` is used nowhere else."""
        raise NotImplementedError

    def initial(self, world: Any) -> State:
        """The state at step 0 of each world; world arrays have the environment axis from here on."""
        raise NotImplementedError

    def transition(self, state: State, action: Array, world: Any) -> State:
        """One step: move the targets, sense with the chosen waveform, track. Returns fresh arrays.

        Reads the tape at [env, public.step]; environments may stand at different steps. ``action``: (env,), or
        (env, sensor) or (env, d).
        """
        raise NotImplementedError

    def predict(self, belief: Any, actions: Array, outcome: Any = None) -> Any:
        """One step of the belief as a planner may predict it.

        Args:
            belief: the belief, axis 0 = environment.
            actions: (env,), or (env, candidate) in which case every array of the result gains the axis ``candidate``;
                axis 0 may be 1 where all environments share their candidates. A box adds its axis d at the end, a
                PerSensor its axis sensor.
            outcome: None for the expected outcome, or uniform draws in [0, 1], (env, *chances) or (env, candidate,
                *chances): an event, such as a detection, happens where its draw is below its probability as the belief
                predicts it. So 0 makes happen whatever can, 1 nothing.
        """
        raise NotImplementedError

    def cost(self, belief: Any) -> Array:
        """The cost of a belief, trace(Lambda P), (env,), or with whatever leading axes ``belief`` has."""
        raise NotImplementedError

    def observe(self, belief: Any) -> Array:
        """The observation's elements in the units that ``observation_fields`` states, (env, elements)."""
        raise NotImplementedError

    def terminal(self, belief: Any) -> Array:
        """Whether the episode is over, (env,) bool."""
        return belief.step >= self.horizon

    def mask(self, belief: Any) -> Array:
        """Which actions are allowed, (env, actions) bool; finite action sets only.

        A PerSensor takes no mask: limits that couple sensors cannot be told sensor by sensor, so they go into the
        joint form. What agents are shown for it is all True, (env, sensors * waveforms), sensor by sensor.
        """
        actions = self.actions
        if isinstance(actions, PerSensorLibrary):
            count = actions.sensors * len(actions)
        else:
            count = len(self.candidates() if isinstance(actions, ParameterBox) else actions.labels)
        return np.ones((len(belief.step), count), dtype=np.bool_)

    def state_info(self, state: State) -> dict[str, Array]:
        """Key figures of the state, each (env, ...); may look at the truth, and is never observed.

        Evaluation knows ``position_error`` (m), ``nees``, and ``lost``: tracks lost, of which those at the episode's
        end count. Those of several targets are (env, target). Where targets come and go, ``present``, (env, target)
        bool, says which are there; the other figures of one that is not are 0, as Gymnasium's checker of environments
        takes no NaN for equal.
        """
        return {}

    def candidates(self) -> Array:
        """The actions that enumerating schedulers try.

        All indices (A,), or all combinations (A^sensors, sensors) of a PerSensor; a system with a box offers points,
        (A, d).
        """
        actions = self.actions
        if isinstance(actions, ParameterBox):
            raise NotImplementedError
        return actions.combinations() if isinstance(actions, PerSensorLibrary) else np.arange(len(actions.labels))

    def constants(self) -> Array:
        """The actions that schedules without a belief (fixed:K, best-fixed, round-robin) choose among, (C, ...).

        By default ``candidates()``. Fewer of them keep the search for the best one short; with a ``mask``, at least
        one of them must always be allowed.
        """
        return self.candidates()

    def named_constants(self) -> dict[str, Array]:
        """Constant actions that have a name, e.g. a paper's own setting; ``fixed:NAME`` transmits one. Default: none.

        They need not be among ``constants()``. A name holds no comma, because policies are listed with commas, and is
        no integer, because ``fixed:K`` is a number's.
        """
        return {}

    def baselines(self) -> dict[str, tuple[str, dict[str, Any]]]:
        """Whole loops that have a name: a scheduler, and parameters of the system that differ from this one's.

        A comparison plays them on the same worlds, e.g. a paper's baseline with a simpler tracker. Default: none.
        """
        return {}
