"""Controlled tracking in urban terrain (Barbosa, Sarkale, Chong, Li, Suvorova and Moran)."""

from __future__ import annotations

import math
from functools import cached_property, lru_cache
from typing import Any, ClassVar, Literal

import numpy as np

from wavegym.core.action_sets import JointLibrary, Library
from wavegym.core.arrays import Array, for_kernel
from wavegym.core.errors import InputError, check_positive
from wavegym.core.parameters import (
    NonNegative,
    Positive,
    Probability,
    changed_default,
    parameter,
    system_parameters,
)
from wavegym.core.policy import makers_by_form
from wavegym.core.system import ObservationField, State, System
from wavegym.core.traits import DecisionMaker, DecisionMakers, TimedPulses
from wavegym.sensors import (
    Antenna,
    Multistatic,
    acceleration_loss,
    false_return_threshold,
    motion_loss,
    range_and_rate,
)
from wavegym.sensors.detection import Fluctuation, echo_law
from wavegym.sensors.receiver import ArrayReceiver
from wavegym.sensors.urban_map import Point, UrbanMap
from wavegym.systems.urban import kernels
from wavegym.systems.urban.receivers import UrbanReceivers
from wavegym.systems.urban.state import (
    HELD_WITHIN,
    Belief,
    Measurements,
    Scene,
    Truth,
    World,
    deviation_model,
    make_scene,
    room_for,
    urban_fields,
    urban_info,
)
from wavegym.systems.urban.tracker import EMPTY, MODELS, Tracks, UrbanTracker
from wavegym.targets import ScriptedPath, Segment
from wavegym.trackers.track_metrics import MOST_TARGETS
from wavegym.waveforms import (
    GaussianChirp,
    PulseTiming,
    PulseTrain,
    check_time_on_target,
    measurement_covariances,
    pulse_timings,
)
from wavegym.waveforms.fisher import SPEED_OF_LIGHT

WITH_DIRECTIONS: dict[str, Any] = {"stay": 0.98, "sigma_acceleration": 0.02, "pushed": True, "confirm_after": 8}
"""Settings of the tracker if receivers measure directions of arrival; otherwise it has those of the paper.

Drivers brake and speed up steadily for some seconds, under random accelerations that last for a scan. Both belong to
NCA: a random walk of the acceleration that is wide enough for the second makes covariances too large.
"""
SEARCHED = 3  # quantities over which a receiver with an array searches for peaks: delay, Doppler, direction
ELEMENTS = 3  # of each receiver's array
GREATEST = 40.0  # m/s^2, greatest acceleration in the table of losses
LOSSES = 801  # values of this table
EFFECTIVE = 7.4338  # effective pulse length over duration k: the chirp sweeps its bandwidth in this time
# Systems share receivers, because computing the noise of a receiver takes 20 ms. Do not write to their arrays.
_shared_receiver = lru_cache(maxsize=64)(ArrayReceiver)


@system_parameters
class Urban(System, DecisionMakers, TimedPulses):
    """A multistatic radar in urban terrain tracks an unknown number of targets and chooses its pulses in every scan.

    Description
        This is the paper's tracking benchmark. By default the first pulse is best in every scan, so there is nothing to
        decide. The scene has one or more transmitters, two or more receivers, and buildings that hide targets and
        reflect signals. Two targets drive the same route through a crossing, ten seconds apart: they drive straight on,
        brake, turn left and speed up. Random accelerations push targets off the route, and their drivers steer back.

        A scan is a train of Gaussian chirps of one of four kinds. Receivers have their own antennas (bistatic) and
        listen while the transmitter transmits, so no echo is eclipsed. The direct signal is assumed to be subtracted.

        A propagation path leads from a transmitter over a target to a receiver, with up to two wall reflections. The
        echo of each path has a new eta = 2E/N0 in every scan. Its mean falls with the fourth power of the half path
        length, by a factor of 0.4 at each wall, and with the acceleration along the line of sight, because a train
        lasts 0.249 s. Each receiver takes the peaks over delay, Doppler shift and direction that exceed its threshold.
        eta decides on the detection. Range and range-rate have the covariance R(psi) / eta, plus rate_floor^2 for
        range-rate. There are also false returns: the threshold is that at which noise has ``clutter_density`` peaks.

        Each receiver is a line of three elements, half a wavelength apart. It measures the cosine of the angle between
        its line and the direction of arrival, with variance 12 / (pi^2 (3^2 - 1) eta). It cannot tell a direction from
        its mirror image in the line, so the lines of two receivers stand at right angles. It reports each return with
        the covariance at its eta.

        The tracker starts, confirms and ends tracks, with LMIPDA and a variable-structure IMM of unscented filters. You
        cannot use a tracker of your own here, because its estimate has a fixed number of targets and no probabilities
        of existence.

    Rewards
        Minus the cost, which is the sum of r min(trace(Lambda P), c0) + (1 - r) c0 over the ``charged`` slots of least
        cost. r is the existence probability of the track, and c0 is the trace of a new track of greatest uncertainty.
        The unit is m^2, with ``weights`` 1, 1 s^2 and 1 s^4 on positions, velocities and accelerations. Losing a track
        never lowers the cost. A false track lowers it in proportion to its existence probability.

    Starting state
        There are no tracks. Each target enters at its arrival.

    Episode end
        Terminates after ``horizon`` scans. The remaining time is observed.

    References
        P. R. Barbosa, Y. Sarkale, E. K. P. Chong, Y. Li, S. Suvorova and W. Moran, "Controlled tracking in urban
        terrain: closing the loop". Buildings and clutter are read off the paper's figure. SNR and thresholds are
        choices of this suite.
    """

    bistatic: ClassVar[bool] = True

    horizon: int = parameter(140, "scans in an episode", ge=1, le=10_000)
    dt: float = parameter(0.25, "time between scans", unit="s", gt=0)
    city: str = parameter("intersection", "an urban map of wavegym, or a TOML file", unit="")
    transmitters: tuple[Point, ...] = parameter(((2085.0, 1470.5),), "positions (x, y) of the transmitters", unit="m")
    receivers: tuple[Point, ...] = parameter(
        ((2088.0, 1475.0), (2078.0, 1467.0)), "positions (x, y) of the receivers, at least two", unit="m"
    )
    direction_of_arrival: bool = parameter(
        True, "whether receivers report directions, and covariances of peaks; False: the paper's tracker", unit=""
    )
    array_axes: tuple[float, ...] | None = parameter(
        None, "azimuth of each receiver's line of elements; by default 0 and 90 in turn", unit="deg"
    )
    arrivals: tuple[float, ...] = parameter(
        (0.0, 10.0), "time at which each target starts", unit="s", truth=True, min_length=1
    )
    start: Point = parameter((1950.0, 1500.0), "start (x, y) of the route of all targets", unit="m", truth=True)
    velocity: Point = parameter((10.0, 0.0), "velocity (x, y) at the start", unit="m/s", truth=True)
    path: tuple[tuple[float, float, float], ...] = parameter(
        ((5.0, 0.0, 0.0), (5.0, -1.0, 0.0), (10.0, 0.0, math.pi / 20), (5.0, 1.0, 0.0)),
        "route: duration, acceleration along the motion and left turn rate of each segment; then constant velocity",
        unit="s, m/s^2, rad/s",
        truth=True,
    )
    durations: tuple[Positive, ...] = parameter(
        (1.375e-6, 0.5e-6),
        "k of the envelopes exp(-t^2 / 2k^2), each with an up and a down sweep; the one-step scheduler sends the first "
        "if there are no tracks",
        unit="s",
    )
    bandwidth: float = parameter(40e6, "bandwidth swept in the effective pulse length 7.43 k", unit="Hz", gt=0)
    carrier: float = parameter(4e9, "carrier frequency", unit="Hz", gt=0)
    fidelity: Literal["measurement", "signal"] = parameter(
        "measurement",
        "measurements from the error model, or from simulated signals as in wavegym/UrbanSignal-v0",
        unit="",
    )
    pulses: int = parameter(249, "pulses in a train", ge=1)
    interval: float = parameter(
        1e-3, "time between pulses; range-rates beyond lambda / (4 interval) are folded", unit="s", gt=0
    )
    reference_snr: float = parameter(
        200.0, "eta of the longest pulse at 100 m, a ratio; energy grows with duration", truth=True, gt=0
    )
    tracker: Literal["vsimm", "ncv"] = parameter(
        "vsimm", "motion models of the tracker: variable-structure IMM, or one nearly constant velocity", unit=""
    )
    sigma: float = parameter(
        0.25,
        "standard deviation of random acceleration: of the targets, and in NCV and turn models",
        unit="m/s^2",
        truth=True,
        ge=0,
    )
    vaguest: float = parameter(5.0, "maximum standard deviation of the position of a new track", unit="m", gt=0)
    ghosts: bool = parameter(True, "whether the tracker uses the map to recognise ghosts", unit="")
    slots: int = parameter(8, "maximum number of tracks", ge=1, le=1000)
    charged: int = parameter(2, "number of slots in the cost", ge=1)
    clutter_density: float = parameter(1e-3, "expected false returns", unit="1/(m m/s)", truth=True, gt=0)
    false_alarm: Probability | None = parameter(
        None, "Pfa of a known cell; by default that at which noise has clutter_density peaks", truth=True
    )
    fluctuation: Fluctuation = parameter(
        "swerling1",
        "fluctuation of echoes from scan to scan; a train is one coherent pulse, so swerling2 equals swerling1 and "
        "swerling4 equals swerling3",
        unit="",
        truth=True,
    )
    error_snr: Literal["mean", "realised"] = parameter(
        "realised",
        "eta that sets the errors of detected echoes and the tracker's covariances: that of the scan, at least 1, or "
        "the mean, as in the paper; with fidelity='signal' peaks keep their own covariances",
        unit="",
        truth=True,
    )
    searched: int | None = parameter(
        None,
        "number of quantities over which receivers search for the peak of an echo, which raises Pd; 0: the cell is "
        "known; by default delay and Doppler shift, and direction if it is measured; always 3 with fidelity='signal'",
        unit="",
        ge=0,
    )
    rate_floor: float = parameter(
        0.1, "standard deviation of range-rate in addition to its noise", unit="m/s", truth=True, gt=0
    )
    reach: float = parameter(300.0, "half path length beyond which nothing is received", unit="m", truth=True, gt=0)
    weights: tuple[NonNegative, NonNegative, NonNegative] = parameter(
        (1.0, 1.0, 1.0), "diagonal of Lambda, for positions, velocities and accelerations", unit="1, s^2, s^4"
    )

    nees_dimension = 4  # position and velocity
    lost_beyond = HELD_WITHIN  # farther away a confirmed track does not hold the target

    def __post_init__(self) -> None:
        """Check several fields together."""
        check_positive("sum of weights", sum(self.weights))
        if len(self.arrivals) > MOST_TARGETS:
            wanted = f"at most {MOST_TARGETS}, the most that GOSPA can assign"
            raise InputError(f"arrivals has {len(self.arrivals)} targets, expected {wanted}")
        if self.charged > self.slots:
            raise InputError(f"charged is {self.charged}, expected 1 to {self.slots} slots")
        if self.fidelity == "signal" and self.false_alarm is not None:
            wanted = "expected None with fidelity='signal', where it follows from clutter_density"
            raise InputError(f"false_alarm is {self.false_alarm}, {wanted}")
        if self.fidelity == "signal" and self.searched not in (None, SEARCHED):
            raise InputError(f"searched is {self.searched}, expected {SEARCHED} with fidelity='signal'")
        if len(self.truth_model.arrivals) != len(self.arrivals):
            given = len(self.truth_model.arrivals)
            raise InputError(f"truth has arrivals of {given} targets, expected {len(self.arrivals)}, as in the system")
        check_time_on_target(self.timings, self.dt)
        _ = self._most, self.actions, self.urban_tracker, self.scene

    @cached_property
    def map(self) -> UrbanMap:
        """The urban map."""
        return UrbanMap.load(self.city)

    @cached_property
    def library(self) -> Library:
        """A train of each duration with an up and a down sweep."""
        trains = []
        for k in self.durations:
            rate = math.pi * self.bandwidth / (EFFECTIVE * k)
            for direction in ("up", "down"):
                chirp = GaussianChirp(duration=k, chirp_rate=rate, direction=direction)
                trains.append(PulseTrain(chirp, count=self.pulses, interval=self.interval))
        return Library(tuple(trains))

    @cached_property
    def actions(self) -> Library | JointLibrary:
        """A train; with several transmitters every combination of trains, which the receivers can separate."""
        several = len(self.transmitters)
        return JointLibrary(self.library, several) if several > 1 else self.library

    @property
    def decision_makers(self) -> tuple[DecisionMaker, ...]:
        """The transmitters. They share all observation fields, which belong to tracks."""
        return makers_by_form(self.actions, "transmitter")

    @property
    def timings(self) -> dict[str, PulseTiming]:
        """One train of each transmitter in a scan."""
        return pulse_timings(self.library, self.carrier)

    def target_ranges(self, world: World) -> Array:
        """Range and range-rate, half those of the direct path, of present targets, (env, scan and target, pair, 2)."""
        truth, found = self.initial(world).truth, []
        places = np.array([(out, back) for out in self.transmitters for back in self.receivers])  # (pair, end, 2)
        for scan in range(self.horizon + 1):
            at = truth.targets[:, self.truth_model.scene.present[scan]][:, :, None]  # (env, target, 1, 6)
            found.append(0.5 * sum(range_and_rate(at[..., :4], places[:, end]) for end in (0, 1)))
            if scan < self.horizon:
                truth = self.move(truth, np.full(len(world.key), scan), world)
        return np.concatenate(found, axis=1)

    def _sent(self, action: Array) -> Array:
        """Index of the waveform that the transmitter of each pair sends, (..., pair)."""
        chosen = np.asarray(action)
        sent = self.actions.indices[chosen] if isinstance(self.actions, JointLibrary) else chosen[..., None]
        return np.repeat(sent, len(self.receivers), axis=-1)

    @cached_property
    def _axes(self) -> tuple[Point, ...]:
        """Unit vector along the elements of each receiver."""
        azimuths = self.array_axes or tuple(90.0 * (m % 2) for m in range(len(self.receivers)))
        if len(azimuths) != len(self.receivers):
            wanted = f"{len(self.receivers)}, one for each receiver"
            raise InputError(f"array_axes has {len(azimuths)} azimuths, expected {wanted}")
        return tuple((math.cos(a), math.sin(a)) for a in map(math.radians, azimuths))

    @cached_property
    def pairs(self) -> list[Multistatic]:
        """All pairs of a transmitter and a receiver."""
        out = [Antenna(self.map, place) for place in self.transmitters]
        back = [Antenna(self.map, *array) for array in zip(self.receivers, self._axes, strict=True)]
        return [Multistatic(transmitter, receiver) for transmitter in out for receiver in back]

    @cached_property
    def signals(self) -> UrbanReceivers:
        """The receivers for ``fidelity="signal"``."""
        trains = [train for train in self.library.entries if isinstance(train, PulseTrain)]
        arrays = [_shared_receiver(train, self.carrier, self.bandwidth, self.reach) for train in trains]
        return UrbanReceivers(
            self.pairs, self.scene, arrays, self._waves[1], self.clutter_density, self.fluctuation, self.rate_floor
        )

    @property
    def _false_alarm(self) -> float:
        if self.fidelity == "signal":
            return math.exp(-self.signals.thresholds[0])  # all waveforms sweep the same band
        if self.false_alarm is not None:
            return self.false_alarm
        return math.exp(
            -false_return_threshold(
                self._waves[0][0], self.clutter_density, ELEMENTS if self.direction_of_arrival else 1
            )
        )

    @property
    def _searched(self) -> int:
        if self.searched is not None:
            return self.searched
        return SEARCHED if self.direction_of_arrival or self.fidelity == "signal" else SEARCHED - 1

    @cached_property
    def urban_tracker(self) -> UrbanTracker:
        """The tracker."""
        directions = {"axes": self._axes, **WITH_DIRECTIONS} if self.direction_of_arrival else {}
        return UrbanTracker(
            self.map, self.transmitters, self.receivers, **directions,
            models=self.tracker, dt=self.dt, slots=self.slots,
            clutter_density=self.clutter_density, false_alarm=self._false_alarm,
            fluctuation=self.fluctuation, error_snr=self.error_snr, searched=self._searched,
            rate_floor=self.rate_floor, reach=self.reach, sigma=self.sigma, vaguest=self.vaguest, ghosts=self.ghosts,
        )  # fmt: skip

    @cached_property
    def scene(self) -> Scene:
        """Targets and propagation paths; no action changes them."""
        route = ScriptedPath(self.start, self.velocity, [Segment(*segment) for segment in self.path])
        times = self.dt * np.arange(self.horizon + 1)
        return make_scene(self.map, self.pairs, route, self.arrivals, times)

    @cached_property
    def _waves(self) -> tuple[Array, Array]:
        """Covariance at an SNR of 1, (waveform, 2, 2), and the SNR at 100 m, (waveform,)."""
        energy = np.repeat(np.array(self.durations) / max(self.durations), 2)
        return measurement_covariances(self.library, self.carrier), self.reference_snr * energy

    @property
    def _train(self) -> tuple[float, float]:
        """Duration of a train, s, and wavelength, m."""
        return self.pulses * self.interval, SPEED_OF_LIGHT / self.carrier

    @cached_property
    def _believed_waves(self) -> tuple[Array, Array]:
        """As ``_waves``, with the energy that trains keep on average of the accelerations that the tracker assumes."""
        covariance, snr = self._waves
        pushes, usual = self.sigma**2 * self.dt, self.urban_tracker.constants.first_acceleration
        return covariance, snr * motion_loss(*self._train, pushes, usual)

    @property
    def ambiguity(self) -> float:
        """Greatest unambiguous range-rate, lambda / (4 interval), m/s; greater range-rates are folded."""
        return SPEED_OF_LIGHT / self.carrier / (4.0 * self.interval)

    @cached_property
    def _most(self) -> int:
        """Room for the measurements of a pair in a scan."""
        return room_for(self.clutter_density * self.reach * 2.0 * self.ambiguity)

    def draw_world(self, rng: np.random.Generator) -> World:
        """The key of all draws of one episode."""
        return World(np.asarray(rng.integers(2**64, dtype=np.uint64)))

    def initial(self, world: World) -> State:
        """The scene at scan 0 without tracks or measurements."""
        count, scene = len(world.key), self.truth_model.scene
        true_states, present = (np.repeat(a[:1], count, axis=0) for a in (scene.truth, scene.present))
        z, _, number = self._no_measurements(count)
        truth = Truth(true_states, present, z, number)
        return State(truth, Belief(np.zeros(count, np.int64), *self.urban_tracker.empty(count)))

    def _no_measurements(self, count: int) -> Measurements:
        lead, size = (count, len(self.pairs)), self.urban_tracker.quantities
        most = self.truth_model._most
        return Measurements(
            np.zeros((*lead, most, size)), np.zeros((*lead, most, size, size)), np.zeros(lead, np.int64)
        )

    @cached_property
    def _sensor_law(self) -> kernels.SensorLaw:
        law = echo_law((self._false_alarm,), self.fluctuation, self._searched, realised=self.error_snr == "realised")
        roots = np.linspace(0.0, math.sqrt(GREATEST), LOSSES)
        return kernels.SensorLaw(
            self.clutter_density, law, self.rate_floor, self.reach, ELEMENTS, self.ambiguity,
            acceleration_loss(*self._train, roots**2), float(roots[1]),
        )  # fmt: skip

    @cached_property
    def _deviation(self) -> tuple[Array, Array]:
        return deviation_model(self.dt)

    def move(self, truth: Truth, step: Array, world: World) -> Truth:
        """The targets one scan on: along the route, with deviations by random accelerations."""
        scene, scan, targets = self.truth_model.scene, step + 1, np.empty(truth.targets.shape)
        kernels.move_targets(
            world.key, scan, truth.targets, scene.truth, scene.present, *self._deviation, self.truth_model.sigma,
            targets,
        )  # fmt: skip
        return truth._replace(targets=targets, present=scene.present[scan])

    def measure(self, truth: Truth, belief: Belief, action: Array, world: World) -> Measurements:
        """One scan of all receivers, from the error model or from simulated signals."""
        scan, sent, law = belief.step + 1, self._sent(action), self.truth_model
        found = self._no_measurements(len(scan))
        if self.fidelity == "signal":
            law.signals.measure(world.key, scan, truth.targets, sent, *found)
        else:
            waves = (values[sent] for values in law._waves)
            kernels.measure(world.key, scan, truth.targets, law.scene, law._sensor_law, *waves, *found)
        if self.direction_of_arrival:
            return found
        waves = (values[sent] for values in self._believed_waves)
        return found._replace(R=self.urban_tracker.direct_errors(found.z, found.number, *waves))

    def annotate(self, truth: Truth, measurements: Measurements) -> Truth:
        """The truth with the measurements of the scan."""
        return truth._replace(z=measurements.z, number=measurements.number)

    def track(self, belief: Belief, action: Array, measurements: Measurements) -> Belief:
        """One scan of the tracker."""
        sent = self._sent(action)
        R, snr = (values[sent] for values in self._believed_waves)
        tracks = Tracks(*belief[1:])
        return Belief(
            belief.step + 1,
            *self.urban_tracker.scan(tracks, measurements.z, measurements.number, R, snr, measurements.R),
        )

    def predict(self, belief: Belief, actions: Array, outcome: Any = None) -> Belief:
        """Predicted tracks with the covariances expected after a scan; ``outcome`` is not used."""
        chosen = np.asarray(actions)
        lead = np.broadcast_shapes(chosen.shape, (len(belief.step), *(1,) * (chosen.ndim - 1)))
        index = np.broadcast_to(chosen, lead).reshape(-1)
        each = index.size // len(belief.step)
        tracks = self.urban_tracker.expect(
            Tracks(*(np.repeat(leaf, each, axis=0) for leaf in belief[1:])),
            *(v[self._sent(index)] for v in self._believed_waves),
        )
        step = np.repeat(belief.step + 1, each).reshape(lead)
        return Belief(step, *(leaf.reshape(*lead, *leaf.shape[1:]) for leaf in tracks))

    @cached_property
    def _weights(self) -> Array:
        return np.repeat(np.array(self.weights), 2)

    @cached_property
    def absent(self) -> float:
        """c0, the cost of an absent track, which is that of a new track of greatest uncertainty."""
        tracker, (position, velocity, acceleration) = self.urban_tracker, self.weights
        return position * tracker.vaguest**2 + 2.0 * velocity * tracker.usual_speed**2 + 2.0 * acceleration

    def cost(self, belief: Belief) -> Array:
        """See Rewards."""
        lead = belief.existence.ndim - 1
        x, P, mu, existence = (for_kernel(leaf).reshape(-1, *leaf.shape[lead:]) for leaf in belief[1:5])
        each = np.empty(existence.shape)
        sizes = (0,) * x.shape[3], (0,) * x.shape[2]
        kernels.costs(x, P, mu, existence, self._weights, self.absent, each, *sizes)
        return np.add.reduce(each[:, : self.charged], axis=1).reshape(belief.existence.shape[:-1])

    def trace(self, belief: Belief) -> Array:
        """trace(Lambda P) summed over the tracks in use, without their existence probabilities."""
        _, P = Tracks(*belief[1:]).combined()
        each = (np.diagonal(P, 0, -2, -1) * self._weights).sum(axis=-1)
        return np.where(belief.status == EMPTY, 0.0, each).sum(axis=-1)

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The observation: the time left, and each slot."""
        return urban_fields(self.slots, MODELS[: len(self.urban_tracker.motion)], self.reach)

    def observe(self, belief: Belief) -> Array:
        """See ``observation_fields``."""
        out = np.zeros((len(belief.step), len(self.observation_fields)))
        kernels.observe(*belief[:7], self._centre, self.horizon, out)
        return out

    @cached_property
    def _centre(self) -> Array:
        return np.array(self.transmitters[0])

    def state_info(self, state: State) -> dict[str, Array]:
        """Figures of each target and of the scan.

        For each target: ``held`` (a confirmed track is within 20 m), ``position_error`` of the nearest track (20 m if
        not held, 0 while the target is absent), its ``position_variance`` (m^2) and ``nees`` (expected: 4), ``present``
        (equal to ``held``, because evaluations average over these targets). For the scan: the numbers of ``confirmed``,
        ``false`` and ``tentative`` tracks, of ``refused`` tracks (new ones without a free slot) and of
        ``measurements``, and ``gospa`` (m, cutoff 20 m).
        """
        return urban_info(state)


@system_parameters
class UrbanSignal(Urban):
    """The urban loop at the signal level: pulse trains at array elements, matched filters, peaks.

    Description
        As wavegym/Urban-v0, but measurements come from simulated signals at the three elements of each receiver. The
        signals contain the echoes of targets over all paths, and noise. The mean of thirty trains without targets is
        subtracted, which cancels the echoes of walls and trees and adds the noise of the mean. Matched filters give an
        image over delay and Doppler.

        The receiver searches the image for peaks, each in its best direction. A peak counts if it exceeds a threshold,
        which noise exceeds ``clutter_density`` times per (m x m/s). A quadratic fit to log |A|^2 measures the peak.
        Paths less than a resolution cell apart give one peak. A train has 25 pulses and lasts 25 ms. The echo of each
        path has a new phase, amplitude (``fluctuation``) and range-rate (``rate_floor``) in every scan. The tracker
        accounts for the search: its Pd is that of ``wavegym.sensors.detection_probability`` with searched = 3. The
        covariance of a peak allows for the noise and the search that have raised it.

    Rewards
        As wavegym/Urban-v0.

    Starting state
        As wavegym/Urban-v0.

    Episode end
        As wavegym/Urban-v0.
    """

    pulses: int = changed_default(Urban, "pulses", 25)
    fidelity: Literal["measurement", "signal"] = changed_default(Urban, "fidelity", "signal")
