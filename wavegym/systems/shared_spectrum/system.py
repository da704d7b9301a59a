"""A radar that shares its band: at every step it chooses a contiguous band beside other users."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from wavegym.core.action_sets import Library, Parameter, ParameterBox
from wavegym.core.arrays import Array
from wavegym.core.covariances import trace_cost
from wavegym.core.errors import InputError, check_ordered, check_positive
from wavegym.core.parameters import Interval, NonNegative, Positive, parameter, system_parameters
from wavegym.core.system import ObservationField, State, System
from wavegym.core.traits import TimedPulses
from wavegym.sensors.detection import Fluctuation, check_cells, echo_law
from wavegym.sensors.interference import Bands, Receiver, contiguous_bands
from wavegym.sensors.trains import check_threshold
from wavegym.systems.shared_spectrum import kernels
from wavegym.systems.shared_spectrum import prediction_kernels as prediction
from wavegym.systems.shared_spectrum.occupancy import predictor_of
from wavegym.systems.shared_spectrum.state import Belief, Measurements, Truth, World
from wavegym.systems.shared_spectrum.users import DRAWS, BandUser, advanced, check_users, drawn_users
from wavegym.targets import MotionModel, constant_velocity, random_path
from wavegym.waveforms import SPEED_OF_LIGHT, PulseTiming, check_range_folds, check_time_on_target, check_velocity_folds

Decibels = Annotated[float, Field(ge=-100.0, le=100.0, allow_inf_nan=False)]
SEARCHED = 2  # delay and Doppler
HALF_C = 0.5 * SPEED_OF_LIGHT
STREAMS = 100  # of a step, for a user's own kinds of users; more than ``users`` may be
FIGURES = "position_error", "velocity_error", "position_variance", "nees", "collisions", "share"
FIRST_LEVEL = 100.0  # noise that is expected in a channel where no user was heard


@system_parameters
class SharedSpectrum(System, TimedPulses):
    """A pulse-Doppler radar chooses the band of each train in a spectrum that other users share.

    Description
        One target moves along the line of sight. In every step the radar sends one coherent train of linear chirps in a
        band of neighbouring channels: the action. Other users transmit in the same spectrum, each in one or two
        channels. Their noise in the radar's band lowers the SNR by its mean, and noise at the edges of the band makes
        range less accurate. A wide band measures range well, but has more users in it.

        The kinds of users are those of ``users``: "static" (a link that stays), "bursts" (a Markov chain), "stepped" (a
        stepped-frequency radar, which moves by a constant number of channels in every step), "hopping" (a pattern of 3
        to 24 steps) and "listening" (a network that leaves after a collision for free channels, and comes back). Their
        powers, widths, shares of a train (``duty``) and patterns are drawn for every episode and never shown. In a step
        each user begins anew with probability ``takeover``: elsewhere, with another stride or pattern. An object of
        your own with the functions of ``users.BandUser`` plays beside them.

        In the gaps of its train the radar measures the noise in every channel, to ``sensing`` dB. The tracker, a Kalman
        filter, takes the errors of a measurement from this noise. The threshold of detection follows the mean of
        ``cells`` reference cells of the same train, and so the noise. The scheduler predicts the occupancy of each
        channel with ``predictor``: a Markov chain, or a longer memory.

    Rewards
        -trace(Lambda P) in m^2 with Lambda = diag(weights), the second in s^2. With a ``price``, each occupied channel
        in the band costs this much more. The radar counts those it heard; ``collisions`` in the info counts the users.
        Without a price a policy may push listening users away, which a regulator may not allow.

    Starting state
        Range (``start_range``) and range-rate (``start_speed``) are uniform; the first estimate is drawn around them
        with covariance diag(``prior_variance``). Before the first train the radar has listened for ``history`` steps.

    Episode end
        Terminates after ``horizon`` steps. The remaining time is observed.

    References
        C. E. Thornton, M. A. Kozy, R. M. Buehrer, A. F. Martone and K. D. Sherbondy, "Deep reinforcement learning
        control for radar detection and tracking in congested spectral environments", IEEE Trans. Cogn. Commun. Netw.
        6(4), 2020: bands, users and sense-and-avoid. C. E. Thornton, R. M. Buehrer, H. S. Dhillon and A. F. Martone,
        2022: context-tree weighting.
    """

    horizon: int = parameter(100, "steps in an episode", ge=1, le=100_000)
    dt: float = parameter(0.25, "time step", unit="s", gt=0)
    carrier_hz: float = parameter(3.5e9, "middle of the spectrum", unit="Hz", gt=0)
    channels: int = parameter(8, "channels of the spectrum", ge=1, le=10)
    channel_width: float = parameter(12.5e6, "width of a channel", unit="Hz", gt=0)
    pulses: int = parameter(50, "pulses of a train", ge=2, le=10_000)
    interval: float = parameter(0.4e-3, "time between the pulses of a train", unit="s", gt=0)
    pulse_duration: float = parameter(40e-6, "duration of a pulse", unit="s", gt=0)
    reference_range: float = parameter(
        94e3, "r0, where eta of a train is 1 without other users", unit="m", truth=True, gt=0
    )
    nearest_range: float = parameter(1000.0, "below this range the SNR stays constant", unit="m", truth=True, gt=0)
    false_alarm: float = parameter(1e-4, "false alarm probability Pf of a cell", truth=True, gt=0, lt=1)
    fluctuation: Fluctuation = parameter(
        "swerling1", "fluctuation of the echo from train to train", unit="", truth=True
    )
    action: Literal["library", "box"] = parameter(
        "library", "an index, or a point of a box of centre and width, which stands for the nearest band", unit=""
    )
    receiver: Receiver = parameter(
        "matched", "filter matched to the pulse, or one that whitens the noise in the band", unit=""
    )
    cells: int = parameter(32, "reference cells of the CFAR detector; 0: it knows the noise", ge=0, le=64)
    users: tuple[Any, ...] = parameter(
        ("static", "bursts", "stepped", "listening"),
        "kinds of the other users, or objects of your own",
        unit="",
        max_length=32,
    )
    user_power: tuple[Decibels, Decibels] = parameter(
        (15.0, 25.0), "bounds of a user's power over the receiver's noise in a channel", unit="dB", truth=True
    )
    duty: tuple[Positive, Positive] = parameter(
        (0.3, 1.0), "bounds of the share of a train in which a user transmits", truth=True
    )
    takeover: float = parameter(
        0.03,
        "probability per step that a user begins anew: elsewhere, with another stride or pattern",
        truth=True,
        ge=0,
        le=1,
    )
    spill: float = parameter(
        40.0, "attenuation of a user in the two channels beside its own", unit="dB", truth=True, ge=0
    )
    sensing: float = parameter(
        1.0, "standard deviation of the measured noise of a channel", unit="dB", truth=True, ge=0, le=4
    )
    sensing_delay: int = parameter(0, "steps until the scheduler knows what was measured", ge=0, le=100)
    predictor: str = parameter(
        "markov", "prediction of the occupancy: counts, markov, reactions, lags:N, stepped:N or context-tree:N", unit=""
    )
    price: float = parameter(0.0, "cost of each occupied channel in the band", unit="m^2", ge=0)
    history: int = parameter(
        16, "steps of listening before the first train, and steps that the observation shows", ge=1, le=1000
    )
    q: float = parameter(2.0, "process noise density", unit="m^2/s^3", truth=True, ge=0)
    weights: tuple[NonNegative, NonNegative] = parameter((1.0, 1.0), "diagonal of Lambda", unit="1, s^2")
    start_range: Interval = parameter((10e3, 40e3), "bounds of the first range", unit="m", truth=True)
    start_speed: Interval = parameter((-30.0, 30.0), "bounds of the first range-rate", unit="m/s", truth=True)
    prior_variance: tuple[Positive, Positive] = parameter(
        (25.0, 25.0), "diagonal of P0", unit="m^2, m^2/s^2", truth=True
    )

    nees_dimension: ClassVar[int] = 2

    def __post_init__(self) -> None:
        """Check several fields together."""
        for name in ("start_range", "start_speed", "user_power", "duty"):
            check_ordered(name, *getattr(self, name))
        check_positive("sum of weights", sum(self.weights))
        check_threshold(self.false_alarm)
        check_cells(self.cells, self.false_alarm)
        check_users(self.users)
        predictor_of(self.predictor, self.bands)
        self._check_steps()
        if self.duty[1] > 1.0:
            raise InputError(f"duty is {self.duty}, expected shares of at most 1")
        if len(self.users) > 2 * self.channels:
            raise InputError(f"users are {len(self.users)} in {self.channels} channels, expected at most two a channel")
        check_time_on_target(self.timings, self.dt)
        (timing,) = self.timings.values()
        if self.start_range[0] < timing.blind_range:
            wanted = f"none nearer than {timing.blind_range:g} m, where the radar still transmits"
            raise InputError(f"start_range is {self.start_range} m, expected {wanted}")
        check_range_folds(self.timings, self.start_range[1])
        check_velocity_folds(self.timings, max(map(abs, self.start_speed)))

    def _check_steps(self) -> None:
        """Raise an InputError for a history that no episode fills, or a delay that leaves nothing to know."""
        if self.history > self.horizon:
            raise InputError(
                f"history is {self.history} steps, expected at most those of the episode (nearest: {self.horizon})"
            )
        if self.sensing_delay >= self.history:
            wanted = f"fewer than history (nearest: {self.history - 1})"
            raise InputError(f"sensing_delay is {self.sensing_delay} steps, expected {wanted}")

    @cached_property
    def bands(self) -> Bands:
        """The bands that an action chooses from."""
        return contiguous_bands(self.channels)

    @cached_property
    def actions(self) -> Library | ParameterBox:
        """Every contiguous band, by its lowest channel and width; or centre and width."""
        low = self.carrier_hz + self.channel_width * (self.bands.first - 0.5 * self.channels)
        high = low + self.channel_width * self.bands.width
        if self.action == "box":
            widest = self.channels * self.channel_width
            return ParameterBox(
                (
                    Parameter("centre", "Hz", low.min(), high.max(), "linear"),
                    Parameter("width", "Hz", 0.5 * self.channel_width, widest + 0.5 * self.channel_width, "linear"),
                )
            )
        return Library(tuple(f"{a / 1e6:g} to {b / 1e6:g} MHz" for a, b in zip(low, high, strict=True)))

    def candidates(self) -> Array:
        """Every band: indices (band,), or their points of the box (band, 2)."""
        if not isinstance(self.actions, ParameterBox):
            return np.arange(len(self.bands.width))
        centre = self.bands.first + 0.5 * self.bands.width - 0.5 * self.channels
        hertz = self.carrier_hz + self.channel_width * centre, self.channel_width * self.bands.width
        return self.actions.encode(np.stack(hertz, axis=1))

    def band_of(self, action: Array) -> Array:
        """The index (...) of the band that an action, an index (...) or a point of the box (..., 2), stands for."""
        if not isinstance(self.actions, ParameterBox):
            return action
        centre, hertz = np.moveaxis(self.actions.decode(action), -1, 0)
        width = np.clip(np.rint(hertz / self.channel_width), 1, self.channels).astype(np.int64)
        middle = (centre - self.carrier_hz) / self.channel_width + 0.5 * self.channels
        first = np.clip(np.rint(middle - 0.5 * width), 0, self.channels - width).astype(np.int64)
        index: Array = self._places[first, width]
        return index

    @cached_property
    def _places(self) -> Array:
        """The index of the band by its lowest channel and width."""
        places = np.zeros((self.channels, self.channels + 1), np.int64)
        places[self.bands.first, self.bands.width] = np.arange(len(self.bands.width))
        return places

    @cached_property
    def timings(self) -> dict[str, PulseTiming]:
        """One timing for all bands."""
        timing = PulseTiming(
            duration=self.pulse_duration, carrier_hz=self.carrier_hz, interval=self.interval, count=self.pulses
        )
        return {f"train of {self.pulses} pulses": timing}

    def target_ranges(self, world: World) -> Array:
        """The path, (env, H + 1, 2)."""
        return self.initial(world).truth.path

    @cached_property
    def motion(self) -> MotionModel:
        """The target's motion model."""
        return constant_velocity(self.dt, self.q)

    @property
    def outcome_shape(self) -> tuple[int, ...]:
        """A draw for the occupancy of each channel, and one for the detection."""
        return (self.channels + 1,)

    @cached_property
    def _radar(self) -> kernels.Radar:
        law = echo_law((self.false_alarm,), self.fluctuation, SEARCHED, cells=self.cells)
        deviation = 0.1 * math.log(10.0) * self.sensing
        return kernels.Radar(
            law, self.reference_range, self.nearest_range, self.dt, self.q, self.takeover, 10.0 ** (-0.1 * self.spill),
            self.sensing, math.exp(0.5 * deviation**2), math.exp(2.0 * deviation),
        )  # fmt: skip

    @cached_property
    def _band(self) -> kernels.Band:
        hertz = self.bands.width * self.channel_width
        delay = HALF_C**2 * 12.0 / np.square(2.0 * math.pi * hertz)
        spread = self.interval**2 * (self.pulses**2 - 1.0) / 12.0
        rate = HALF_C / self.carrier_hz / (2.0 * math.pi)
        coupling = (
            -self.carrier_hz * self.pulse_duration / hertz
        )  # up-chirp: with too high a range-rate the corrected range is too small
        return kernels.Band(*self.bands, delay, coupling, rate * rate / spread, self.receiver == "whitening")

    def draw_world(self, rng: np.random.Generator) -> World:
        """All draws of one episode."""
        H, S = self.horizon, self.history
        return World(
            rng.random(2), rng.standard_normal((H + 1, 4)), rng.standard_normal((S + H, self.channels)),
            rng.random((len(self._kinds), DRAWS)), rng.integers(2**64, size=3, dtype=np.uint64),
        )  # fmt: skip

    def initial(self, world: World) -> State:
        """The target's path, the first estimate, and the users after ``history`` steps of listening."""
        real, count = self.truth_model, len(world.start)
        low, high = np.array([real.start_range, real.start_speed]).T
        path = random_path(real.motion, low + (high - low) * world.start, world.normal[:, 1:, :2].copy())
        mean = path[:, 0] + np.sqrt(real.prior_variance) * world.normal[:, 0, :2]
        users, places = drawn_users(self._kinds, world.kind, self.channels, real.user_power, real.duty)
        zero = np.zeros(count, np.int64)
        noise = np.ones((count, self.channels))
        own = tuple(
            (user.begin(self._own_draws(user, i, zero - 1, world), self.channels), 0.0 * noise)
            for i, user in enumerate(self._own)
        )
        late = np.ones((count, self.sensing_delay, self.channels))
        taken = np.zeros((count, 2), np.int64)
        truth = Truth(path[:, 0].copy(), path, users, places, own, taken, noise, late, zero.copy())
        covariance = np.broadcast_to(np.diag(self.prior_variance), (count, 2, 2)).copy()
        heard = np.zeros((count, self.history + self.horizon, self.channels), np.uint8)
        level = np.full((count, self.channels), FIRST_LEVEL)
        belief = Belief(
            zero, mean, covariance, heard, np.full((count, self.horizon), -1, np.int16), level, np.zeros(count)
        )
        return self._listened(State(truth, belief), world)

    def _listened(self, state: State, world: World) -> State:
        """The state after ``history`` steps in which the radar only listens; the belief's arrays change in place."""
        truth, belief = state
        none = np.full(len(belief.step), -1)
        for k in range(self.history):
            truth = self._advanced(truth, belief.step + k, world)
            noise = truth.noise * 10.0 ** (0.1 * self.truth_model.sensing * world.sensing[:, k])
            known, late = _queued(truth.late, noise)
            written = belief.heard, belief.sent, belief.level, belief.struck
            kernels.remember(
                belief.step, belief.step + k - self.sensing_delay, none, noise, known, self._band, *written
            )
            truth = truth._replace(late=late)
        return State(truth, belief)

    @cached_property
    def _kinds(self) -> tuple[str, ...]:
        return tuple(user for user in self.users if isinstance(user, str))

    @cached_property
    def _own(self) -> tuple[BandUser, ...]:
        """The user's own kinds of users."""
        return tuple(user for user in self.users if not isinstance(user, str))

    def _own_draws(self, user: BandUser, number: int, first: Array, world: World) -> Array:
        """Uniform draws (env, draws) of a user of one's own, ``first`` (env,) steps after the first of listening."""
        draws = np.empty((len(first), user.draws))
        kernels.own_draws(STREAMS * (first + 1) + number, world.key, user.draws, draws)
        return draws

    def _advanced(self, truth: Truth, first: Array, world: World) -> Truth:
        """The users one step on."""
        places, noise = np.empty_like(truth.places), np.empty_like(truth.noise)
        real = self.truth_model._radar
        kernels.users_step(first, world.key, truth.users, truth.places, truth.taken, truth.noise, real, places, noise)
        channels, own = np.arange(self.channels), []
        band = (channels >= truth.taken[:, :1]) & (channels < truth.taken[:, 1:])
        for i, (user, (state, _)) in enumerate(zip(self._own, truth.own, strict=True)):
            own.append(advanced(user, state, band, self._own_draws(user, i, first, world)))
            noise += own[-1][1]
        return truth._replace(places=places, noise=noise, own=tuple(own))

    def _remembered(self, belief: Belief, noise: Array, known: Array, action: Array) -> Belief:
        """The belief with the noise (env, channel) measured in this step and known since, and own band (env,)."""
        fresh = belief._replace(
            heard=belief.heard.copy(), sent=belief.sent.copy(), level=belief.level.copy(), struck=belief.struck.copy()
        )
        row = self.history + belief.step - self.sensing_delay
        written = fresh.heard, fresh.sent, fresh.level, fresh.struck
        kernels.remember(belief.step, row, action, noise, known, self._band, *written)
        return fresh

    def move(self, truth: Truth, step: Array, world: World) -> Truth:
        """The target along its path; the users by their own rules, which may react to the last band."""
        targets = truth.path[np.arange(len(step)), step + 1]
        return self._advanced(truth, self.history + step, world)._replace(targets=targets)

    def measure(self, truth: Truth, belief: Belief, action: Array, world: World) -> Measurements:
        """The echo of the train at the true range and noise, and the noise measured in its gaps."""
        count, band = len(belief.step), self.band_of(action)
        present, z, noise = np.empty(count, np.bool_), np.empty((count, 2)), np.empty_like(truth.noise)
        kernels.receive(
            belief.step, truth.targets, truth.noise, band, world.key, world.normal, world.sensing, self.history,
            self.truth_model._radar, self._band, present, z, noise,
        )  # fmt: skip
        return Measurements(present, z, noise, _queued(truth.late, noise)[0], np.array(band))

    def track(self, belief: Belief, action: Array, measurements: Measurements) -> Belief:
        """One step of the Kalman filter with the measured noise."""
        mean, covariance = np.empty_like(belief.mean), np.empty_like(belief.covariance)
        present, z, noise, known, band = measurements
        kernels.filtered(
            belief.mean, belief.covariance, present, z, noise, band, self._radar, self._band, mean, covariance
        )
        after = self._remembered(belief, noise, known, band)
        return after._replace(step=belief.step + 1, mean=mean, covariance=covariance)

    def annotate(self, truth: Truth, measurements: Measurements) -> Truth:
        """The channels of the band, to which users may react, the users that it overlapped, and the measured noise."""
        taken, collisions = np.empty_like(truth.taken), np.empty_like(truth.collisions)
        kernels.collide(measurements.band, truth.users, truth.places, self._band, taken, collisions)
        for _, noise in truth.own:
            collisions += ((noise > 0.0) & self.held[measurements.band]).any(axis=1)
        _, late = _queued(truth.late, measurements.noise)
        return truth._replace(taken=taken, late=late, collisions=collisions)

    @cached_property
    def _predictor(self) -> Callable[[Array, Array, Array, int], Array]:
        return predictor_of(self.predictor, self.bands)

    def occupancy(self, belief: Belief) -> Array:
        """Probability (env, channel) that each channel is occupied in the next train, by ``predictor``."""
        known = self.history + belief.step - self.sensing_delay
        return self._predictor(belief.heard, belief.sent, known, 1 + self.sensing_delay)

    def predict(self, belief: Belief, actions: Array, outcome: Array | None = None) -> Belief:
        """The belief after one band: the expectation over ``occupancy`` and the detection, or the drawn ones."""
        bands = self.band_of(actions)
        several = bands if bands.ndim == 2 else bands[:, None]
        shape = len(belief.step), several.shape[1]
        x, P, noise = np.empty((*shape, 2)), np.empty((*shape, 2, 2)), np.empty((*shape, self.channels))
        several, probability = np.broadcast_to(several, shape), self.occupancy(belief)
        given = belief.mean, belief.covariance
        if outcome is None:
            noise[:] = np.where(probability > 0.5, belief.level, 1.0)[:, None]  # what is likely, for the history
            prediction.expected(*given, probability, belief.level, several, self._radar, self._band, x, P)
        else:
            draws = np.broadcast_to(outcome if outcome.ndim == 3 else outcome[:, None], (*shape, self.channels + 1))
            noise[:] = np.where(draws[..., :-1] < probability[:, None], belief.level[:, None], 1.0)
            prediction.drawn(*given, noise, draws[..., -1].copy(), several, self._radar, self._band, x, P)
        after = self._after(belief, x, P, noise, several)
        if outcome is None:
            after = after._replace(struck=(probability[:, None] * self.held[several]).sum(axis=2))
        return after if bands.ndim == 2 else Belief(*(each[:, 0] for each in after))

    @cached_property
    def held(self) -> Array:
        """Whether each band holds each channel, (band, channel) bool."""
        first, width, channels = self.bands.first[:, None], self.bands.width[:, None], np.arange(self.channels)
        held: Array = (channels >= first) & (channels < first + width)
        return held

    def _after(self, belief: Belief, x: Array, P: Array, noise: Array, band: Array) -> Belief:
        """The beliefs (env, candidate) after bands and noise (env, candidate, ...)."""
        each = Belief(*(np.repeat(field[:, None], x.shape[1], axis=1) for field in belief))
        flat = Belief(*(field.reshape(-1, *field.shape[2:]) for field in each))
        flat_noise = noise.reshape(-1, self.channels)  # also for what becomes known of earlier steps
        flat = self._remembered(flat, flat_noise, flat_noise, band.reshape(-1))
        again = Belief(*(field.reshape(*x.shape[:2], *field.shape[1:]) for field in flat))
        return again._replace(step=each.step + 1, mean=x, covariance=P, level=each.level)

    def cost(self, belief: Belief) -> Array:
        """trace(Lambda P), and the price of the occupied channels in the last band."""
        return self.trace(belief) + self.price * belief.struck

    def trace(self, belief: Belief) -> Array:
        """trace(Lambda P)."""
        return trace_cost(belief.covariance[..., None, :, :], np.array(self.weights))

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """SNR, log deviations, measured noise and own bands of the last steps, time left."""
        steps, channels = range(1, self.history + 1), range(self.channels)
        return (
            ObservationField("snr", "dB", 20.0, 6.0, "eta at the estimated range without other users"),
            ObservationField("log10_sigma_r", "log10(m)", 0.0, 0.5, "standard deviation of range"),
            ObservationField("log10_sigma_v", "log10(m/s)", 0.0, 0.5, "standard deviation of range-rate"),
            ObservationField("time_left", "1", 0.5, 0.3, "fraction of the horizon still to come"),
            *(
                ObservationField(
                    f"noise_{k}_{c}", "dB", 10.0, 10.0, f"measured {k + self.sensing_delay} steps ago in channel {c}"
                )
                for k in steps
                for c in channels
            ),
            *(
                ObservationField(f"sent_{k}_{c}", "1", 0.5, 0.5, f"whether the band of {k} steps ago held channel {c}")
                for k in steps
                for c in channels
            ),
        )

    def observe(self, belief: Belief) -> Array:
        """See ``observation_fields``."""
        out = np.empty((len(belief.step), len(self.observation_fields)))
        kernels.observe(
            belief.mean, belief.covariance, belief.step, belief.heard, belief.sent, self.history, self.sensing_delay,
            self.horizon, self._radar, self._band, out,
        )  # fmt: skip
        return out

    def state_info(self, state: State) -> dict[str, Array]:
        """``position_error`` (m) and ``velocity_error`` (m/s), absolute; ``position_variance`` (m^2); ``nees`` of both
        (expected: 2); ``collisions`` with other users in the step; ``share`` of the spectrum that the band took.
        """
        truth, belief = state
        out = np.empty((len(FIGURES), len(belief.step)))
        kernels.figures(
            truth.targets, belief.mean, belief.covariance, belief.sent, belief.step, truth.collisions, self._share, out
        )
        return dict(zip(FIGURES, out, strict=True))

    @cached_property
    def _share(self) -> Array:
        """The share of the spectrum that each band takes, (band,)."""
        return self.bands.width / self.channels


def _queued(late: Array, noise: Array) -> tuple[Array, Array]:
    """The oldest noise (env, channel) of a queue (env, delay, channel) with ``noise`` in front, and the rest."""
    queue = np.concatenate([noise[:, None], late], axis=1)
    return queue[:, -1], queue[:, :-1]
