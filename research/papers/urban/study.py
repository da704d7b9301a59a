"""The comparison of Barbosa et al., section V, on the same worlds; also every filter with every scheduler."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from joblib import Memory, delayed

from research.papers.seeds import POLICY, TEST, TUNE
from research.papers.urban.false_tracks import false_tracks
from research.papers.work import check_jobs, run_all
from wavegym.core.arrays import Array
from wavegym.core.errors import check_int
from wavegym.core.system import State
from wavegym.core.worlds import draw_worlds, word, world_seeds
from wavegym.schedulers.registry import make_policy
from wavegym.systems.urban.state import HELD_WITHIN
from wavegym.systems.urban.system import Urban
from wavegym.systems.urban.tracker import CONFIRMED, EMPTY, Tracks

TRACKERS = ()  # the user has no choice of tracker
LOOSE, STRICT = "loose", "strict"
SETTINGS = {LOOSE: 12.0, STRICT: 5.0}  # m: the largest standard deviation of a new track's position
STARTS = {
    STRICT: 5.0,
    "8 m": 8.0,
    LOOSE: 12.0,
    "20 m": 20.0,
    "30 m": 30.0,
}  # the same, for the table of initiation limits
GHOSTS = {True: "ghost logic", False: "no ghost logic"}
VSIMM, NCV, NCV1 = "VS-IMM", "NCV", "NCV, 1 m/s²"
FILTERS: dict[str, dict[str, Any]] = {
    VSIMM: {"tracker": "vsimm"},
    NCV: {"tracker": "ncv"},
    NCV1: {"tracker": "ncv", "sigma": 1.0},
}
MYOPIC, TURNS, LONG, SHORT, RANDOM = "myopic", "round-robin", "fixed:2", "fixed:0", "random"
POLICIES = (MYOPIC, TURNS, LONG, SHORT, RANDOM)
PAPER: dict[str, Any] = {
    "direction_of_arrival": False, "error_snr": "mean", "searched": 0, "false_alarm": 1e-3,
    "truth": {"sigma": 0.0},  # targets keep to the route
}  # fmt: skip
PULSES = (0.5e-6, 1.375e-6)  # s, in the paper's order; without a track the scheduler sends the first pulse
CHUNK = 50  # worlds played as one batch


class Case(NamedTuple):
    """The limit for new tracks (a key of ``STARTS``), whether ghost logic is on, the filter and the policy."""

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
    """The runs of one filter and one policy, axis 0 = run; scan k = 1, 2, ..."""

    confirmed: Array  # (run, k) confirmed tracks
    false: Array  # (run, k) confirmed tracks with no target within 20 m
    held: Array  # (run, k, target) bool: a confirmed track is within 20 m
    error: Array  # (run, k, target) m, of the nearest track; 20 where not held, 0 where the target is absent
    lost: Array  # (run, k, target) bool: both direct paths are open, and the target is not held
    gospa: Array  # (run, k) m
    mu: Array  # (run, k, target, model) of the nearest confirmed track; NaN where not held
    action: Array  # (run, k) the pulse
    tracked: Array  # (run, k) bool: there was a track when the pulse was chosen
    place: Array  # (run, k, slot, 4) state of a confirmed track; NaN elsewhere
    origins: Array  # (run, origin) false confirmed tracks by their origin (``false_tracks.ORIGINS``)


@dataclass(frozen=True)
class Study:
    """All that was played.

    Attributes:
        seed: of all worlds.
        runs: the runs of each case; axis 0 is the same world in all cases.
    """

    seed: int
    runs: Mapping[Case, Runs]

    def of(self, setting: str, loop: tuple[str, str], ghosts: bool = True) -> Runs:
        """Runs of one filter and policy."""
        return self.runs[Case(setting, ghosts, *loop)]


def play(runs: int, seed: int = 0, jobs: int = -1, *, store: Path | None = None) -> Study:
    """Play every case on the same worlds; the result does not depend on ``jobs``.

    Args:
        runs: Monte Carlo runs of each case.
        seed: of the worlds.
        jobs: processes; -1 = one for each core.
        store: folder for partial results; the same call continues from them after an interruption.

    Raises:
        InputError: a number out of range.
    """
    check_int("runs", runs, 1)
    check_jobs(jobs)
    seeds = world_seeds(seed, TEST, runs)
    for of in FILTERS:  # compiles the kernels once, not in several processes at the same time
        _play(Case(STRICT, True, of, MYOPIC), world_seeds(seed, TUNE, 1), scans=2)
    chunks = [seeds[start : start + CHUNK] for start in range(0, runs, CHUNK)]
    part = Memory(store, verbose=0).cache(_play)
    played = iter(run_all(jobs, "playing", [delayed(part)(case, chunk) for case in CASES for chunk in chunks]))
    parts = {case: [next(played) for _ in chunks] for case in CASES}
    return Study(seed, {case: Runs(*map(np.concatenate, zip(*of, strict=True))) for case, of in parts.items()})


@cache
def system(case: Case) -> Urban:
    """The closed loop in which a case is played."""
    return Urban(**PAPER, vaguest=STARTS[case.setting], ghosts=case.ghosts, durations=PULSES, **FILTERS[case.filter])


def _play(case: Case, seeds: Sequence[int], scans: int = 0) -> Runs:
    """One batch of worlds, to the end or for this number of ``scans``."""
    loop = system(case)
    world, policy = draw_worlds(loop, seeds), make_policy(case.policy, loop, None)
    state = loop.initial(world)
    policy.begin(loop, len(seeds), np.random.default_rng([word(POLICY), seeds[0]]))
    kept: list[tuple[Array, ...]] = []
    born: list[Array] = []
    for _ in range(scans or loop.horizon):
        tracked = (state.belief.status != EMPTY).any(axis=1)
        action = policy.act(state.belief, None, None)
        state = loop.transition(state, action, world)
        found = loop.state_info(state)
        found["lost"] = loop.truth_model.scene.direct[state.belief.step] & ~found["held"]
        measured = (found[key] for key in ("confirmed", "false", "held", "position_error", "lost", "gospa"))
        place, mu = _confirmed(state)
        kept.append((*measured, mu, action, tracked, place))
        born.append(state.belief.step[:, None] - state.belief.age)
    arrays = [np.stack(of, axis=1) for of in zip(*kept, strict=True)]
    origins = false_tracks(loop.scene, loop.transmitters[0], loop.receivers, arrays[-1], np.stack(born, axis=1))
    return Runs._make([*arrays, origins])


def _confirmed(state: State) -> tuple[Array, Array]:
    """States of confirmed tracks (env, slot, 4), and models (env, target, model) of each target's nearest track."""
    hidden, belief = state
    x, _ = Tracks(*belief[1:]).combined()
    place = np.where((belief.status == CONFIRMED)[..., None], x[..., :4], np.nan)
    off = hidden.targets[:, :, None, :2] - place[:, None, :, :2]  # (env, target, slot, 2)
    distance = np.nan_to_num(np.hypot(off[..., 0], off[..., 1]), nan=np.inf)
    held = hidden.present & (distance.min(axis=2) <= HELD_WITHIN)
    mu = np.take_along_axis(belief.mu, distance.argmin(axis=2)[..., None], axis=1)
    return place, np.where(held[..., None], mu, np.nan)
