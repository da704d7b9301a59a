"""One agile beam that tracks dozens of targets and searches for more."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from wavegym.core import trees
from wavegym.core.action_sets import Library
from wavegym.core.arrays import Array, for_kernel
from wavegym.core.errors import InputError, check_within
from wavegym.core.parameters import Count, Positive, parameter, system_parameters
from wavegym.core.system import ObservationField, State, System
from wavegym.core.track_loss import LOST_AFTER, NO_TRACK_YET
from wavegym.core.traits import DwellRule, TimedPulses, TrackSlots, UnequalSteps
from wavegym.systems.multifunction_radar import step_kernels as kernels
from wavegym.systems.multifunction_radar.actions import Dwells, Train
from wavegym.systems.multifunction_radar.area_kernels import Area, usual_number
from wavegym.systems.multifunction_radar.beam_kernels import FINEST, SLOPE, Beam, Look
from wavegym.systems.multifunction_radar.dwell_kernels import Laws
from wavegym.systems.multifunction_radar.flight_kernels import Flight, begin_all, fly_all
from wavegym.systems.multifunction_radar.gain_kernels import settle
from wavegym.systems.multifunction_radar.looks import Receiver, share_kept
from wavegym.systems.multifunction_radar.search_flow import Search, best_search
from wavegym.systems.multifunction_radar.state import PARTS, Belief, Traffic, Truth, World, flying, take_figures
from wavegym.systems.multifunction_radar.step_kernels import Menu, Real
from wavegym.systems.multifunction_radar.track_kernels import Modes
from wavegym.waveforms import SPEED_OF_LIGHT, PulseTiming, check_range_folds

COLUMNS = 10  # of ``slots_now``
LOGARITHMS = [3, 4, 5, 7, 8, 9]  # columns of ``slots_now`` that agents observe as log2
TINY = 1e-12
FEW = 1.0 / 64.0  # least observed ratio of undetected targets to their number without any search
STEPS = 400  # of the table of shares kept
REFERENCE = DwellRule()  # of the time before an episode: the greatest gain per second
SEARCH_SHARE = 0.5  # of the time, for the value of a find
DRAWS = 2  # uniform draws that decide one dwell in ``predict``

Speed = Annotated[float, Field(gt=0, le=1e4)]
Acceleration = Annotated[float, Field(ge=0, le=1e3)]
Section = Annotated[float, Field(ge=1e-6, le=1e6)]
Rate = Annotated[float, Field(ge=1e-6, le=100)]
Spread = Annotated[float, Field(ge=1e-3, le=1e4)]


@system_parameters
class MultifunctionRadar(System, UnequalSteps, TrackSlots, TimedPulses):
    """One agile-beam radar tracks dozens of targets and searches for more, one dwell at a time.

    Description
        An action is the next dwell: update a track, search a sector, or wait. Updates and searches send one of several
        trains: ``bursts``, each of a number of ``pulses``. The mask excludes updates of slots without a track; if such
        an action is taken, the radar waits (metric ``replaced``). Dwells differ in duration, and targets move during
        each.

        An update points at the predicted azimuth. The gain falls with the pointing error, so a late update misses, and
        a track can be lost. A search points at the next beam of its sector, with its energy spread over several
        elevations. A detection that no track explains begins a tentative track, which later dwells confirm or refute.

        The antenna is a planar array: away from straight ahead its beam broadens and its gain falls. Within a burst the
        pulses are summed in Doppler filters. An accelerating target spreads over several of them. The powers of bursts
        are added (Swerling 2). Each filter has its false alarms. The radar measures range, azimuth (a monopulse, biased
        and less precise off the axis) and range-rate modulo a fold. It has no clutter.

        Targets cross the region on all sides and manoeuvre: a Markov chain switches between two limits of acceleration.
        Their cross sections differ. Each track is an IMM of two white accelerations with a probability of existence and
        of each class of cross section. The belief also holds the intensity of targets without a track. The radar is
        overloaded: it could spend all its time on search. A tracker of your own does not fit: its estimate has a fixed
        number of targets and no probabilities of existence.

    Rewards
        -c, the cost of the dwell: the integral over its duration of the expected squared GOSPA distance, in m^2 s.
        Every undetected target costs c0. A track with existence probability e and position covariance P costs e tr P +
        (1 - e) c0 if it is reported and e c0 if it is not. It is reported if that costs less. With ``priority`` nearer
        targets weigh more.

    Starting state
        The traffic is in equilibrium, and so is the radar: for ``settled`` seconds before the episode it has chosen the
        dwell of the greatest gain per second. When these seconds begin, each target has a track with probability
        ``known``, with a first estimate drawn around the truth.

    Episode end
        Truncated by the first dwell that ends at ``seconds`` or later, or after ``horizon`` dwells.

    References
        G. van Keuk and S. S. Blackman, "On phased-array radar tracking and parameter control", IEEE Transactions on
        Aerospace and Electronic Systems 29 (1993) 186-194 (updates by the predicted angular error, loss by the pointing
        error). This suite adds load, existence and search.
    """

    terminates: ClassVar[bool] = False
    strict: ClassVar[bool] = False

    horizon: int = parameter(50_000, "maximum number of dwells in an episode", ge=1, le=1_000_000)
    seconds: float = parameter(60.0, "length of an episode", unit="s", ge=1e-3, le=3600)
    targets: float = parameter(
        16.0,
        "expected number of targets in the region, in the world and in the search's prior",
        truth=True,
        ge=0,
        le=500,
    )
    settled: float = parameter(
        4.0, "time before the episode in which a rule chooses the dwells", unit="s", ge=0, le=1000
    )
    known: float = parameter(0.8, "share of the targets at the start of this time that have a track", ge=0, le=1)
    first_errors: tuple[Spread, Spread] = parameter(
        (100.0, 30.0),
        "standard deviations of the first estimates in position and velocity, on each axis",
        unit="m, m/s",
    )
    tracker: Literal["imm"] = parameter("imm", "the tracker of the description", unit="")
    slots: Count = parameter(64, "maximum number of tracks", le=1000)
    sectors: Count = parameter(12, "number of search sectors", le=360)
    bins: Count = parameter(7, "number of range bins of the intensity of undetected targets", le=100)
    nearest: float = parameter(5e3, "minimum range of the region", unit="m", ge=100, le=1e6)
    farthest: float = parameter(30e3, "maximum range of the region", unit="m", ge=100, le=1e6)
    half_sector: float = parameter(60.0, "maximum azimuth of the region, on either side", unit="deg", ge=1, le=80)
    speeds: tuple[Speed, Speed] = parameter((100.0, 300.0), "minimum and maximum speed", unit="m/s", truth=True)
    acceleration: tuple[Acceleration, Acceleration] = parameter(
        (8.0, 60.0), "maximum acceleration of each mode, uniform in a disc", unit="m/s^2", truth=True
    )
    leave: tuple[Rate, Rate] = parameter((0.05, 0.2), "rate at which a target leaves each mode", unit="1/s", truth=True)
    sections: tuple[Section, ...] = parameter(
        (0.01, 0.03, 0.1),
        "mean radar cross section of each class of targets; all classes are equally frequent",
        unit="m^2",
        truth=True,
        min_length=1,
    )
    cell: float = parameter(0.2, "time between changes of a target's acceleration", unit="s", ge=1e-3, le=1)
    carrier_hz: float = parameter(5.6e9, "carrier frequency", unit="Hz", gt=0)
    pulse: float = parameter(30e-6, "duration of a pulse", unit="s", gt=0)
    interval: float = parameter(320e-6, "time between two pulses", unit="s", gt=0)
    pulses: tuple[Count, ...] = parameter((16, 48, 128, 32), "numbers of pulses of a burst, by dwell", min_length=1)
    bursts: tuple[Count, ...] = parameter((1, 1, 1, 4), "numbers of bursts, by dwell", min_length=1)
    overhead: float = parameter(1e-3, "time to steer and set up before each dwell", unit="s", ge=0, le=1)
    dt: float = parameter(5e-3, "duration of a wait; other steps take as long as their dwells", unit="s", gt=0, le=1)
    beam_width: float = parameter(
        1.5, "half-power width of the beam straight ahead, one way", unit="deg", truth=True, ge=0.1, le=10
    )
    elevations: Count = parameter(
        4, "receive beams in elevation that a search forms at once, over which it spreads its energy", le=100
    )
    reference_range: float = parameter(
        160e3,
        "range at which a burst of 10 ms at 1 m^2 has E/N0 = 1 on the beam's axis, straight ahead",
        unit="m",
        truth=True,
        ge=100,
        le=1e8,
    )
    range_cell: float = parameter(150.0, "range resolution", unit="m", ge=0.1, le=1e4)
    false_alarms: tuple[Positive, Positive] = parameter(
        (0.01, 0.05), "expected false alarms of a dwell over all cells, in an update and in a search"
    )
    gate: float = parameter(25.0, "squared Mahalanobis distance of the gate", ge=1, le=1e3)
    dropped: float = parameter(0.05, "existence probability below which a track is dropped", ge=0, lt=0.5)
    c0: float = parameter(1e4, "cost of a target that is not reported, per second", unit="m^2", ge=1, le=1e12)
    priority: float = parameter(
        1.0,
        "weight of the cost of a target at the nearest range; falls linearly with range to 1 at the farthest",
        ge=1,
        le=100,
    )
    sample: float = parameter(0.6, "time between two evaluations of the metrics by truth", unit="s", gt=0, le=10)

    def __post_init__(self) -> None:
        """Check several fields together."""
        if not self.nearest < self.farthest:
            raise InputError(f"farthest is {self.farthest!r} m, expected more than nearest, {self.nearest!r} m")
        if self.speeds[0] > self.speeds[1]:
            raise InputError(f"speeds is {self.speeds}, expected the least first (nearest: {self.speeds[::-1]})")
        for name, value in zip(("false_alarms.0", "false_alarms.1"), self.false_alarms, strict=True):
            check_within(name, value, 1e-9, 1.0)
        if len(self.bursts) != len(self.pulses):
            raise InputError(f"bursts is {self.bursts}, expected a number for each of the pulses {self.pulses}")
        if len({train.label for train in self.trains}) < len(self.trains):
            raise InputError(f"pulses is {self.pulses}, expected no two dwells alike")
        self._check_sectors()
        check_range_folds(self.timings, self.farthest)
        blind = max(timing.blind_range for timing in self.timings.values())
        check_within("nearest", self.nearest, blind, self.farthest, "m")
        longest = max(self.dwells.seconds) + self.overhead
        if longest > self.sample:
            raise InputError(
                f"sample is {self.sample!r} s, expected the longest dwell or more (nearest: {longest:.6g})"
            )

    def _check_sectors(self) -> None:
        """Each sector is as wide as a beam or wider; the outer ones are the narrowest in the sine of the azimuth."""
        most = self.sectors
        while most > 1 and np.diff(_edges(self.half_sector, most))[0] < self.beam.width:
            most -= 1
        if most < self.sectors:
            raise InputError(f"sectors is {self.sectors}, expected each as wide as a beam or wider (nearest: {most})")

    # --- derived from the parameters ---

    @property
    def timings(self) -> dict[str, PulseTiming]:
        """A burst of each number of pulses."""
        return {
            f"{count} pulses": PulseTiming(
                duration=self.pulse, carrier_hz=self.carrier_hz, interval=self.interval, count=count
            )
            for count in self.pulses
        }

    @property
    def wavelength(self) -> float:
        """Of the carrier, m."""
        return SPEED_OF_LIGHT / self.carrier_hz

    @property
    def duration_means(self) -> str:
        """See ``TimedPulses``."""
        return "A pulse lasts for `pulse`, and is of constant power."

    def target_ranges(self, world: World) -> Array:
        """Of every present target at each second, all worlds in one row, (1, n, 2)."""
        truth, flight = self._traffic_before(world), self.truth_model.flight
        fly_all(world.key, truth.arrival, truth.cell[0], 0, flying(truth), flight)
        x, found, cells = truth.state, [], round(1.0 / self.cell)
        for second in range(math.ceil(self.seconds)):
            r = np.hypot(x[..., 0], x[..., 2])
            found.append(np.stack([r, (x[..., 0] * x[..., 1] + x[..., 2] * x[..., 3]) / r], axis=-1)[truth.here])
            begin = second * cells
            fly_all(world.key, truth.arrival, begin, begin + cells, flying(truth), flight)
        return np.concatenate(found)[None]

    @cached_property
    def trains(self) -> tuple[Train, ...]:
        """The pulses of each dwell."""
        return tuple(Train(*each, self.interval) for each in zip(self.pulses, self.bursts, strict=True))

    @cached_property
    def dwells(self) -> Dwells:
        """The dwells and their purposes."""
        return Dwells(self.trains, self.overhead, self.dt, self.slots, self.sectors)

    @property
    def receiver(self) -> Receiver:
        """How echoes are judged."""
        return Receiver(
            self.wavelength, self.farthest - self.nearest, self.range_cell, self.acceleration, self.elevations,
            self.false_alarms
        )  # fmt: skip

    @cached_property
    def menu(self) -> Menu:
        """All actions."""
        return self.receiver.menu(self.dwells, self.laws, self.bins)

    @cached_property
    def value_of_find(self) -> Array:
        """What a find saves until the target would have been found anyway or has left, in s of c0; (beam, bin, class).

        Where half of the time is searched as well as possible. The track's own cost and time are not subtracted.
        """
        return self.best_search(SEARCH_SHARE).value

    def best_search(self, share: float) -> Search:
        """The equilibrium of least cost if a share of the time is searched."""
        durations = np.array(self.dwells.seconds) + self.overhead
        return best_search(self.area, self.menu.covers, durations, share)

    def worths(self, worth: float = REFERENCE.worth, powers: ArrayLike = REFERENCE.power) -> Array:
        """``worth`` times powers (h,) of the value of a find, (h, beam, bin, class); by default the reference's."""
        found: Array = worth * self.value_of_find ** np.reshape(powers, (-1, 1, 1, 1))
        return found

    @property
    def actions(self) -> Library:
        """Updates slot by slot, then searches sector by sector, each with every dwell, then the wait."""
        return self.dwells.library

    @cached_property
    def traffic(self) -> Traffic:
        """How targets come."""
        return Traffic(
            self.nearest, self.farthest, math.radians(self.half_sector), self.targets, self.speeds[0], self.speeds[1]
        )

    @cached_property
    def modes(self) -> Modes:
        """The motion model."""
        low, high = (0.25 * limit * limit * self.cell for limit in self.acceleration)  # of an axis of the disc
        return Modes((low, high), self.leave)

    @cached_property
    def beam(self) -> Beam:
        """The radar's numbers."""
        return Beam(
            width=math.sin(math.radians(self.beam_width)),
            reference=self.reference_range,
            range_error=self.range_cell / SLOPE,
            fold=0.5 * self.wavelength / self.interval,
            kept=share_kept(FINEST * np.arange(STEPS)),
            sections=np.array(self.sections),
            nearest=self.nearest,
            farthest=self.farthest,
            gate=self.gate,
        )

    @cached_property
    def area(self) -> Area:
        """The region, and how undetected targets move in it."""
        traffic = self.traffic
        flow = traffic.mean_speed / math.pi
        edges = _edges(self.half_sector, self.sectors)
        beams = np.ceil(np.diff(edges) / self.beam.width - 1e-9).astype(np.int64)  # of each sector
        first = np.append(0, np.cumsum(beams))
        edges = np.interp(np.arange(first[-1] + 1), first, edges)
        return Area(
            half_sector=traffic.half_sector,
            nearest=self.nearest,
            farthest=self.farthest,
            first=first,
            edges=edges,
            angle=np.diff(np.arcsin(edges)),
            traffic=traffic.density,
            radial=flow / ((self.farthest - self.nearest) / self.bins),
            lateral=flow,
            dropped=self.dropped,
            speed=math.sqrt(traffic.velocity_variance),
            priority=self.priority,
        )

    @cached_property
    def flight(self) -> Flight:
        """How targets fly."""
        return Flight(
            self.cell, self.acceleration, self.leave, *self.speeds, self.nearest, self.farthest,
            math.radians(self.half_sector)
        )  # fmt: skip

    @cached_property
    def laws(self) -> Laws:
        """What the tracker assumes."""
        return Laws(self.modes, self.beam, self.area, self.c0)

    # --- the loop ---

    def draw_world(self, rng: np.random.Generator) -> World:
        """All random numbers of one episode."""
        most = self.truth_model.traffic.most_targets(self.settled + self.seconds)
        key = rng.integers(0, 2**63, dtype=np.uint64)
        return World(np.asarray(key), rng.random((most, 8)), rng.standard_normal((most, 4)))

    def _traffic_before(self, world: World) -> Truth:
        """Traffic in equilibrium, ``settled`` seconds before the episode."""
        x, arrival = self.truth_model.traffic.states(world.draw)
        here, arrival = arrival < 0.0, arrival - self.settled
        first, second = self.truth_model.leave
        mode = (world.draw[..., 5] < first / (first + second)).astype(np.int64)
        section = (world.draw[..., 7] * len(self.truth_model.sections)).astype(np.int64)
        count, slots = len(here), self.slots
        none = np.zeros(count)
        begun = Truth(
            state=x, acceleration=np.zeros((*here.shape, 2)), mode=mode, here=here, section=section,
            cell=np.full(count, math.floor(-self.settled / self.cell)), looks=np.zeros(here.shape, np.int64),
            origin=np.full((count, slots), -1), arrival=arrival, astray=np.full(here.shape, NO_TRACK_YET),
            confirmed=np.full(here.shape, np.nan), false=none,
            square_gospa=np.zeros((count, len(PARTS))), squared_error=np.zeros((count, slots)),
            variance=np.zeros((count, slots)), nees=np.zeros((count, slots)),
            replaced=np.zeros(count, np.bool_), present=np.zeros((count, slots), np.bool_),
        )  # fmt: skip
        begin_all(world.key, begun.cell, flying(begun), self.truth_model.flight)
        return begun

    def initial(self, world: World) -> State:
        """After ``settled`` seconds of the reference rule."""
        truth, count = self._traffic_before(world), len(world.key)
        belief = self._nothing_seen(count)
        belief.undetected[:] *= 1.0 - self.known
        known, variance = world.draw[..., 6] < self.known, np.square(self.first_errors)
        first = truth.state, truth.here, known, world.error
        kernels.first_tracks(*first, self.modes, variance, belief, truth.origin)
        settle(self._real(truth, world), belief, self.menu, self.laws, REFERENCE, self.worths())
        take_figures(truth, belief, np.arange(count), self.truth_model.flight, self.laws, self.lost_beyond)
        return State(truth, belief)

    @cached_property
    def usual_numbers(self) -> Array:
        """Targets of all classes in a cell without any search, (beam, bin)."""
        shape = len(self.area.angle), self.bins, 1
        return np.array([[usual_number(i, b, shape, self.area) for b in range(self.bins)] for i in range(shape[0])])

    def by_sector(self, numbers: Array) -> Array:
        """Sums (..., sector, bin) over the beams of each sector, of numbers (..., beam, bin)."""
        return np.add.reduceat(numbers, self.area.first[:-1], axis=-2)

    def _nothing_seen(self, count: int) -> Belief:
        slots, classes = self.slots, len(self.sections)
        return Belief(
            step=np.zeros(count, np.int64), time=np.full(count, -self.settled),
            updated=np.full((count, slots), -self.settled),
            mean=np.zeros((count, slots, 2, 4)), covariance=np.zeros((count, slots, 2, 4, 4)),
            probability=np.full((count, slots, 2), 0.5), existence=np.zeros((count, slots)),
            section=np.full((count, slots, classes), 1.0 / classes), moments=np.zeros((count, slots, 10)),
            undetected=np.tile(self.usual_numbers[:, :, None] / classes, (count, 1, 1, classes)),
            turn=np.zeros((count, self.sectors), np.int64), spent=np.zeros((count, 3)), duration=np.zeros(count),
        )  # fmt: skip

    def transition(self, state: State, action: Array, world: World) -> State:
        """One dwell."""
        truth, belief = trees.copied(state)
        kernels.advance(self._real(truth, world), belief, action, self.menu, self.laws)
        truth.replaced[:] = ~self.mask(state.belief)[np.arange(len(action)), action]
        due = np.flatnonzero(belief.time // self.sample > state.belief.time // self.sample)
        if len(due):
            take_figures(truth, belief, due, self.truth_model.flight, self.laws, self.lost_beyond)
        return State(truth, belief)

    def _real(self, truth: Truth, world: World) -> Real:
        """For kernels, which change the truth."""
        model = self.truth_model
        return Real(
            world.key, flying(truth), truth.arrival, truth.section, truth.cell, truth.looks, truth.origin,
            model.flight, model.beam
        )  # fmt: skip

    @property
    def outcome_shape(self) -> tuple[int, ...]:
        """Uniform draws of a dwell: of its detection, and of the power of its echo."""
        return (DRAWS,)

    def predict(self, belief: Belief, actions: Array, outcome: Array | None = None) -> Belief:
        """The belief after a dwell; see ``System.predict``.

        Expected, the covariance of an updated track is the mean of that with a detection and that without, and a search
        changes nothing but the time. With draws, a search begins one track at most, and meets no track that exists.
        """
        if actions.ndim == 1:
            return self._predict_one(trees.copied(belief), actions, outcome)
        shape = len(belief.step), actions.shape[1]
        rows = np.broadcast_to(actions, shape).reshape(-1)
        if outcome is not None:
            outcome = np.broadcast_to(outcome, (*shape, DRAWS)).reshape(-1, DRAWS)
        after = self._predict_one(trees.repeated(belief, shape[1]), rows, outcome)
        made: Belief = trees.tree_map(lambda leaf: leaf.reshape(shape + leaf.shape[1:]), after)
        return made

    def _predict_one(self, belief: Belief, actions: Array, outcome: Array | None) -> Belief:
        """``predict`` of one action for each environment; changes the belief."""
        draws = np.zeros((len(actions), 0)) if outcome is None else for_kernel(outcome)
        kernels.foresee(belief, for_kernel(actions), draws, self.menu, self.laws)
        return belief

    def cost(self, belief: Belief) -> Array:
        """The cost of the last dwell, m^2 s."""
        cost: Array = belief.spent.sum(axis=-1)
        return cost

    def duration(self, belief: Belief) -> Array:
        """Length of the last dwell, s."""
        return belief.duration

    def slots_now(self, belief: Belief) -> Array:
        """See ``TrackSlots``."""
        out = np.empty((*belief.existence.shape, COLUMNS))
        kernels.describe_slots(belief, self._second, self.value_of_find, self.laws, out)
        return out

    @cached_property
    def _second(self) -> Look:
        """A look of a second of transmission."""
        return self.receiver.look(Train(round(1.0 / self.interval), 1, self.interval), searching=False)

    def terminal(self, belief: Belief) -> Array:
        """Whether the time, or the number of dwells, is over, (env,) bool."""
        over: Array = (belief.time >= self.seconds) | (belief.step >= self.horizon)
        return over

    def mask(self, belief: Belief) -> Array:
        """Updates of slots with a track, all searches, and the wait, (env, action) bool."""
        return self.dwells.mask(belief.existence > 0.0)

    # --- for agents and evaluation ---

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The rows of the slots, then undetected targets of every sector and bin over their number without search."""
        half = 0.5 * (self.nearest + self.farthest)
        columns = (
            ("existence", "1", 0.5, 0.5, "probability of existence; 0: the slot is free"),
            ("range", "m", half, 0.5 * half, "range"),
            ("azimuth", "rad", 0.0, 0.5 * self.traffic.half_sector, "azimuth, clockwise from the middle"),
            ("pointing", "1", -3.0, 2.0, "log2 of the azimuth's standard deviation in beam widths"),
            ("position", "1", 6.0, 2.0, "log2 of the position's standard deviation in m"),
            ("velocity", "1", 5.0, 2.0, "log2 of the velocity's standard deviation at the last update in m/s"),
            ("age", "s", 1.0, 1.0, "time since the last update"),
            ("density", "1", 4.5, 2.0, "log2 of the expected density of the acceleration in m^2/s^3"),
            ("snr", "1", 14.0, 3.0, "log2 of E/N0 of a second of transmission"),
            ("value", "s", 2.0, 2.0, "log2 of the value of a find at its place in s"),
        )
        slots = [
            ObservationField(f"{name}_{k}", unit, centre, scale, f"slot {k}: {meaning}")
            for k in range(self.slots)
            for name, unit, centre, scale, meaning in columns
        ]
        about = "log2 of the undetected targets over their number without any search, at least 1/64"
        cells = [
            ObservationField(f"undetected_{s}_{b}", "1", -2.0, 2.0, f"sector {s}, bin {b}: {about}")
            for s in range(self.sectors)
            for b in range(self.bins)
        ]
        return (*slots, *cells)

    @cached_property
    def _centres(self) -> Array:
        """Of the columns of a slot after its existence."""
        return np.array([field.centre for field in self.observation_fields[1:COLUMNS]])

    def observe(self, belief: Belief) -> Array:
        """See ``observation_fields``; what a free slot does not have is at the field's centre."""
        rows = self.slots_now(belief)
        taken = rows[..., 0] > 0.0
        own = rows[taken]
        own[:, LOGARITHMS] = np.log2(np.maximum(own[:, LOGARITHMS], TINY))
        rows[..., 1:] = self._centres
        rows[taken] = own
        number, usual = self.by_sector(belief.undetected.sum(axis=-1)), self.by_sector(self.usual_numbers)
        share = np.log2(np.clip(number / np.maximum(usual, TINY), FEW, None))
        return np.concatenate([rows.reshape(len(rows), -1), share.reshape(len(rows), -1)], axis=1)

    @property
    def nees_dimension(self) -> int:
        """Elements of a state."""
        return 4

    @property
    def lost_beyond(self) -> float:
        """Width of the beam in the middle of the region, m: a beam that points at the estimate misses the target."""
        return math.radians(self.beam_width) * 0.5 * (self.nearest + self.farthest)

    def state_info(self, state: State) -> dict[str, Array]:
        """Figures by truth, evaluated every ``sample`` seconds and held in between.

        For each slot: ``present`` (a confirmed track within ``lost_beyond`` of a target, the one whose echo it has used
        last), and of these ``position_error`` (m), ``position_variance`` (m^2) and ``nees``. For all:
        ``gospa`` (m) of the reported tracks, and the parts of its square (m^2): ``gospa_unfound``, targets without a
        track that have never had a confirmed one, ``gospa_lost``, other targets without a track, ``gospa_false``,
        tracks without a target, and ``gospa_error``, the squared errors of the others; ``lost``, the number of targets
        lost (after five samples astray in a row, in place of steps); ``false_tracks``, other confirmed tracks;
        ``targets``, the number present; ``confirm_delay`` (s), mean time from arrival to the first confirmed track so
        far, over targets without a track at the start. For the dwell:
        ``duration`` (s); whether it was ``replaced`` by a wait; and its cost (m^2 s) by ``cost_undetected``,
        ``cost_tentative`` and ``cost_confirmed``.
        """
        truth, belief = state
        known = truth.confirmed > 0.0  # no NaN, and no track from the beginning
        delay = np.where(known, truth.confirmed - np.maximum(truth.arrival, -self.settled), 0.0).sum(axis=1)
        return {
            "duration": belief.duration.copy(),
            "position_error": np.sqrt(truth.squared_error),
            "position_variance": truth.variance.copy(),
            "nees": truth.nees.copy(),
            "present": truth.present.copy(),
            "gospa": np.sqrt(truth.square_gospa.sum(axis=1)),
            **{f"gospa_{part}": truth.square_gospa[:, n].copy() for n, part in enumerate(PARTS)},
            "cost_undetected": belief.spent[:, kernels.UNDETECTED].copy(),
            "cost_tentative": belief.spent[:, kernels.TENTATIVE].copy(),
            "cost_confirmed": belief.spent[:, kernels.CONFIRMED_TRACKS].copy(),
            "lost": (truth.astray >= LOST_AFTER).sum(axis=1),
            "false_tracks": truth.false.copy(),
            "targets": truth.here.sum(axis=1),
            "replaced": truth.replaced.copy(),
            "confirm_delay": delay / np.maximum(known.sum(axis=1), 1),
        }


def _edges(half_sector: float, sectors: int) -> Array:
    """Sines of the azimuths of the sectors' edges; half_sector in degrees."""
    return np.sin(np.radians(half_sector) * np.linspace(-1.0, 1.0, sectors + 1))
