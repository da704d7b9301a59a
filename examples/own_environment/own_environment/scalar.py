"""A system of one's own in plain NumPy: a random walk, watched with dwells of different length and price."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wavegym.core.system import Element, State, System


class World(NamedTuple):
    """All draws of an episode."""

    normal: np.ndarray  # (H + 1, 2)


class Hidden(NamedTuple):
    """The true position."""

    truth: np.ndarray  # (env,)


class Public(NamedTuple):
    """The belief, and the price paid for the last dwell."""

    step: np.ndarray  # (env,)
    mean: np.ndarray  # (env,)
    variance: np.ndarray  # (env,)
    price: np.ndarray  # (env,)


class Dwells(NamedTuple):
    """The action set: anything with labels."""

    labels: tuple[str, ...]


@dataclass(frozen=True)
class ScalarDwell(System):
    """A random walk of variance q a step; dwell i measures with variance r[i] and costs price[i].

    Description
        x_{k+1} = x_k + w, z = x + v. A long dwell measures well and costs more.

    Rewards
        -(variance + price of the dwell).
    """

    horizon: int = 20
    dt: float = 1.0
    q: float = 1.0
    r: tuple[float, ...] = (4.0, 1.0, 0.25)
    price: tuple[float, ...] = (0.0, 0.1, 0.5)

    @property
    def actions(self) -> Dwells:
        """Short to long."""
        return Dwells(tuple(f"dwell {r:g}" for r in self.r))

    @property
    def elements(self) -> tuple[Element, ...]:
        """Variance and time left."""
        return (
            Element("variance", "m^2", 1.0, 1.0, "variance of the position"),
            Element("time_left", "1", 0.5, 0.3, "fraction of the horizon still to come"),
        )

    def draw_world(self, rng: np.random.Generator) -> World:
        """Row 0: the start; row k: the walk and the measurement error of step k."""
        return World(rng.standard_normal((self.horizon + 1, 2)))

    def begin(self, world: World) -> State:
        """Known to within one metre."""
        first, zero = world.normal[:, 0], np.zeros(len(world.normal))
        return State(Hidden(first[:, 0].copy()), Public(zero.astype(np.int64), zero.copy(), zero + 1.0, zero.copy()))

    def advance(self, state: State, action: np.ndarray, world: World) -> State:
        """Walk, measure, filter."""
        public = state.public
        draws = world.normal[np.arange(len(action)), public.step + 1]
        truth = state.hidden.truth + np.sqrt(self.q) * draws[:, 0]
        after = self.imagine(public, action)
        gain = after.variance / np.take(self.r, action)
        measured = truth + np.sqrt(np.take(self.r, action)) * draws[:, 1]
        return State(Hidden(truth), after._replace(mean=public.mean + gain * (measured - public.mean)))

    def imagine(self, public: Public, actions: np.ndarray, outcome: None = None) -> Public:
        """One Kalman step; with candidates, every array gains their axis."""
        belief = public if actions.ndim == 1 else Public(*(a[:, None] for a in public))
        r, price = np.take(self.r, actions), np.take(self.price, actions)
        predicted = belief.variance + self.q
        variance = predicted * r / (predicted + r)
        step, mean = (np.broadcast_to(a, variance.shape) for a in (belief.step + 1, belief.mean))
        return Public(step, mean, variance, np.broadcast_to(price, variance.shape))

    def cost(self, public: Public) -> np.ndarray:
        """Variance and price."""
        return public.variance + public.price

    def observe(self, public: Public) -> np.ndarray:
        """See ``elements``."""
        return np.stack([public.variance, 1.0 - public.step / self.horizon], axis=1)

    def metrics(self, state: State) -> dict[str, np.ndarray]:
        """The absolute error in metres."""
        return {"position_error": np.abs(state.public.mean - state.hidden.truth)}
