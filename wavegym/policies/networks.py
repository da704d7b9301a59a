"""Trained networks in plain NumPy: a decision takes some ten microseconds and needs no torch.

A network has a kind, float32 arrays, and the range of the observations in training. Outside this range the behaviour of
the policy is unknown. ``learning.export`` converts Stable-Baselines3's policies.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.files import pack_arrays, unpack_arrays
from wavegym.core.system import System
from wavegym.observations.forecasts import PRESENT
from wavegym.observations.observer import Observer

MARGIN = 0.1  # of the range, on both sides: the extremes of a few episodes are not those of all
RANGE_KEY = "observed"  # in run.json
DIGITS = 4  # of an observation, which is within +-10
KINDS, ACTIVATIONS = ("mlp", "mixture", "scorer"), ("tanh", "relu")
LIMIT = 1 << 26  # bytes of all arrays of a network
WIDEST = 8192  # of an axis: a decision then needs less than 1 GB


class TrainingRange(NamedTuple):
    """Least and greatest values of the elements of a network's observation.

    The forecasts of all candidates have one range, because a policy scores candidates alike.

    Attributes:
        own: number of elements before the forecasts.
        low: of these elements and of the forecasts of one candidate, (element,).
        high: the same.
    """

    own: int
    low: Array
    high: Array

    @classmethod
    def of(cls, observation: Array, own: int, forecasts: int) -> TrainingRange:
        """The range of observations (env, element), with this number of forecasts of each candidate."""
        low, high = _extremes(observation, own, own + forecasts)
        return cls(own, low.min(axis=0), high.max(axis=0))

    @classmethod
    def from_record(cls, found: Mapping[str, Any]) -> TrainingRange:
        """The range of ``record``. Raises KeyError, TypeError or ValueError for anything else."""
        return cls(int(found["own"]), np.array(found["low"], np.float64), np.array(found["high"], np.float64))

    def record(self) -> dict[str, Any]:
        """The range as JSON, rounded."""
        low, high = (np.round(values.astype(np.float64), DIGITS).tolist() for values in (self.low, self.high))
        return {"own": self.own, "low": low, "high": high}

    def joined(self, other: TrainingRange) -> TrainingRange:
        """The range of both."""
        return self._replace(low=np.minimum(self.low, other.low), high=np.maximum(self.high, other.high))

    def is_left(self, observation: Array) -> Array:
        """Whether an element is farther outside than ``MARGIN``, (env,) bool, of observations (env, element)."""
        low, high = _extremes(observation, self.own, len(self.low))
        margin = MARGIN * (self.high - self.low) + 10.0**-DIGITS
        return np.asarray(((low < self.low - margin) | (high > self.high + margin)).any(axis=1))


def _extremes(observation: Array, own: int, elements: int) -> tuple[Array, Array]:
    """Least and greatest values, (env, element) each: of the forecasts, over the candidates."""
    if elements == own:
        return observation, observation
    forecasts = observation[:, own:].reshape(len(observation), -1, elements - own)
    low, high = forecasts.min(axis=1), forecasts.max(axis=1)
    if not own:
        return low, high
    return np.concatenate([observation[:, :own], low], axis=1), np.concatenate([observation[:, :own], high], axis=1)


class Network(NamedTuple):
    """The content of a policy file.

    Attributes:
        kind: "mlp", "mixture" (also an MLP) or "scorer".
        activation: "tanh" or "relu".
        heads: number of alternatives of each choice: one entry, or one for each sensor; empty for a point of a box;
            for a mixture, one entry: its number of modes. A scorer of candidates that are alike scores any number.
        arrays: of an MLP W0 (out, in), b0, W1, ...; of a scorer those of its context, then ``shared``, ``own``,
            ``pairs``, ``offset``, ``round0``, ``round0_others``, ... and ``score`` as in ``learning.scorer``.
            A scorer of candidates that are alike has ``own`` and ``own_bias`` in place of all before ``round0``, and
            its observation is the forecasts alone.
    """

    kind: str
    activation: str
    heads: tuple[int, ...]
    arrays: dict[str, Array]

    @property
    def is_alike(self) -> bool:
        """Whether this is a scorer of candidates that differ in their forecasts only."""
        return "own_bias" in self.arrays

    @property
    def inputs(self) -> int:
        """Number of elements of an observation, forecasts included; of candidates that are alike, of one of them."""
        given = self.arrays
        if self.is_alike:
            return int(given["own"].shape[1])
        if self.kind != "scorer" or "own" not in given:
            return int(given["W0"].shape[1])
        candidates, pairs = given["pairs"].shape
        return int(given["W0"].shape[1] + candidates * (given["own"].shape[1] - pairs))

    def outputs(self, observation: Array) -> Array:
        """Logits, values or means (env, outputs) of observations (env, elements) float32.

        Outputs of a mixture are the logits of its modes, then the mean of each mode.
        """
        activate = np.tanh if self.activation == "tanh" else _relu
        return (self._scores if self.kind == "scorer" else self._mlp)(observation, activate)

    def _mlp(self, hidden: Array, activate: Any) -> Array:
        given = list(self.arrays.values())  # W0, b0, W1, ...
        for weight, offset in zip(given[:-2:2], given[1:-2:2], strict=True):
            hidden = hidden @ weight.T  # a new array: the lines below may overwrite it
            hidden += offset
            activate(hidden, out=hidden)
        return np.asarray(hidden @ given[-2].T + given[-1])

    def _scores(self, observation: Array, activate: Any) -> Array:
        given = self.arrays
        hidden = activate(self._alike(observation) if self.is_alike else self._in_context(observation, activate))
        present = self._present(observation) if self.is_alike else None
        for n in range(self.number_of("round") // 3):
            others = (_pooled(hidden, present) @ given[f"round{n}_others"].T)[:, None]
            exchanged = activate(hidden @ given[f"round{n}"].T + given[f"round{n}_bias"] + others)
            hidden = hidden + exchanged if exchanged.shape == hidden.shape else exchanged
        return (hidden @ given["score"].T)[..., 0]

    def _alike(self, observation: Array) -> Array:
        """The first layer of candidates that are alike, (env, candidate, width)."""
        figures = observation.reshape(len(observation), -1, self.inputs)
        return np.asarray(figures @ self.arrays["own"].T + self.arrays["own_bias"])

    def _present(self, observation: Array) -> Array:
        """1 or 0 for each candidate: whether it is one, no free slot, (env, candidate, 1)."""
        figures = observation.reshape(len(observation), -1, self.inputs)
        return np.asarray(figures[..., PRESENT].sum(axis=2, keepdims=True))

    def _in_context(self, observation: Array, activate: Any) -> Array:
        """The first layer of candidates with a context, (env, candidate, width)."""
        given, layers = self.arrays, self.number_of("W")
        elements, (candidates, _) = given["W0"].shape[1], given["offset"].shape
        context = observation[:, :elements]
        for n in range(layers):
            context = activate(context @ given[f"W{n}"].T + given[f"b{n}"])
        hidden = (context @ given["shared"].T + given["shared_bias"])[:, None] + given["offset"]
        if "own" in given:
            predicted = observation[:, elements:].reshape(
                len(observation), candidates, (observation.shape[1] - elements) // candidates
            )
            hidden = hidden + np.concatenate([predicted, observation[:, given["pairs"]]], axis=2) @ given["own"].T
        return np.asarray(hidden)

    def number_of(self, start: str) -> int:
        """Number of arrays whose names begin with ``start``."""
        return sum(name.startswith(start) for name in self.arrays)

    def to_bytes(self) -> bytes:
        """An .npz file; equal networks give equal bytes."""
        about = {"kind": self.kind, "activation": self.activation, "heads": np.array(self.heads, np.int64)}
        return pack_arrays({**{f"_{key}": np.asarray(value) for key, value in about.items()}, **self.arrays})

    @classmethod
    def from_bytes(cls, content: bytes) -> Network:
        """The network in such a file; runs no code from it.

        Raises:
            ValueError: any other file, arrays that do not fit together, weights that are not finite.
        """
        arrays = unpack_arrays(content, LIMIT)
        try:
            kind, activation, heads = (arrays.pop(f"_{name}") for name in ("kind", "activation", "heads"))
            network = cls(str(kind), str(activation), tuple(heads.tolist()), arrays)
            network._try_out()
        except (KeyError, IndexError, TypeError, AttributeError, ZeroDivisionError) as error:
            raise ValueError(f"its arrays make no network: {type(error).__name__}: {error}") from None
        return network

    def _try_out(self) -> None:
        """Raise an error where the arrays do not fit together or are not finite."""
        for entry, value, known in (("kind", self.kind, KINDS), ("activation", self.activation, ACTIVATIONS)):
            if value not in known:
                raise ValueError(f"its {entry} is {value!r}, expected one of {', '.join(known)}")
        for name, array in self.arrays.items():
            if name != "pairs" and (array.dtype != np.float32 or not np.isfinite(array).all()):
                raise ValueError(f"its weights {name} are not finite 32-bit numbers")
            if max(array.shape, default=0) > WIDEST:
                raise ValueError(
                    f"its array {name} has the shape {array.shape}, expected at most {WIDEST} on each axis"
                )
        scores = self.outputs(np.ones((1, self.inputs), np.float32))
        if not np.isfinite(scores).all():
            raise ValueError("its outputs for an observation of ones are not finite")
        count = scores.shape[1]
        if self.kind == "mixture" and (len(self.heads) != 1 or count % self.heads[0] or count <= self.heads[0]):
            raise ValueError(f"it has {count} outputs, expected those of {self.heads} modes")
        if self.kind != "mixture" and self.heads and not self.is_alike and sum(self.heads) != count:
            raise ValueError(f"it has {count} outputs, expected {sum(self.heads)}")


def _pooled(hidden: Array, present: Array | None) -> Array:
    """See ``learning.scorer.pooled``."""
    if present is None:
        return np.concatenate([hidden.mean(axis=1), hidden.max(axis=1)], axis=1)
    weights = present / present.sum(axis=1, keepdims=True)
    mean = (weights.transpose(0, 2, 1) @ hidden)[:, 0]
    return np.concatenate([mean, np.where(present > 0.0, hidden, -np.inf).max(axis=1)], axis=1)


def _likeliest(outputs: Array, modes: int) -> Array:
    """The mean (env, parameter) of the likeliest mode of a mixture, from its outputs."""
    points = outputs[:, modes:].reshape(len(outputs), modes, -1)
    return points[np.arange(len(outputs)), outputs[:, :modes].argmax(axis=1)]


def _relu(values: Array, out: Array | None = None) -> Array:
    return np.maximum(values, 0.0, out=out)


class LearnedPolicy:
    """A trained network as a deterministic policy for a batch of environments.

    Args:
        network: the trained network.
        forecasts: whether its observation holds forecasts of each candidate after the system's own elements.
        candidates: length of the short list from which it chooses; None: from all actions.
        training_range: of what it observed in its training; None: not known.

    Attributes:
        shown: what the network was given for its last decision, (env, element).
    """

    def __init__(
        self,
        network: Network,
        forecasts: bool = False,
        candidates: int | None = None,
        training_range: TrainingRange | None = None,
    ) -> None:
        self.network, self.forecasts, self.candidates = network, forecasts, candidates
        self.training_range = training_range
        self.shown: Array | None = None
        self._observer: Observer | None = None
        self._own = 0

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        self._observer = Observer(system, self.forecasts, self.candidates)
        self._own = len(system.observation_fields)
        self.shown = None

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``: the allowed action of highest logit or value.

        An observation that the network was not made for, as one without forecasts, is computed anew from ``belief``.
        """
        if observation is None:
            raise InputError("a learned policy was given no observation, expected the environment's")
        shortlist = self._observer.shortlist if self._observer else None
        if shortlist is None:
            return self._chosen(belief, observation, mask)
        return shortlist.taken(belief, self._chosen(belief, observation, shortlist(belief).allowed))

    def _chosen(self, belief: Any, observation: Array, mask: Array | None) -> Array:
        """The actions, or ranks in the short list."""
        if self._observer and observation.shape[1] != len(self._observer.observation_fields):
            observation, _ = self._observer(belief)
        if self.network.is_alike:
            observation = observation[:, self._own :]
        self.shown = observation
        outputs, heads = self.network.outputs(observation), self.network.heads
        if self.network.kind == "mixture":
            outputs, heads = _likeliest(outputs, *heads), ()
        if not heads:
            return np.maximum(np.minimum(outputs, 1.0), -1.0)  # np.clip takes four times longer
        if mask is not None:
            outputs = np.where(mask, outputs, -np.inf)
        if len(heads) == 1:
            return outputs.argmax(axis=1)
        edges = np.cumsum(heads)[:-1]
        return np.stack([part.argmax(axis=1) for part in np.split(outputs, edges, axis=1)], axis=1)

    def is_outside_training(self) -> Array | None:
        """See ``Trained``."""
        if self.training_range is None or self.shown is None:
            return None
        return self.training_range.is_left(self.shown)
