"""The comparison of Sira, Papandreou-Suppappola, Morrell and Cochran, section 6, played on the same worlds.

The draws of a world depend neither on the chirps allowed nor on the clutter's density, so runs pair across all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from joblib import Memory, delayed

from research.papers.seeds import TEST, TUNE
from research.papers.work import check_jobs, run_all
from wavegym.core import shortcuts
from wavegym.core.arrays import Array
from wavegym.core.errors import check_choice, check_int
from wavegym.core.policy import Policy
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.evaluation.comparison import CHUNK
from wavegym.schedulers.myopic import Myopic, Progressive
from wavegym.schedulers.rollout import rollout
from wavegym.schedulers.simple import Fixed
from wavegym.systems.agile_clutter.system import AgileClutter
from wavegym.waveforms import chirp_law, parse_law

LAWS = AgileClutter.laws  # each phase function in one shape
SHAPES = (  # each in several shapes; the paper does not list the shapes that it tried
    "lfm",
    *(f"pfm:{kappa:g}" for kappa in (2.5, 3, 4, 6)),
    *(f"{kind}:{g:g}" for kind in ("hfm", "efm") for g in (0.1, 0.2, 0.5, 1)),
)
FULL, FREE, LINEAR, LIBRARY = "fully agile", "shapes free", "agile LFM", "library myopic"
BEST_FIXED, BEST_FREE = "best fixed", "best fixed, shapes free"
AGILE: dict[str, tuple[str, ...]] = {  # the paper's search, over these phase functions
    FULL: LAWS,
    FREE: SHAPES,
    **{f"agile {parse_law(law)[0].upper()}": (law,) for law in LAWS},
}
CONSTANT = (BEST_FIXED, BEST_FREE)
POLICIES = (*AGILE, *CONSTANT, LIBRARY)
TRACKERS = ("jpda", "particle", "both")
MOST_OUTSIDE = 5  # returns outside the gates of a track that is kept
CLUTTER = {"clutter": AgileClutter.clutter_density, "no clutter": 0.0}  # false returns per m (m/s)
TUNING_WORLDS, SHORTLIST = 100, 16
CONVERGENCE, CONVERGENCE_RUNS = (200, 1000, 4000), 200  # numbers of particles, and the number of runs for each


class Case(NamedTuple):
    """The tracker, the clutter, the policy and the number of particles (0: the default of the system)."""

    tracker: str
    clutter: str
    policy: str
    particles: int = 0


class Runs(NamedTuple):
    """The runs of one policy, axis 0 = run."""

    squared_error: Array  # (run, k, target) m^2, weighted with Lambda; NaN while the target is absent
    cost: Array  # (run, k) the tracker's own trace(Lambda P), m^2
    nees: Array  # (run, k, target) normalised estimation error squared, expected 4; NaN while the target is absent
    law: Array  # (run, k, sensor) int, index into the phase functions of the policy
    clutter: Array  # (run, k) clutter points inside gates, both sensors
    lost: Array  # (run, target) bool: more than five of its returns fell outside its gates

    @property
    def kept(self) -> Array:
        """The paper's selection, (run,) bool: no target lost."""
        return np.logical_not(np.logical_or.reduce(self.lost, axis=1))

    @property
    def summed(self) -> Array:
        """Squared error of the targets present together, (run, k)."""
        return np.nansum(self.squared_error, axis=2)


@dataclass(frozen=True)
class Study:
    """All that was played.

    Attributes:
        seed: of all worlds.
        runs: the runs of each policy, by case; axis 0 is the same world in all cases.
        fixed: for each case with a best constant: its index and its waveforms, one for each sensor.
        converged: the runs of the library's one-step scheduler in clutter, by number of particles, on the first worlds;
            empty without a particle filter.
    """

    seed: int
    runs: Mapping[Case, Runs]
    fixed: Mapping[Case, tuple[int, tuple[str, ...]]]
    converged: Mapping[int, Runs]

    @property
    def settings(self) -> list[tuple[str, str]]:
        """The (tracker, clutter) played."""
        return list(dict.fromkeys((case.tracker, case.clutter) for case in self.runs))

    def of(self, tracker: str, clutter: str) -> dict[str, Runs]:
        """Every policy's runs in one setting."""
        return {policy: self.runs[Case(tracker, clutter, policy)] for policy in POLICIES}


def play(
    runs: int,
    seed: int = 0,
    jobs: int = -1,
    *,
    store: Path | None = None,
    tracker: str = TRACKERS[0],
    tuning: int = TUNING_WORLDS,
) -> Study:
    """Play every policy on the same worlds, in clutter and without; the result does not depend on ``jobs``.

    Args:
        runs: Monte Carlo runs; the paper has 500.
        seed: of the worlds and of the tuning worlds.
        jobs: processes; -1 = one for each core.
        store: folder for partial results; the same call continues from them after an interruption.
        tracker: "jpda", "particle" or "both".
        tuning: number of worlds on which the best constant is found; they are not played afterwards.

    Raises:
        InputError: an unknown tracker, or a number out of range.
    """
    check_int("runs", runs, 1)
    check_int("tuning", tuning, 1)
    check_jobs(jobs)
    trackers = TRACKERS[:2] if check_choice("tracker", tracker, TRACKERS) == "both" else (tracker,)
    seeds = world_seeds(seed, TEST, runs)
    settings = [(tracker, clutter) for tracker in trackers for clutter in CLUTTER]
    cases = [Case(*setting, policy) for setting in settings for policy in POLICIES]
    for case in cases:  # compiles the kernels once, not in several processes at the same time
        _play(case, 0, world_seeds(seed, TUNE, 1), steps=1)
    memory = Memory(store, verbose=0)
    fixed = _best_constants([case for case in cases if case.policy in CONSTANT], seed, tuning, jobs, memory)
    counts = [Case("particle", "clutter", LIBRARY, count) for count in CONVERGENCE if "particle" in trackers]
    played = _all_runs(
        [(case, seeds) for case in cases] + [(case, seeds[:CONVERGENCE_RUNS]) for case in counts], fixed, jobs, memory
    )
    constants = {case: (index, _waveforms(case, index)) for case, index in fixed.items()}
    converged = {case.particles: played[case] for case in counts}
    return Study(seed, {case: played[case] for case in cases}, constants, converged)


class CountingEverySensor(AgileClutter):
    """Returns outside the gates count at either sensor, as in the paper."""

    counts_every_sensor = True


@cache
def scene(case: Case) -> AgileClutter:
    """The closed loop that a case is played in."""
    printed = {"snr_law": "printed"}  # the law whose figures are reproduced
    settings: dict[str, Any] = {"tracker": case.tracker, "clutter_density": CLUTTER[case.clutter], **printed}
    if case.particles:
        settings["particles"] = case.particles
    if case.policy in AGILE:
        settings["action"] = "box"
    if case.policy == BEST_FREE:  # the longest and widest, like the best with one shape each
        settings |= {"durations": (max(AgileClutter.durations),), "sweeps": (max(AgileClutter.sweeps),)}
    return CountingEverySensor(laws=_offered(case.policy), **settings)


def names(policy: str) -> tuple[str, ...]:
    """The phase functions of a policy, in the order of the indices in ``Runs.law``: "LFM", "PFM3", "HFM0.1", ..."""
    return tuple(chirp_law(*parse_law(law)).name for law in _offered(policy))


def laws(system: AgileClutter, actions: Array) -> Array:
    """The phase functions that ``actions`` (in form "library" or "box") transmit, (..., sensor) index into its laws."""
    action_set = system.action_set
    if action_set.form == "library":
        return actions // (len(action_set.library) // len(action_set.laws))
    return action_set.decode_chirps(actions)[0]


def _offered(policy: str) -> tuple[str, ...]:
    return SHAPES if policy == BEST_FREE else AGILE.get(policy, LAWS)


def _waveforms(case: Case, index: int) -> tuple[str, ...]:
    """The labels of the constant's waveforms, one for each sensor."""
    system = scene(case)
    return tuple(system.action_set.library.labels[i] for i in shortcuts.constants(system)[index])


def _best_constants(cases: Sequence[Case], seed: int, tuning: int, jobs: int, memory: Memory) -> dict[Case, int]:
    """The constant with the least predicted cost in each case; the first if several are equal.

    With JPDA every constant is tried. With the particle filter that would take hours, because short or linear chirps
    let much clutter into the gates. It tries only the ``SHORTLIST`` constants with the least cost under JPDA.
    """
    seeds = world_seeds(seed, TUNE, tuning)
    cost = memory.cache(_cost)
    quick = {case: case._replace(tracker="jpda") for case in cases}
    every = [(case, k) for case in dict.fromkeys(quick.values()) for k in range(len(shortcuts.constants(scene(case))))]
    costs = _costs(every, seeds, jobs, cost)
    slow = [case for case in cases if case not in quick.values()]
    costs |= _costs([(case, k) for case in slow for k in _ranked(costs, quick[case])[:SHORTLIST]], seeds, jobs, cost)
    return {case: _ranked(costs, case)[0] for case in cases}


def _ranked(costs: Mapping[tuple[Case, int], float], case: Case) -> list[int]:
    """A case's constants, the cheapest first; equal ones keep their order."""
    return sorted((k for tried, k in costs if tried == case), key=lambda k: (costs[case, k], k))


def _costs(
    constants: Sequence[tuple[Case, int]], seeds: Sequence[int], jobs: int, cost: Callable[..., float]
) -> dict[tuple[Case, int], float]:
    """Predicted cost of constants, each a case and an index."""
    return dict(zip(constants, run_all(jobs, "tuning", [delayed(cost)(*c, seeds) for c in constants]), strict=True))


def _cost(case: Case, index: int, seeds: Sequence[int]) -> float:
    system = scene(case)
    return float(rollout(system, Fixed(index), draw_worlds(system, seeds)).mean_cost.mean())


def _all_runs(
    cases: Sequence[tuple[Case, Sequence[int]]], fixed: Mapping[Case, int], jobs: int, memory: Memory
) -> dict[Case, Runs]:
    """Each case played on its worlds."""
    batches = [(case, seeds[start : start + CHUNK]) for case, seeds in cases for start in range(0, len(seeds), CHUNK)]
    part = memory.cache(_play)
    work = [delayed(part)(case, fixed.get(case, 0), seeds) for case, seeds in batches]
    parts: dict[Case, list[Runs]] = {}
    for (case, _), runs in zip(batches, run_all(jobs, "playing", work), strict=True):
        parts.setdefault(case, []).append(runs)
    return {case: Runs(*(np.concatenate(a) for a in zip(*played, strict=True))) for case, played in parts.items()}


def _policy(name: str, fixed: int) -> Policy:
    if name in AGILE:
        return Progressive()
    return Fixed(fixed) if name in CONSTANT else Myopic()


def _play(case: Case, fixed: int, seeds: Sequence[int], steps: int | None = None) -> Runs:
    """One batch of worlds, to the end or for this number of ``steps``."""
    system, policy = scene(case), _policy(case.policy, fixed)
    world = draw_worlds(system, seeds)
    state = system.initial(world)
    policy.begin(system, len(seeds), np.random.default_rng(0))  # no policy here draws random numbers
    kept: list[tuple[Array, ...]] = []
    for _ in range(steps or system.horizon):
        action = policy.act(state.belief, None, None)
        state = system.transition(state, action, world)
        figures = system.state_info(state)
        squared = np.where(figures["present"], figures["squared_error"], np.nan)
        nees = np.where(figures["present"], figures["nees"], np.nan)
        kept.append((squared, system.cost(state.belief), nees, laws(system, action), figures["clutter"]))
    squared_error, cost, nees, law, clutter = (np.stack(arrays, axis=1) for arrays in zip(*kept, strict=True))
    return Runs(squared_error, cost, nees, law, clutter, figures["returns_outside"] > MOST_OUTSIDE)
