"""A street radar that must choose: ``Urban`` with two streets. A scan illuminates one, both at half energy, or none.

A trial of what a planner gains with such a choice; not an environment of the suite. See ``street_trial.py``.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from street_kernels import foresee, measure, move

from wavegym.core import shortcuts
from wavegym.core.action_sets import Library
from wavegym.core.parameters import changed_default, parameter, system_parameters
from wavegym.core.system import ObservationField, State
from wavegym.systems.urban import kernels
from wavegym.systems.urban.scan_kernels import scan
from wavegym.systems.urban.state import Belief as UrbanBelief
from wavegym.systems.urban.state import Measurements, make_scene
from wavegym.systems.urban.system import Urban
from wavegym.systems.urban.tracker import CONFIRMED, EMPTY, Tracks
from wavegym.targets import ScriptedPath, Segment
from wavegym.trackers import gospa
from wavegym.waveforms import PulseTrain, measurement_covariances

LANES, SPEEDS, ENTRIES = (70.0, -70.0), (6.0, 8.0, 10.0), (-140.0, -110.0, -80.0)  # m, m/s, m: of the drawn routes
HANDED_OVER = (3.0, 3.0, 1.0, 1.0)  # standard deviations of the first estimate of (x, y, xdot, ydot)
FIRST, LIVE = (
    0.95,
    0.9995,
)  # existence of a new track; probability that a vehicle is still there a scan later
NOBODY = 1e-9  # gate probability of a scan without a pulse: no detection is expected
CHOICES = {"time": ((0, 1), (1, 1), (2, 2)), "revisit": ((0, 1), (1, 1)), "energy": ((2, 1), (3, 0))}
"""Of each kind: (streets lit: the first, the second, both, none; trains' divisor, 0 for silence) of each action."""


class World(NamedTuple):
    """One episode's tape."""

    key: Any  # () uint64
    route: Any  # (vehicle,)
    start: Any  # (vehicle, 4) normal: error of the first estimate


class Belief(NamedTuple):
    """The tracks, the beam's street, scans left of its turn, and energy in whole trains; axis 0 = environment."""

    step: Any
    x: Any
    P: Any
    mu: Any
    existence: Any
    status: Any
    age: Any
    refused: Any
    pointed: Any
    dead: Any
    energy: Any


class StreetTruth(NamedTuple):
    """The vehicles (env, vehicle, 6) and their routes (env, vehicle)."""

    targets: Any
    route: Any


@system_parameters
class Street(Urban):
    """Two streets on both sides of a square: a vehicle that is not observed now may soon be hidden, and be lost.

    Description
        The radar of ``Urban`` in the middle of a square. Two vehicles drive in each street, and kiosks hide them at
        intervals; an induction loop has detected them first. ``kind`` is the choice of a scan: "time": one street with
        the whole train, or both with half a train each; "revisit": one of the streets; "energy": both streets or
        silence, from an account of ``budget`` trains a scan. ``dead_scans`` is the time in which a beam on a mount
        turns to the other street.

    Rewards
        As wavegym/Urban-v0.

    Starting state
        A confirmed track for each vehicle, drawn around the truth.

    Episode end
        Terminates after ``horizon`` scans.

    References
        As wavegym/Urban-v0; the streets are a trial of this suite.
    """

    kind: str = parameter("revisit", 'the choice: "time", "revisit" or "energy"', unit="")
    dead_scans: int = parameter(0, "scans without a pulse while the beam turns to the other street", ge=0)
    budget: float = parameter(0.25, "trains a scan that the account of kind 'energy' holds", gt=0)
    horizon: int = changed_default(Urban, "horizon", 80)
    city: str = changed_default(Urban, "city", str(Path(__file__).parent / "square.toml"))
    transmitters: Any = changed_default(Urban, "transmitters", ((0.0, 0.0),))
    receivers: Any = changed_default(Urban, "receivers", ((5.0, 3.0), (-5.0, -3.0)))
    arrivals: Any = changed_default(Urban, "arrivals", (0.0, 0.0, 0.0, 0.0))
    charged: int = changed_default(Urban, "charged", 4)
    tracker: Any = changed_default(Urban, "tracker", "ncv")

    @cached_property
    def actions(self) -> Library:
        """Of CHOICES."""
        names, shares = ("street 1", "street 2", "both streets", "silence"), ("", "", ", half a train each")
        return Library(tuple(names[lit] + shares[share] for lit, share in CHOICES[self.kind]))

    @cached_property
    def scene(self) -> Any:
        """All routes, as the targets of one scene: straight, right of the centre line."""
        scenes, times = [], self.dt * np.arange(self.horizon + 1)
        for lane in LANES:
            for way in (1.0, -1.0):
                for v in SPEEDS:
                    for x in ENTRIES:
                        path = ScriptedPath((way * x, lane - way * 3.5), (way * v, 0.0), [Segment(1.0, 0.0, 0.0)])
                        scenes.append(make_scene(self.map, self.pairs, path, (0.0,), times))
        most = max(one.path_index.shape[3] for one in scenes)

        def joined(name: str, axis: int) -> Any:
            """One field of all scenes, its paths padded to one length."""
            parts = [getattr(one, name) for one in scenes]
            if name in ("path_index", "reflected"):
                parts = [np.pad(a, [(0, 0)] * 3 + [(0, most - a.shape[3])]) for a in parts]
            return np.concatenate(parts, axis=axis)

        return scenes[0]._replace(
            truth=joined("truth", 1), path_count=joined("path_count", 2), path_index=joined("path_index", 2),
            reflected=joined("reflected", 2),
        )  # fmt: skip

    @cached_property
    def _law(self) -> tuple[Any, Any]:
        """Covariance at unit SNR (divisor, 2, 2) and SNR at 100 m (divisor,) of silence, a train and half a train."""
        chirp = self.library.entries[0].pulse
        trains = [PulseTrain(chirp, count=self.pulses // share, interval=self.interval) for share in (1, 2)]
        own = measurement_covariances(Library(tuple(trains)), self.carrier)
        return own[[0, 0, 1]], self.reference_snr * np.array([0.0, 1.0, 0.5])

    @cached_property
    def _lit(self) -> list[Any]:
        """The tracker's constants if the first, the second, both or no streets are lit."""
        known = self.urban_tracker.constants._replace(survival=LIVE)
        north = known.corner[1] + known.cell * (np.arange(known.out_visible.shape[2]) + 0.5) > 0.0
        sides = (north, ~north, north | True, north & False)
        own = [known._replace(out_visible=known.out_visible & side[:, None]) for side in sides]
        return [*own[:3], own[3]._replace(gate_probability=NOBODY)]

    def mask(self, belief: Any) -> Any:
        """Only silence if the account is empty."""
        if self.kind != "energy":
            return np.ones((*np.shape(belief.step), len(self.actions)), np.bool_)
        return np.stack([belief.energy >= 1.0, belief.energy >= 0.0], axis=-1)

    def _sent(self, belief: Any, action: Any) -> tuple[Any, Any, Any, Any]:
        """Streets lit, divisor, and the settings after the step: pointed, dead."""
        lit, share = np.array(CHOICES[self.kind])[np.asarray(action)].T
        turns = (lit < 2) & (lit != belief.pointed)
        dead = np.where(turns, self.dead_scans, belief.dead)
        quiet = (dead > 0) | (share == 0)
        lit, share = np.where(quiet, 3, lit), np.where(quiet, 0, share)
        return lit, share, np.where(turns, np.asarray(action), belief.pointed), np.maximum(dead - 1, 0)

    def draw_world(self, rng: np.random.Generator) -> World:
        """Two routes in each street."""
        n, each = len(self.arrivals), len(SPEEDS) * len(ENTRIES) * 2
        street = each * (np.arange(n) % 2)
        key = np.asarray(rng.integers(2**64, dtype=np.uint64))
        return World(key, street + rng.integers(each, size=n), rng.standard_normal((n, 4)))

    def initial(self, world: World) -> State:
        """Vehicles on their routes, and a confirmed track of each."""
        count, n = world.route.shape
        targets, tracks = self.scene.truth[0][world.route], self.urban_tracker.empty(count)
        tracks.x[:, :n, :, :4] = (targets[..., :4] + np.array(HANDED_OVER) * world.start)[:, :, None]
        tracks.P[:, :n] = np.diag((*np.square(HANDED_OVER), self.sigma**2, self.sigma**2))
        tracks.existence[:, :n], tracks.status[:, :n], tracks.age[:, :n] = FIRST, CONFIRMED, 8
        zero = np.zeros(count, np.int64)
        belief = Belief(zero, *tracks, zero - 1, zero.copy(), np.full(count, self.budget * self.horizon))
        return State(StreetTruth(targets, world.route), belief)

    def move(self, truth: Any, step: Any, world: World) -> Any:
        """As ``Urban``, each vehicle on its own route."""
        after = np.empty(truth.targets.shape)
        move(
            world.key, step + 1, truth.targets, self.scene.truth, truth.route, *self._deviation, self.sigma, after
        )  # fmt: skip
        return truth._replace(targets=after)

    def measure(self, truth: Any, belief: Any, action: Any, world: World) -> Measurements:
        """Detections in the lit streets, and clutter while anything is sent."""
        lit, share, _, _ = self._sent(belief, action)
        found, (wave, snr) = self._no_measurements(len(lit)), self._law
        street = truth.route // (len(self.scene.truth[0]) // 2)
        shown = (lit[:, None] == 2) | (lit[:, None] == street)
        measure(
            world.key, belief.step + 1, truth.targets, truth.route, shown, self.scene, self._sensor_law, wave[share],
            snr[share], *found,
        )  # fmt: skip
        return found

    def _of_pairs(self, share: Any) -> tuple[Any, Any]:
        """Covariance and SNR of every pair; silence has those of a train, which no measurement uses."""
        wave, snr = self._law
        each = np.repeat(np.maximum(share, 1)[:, None], len(self.pairs), axis=1)
        return wave[each], snr[each]

    def annotate(self, truth: Any, measurements: Measurements) -> Any:
        """The truth itself: ``state_info`` reports no figures of the scan."""
        return truth

    def _groups(self, leaves: list[Any], lit: Any, share: Any, update: Any) -> list[Any]:
        """The tracks after ``update(part, constants, rows)`` of the environments that light the same streets."""
        after = [np.array(leaf, order="C") for leaf in leaves]
        for k in range(4):
            rows = np.flatnonzero(lit == k)
            if len(rows):
                part = [leaf[rows] for leaf in after]
                update(part, self._lit[k], rows)
                for leaf, own in zip(after, part, strict=True):
                    leaf[rows] = own
        return after

    def track(self, belief: Any, action: Any, measurements: Measurements) -> Belief:
        """One scan of the tracker that knows which street is lit."""
        lit, share, pointed, dead = self._sent(belief, action)
        z, R, number = measurements

        def update(part: list[Any], constants: Any, rows: Any) -> None:
            waves = self._of_pairs(share[rows])
            scan(*part[:6], constants, *waves, z[rows], R[rows], number[rows], part[6], *self.urban_tracker._sizes)

        tracks = self._groups(list(belief[1:8]), lit, share, update)
        return Belief(belief.step + 1, *tracks, pointed, dead, belief.energy - (share > 0))

    def _foreseen(self, tracks: list[Any], lit: Any, share: Any, draws: Any = None) -> list[Any]:
        """The tracks a scan later: expected, or with drawn detections (env, pair * slot)."""

        def update(part: list[Any], constants: Any, rows: Any) -> None:
            wave, snr = self._of_pairs(share[rows])  # equal in all environments that light the same streets
            drawn = np.empty((len(rows), 0)) if draws is None else draws[rows]
            foresee(*part[:6], constants, wave[0, 0], snr[0, 0], drawn, *self.urban_tracker._sizes)

        return self._groups(tracks, lit, share, update)

    @property
    def outcome_shape(self) -> tuple[int, ...]:
        """A draw for each pair and track."""
        return (len(self.pairs) * self.slots,)

    def predict(self, belief: Any, actions: Any, outcome: Any = None) -> Belief:
        """See ``street_kernels.foresee``."""
        chosen = np.asarray(actions)
        lead = np.broadcast_shapes(chosen.shape, (len(belief.step), *(1,) * (chosen.ndim - 1)))
        index = np.broadcast_to(chosen, lead).reshape(-1)
        flat = Belief(*(np.repeat(leaf, index.size // len(belief.step), axis=0) for leaf in belief))
        draws = None
        if outcome is not None:
            given = np.asarray(outcome, np.float64)
            wider = given if given.ndim > len(lead) else given[:, None]
            draws = np.ascontiguousarray(np.broadcast_to(wider, (*lead, *self.outcome_shape))).reshape(
                -1, given.shape[-1]
            )
        lit, share, pointed, dead = self._sent(flat, index)
        tracks = self._foreseen(list(flat[1:8]), lit, share, draws)
        after = Belief(flat.step + 1, *tracks, pointed, dead, flat.energy - (share > 0))
        return Belief(*(leaf.reshape(*lead, *leaf.shape[1:]) for leaf in after))

    @cached_property
    def _ahead(self) -> Any:
        """Weights of the covariance in the summed cost of 0, 1, 2 ... scans, (scan, 6, 6)."""
        F, made = self.urban_tracker.motion[0].F, [np.zeros((6, 6))]
        for _ in range(self.horizon):
            made.append(np.diag(self._weights) + F.T @ made[-1] @ F)
        return np.array(made)

    def cost(self, belief: Any) -> Any:
        """As ``Urban``."""
        return super().cost(UrbanBelief(*belief[:8]))

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """As ``Urban``."""
        return super().observation_fields

    def observe(self, belief: Any) -> Any:
        """As ``Urban``, without the beam and the account."""
        out = np.zeros((len(belief.step), len(self.observation_fields)))
        kernels.observe(*belief[:7], self._centre, self.horizon, out)
        return out

    def state_info(self, state: State) -> dict[str, Any]:
        """The squared GOSPA distance, (env,) m^2, and the number of confirmed tracks."""
        truth, belief = state
        x, _ = Tracks(*belief[1:8]).combined()
        sure, there = belief.status == CONFIRMED, np.ones(truth.route.shape, np.bool_)
        distance = gospa(truth.targets[..., :2], x[..., :2], there, sure, 20.0).distance
        return {"squared_gospa": distance**2, "confirmed": sure.sum(axis=1), "empty": (belief.status == EMPTY).sum(1)}


@shortcuts.spending.register(Street)
def spending(system: Street) -> Any:
    """Trains that each action sends."""
    return np.array([float(share > 0) for _, share in CHOICES[system.kind]])


@shortcuts.delay.register(Street)
def delay(system: Street, belief: Any) -> Any:
    """Scans until the beam has turned."""
    lit = np.array([streets for streets, _ in CHOICES[system.kind]])
    turned = np.where(lit == belief.pointed[:, None], belief.dead[:, None], system.dead_scans)
    return np.where(lit < 2, turned, 0)


@shortcuts.gain.register(Street)
def gain(system: Street, belief: Any, wait: Any, ahead: Any) -> Any:
    """What a look after ``wait`` scans saves in the ``ahead`` scans from then on; without the limit c0."""
    actions, count = len(system.actions), len(belief.step)
    late = np.broadcast_to(np.asarray(wait), (count, actions)).reshape(-1)
    tracks = [np.repeat(leaf, actions, axis=0) for leaf in belief[1:8]]
    for k in range(late.max(initial=0)):
        rows = np.flatnonzero(late > k)
        silent = np.full(len(rows), 3), np.zeros(len(rows), np.int64)
        for leaf, own in zip(tracks, system._foreseen([leaf[rows] for leaf in tracks], *silent), strict=True):
            leaf[rows] = own
    lit, share = np.tile(np.array(CHOICES[system.kind]), (count, 1)).T
    without = Tracks(*system._foreseen(tracks, np.full_like(lit, 3), np.zeros_like(lit))).combined()[1]
    found = system._foreseen(tracks, lit, share)
    counted = np.minimum(ahead, np.maximum(system.horizon - np.repeat(belief.step, actions) - late, 0))
    saved = np.einsum("ejk,eskj,es->e", system._ahead[counted], without - Tracks(*found).combined()[1], found[3])
    return np.maximum(saved, 0.0).reshape(count, actions)
