"""Controlled tracking in urban terrain (Barbosa, Sarkale, Chong, Li, Suvorova and Moran)."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, Literal

import numpy as np
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from wavegym.core.action_sets import JointLibrary, Library
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int, check_non_negative, check_positive
from wavegym.core.system import ObservationField, State, System
from wavegym.sensors import Antenna, Multistatic
from wavegym.sensors.receiver import ArrayReceiver
from wavegym.sensors.urban_map import City, Point
from wavegym.systems.urban import kernels
from wavegym.systems.urban.receivers import StreetReceivers
from wavegym.systems.urban.state import (
    Belief,
    Scene,
    Truth,
    World,
    key_figures,
    make_scene,
    room_for,
    urban_elements,
)
from wavegym.targets import ScriptedPath, Segment
from wavegym.trackers import StreetTracker, Tracks
from wavegym.trackers.urban.tracker import MODELS
from wavegym.waveforms import (
    GaussianChirp,
    PulseTrain,
    measurement_covariances,
)
from wavegym.waveforms.fisher import SPEED_OF_LIGHT

EFFECTIVE = 7.4338  # durations in which the chirp sweeps its bandwidth


@dataclass(frozen=True, config=ConfigDict(extra="forbid", allow_inf_nan=False))
class Urban(System):
    """A multistatic radar in a street follows an unknown number of targets, and chooses its pulses scan by scan.

    Description
        One transmitter or more, two receivers or more, buildings that hide and reflect. Two targets drive the same way
        through the crossing, ten seconds apart: straight on, braking, round a left bend, speeding up. A scan is a train
        of Gaussian chirps of one of four kinds; each receiver detects each way from a transmitter by target to
        receiver, by no wall, one or two, with Pd = Pfa^(1 / (1 + eta / 2)), and measures range and range-rate with
        R(psi) / eta, eta falling with the fourth power of the half path and .4 with each wall, and with the variance
        rate_floor^2 of range-rate beside it; and there are false returns. Tracks are begun, confirmed and ended by the
        tracker: LMIPDA and a variable-structure IMM of unscented filters.

    Rewards
        Minus the cost, summed over the ``charged`` slots that cost least: r min(trace(Lambda P), c0) + (1 - r) c0, with
        r the track's probability of existence and c0 the trace of a track just begun at its vaguest; m^2, with
        ``weights`` 1, 1 s^2 and 1 s^4 on positions, velocities and accelerations. To lose a track never pays; a false
        one pays as much as the tracker believes in it.

    Starting state
        No tracks; the first target enters at its arrival.

    Episode end
        Terminates after ``horizon`` scans; the time left is observed.

    Arguments
        city: a city that comes with wavegym, or a TOML file. transmitters, receivers: (x, y) in m. arrivals: s at which
        each target starts. fidelity: "measurement", or "signal" as in wavegym/UrbanSignal-v0. start: (x, y) in m.
        velocity: (x, y) in m/s, there. path: (s, m/s^2 along the motion, rad/s to the left) of each stretch; then it
        drives on. durations: k of the pulses' envelopes exp(-t^2 / 2k^2), s; each sweeps up or down; the first is sent
        where no track says otherwise. bandwidth: swept in 7.43 k, the effective pulse, Hz. carrier: Hz. pulses: of a
        train. interval: between two pulses, s; range-rates beyond lambda / (4 interval) are folded. reference_snr: eta
        at 100 m of the longest pulse; energy grows with duration. tracker: "vsimm" or "ncv". sigma: of the acceleration
        that NCV and turns expect, m/s^2. vaguest: standard deviation of a new track's place at most, m. ghosts: whether
        the tracker tells ghosts by the map. slots: tracks at most. charged: slots that count in the cost.
        clutter_density: false returns per (m x m/s). false_alarm: Pfa, 1e-3 if not given; of signals it follows from
        ``clutter_density``, which sets the threshold. rate_floor: m/s. reach: half path, m. weights: diagonal of
        Lambda, for positions, velocities and accelerations.

    References
        P. R. Barbosa, Y. Sarkale, E. K. P. Chong, Y. Li, S. Suvorova and W. Moran, "Controlled tracking in urban
        terrain: closing the loop". The paper's buildings and clutter are read off its figure, its SNR and thresholds
        are proposals of this suite.
    """

    horizon: int = 140
    dt: float = 0.25
    city: str = "intersection"
    transmitters: tuple[Point, ...] = ((2085.0, 1470.5),)
    receivers: tuple[Point, ...] = ((2088.0, 1475.0), (2078.0, 1467.0))
    arrivals: tuple[float, ...] = (0.0, 10.0)
    start: Point = (1950.0, 1500.0)
    velocity: Point = (10.0, 0.0)
    path: tuple[tuple[float, float, float], ...] = (
        (5.0, 0.0, 0.0), (5.0, -1.0, 0.0), (10.0, 0.0, math.pi / 20), (5.0, 1.0, 0.0),
    )  # fmt: skip
    durations: tuple[float, ...] = (1.375e-6, 0.5e-6)
    bandwidth: float = 40e6
    carrier: float = 4e9
    fidelity: Literal["measurement", "signal"] = "measurement"
    pulses: int = 249
    interval: float = 1e-3
    reference_snr: float = 200.0
    tracker: Literal["vsimm", "ncv"] = "vsimm"
    sigma: float = 0.25
    vaguest: float = 5.0
    ghosts: bool = True
    slots: int = 8
    charged: int = 2
    clutter_density: float = 1e-3
    false_alarm: float | None = None
    rate_floor: float = 0.1
    reach: float = 300.0
    weights: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        """Check what single types cannot say."""
        for name in ("horizon", "slots"):
            check_int(name, getattr(self, name), 1)
        for name in ("dt", "bandwidth", "carrier", "reference_snr"):
            check_positive(name, getattr(self, name))
        if not self.arrivals:
            raise InputError("arrivals is (), expected the time in s at which each target starts")
        for weight in self.weights:
            check_non_negative("weight", weight)
        check_positive("sum of weights", sum(self.weights))
        check_positive("clutter_density", self.clutter_density)
        if not 1 <= self.charged <= self.slots:
            raise InputError(f"charged is {self.charged}, expected 1 to {self.slots} slots")
        if self.fidelity == "signal" and self.false_alarm is not None:
            wanted = "expected none with fidelity='signal': it follows from clutter_density"
            raise InputError(f"false_alarm is {self.false_alarm}, {wanted}")
        _ = self.actions, self.following, self.scene, self._most

    @cached_property
    def map(self) -> City:
        """The city."""
        return City.load(self.city)

    @cached_property
    def library(self) -> Library:
        """Trains of each duration, sweeping up and down."""
        trains = []
        for k in self.durations:
            rate = math.pi * self.bandwidth / (EFFECTIVE * check_positive("duration", k, "s"))
            for direction in ("up", "down"):
                chirp = GaussianChirp(duration=k, chirp_rate=rate, direction=direction)
                trains.append(PulseTrain(chirp, count=self.pulses, interval=self.interval))
        return Library(tuple(trains))

    @cached_property
    def actions(self) -> Library | JointLibrary:
        """A train; of several transmitters every combination, which receivers tell apart."""
        several = len(self.transmitters)
        return JointLibrary(self.library, several) if several > 1 else self.library

    def _sent(self, action: Array) -> Array:
        """Number of the waveform that each pair's transmitter sends, (..., pair)."""
        chosen = np.asarray(action)
        sent = self.actions.indices[chosen] if isinstance(self.actions, JointLibrary) else chosen[..., None]
        return np.repeat(sent, len(self.receivers), axis=-1)

    @cached_property
    def pairs(self) -> list[Multistatic]:
        """Each transmitter with each receiver."""
        out, back = ([Antenna(self.map, place) for place in side] for side in (self.transmitters, self.receivers))
        return [Multistatic(transmitter, receiver) for transmitter in out for receiver in back]

    @cached_property
    def signals(self) -> StreetReceivers:
        """What turns samples into measurements, for ``fidelity="signal"``."""
        trains = [train for train in self.library.entries if isinstance(train, PulseTrain)]
        arrays = [ArrayReceiver(train, self.carrier, self.bandwidth, self.reach) for train in trains]
        return StreetReceivers(self.pairs, self.scene, arrays, self._waves[1], self.clutter_density)

    @property
    def _false_alarm(self) -> float:
        if self.fidelity == "signal":
            return math.exp(-self.signals.thresholds[0])  # all waveforms sweep the same band
        return 1e-3 if self.false_alarm is None else self.false_alarm

    @cached_property
    def following(self) -> StreetTracker:
        """The tracker."""
        return StreetTracker(
            self.map, self.transmitters, self.receivers, models=self.tracker, dt=self.dt, slots=self.slots,
            clutter_density=self.clutter_density, false_alarm=self._false_alarm, rate_floor=self.rate_floor,
            reach=self.reach, sigma=self.sigma, vaguest=self.vaguest, ghosts=self.ghosts,
        )  # fmt: skip

    @cached_property
    def scene(self) -> Scene:
        """What happens whatever is transmitted."""
        route = ScriptedPath(self.start, self.velocity, [Segment(*stretch) for stretch in self.path])
        times = self.dt * np.arange(self.horizon + 1)
        return make_scene(self.map, self.pairs, route, self.arrivals, times)

    @cached_property
    def _waves(self) -> tuple[Array, Array]:
        """Covariance at an SNR of 1, (waveform, 2, 2), and the SNR at 100 m, (waveform,)."""
        energy = np.repeat(np.array(self.durations) / max(self.durations), 2)
        return measurement_covariances(self.library, self.carrier), self.reference_snr * energy

    @property
    def ambiguity(self) -> float:
        """Range-rates beyond this are folded, m/s: lambda / (4 interval)."""
        return SPEED_OF_LIGHT / self.carrier / (4.0 * self.interval)

    @cached_property
    def _most(self) -> int:
        """Measurements of a pair in a scan that there is room for."""
        return room_for(self.clutter_density * self.reach * 2.0 * self.ambiguity)

    def baselines(self) -> dict[str, tuple[str, dict[str, Any]]]:
        """The paper's baseline: waveforms in turn, and one nearly constant velocity."""
        return {"open-loop": ("round-robin", {"tracker": "ncv"})}

    def draw_world(self, rng: np.random.Generator) -> World:
        """The key of all draws of one episode."""
        return World(np.asarray(rng.integers(2**64, dtype=np.uint64)))

    def initial(self, world: World) -> State:
        """No tracks, no scan."""
        count = len(world.key)
        true_states, present = (np.repeat(a[:1], count, axis=0) for a in (self.scene.truth, self.scene.present))
        nothing = np.zeros((count, len(self.pairs), self._most, 2)), np.zeros((count, len(self.pairs)), np.int64)
        truth = Truth(true_states, present, *nothing, np.zeros(count, np.int64))
        return State(truth, Belief(np.zeros(count, np.int64), *self.following.empty(count)))

    def transition(self, state: State, action: Array, world: World) -> State:
        """One scan: the street is measured with the chosen train, and the tracks take it."""
        scan = state.belief.step + 1
        sent = self._sent(action)
        R, snr = (values[sent] for values in self._waves)
        z, count = np.zeros(state.truth.z.shape), np.zeros(state.truth.number.shape, np.int64)
        if self.fidelity == "signal":
            self.signals.measure(world.key, scan, sent, z, count)
        else:
            kernels.measure(world.key, scan, self.scene, self.following.street, R, snr, self.ambiguity, z, count)
        tracks, refused = self.following.scan(Tracks(*state.belief[1:]), z, count, R, snr)
        truth = Truth(self.scene.truth[scan], self.scene.present[scan], z, count, refused)
        return State(truth, Belief(scan, *tracks))

    def predict(self, belief: Belief, actions: Array, outcome: Any = None) -> Belief:
        """Predicted tracks with covariances as a scan may be expected to leave them; no draws decide anything."""
        chosen = np.asarray(actions)
        lead = np.broadcast_shapes(chosen.shape, (len(belief.step), *(1,) * (chosen.ndim - 1)))
        index = np.broadcast_to(chosen, lead).reshape(-1)
        each = index.size // len(belief.step)
        tracks = self.following.expect(
            Tracks(*(np.repeat(leaf, each, axis=0) for leaf in belief[1:])),
            *(v[self._sent(index)] for v in self._waves),
        )
        step = np.repeat(belief.step + 1, each).reshape(lead)
        return Belief(step, *(leaf.reshape(*lead, *leaf.shape[1:]) for leaf in tracks))

    @cached_property
    def _weights(self) -> Array:
        return np.repeat(np.array(self.weights), 2)

    @property
    def absent(self) -> float:
        """c0, what a track that is not there costs: as much as one just begun at its vaguest."""
        tracker, (position, velocity, acceleration) = self.following, self.weights
        return position * tracker.vaguest**2 + 2.0 * velocity * tracker.usual_speed**2 + 2.0 * acceleration

    def cost(self, belief: Belief) -> Array:
        """See Rewards."""
        _, P = Tracks(*belief[1:]).combined()
        trace = np.minimum((np.diagonal(P, 0, -2, -1) * self._weights).sum(axis=-1), self.absent)
        each = self.absent - belief.existence * (self.absent - trace)
        return np.sort(each, axis=-1)[..., : self.charged].sum(axis=-1)

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The time left, and each slot."""
        return urban_elements(self.slots, MODELS[: len(self.following.motion)], self.reach)

    def observe(self, belief: Belief) -> Array:
        """See ``observation_fields``."""
        out = np.zeros((len(belief.step), len(self.observation_fields)))
        kernels.observe(*belief, self._centre, self.horizon, out)
        return out

    @cached_property
    def _centre(self) -> Array:
        return np.array(self.transmitters[0])

    def state_info(self, state: State) -> dict[str, Array]:
        """Of each target ``held``: whether a confirmed track is within 20 m; ``position_error`` of the nearest (20 m
        where none is, 0 while the target is not there) and its ``nees`` (expected: 4), with ``present`` for those that
        are held, of which evaluations take means; ``lost``: both straight ways are open, and it is not held. Of the
        scan: ``confirmed``, ``false`` and ``tentative`` tracks, those ``refused`` a slot, ``gospa`` (m, cutoff 20 m),
        and the ``measurements``.
        """
        return key_figures(state, self.scene.direct)
