"""Named forecasts of each candidate, and their products with resources: the features of a searched rule."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core import shortcuts
from wavegym.core.action_sets import ParameterBox, PerSensorLibrary
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.horizon_weights import horizon_weights
from wavegym.core.system import System
from wavegym.observations.forecasts import FLOOR, LOOKS, MOST
from wavegym.schedulers.heuristics.index_policies import weighted
from wavegym.schedulers.heuristics.price_policies import clear_slots_left, gain_until_clear, hidden_steps

SPANS = (4, 8, 16, 40)  # steps over which gains in units of the cost are summed
HOLDS = (2, 6)  # steps over which a gain is summed where its target stays in sight; the hidden steps follow
LATER = (2, 4, 8, 16)  # steps of prediction without a measurement, where the system has no gain
CUSHION = 1.0  # longest pulses: keeps scarcity finite when the account is empty
RESOURCES = ("time_left", "energy_left", "energy_rate", "occluded", "visible_ahead", "change_1")  # observation fields
RATIO, PRICE = "ratio", "price"  # forms of rules: logarithms of gains; gains minus the price of the spending


class RuleFeatures:
    """The features of one system's candidates. A product of a forecast and a resource is called FORECAST*RESOURCE.

    Forecasts:
        ``ln_cost_ahead``: expected cost one step ahead over the candidates' mean; ``ln_cost_L``: the same of L steps
        without another measurement (systems with linear motion and no gain). ``log10_gain_W_S``: gain of the pulse sent
        W steps late, over S steps and the mean cost. ``gain_S``: gain over S steps, in units of the cost.
        ``log10_hold_S``, ``hold_S``: the same over S steps and the hidden steps that follow. ``ln_delay``; ``ready``:
        no delay; ``spending``.
    Resources:
        ``scarcity``: (steps left + 1) / (energy + 1), and its square; ``clear_slots``: the same of the clear slots
        left; ``cost``: the mean cost ahead; and the system's observation fields among ``RESOURCES``.

    Args:
        system: the closed loop.

    Attributes:
        forms: the names of the features of each form of rule.
        names: those of all forms, in order.

    Raises:
        InputError: the action set is not one index for at most ``MOST`` candidates.
    """

    def __init__(self, system: System) -> None:
        if isinstance(system.actions, (ParameterBox, PerSensorLibrary)) or len(system.candidates()) > MOST:
            wanted = f"one index for at most {MOST} actions (nearest: 'myopic')"
            raise InputError(f"searched-rule cannot score the actions of {type(system).__name__}, expected {wanted}")
        self.system: Any = system
        self.candidates = system.candidates()
        self._gain, self._spending = shortcuts.gain.of(system), shortcuts.spending.of(system)
        self._by_target, self._linear = shortcuts.gain_by_target.of(system), shortcuts.linear_cost.of(system)
        self._fields = {field.name: n for n, field in enumerate(system.observation_fields)}
        self._weights: dict[int, Array] = {}
        self.forms = {RATIO: self._ratio()}
        if self._spending and self._gain:
            self.forms[PRICE] = self._price()
        self.names = tuple(dict.fromkeys(name for names in self.forms.values() for name in names))

    def _holds(self) -> bool:
        """Whether the belief has the times at which targets are hidden: ``visible``, (env, H[, target])."""
        fields = getattr(self.system, "observation_fields", ())
        is_known = any(field.name == "visible_ahead" for field in fields)
        return bool(self._by_target or (is_known and self._gain))

    def _ratio(self) -> tuple[str, ...]:
        names = ["ln_cost_ahead"]
        if not self._gain:
            if self._linear:
                names += [f"ln_cost_{steps}" for steps in LATER]
                names += ["ln_cost_ahead*time_left", f"ln_cost_{LATER[1]}*time_left"]
            return tuple(names)
        names += [f"log10_gain_{wait}_{steps}" for wait, steps in LOOKS]
        if self._holds():
            names += [f"log10_hold_{steps}" for steps in HOLDS]
        return (*names, "ln_delay", "ready", "ln_delay*time_left", "log10_gain_0_40*time_left")

    def _price(self) -> tuple[str, ...]:
        names = [f"gain_{steps}" for steps in SPANS]
        priced = ["scarcity", "scarcity2", "cost"]
        if self._holds():
            names += [f"hold_{steps}" for steps in HOLDS]
            priced += ["clear_slots", "clear_slots2"]
        priced += [name for name in RESOURCES if name in self._fields or name == "time_left"]
        return (*names, "spending", *(f"spending*{name}" for name in priced))

    def __call__(self, belief: Any, names: tuple[str, ...]) -> Array:
        """The features ``names`` of every candidate, (env, candidate, feature); ``belief`` as policies take it."""
        made: dict[str, Array] = {}
        shape = len(belief.step), len(self.candidates)
        out = np.empty((*shape, len(names)))
        for n, name in enumerate(names):
            forecast, _, resource = name.partition("*")
            value = self._forecast(forecast, belief, made)
            if resource:
                value = value * self._resource(resource, belief, made)[:, None]
            out[..., n] = value
        return out

    def _forecast(self, name: str, belief: Any, made: dict[str, Array]) -> Array:
        """One forecast, (env, candidate) or (candidate,)."""
        if name not in made:
            made[name] = self._made(name, belief, made)
        return made[name]

    def _made(self, name: str, belief: Any, made: dict[str, Array]) -> Array:
        kind, _, number = name.rpartition("_")
        if name == "spending":
            return np.asarray(shortcuts.spending(self.system))
        if name in ("ln_delay", "ready"):
            delay = self._delay(belief, made)
            return np.log1p(delay) if name == "ln_delay" else (delay == 0).astype(np.float64)
        if name == "ln_cost_ahead":
            self._mean_cost(belief, made)
            return made[name]
        if kind == "ln_cost":
            self._mean_cost(belief, made)
            return self._without_looks(int(number), made)
        if kind == "hold":
            return self._hold(belief, int(number))
        if kind == "gain":
            return shortcuts.gain(self.system, belief, self._delay(belief, made), int(number))
        return self._share(name, belief, made)

    def _share(self, name: str, belief: Any, made: dict[str, Array]) -> Array:
        """Logarithm of a gain per step and mean cost; a look that may raise the cost counts as no gain."""
        parts = name.removeprefix("log10_").split("_")
        if parts[0] == "hold":
            gain, steps = self._hold(belief, int(parts[1])), int(parts[1])
        else:
            wait, steps = int(parts[1]), int(parts[2])
            gain = shortcuts.gain(self.system, belief, self._delay(belief, made) + wait, steps)
        return np.log10(np.maximum(gain, 0.0) / (self._mean_cost(belief, made)[:, None] * steps) + FLOOR)

    def _hold(self, belief: Any, steps: int) -> Array:
        if self._by_target:
            return self._by_target(belief, 0, steps + hidden_steps(belief))
        return gain_until_clear(self.system, belief, steps + hidden_steps(belief))

    def _delay(self, belief: Any, made: dict[str, Array]) -> Array:
        if "delay" not in made:
            shape = len(belief.step), len(self.candidates)
            made["delay"] = np.broadcast_to(shortcuts.delay(self.system, belief), shape)
        return made["delay"]

    def _mean_cost(self, belief: Any, made: dict[str, Array]) -> Array:
        """Mean over the candidates of the cost one step ahead, (env,); 1 without targets."""
        if "mean" not in made:
            shape = len(belief.step), *self.candidates.shape
            predicted = self.system.predict(belief, np.broadcast_to(self.candidates, shape))
            ahead = self.system.cost(predicted)
            mean = ahead.mean(axis=1)
            made["mean"] = np.where(mean > 0.0, mean, 1.0)
            made["ln_cost_ahead"] = np.log(np.where(mean[:, None] > 0.0, ahead, 1.0) / made["mean"][:, None])
            made["covariance"] = getattr(predicted, "covariance", np.empty(0))
        return made["mean"]

    def _without_looks(self, steps: int, made: dict[str, Array]) -> Array:
        if steps not in self._weights:
            known = shortcuts.linear_cost(self.system)
            self._weights[steps] = horizon_weights(known.F, known.weights, steps)
        cost = weighted(made["covariance"], self._weights[steps])
        return np.log(np.maximum(cost, np.finfo(np.float64).tiny))

    def _resource(self, name: str, belief: Any, made: dict[str, Array]) -> Array:
        """One resource, (env,)."""
        left = np.maximum(self.system.horizon - belief.step, 0)
        if name == "time_left":
            return left / self.system.horizon
        if name == "cost":
            return self._mean_cost(belief, made)
        if name in self._fields:
            if "observed" not in made:
                made["observed"] = self.system.observe(belief)
            return made["observed"][:, self._fields[name]]
        if name.startswith("clear_slots"):
            left = clear_slots_left(belief, self.system.horizon)
        ratio = (left + CUSHION) / (belief.energy + CUSHION)
        return ratio * ratio if name.endswith("2") else ratio
