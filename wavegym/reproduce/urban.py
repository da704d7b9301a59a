"""What Barbosa et al. compare in their section V, played on the same worlds, and every filter with every scheduler."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from joblib import delayed

from wavegym.core.arrays import Array
from wavegym.core.errors import whole
from wavegym.core.system import State
from wavegym.evaluation.worlds import draw_worlds, word, world_seeds
from wavegym.reproduce.urban_false import false_tracks
from wavegym.reproduce.work import check_jobs, each
from wavegym.schedulers.registry import make_policy
from wavegym.systems.urban.state import HELD_WITHIN
from wavegym.systems.urban.system import Urban
from wavegym.trackers import Tracks
from wavegym.trackers.urban.tracker import CONFIRMED, EMPTY

LOOSE, STRICT = "loose", "strict"
SETTINGS = {LOOSE: 12.0, STRICT: 5.0}  # m: standard deviation of a new track's place at most
STARTS = {STRICT: 5.0, "8 m": 8.0, LOOSE: 12.0, "20 m": 20.0, "30 m": 30.0}  # what the headline makes of it
GHOSTS = {True: "ghost logic", False: "no ghost logic"}
VSIMM, NCV, NCV1 = "VS-IMM", "NCV", "NCV, 1 m/s²"
FILTERS: dict[str, dict[str, Any]] = {
    VSIMM: {"tracker": "vsimm"},
    NCV: {"tracker": "ncv"},
    NCV1: {"tracker": "ncv", "sigma": 1.0},
}
MYOPIC, TURNS, LONG, SHORT, RANDOM = "myopic", "round-robin", "fixed:2", "fixed:0", "random"
POLICIES = (MYOPIC, TURNS, LONG, SHORT, RANDOM)
PULSES = (0.5e-6, 1.375e-6)  # s, as the paper lists them: the first is sent where no track says otherwise
CHUNK = 50  # worlds played as one batch


class Case(NamedTuple):
    """How vague a track may begin, whether the map tells ghosts, by which filter, by whose choices."""

    setting: str
    ghosts: bool
    filter: str
    policy: str


CLOSED, OPEN = (VSIMM, MYOPIC), (NCV, TURNS)  # the paper's two systems: filter, policy
CASES = (
    *(Case(setting, True, of, policy) for setting in SETTINGS for of in FILTERS for policy in POLICIES),
    *(Case(setting, False, *loop) for setting in SETTINGS for loop in (CLOSED, OPEN)),
    *(Case(start, True, *loop) for start in STARTS if start not in SETTINGS for loop in (CLOSED, OPEN)),
)


class Runs(NamedTuple):
    """What happened under one filter and one policy, axis 0 = run; scan k = 1, 2, ..."""

    confirmed: Array  # (run, k) confirmed tracks
    false: Array  # (run, k) those with no target within 20 m
    held: Array  # (run, k, target) bool: a confirmed track is within 20 m
    error: Array  # (run, k, target) m, of the nearest; 20 where not held, 0 where not there
    lost: Array  # (run, k, target) bool: both straight ways are open, and it is not held
    gospa: Array  # (run, k) m
    mu: Array  # (run, k, target, model) of the nearest confirmed track; NaN where not held
    action: Array  # (run, k) the pulse
    tracked: Array  # (run, k) bool: there was a track when it was chosen
    place: Array  # (run, k, slot, 4) state of a confirmed track; NaN elsewhere
    origins: Array  # (run, origin) false confirmed tracks by what they were made of (``urban_false.ORIGINS``)


@dataclass(frozen=True)
class Study:
    """All that was played.

    Attributes:
        root: the seed of it all.
        runs: what happened in each case; axis 0 is the same world in all of them.
    """

    root: int
    runs: Mapping[Case, Runs]

    def of(self, setting: str, loop: tuple[str, str], ghosts: bool = True) -> Runs:
        """Runs of one filter and policy."""
        return self.runs[Case(setting, ghosts, *loop)]


def play(runs: int = 50, root: int = 0, jobs: int = -1) -> Study:
    """Play every case on the same worlds; the result does not depend on ``jobs``.

    Args:
        runs: Monte Carlo runs of each case.
        root: the seed from which worlds follow.
        jobs: processes; -1 = one for each core.

    Raises:
        InputError: a number out of range.
    """
    whole("runs", runs, 1)
    check_jobs(jobs)
    seeds = world_seeds(root, "test", runs)
    for of in FILTERS:  # kernels get compiled here, not by several processes at once
        _play(Case(STRICT, True, of, MYOPIC), world_seeds(root, "tune", 1), scans=2)
    chunks = [seeds[start : start + CHUNK] for start in range(0, runs, CHUNK)]
    played = iter(each(jobs, "playing", [delayed(_play)(case, chunk) for case in CASES for chunk in chunks]))
    parts = {case: [next(played) for _ in chunks] for case in CASES}
    return Study(root, {case: Runs(*map(np.concatenate, zip(*of, strict=True))) for case, of in parts.items()})


def system(case: Case) -> Urban:
    """The closed loop that a case is played in."""
    return Urban(vaguest=STARTS[case.setting], ghosts=case.ghosts, durations=PULSES, **FILTERS[case.filter])


def _play(case: Case, seeds: Sequence[int], scans: int = 0) -> Runs:
    """One batch of worlds, to the end or for so many ``scans``."""
    loop = system(case)
    world, policy = draw_worlds(loop, seeds), make_policy(case.policy, loop, None)
    state = loop.begin(world)
    policy.begin(loop, len(seeds), np.random.default_rng([word("policy"), seeds[0]]))
    kept: list[tuple[Array, ...]] = []
    born: list[Array] = []
    for _ in range(scans or loop.horizon):
        tracked = (state.public.status != EMPTY).any(axis=1)
        action = policy.act(state.public, None, None)
        state = loop.advance(state, action, world)
        found = loop.metrics(state)
        told = (found[key] for key in ("confirmed", "false", "held", "position_error", "lost", "gospa"))
        place, mu = _confirmed(state)
        kept.append((*told, mu, action, tracked, place))
        born.append(state.public.step[:, None] - state.public.age)
    arrays = [np.stack(of, axis=1) for of in zip(*kept, strict=True)]
    origins = false_tracks(loop.scene, loop.transmitters[0], loop.receivers, arrays[-1], np.stack(born, axis=1))
    return Runs._make([*arrays, origins])


def _confirmed(state: State) -> tuple[Array, Array]:
    """Confirmed tracks' states (env, slot, 4), and the models (env, target, model) of the one nearest each target."""
    hidden, public = state
    x, _ = Tracks(*public[1:]).combined()
    place = np.where((public.status == CONFIRMED)[..., None], x[..., :4], np.nan)
    off = hidden.truth[:, :, None, :2] - place[:, None, :, :2]  # (env, target, slot, 2)
    distance = np.nan_to_num(np.hypot(off[..., 0], off[..., 1]), nan=np.inf)
    held = hidden.present & (distance.min(axis=2) <= HELD_WITHIN)
    mu = np.take_along_axis(public.mu, distance.argmin(axis=2)[..., None], axis=1)
    return place, np.where(held[..., None], mu, np.nan)
