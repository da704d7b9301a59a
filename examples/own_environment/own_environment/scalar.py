"""Your own system in plain NumPy: a random walk, observed with dwells of different length and price."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wavegym.core.system import ObservationField, State, System


class World(NamedTuple):
    """All draws of an episode."""

    normal: np.ndarray  # (H + 1, 2)


class Truth(NamedTuple):
    """The true position."""

    targets: np.ndarray  # (env,)


class Belief(NamedTuple):
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
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """Variance and time left."""
        return (
            ObservationField("variance", "m^2", 1.0, 1.0, "variance of the position"),
            ObservationField("time_left", "1", 0.5, 0.3, "fraction of the horizon still to come"),
        )

    def draw_world(self, rng: np.random.Generator) -> World:
        """Row 0: the start; row k: the walk and the measurement error of step k."""
        return World(rng.standard_normal((self.horizon + 1, 2)))

    def initial(self, world: World) -> State:
        """Known to within one metre."""
        first, zero = world.normal[:, 0], np.zeros(len(world.normal))
        return State(Truth(first[:, 0].copy()), Belief(zero.astype(np.int64), zero.copy(), zero + 1.0, zero.copy()))

    def transition(self, state: State, action: np.ndarray, world: World) -> State:
        """Walk, measure, filter."""
        belief = state.belief
        draws = world.normal[np.arange(len(action)), belief.step + 1]
        truth = state.truth.targets + np.sqrt(self.q) * draws[:, 0]
        after = self.predict(belief, action)
        gain = after.variance / np.take(self.r, action)
        measured = truth + np.sqrt(np.take(self.r, action)) * draws[:, 1]
        return State(Truth(truth), after._replace(mean=belief.mean + gain * (measured - belief.mean)))

    def predict(self, belief: Belief, actions: np.ndarray, outcome: None = None) -> Belief:
        """One Kalman step; with candidates, every array gains their axis."""
        belief = belief if actions.ndim == 1 else Belief(*(a[:, None] for a in belief))
        r, price = np.take(self.r, actions), np.take(self.price, actions)
        predicted = belief.variance + self.q
        variance = predicted * r / (predicted + r)
        step, mean = (np.broadcast_to(a, variance.shape) for a in (belief.step + 1, belief.mean))
        return Belief(step, mean, variance, np.broadcast_to(price, variance.shape))

    def cost(self, belief: Belief) -> np.ndarray:
        """Variance and price."""
        return belief.variance + belief.price

    def observe(self, belief: Belief) -> np.ndarray:
        """See ``observation_fields``."""
        return np.stack([belief.variance, 1.0 - belief.step / self.horizon], axis=1)

    def state_info(self, state: State) -> dict[str, np.ndarray]:
        """The absolute error in metres."""
        return {"position_error": np.abs(state.belief.mean - state.truth.targets)}
