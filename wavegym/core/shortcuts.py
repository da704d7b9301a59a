"""Shortcuts: what schedulers can do faster, or further, in some systems; registered for pairs, not inherited.

A kind of shortcut is declared once, as a function whose docstring describes the result. The folder of a system
registers its implementations, as with ``functools.singledispatch``. Anybody may register one for any system::

    @shortcuts.best_action.register(MySystem)
    def best_action(system, belief): ...

A scheduler calls ``search = best_action.of(system)``, which returns a function of the other arguments, or None; or it
calls ``best_action(system, belief)``. A shortcut replaces results of generic functions of the contract. It is void in a
subclass that overrides one of them: a new ``cost`` is never used with a search for the old cost. A shortcut that
replaces nothing adds information to the contract.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial, update_wrapper
from typing import Any, Generic, NamedTuple, ParamSpec, TypeVar

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, nearest
from wavegym.core.horizon_weights import LinearCost
from wavegym.core.traits import DwellRule, lacks_trait

P = ParamSpec("P")
R = TypeVar("R")
Function = TypeVar("Function", bound=Callable[..., Any])

KINDS: dict[str, Shortcut[..., Any]] = {}  # all kinds that were declared, by name


class Recursion(NamedTuple):
    """The Riccati recursion of each environment to the episode's end: a linear model, Pd = 1 and a known SNR.

    At step k + 1 action a measures with covariance R[env, k, a]; the cost of a step is sum_i weights[i] P_ii.
    """

    covariance: Array  # (env, n, n) P0, positive definite
    F: Array  # (n, n)
    Q: Array  # (n, n)
    M: Array  # (m, n) measurement matrix
    R: Array  # (env, H, A, m, m) measurement covariances at steps 1 ... H, in the order of ``candidates``
    weights: Array  # (n,)


class Shortcut(Generic[P, R]):
    """One kind of shortcut.

    Attributes:
        name: its name, that of the function which declares it.
        replaces: names of the functions of the contract, or other shortcuts, whose results it must reproduce.
        generic: the implementation for systems that do not have it, or None.
    """

    def __init__(self, declared: Callable[P, R], replaces: tuple[str, ...], has_generic: bool) -> None:
        update_wrapper(self, declared)
        self.name, self.replaces = declared.__name__, replaces
        self.generic = declared if has_generic else None
        self.registered: dict[type, Callable[..., R] | None] = {}
        self._found: dict[type, tuple[Callable[..., R] | None, str]] = {}
        known = KINDS.setdefault(self.name, self)
        if known.__module__ != self.__module__:
            taken = f"shortcut {self.name} of {self.__module__} is declared in {known.__module__}"
            raise InputError(f"{taken} already, expected another name")
        KINDS[self.name] = self  # a module may be loaded again

    def __reduce__(self) -> str:
        """A pickle holds the name, as for a function."""
        return self.name

    def register(self, cls: type) -> Callable[[Function], Function]:
        """A decorator of the implementation for systems of this class and of its subclasses.

        Raises:
            InputError: no class, or one without a function that the shortcut replaces.
        """
        if not isinstance(cls, type):
            raise InputError(f"{self.name} was registered for {cls!r:.40}, expected a class of systems")
        for name in self.replaces:
            if name not in KINDS and not hasattr(cls, name) and name not in getattr(cls, "__dataclass_fields__", ()):
                wanted = f"a function of {cls.__name__}{nearest(name, dir(cls))}"
                raise InputError(f"{self.name} replaces {name!r}, expected {wanted}")

        def registered(function: Function) -> Function:
            self._put(cls, function)
            return function

        return registered

    def withdraw(self, cls: type) -> None:
        """Systems of this class do not have the shortcut, even if their base class has it."""
        self._put(cls, None)

    def _put(self, cls: type, function: Callable[..., R] | None) -> None:
        self.registered[cls] = function
        for kind in KINDS.values():  # one shortcut may replace another
            kind._found.clear()

    def of(self, system: object) -> Callable[..., R] | None:
        """The function of the arguments after ``system``; None where the system does not have it."""
        function, _ = self._find(type(system))
        return None if function is None else partial(function, system)

    def why_not(self, system: object) -> str:
        """Why the system does not have it, for an error; "" where it does."""
        return self._find(type(system))[1]

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """The result for the system ``args[0]``. Raises an InputError where there is none, and no generic way."""
        function, why = self._find(type(args[0]))
        function = function or self.generic
        if function is None:
            raise InputError(f"{self.name} cannot be computed for {type(args[0]).__name__}: {why}")
        return function(*args, **kwargs)

    def _find(self, cls: type) -> tuple[Callable[..., R] | None, str]:
        """The function for a class, and why there is none."""
        found = self._found.get(cls)
        if found is None:
            found = self._found[cls] = self._searched(cls)
        return found

    def _searched(self, cls: type) -> tuple[Callable[..., R] | None, str]:
        level = next((i for i, base in enumerate(cls.__mro__) if base in self.registered), None)
        if level is None:
            own = getattr(cls, self.name, None)
            if callable(own) or isinstance(own, (property, cached_property)):
                wanted = f"expected @{self.name}.register({cls.__name__})"
                return None, f"it has {self.name} but does not register it, {wanted}"
            return None, f"it has no {self.name}"
        base = cls.__mro__[level]
        function = self.registered[base]
        if function is None:
            return None, f"it withdraws {self.name}"
        for generic in self.replaces:
            if any(_defines(below, generic) for below in cls.__mro__[:level]):
                known = f"{self.name} is registered for {base.__name__}, which knows nothing of it"
                return None, f"it overrides {generic}, but {known}"
        return function, ""


def _defines(cls: type, name: str) -> bool:
    """Whether a class itself defines ``name``, as an attribute, a field or a shortcut."""
    kind = KINDS.get(name)
    own = name in vars(cls) or name in vars(cls).get("__annotations__", {})
    return own or (kind is not None and cls in kind.registered)


def shortcut(*replaces: str, generic: bool = False) -> Callable[[Callable[P, R]], Shortcut[P, R]]:
    """A decorator of the function that declares a kind; it only needs a signature and a docstring.

    Args:
        replaces: names of the functions of the contract whose results it replaces.
        generic: whether the function itself is the implementation for all other systems.

    Raises:
        InputError: something else than names, as ``@shortcut`` without parentheses gives.
    """
    if not all(isinstance(name, str) for name in replaces):
        raise InputError(
            f"shortcut replaces {replaces!r:.40}, expected names of functions: @shortcut('predict', 'cost')"
        )
    return lambda declared: Shortcut(declared, replaces, generic)


def why_not(system: object, kind: Shortcut[..., Any] | type) -> str:
    """Why a system does not have a shortcut or a trait, for an error; "" where it does."""
    return kind.why_not(system) if isinstance(kind, Shortcut) else lacks_trait(system, kind)


# --- the kinds of the suite ---


@shortcut("move", "measure", "track", "annotate")
def fused_transition(system: Any, state: Any, action: Array, world: Any) -> Any:
    """A whole step in compiled form: the state after ``move``, ``measure``, ``track`` and ``annotate``."""


@shortcut("predict", "cost", "candidates")
def best_action(system: Any, belief: Any) -> Array:  # type: ignore[empty-body]
    """The one-step choice of least cost, or nearly so, found faster than by trying all candidates.

    Actions (env, ...). Raises NotImplementedError for a form of the action set that it is not for.
    """


@shortcut("predict", "cost", "candidates", "terminal")
def best_sequence(system: Any, belief: Any, depth: int) -> tuple[Array, Array]:  # type: ignore[empty-body]
    """The best sequence of candidates: an exhaustive lookahead in compiled form.

    Index of the first candidate (env,), and summed cost of the sequence (env,).
    """


@shortcut("predict", "cost", "terminal")
def plan(system: Any, belief: Any, depth: int) -> tuple[Array, Array]:  # type: ignore[empty-body]
    """A good sequence of any length, found by a local search.

    First actions (env, ...), and the predicted summed cost of the sequence (env,).
    """


@shortcut("transition", "fused_transition", "move", "measure", "track", "cost", "candidates")
def deterministic_recursion(system: Any, world: Any) -> Recursion:  # type: ignore[empty-body]
    """The recursion of whole episodes, axis 0 = world, of a covariance that depends on the actions alone.

    Finite-horizon optima can be computed from it. Raises NotImplementedError if the parameters make the covariance
    depend on more than the actions.
    """


@shortcut("cost")
def linear_cost(system: Any) -> LinearCost:  # type: ignore[empty-body]
    """Transition matrix and weights where the cost is trace(Lambda P) summed over targets of linear motion."""


@shortcut("predict", "cost")
def gain(system: Any, belief: Any, wait: Array | int, ahead: Any) -> Array:  # type: ignore[empty-body]
    """The reduction by a candidate's pulse of the summed cost over ``ahead`` steps from the pulse on, (env, candidate).

    Args:
        system: the closed loop.
        belief: axis 0 = environment.
        wait: steps until the pulse is sent, with all set-up complete: a number, or (env, candidate).
        ahead: steps over which the cost is summed, the one of the pulse included.
    """


@shortcut("predict", "cost")
def gain_by_target(system: Any, belief: Any, wait: Array | int, ahead: Array) -> Array:  # type: ignore[empty-body]
    """``gain`` with a number of steps ``ahead`` for every target, (env, target)."""


@shortcut("predict", generic=True)
def delay(system: Any, belief: Any) -> Array:
    """Steps until each candidate's pulse can be sent, (env, candidate) int; by default 0."""
    return np.zeros((len(belief.step), len(system.actions.labels)), np.int64)


@shortcut()
def spending(system: Any) -> Array:  # type: ignore[empty-body]
    """The spending of each candidate from the account in the belief's field ``energy`` (env,), (candidate,)."""


@shortcut("predict", "cost")
def gain_per_second(system: Any, belief: Any, *args: Any) -> Array:  # type: ignore[empty-body]
    """The reduction of the later cost by each candidate's step, per second of its duration, (env, candidate).

    The one-step scheduler takes the candidate with the greatest gain, because costs of steps of different lengths are
    not comparable. With ``TrackSlots`` there are two more arguments. A find is worth ``worth`` times its value, in
    seconds of its full cost, to the power ``power``. Several powers make a last axis.
    """


@shortcut("predict", "cost")
def cost_to_come(system: Any, belief: Any, seconds: float) -> Array:  # type: ignore[empty-body]
    """Cost of the tracks in the coming ``seconds`` if the beam rested, and that of targets to be found, (env,).

    For ``TrackSlots``.
    """


@shortcut("predict", "cost")
def scores(system: Any, belief: Any, rule: DwellRule) -> Array:  # type: ignore[empty-body]
    """The score of every candidate by a ``DwellRule``, (env, candidate), in compiled form."""


@shortcut("predict", "cost")
def simulate(  # type: ignore[empty-body]
    system: Any, belief: Any, actions: Array, rule: DwellRule, seconds: float, futures: int
) -> Array:
    """Expected cost of the next ``seconds`` that begin with a candidate, and of the time after, (env, candidate).

    Args:
        system: the closed loop.
        belief: axis 0 = environment.
        actions: the candidates, (env, candidate).
        rule: chooses the later dwells of the futures.
        seconds: length of the futures.
        futures: number of futures; all candidates have the same draws, which differ between steps.
    """


@shortcut("information")
def most_information(  # type: ignore[empty-body]
    system: Any, belief: Any, threshold: float | None = None
) -> tuple[Array, Array]:
    """Actions of the most information that reach the threshold for every target, and whether there are any, (env,).

    The system has the attribute ``threshold``, taken for None, and the function ``information(belief, actions)``: the
    weighted information of each target, (env[, candidate], target); the threshold for one that is absent.
    """


@shortcut("predict")
def innovation_covariance(system: Any, belief: Any, actions: Array) -> Array:  # type: ignore[empty-body]
    """S one step ahead, (env, candidate, m, m); its determinant is the squared volume of the gate."""


@shortcut("predict", "cost")
def next_pulse(system: Any, belief: Any) -> tuple[Array, Array]:  # type: ignore[empty-body]
    """Predicted covariance (env, n, n) and eta (env,) at the next pulse, in Kershaw and Evans's loop.

    The system has the attributes ``weights``, ``carrier_hz`` and ``eclipsing``.
    """


class SensorBySensor(NamedTuple):
    """The predicted cost of any chirps, one sensor after another.

    Attributes:
        begin: from a belief to the targets at the time of the next pulse, before any sensor measures.
        costs: from these targets, a sensor, C (env or 1, candidate, 2, 2) at unit SNR, receive windows (env or 1,
            candidate, 11) and rows of thresholds (candidate,), as ``action_set`` gives them, to trace(Lambda P) after
            its pulse, (env, candidate).
        after: from these targets, a sensor, C (env, 2, 2), window (env, 11) and row of the threshold (env,), to the
            targets after this sensor's pulse.
    """

    begin: Callable[[Any], Any]
    costs: Callable[[Any, int, Array, Array, Array], Array]
    after: Callable[[Any, int, Array, Array, Array], Any]


@shortcut("predict", "cost")
def sensor_by_sensor(system: Any) -> SensorBySensor:  # type: ignore[empty-body]
    """The predicted cost of any chirps, one sensor after another.

    The system has the attribute ``action_set``, as ``wavegym.systems.agile_clutter.actions.ChirpActions``.
    """


def _no_settings(belief: Any) -> Array:
    return np.zeros((len(belief.step), 0))


class MeasuredFields(NamedTuple):
    """Measurements of a step as an observation that holds nothing of the belief.

    Attributes:
        fields: the ``ObservationField`` of each column of ``values``.
        values: from the result of ``measure`` to (env, fields); a field that was not received has its centre.
        setting_fields: the ``ObservationField`` of each column of ``settings``.
        settings: from the belief to the sensors' settings, which need no tracker, (env, fields).
    """

    fields: tuple[Any, ...]
    values: Callable[[Any], Array]
    setting_fields: tuple[Any, ...] = ()
    settings: Callable[[Any], Array] = _no_settings


@shortcut("measure")
def measured_fields(system: Any) -> MeasuredFields:  # type: ignore[empty-body]
    """Measurements of a step as an observation that holds nothing of the belief."""


@shortcut("candidates", generic=True)
def constants(system: Any) -> Array:
    """The actions that open-loop schedules (fixed:K, best-fixed, round-robin) choose among, (C, ...).

    By default ``candidates()``. A shorter list shortens the search for the best constant. With a ``mask``, at least one
    constant must always be allowed.
    """
    every: Array = system.candidates()
    return every


@shortcut(generic=True)
def named_constants(system: Any) -> dict[str, Array]:
    """Named constant actions, such as a paper's own setting; ``fixed:NAME`` transmits one. By default none.

    They need not be among ``constants``. A name has no comma, which separates policies, and is not an integer, which
    is an index in ``fixed:K``.
    """
    return {}


@shortcut(generic=True)
def baselines(system: Any) -> dict[str, tuple[str, dict[str, Any]]]:
    """Named baselines: a scheduler, and the parameters in which its loop differs from this system. By default none.

    A comparison plays them on the same worlds: a paper's baseline with a simpler tracker, for example.
    """
    return {}


@shortcut("candidates")
def target_of_action(system: Any) -> Array:  # type: ignore[empty-body]
    """The target of each beam of each candidate, (candidate, beam) int, where candidates select targets."""


class SensedBand(NamedTuple):
    """A spectrum of channels that other users share: what the radar heard there, and its bands.

    Attributes:
        held: whether each candidate, a band, holds each channel, (candidate, channel) bool.
        busy: noise from which a channel counts as occupied.
        noise: from a belief and a number of steps to the noise in each channel in the last steps, the latest first,
            (env, step, channel); NaN before the first step that was heard.
        last: from a belief to the band of the last step, (env,) int, or -1.
        cost: from a belief and the probability that each channel is occupied, (env, channel), to the expected cost of
            each candidate, (env, candidate).
    """

    held: Array
    busy: float
    noise: Callable[[Any, int], Array]
    last: Callable[[Any], Array]
    cost: Callable[[Any, Array], Array]


@shortcut("predict", "cost", "candidates")
def sensed_band(system: Any) -> SensedBand:  # type: ignore[empty-body]
    """A spectrum of channels that other users share: what the radar heard there, and its bands."""
