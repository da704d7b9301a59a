"""Any policy of wavegym as a sensor manager of Stone Soup, which reads the belief from tracks of Stone Soup.

The objective of a wavegym system is a reward for Stone Soup's own managers.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from stonesoup.base import Property
from stonesoup.predictor import Predictor
from stonesoup.sensormanager.base import SensorManager
from stonesoup.sensormanager.reward import RewardFunction, UncertaintyRewardFunction
from stonesoup.updater import Updater

from wavegym.core import trees
from wavegym.core.action_sets import by_sensor
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.core.worlds import word
from wavegym.evaluation.adapters import as_policy
from wavegym.evaluation.play import Task, make_task
from wavegym.integrations.stonesoup.sensor import WaveformRadar, radars_of
from wavegym.observations.observer import Observer
from wavegym.policies.runs import ALGORITHMS, load_pretrained
from wavegym.schedulers.rollout import allowed
from wavegym.systems.composed import PlanarRadar

NEAR = 1e-3  # m, between a radar and the system's
ROUNDING = 1e-6  # of a time step: Stone Soup's times are whole microseconds


class PolicySensorManager(SensorManager):
    """Lets a wavegym policy choose the waveforms of the managed ``WaveformRadar`` objects.

    The tracks become the belief of the system for which the policy was made: a track is one target, its states are in
    the order of the radars' ``mapping``, and a track that was not measured ends in its prediction. The radars must have
    the pulses of the system. Steps count from ``start_time``; after ``horizon`` steps the next episode begins.

    Raises:
        InputError: at the first choice, radars that are not the system's; at every choice, tracks or times that do not
            fit the system.
    """

    env: Any = Property(doc="The id of an environment, such as ``KershawEvansPosition-v0``, or a system")
    policy: Any = Property(
        default="myopic",
        doc="What ``wavegym.evaluation.as_policy`` takes: the name of a scheduler or of a saved agent, a folder, a "
        "Policy, a model or a function",
    )
    parameters: dict[str, Any] = Property(default_factory=dict, doc="Parameters of the environment, with an id")
    start_time: datetime = Property(default=None, doc="Time of step 0; default: of the tracks at the first choice")
    seed: int = Property(default=0, doc="Of a policy that draws numbers")

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        given = self.env
        self._task = Task("", given, None, {}) if isinstance(given, System) else make_task(given, self.parameters)
        self.system: Any = self._task.system
        self._policy = self._made_policy()
        self._observer = Observer(self.system)
        self._reader: TrackReader | None = None
        self._episode: int | None = None

    def _made_policy(self) -> Policy:
        """The policy; for the name of an agent, the run that comes with the package."""
        if isinstance(self.policy, str) and self.policy in ALGORITHMS:
            return load_pretrained(self._task.env_id, self.policy, self.system)
        return as_policy(self.policy, self._task)

    def choose_actions(self, tracks: Any, timestamp: datetime, nchoose: int = 1, **kwargs: Any) -> list[dict[Any, Any]]:
        """The policy's choice: a list of one dictionary from radars to their actions.

        Args:
            tracks: the tracks of all targets, with their estimates one time step before ``timestamp``.
            timestamp: the time of the next measurement.
            nchoose: 1.
            **kwargs: not used.
        """
        if nchoose != 1:
            raise InputError(f"nchoose is {nchoose!r}, expected 1: a policy chooses one action (nearest: 1)")
        belief = self.belief(tracks, timestamp)
        observation, _ = self._observer(belief)
        action = self._policy.act(belief, observation, allowed(self.system, belief))
        chosen = by_sensor(self.system.actions, np.asarray(action))[0]
        return [
            {radar: (self._action(radar, int(i), timestamp),) for radar, i in zip(self._radars, chosen, strict=True)}
        ]

    def belief(self, tracks: Any, timestamp: datetime) -> Any:
        """The belief (axis 0 = environment, of length 1) before the measurement at ``timestamp``."""
        reader, step = self._ready(), self._step(tracks, timestamp)
        episode, step = divmod(step, self.system.horizon)
        if episode != self._episode:
            reader.restart()
            self._policy.begin(self.system, 1, np.random.default_rng([word("policy"), self.seed + episode]))
            self._episode = episode
        return reader.read(tracks, step)

    def _ready(self) -> TrackReader:
        """The reader of tracks, once the radars are known."""
        if self._reader is None:
            self._radars = self._in_order()
            self._reader = TrackReader(self.system, self._radars[0])
        return self._reader

    def _in_order(self) -> list[Any]:
        """The managed radars in the order of the system's: several by their places, each with the system's pulses."""
        own, free = radars_of(self.system), set(self.sensors)
        if len(own) != len(free):
            raise InputError(f"the manager has {len(free)} sensors, expected {len(own)}, as the system has")
        found = [min(free, key=partial(_distance, other)) for other in own] if len(own) > 1 else list(free)
        for radar, other in zip(found, own, strict=True):
            if len(own) > 1 and _distance(other, radar) > NEAR:
                place = tuple(np.ravel(other.position).tolist())
                raise InputError(f"no sensor of the manager is at {place} m, expected one, as the system has")
            C, wanted = radar.pulses.covariances, other.pulses.covariances
            if C.shape != wanted.shape or not np.allclose(C, wanted, rtol=1e-9, atol=0.0):
                given = f"the radar has a library of {len(C)} waveforms"
                raise InputError(f"{given}, expected the system's {len(wanted)} (nearest: radars_of(system))")
        return found

    def _step(self, tracks: Any, timestamp: datetime) -> int:
        """The step of the tracks' last states, which is one before that of ``timestamp``."""
        times = {track.timestamp for track in tracks}
        if len(times) != 1:
            raise InputError(
                f"the tracks end at {sorted(times)}, expected one time: append the prediction of a target that was not "
                "detected"
            )
        (now,), dt = times, self.system.dt
        if self.start_time is None:
            self.start_time = now
        ahead, past = ((b - a).total_seconds() / dt for a, b in ((now, timestamp), (self.start_time, now)))
        if abs(ahead - 1.0) > ROUNDING or past < -ROUNDING or abs(past - round(past)) > ROUNDING * max(past, 1.0):
            given = f"the tracks end {past * dt:g} s after the start and {ahead * dt:g} s before the measurement"
            raise InputError(f"{given}, expected whole time steps of {dt:g} s, and one of them")
        return round(past)

    def _action(self, radar: Any, index: int, timestamp: datetime) -> Any:
        (generator,) = radar.actions(timestamp)
        return generator.action_from_value(index)


def _distance(radar: Any, other: Any) -> float:
    """Distance between two radars, m; infinite if one has no place."""
    if other.position is None or len(other.position) != len(radar.position):
        return np.inf
    return float(np.linalg.norm(np.asarray(radar.position, np.float64) - np.asarray(other.position, np.float64)))


class WeightedTraceReward(RewardFunction):
    """Minus trace(Lambda P) of all tracks after the measurement: what ``myopic`` minimises.

    Stone Soup's ``UncertaintyRewardFunction`` sums norms of whole covariances, which add m^2 and m^2/s^2.
    """

    predictor: Predictor = Property(doc="Predicts the tracks to the time of the measurement")
    updater: Updater = Property(doc="Updates them")
    weights: Sequence[float] = Property(doc="The diagonal of Lambda in the order of the state vector, (n,)")

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._uncertainty = UncertaintyRewardFunction(self.predictor, self.updater, return_tracks=True)

    def __call__(self, config: Any, tracks: Any, metric_time: Any, *args: Any, **kwargs: Any) -> float:
        """The reward of a choice of actions for each sensor."""
        _, after = self._uncertainty(config, tracks, metric_time)
        return -float(sum(np.dot(self.weights, np.diagonal(track.covar)) for track in after))


class TrackReader:
    """Reads the belief of one environment from tracks.

    A track takes the slot of a target whose first estimate is nearest to its own, and keeps it. A slot that no track
    has taken yet holds the system's first estimate; a slot whose track has ended, its last one.

    Args:
        system: whose belief is read.
        radar: that says how Stone Soup's state vectors are ordered. Tracks in a plane become range and range-rate, seen
            from the radar, where the system is one of a line of sight.

    Raises:
        InputError: a belief that holds more than means and covariances, or states that cannot be told from the tracks.
    """

    def __init__(self, system: System, radar: WaveformRadar) -> None:
        self._system, self._radar = system, radar
        world = trees.stack([system.draw_world(np.random.default_rng(0))])
        first: Any = system.initial(world).belief
        # Prediction begins with means and covariances, also if a tracker of wavegym keeps hypotheses.
        self._first = first._replace(hypotheses=None) if hasattr(first, "hypotheses") else first
        fields = getattr(self._first, "_fields", ())
        other = [name for name in fields if name not in ("step", "mean", "covariance")]
        told = [name for name in other if getattr(self._first, name) is not None]
        if not {"step", "mean", "covariance"} <= set(fields) or told:
            given = f"belief of {type(system).__name__} has {', '.join(told) or 'no means and covariances'}"
            raise InputError(f"{given}, expected means and covariances only, which tracks tell (nearest: KershawEvans)")
        n, mapping = self._first.mean.shape[-1], tuple(radar.mapping)
        self._is_projected = len(mapping) != n
        if self._is_projected and (n != len(radar.law.quantities) or not isinstance(radar.law, PlanarRadar)):
            wanted = f"a mapping of {n} elements, as states of {type(system).__name__} have, or a PlanarRadar for 2"
            raise InputError(f"mapping of the radar is {mapping}, expected {wanted}")
        self.restart()

    def restart(self) -> None:
        """Forget which track has which slot."""
        self._slots: dict[Any, int] = {}
        self._mean = self._first.mean.reshape(-1, self._first.mean.shape[-1]).copy()
        self._covariance = self._first.covariance.reshape(*self._mean.shape, -1).copy()

    def read(self, tracks: Any, step: int) -> Any:
        """The belief (axis 0 = environment, of length 1) at ``step``.

        Raises:
            InputError: no track, or more tracks than targets.
        """
        estimates = {track.id: self._estimate(track) for track in tracks}
        self._assign({id: mean for id, (mean, _) in estimates.items() if id not in self._slots})
        for id, (mean, covariance) in estimates.items():
            self._mean[self._slots[id]], self._covariance[self._slots[id]] = mean, covariance
        return self._first._replace(
            step=np.array([step]),
            mean=self._mean.reshape(self._first.mean.shape).copy(),
            covariance=self._covariance.reshape(self._first.covariance.shape).copy(),
        )

    def _estimate(self, track: Any) -> tuple[Array, Array]:
        """Mean (n,) and covariance (n, n) of a track's last state, in the system's coordinates."""
        radar = self._radar
        if self._is_projected:
            model = radar.measurement_model
            H = model.jacobian(track)
            return np.ravel(model.function(track)), H @ np.asarray(track.covar, np.float64) @ H.T
        order = list(radar.mapping)
        return np.asarray(track.mean, np.float64).ravel()[order], np.asarray(track.covar, np.float64)[
            np.ix_(order, order)
        ]

    def _assign(self, fresh: dict[Any, Array]) -> None:
        """Give each new track the free slot of the nearest first estimate."""
        free = [i for i in range(len(self._mean)) if i not in self._slots.values()]
        if len(fresh) > len(free) or not (fresh or self._slots):
            given = f"{len(fresh) + len(self._slots)} tracks"
            raise InputError(f"the scheduler is given {given}, expected 1 to {len(self._mean)}, one for each target")
        if fresh:
            distance = np.linalg.norm(np.stack(list(fresh.values()))[:, None] - self._mean[free], axis=-1)
            for id, column in zip(fresh, linear_sum_assignment(distance)[1], strict=True):
                self._slots[id] = free[column]
