"""What Sira, Papandreou-Suppappola, Morrell and Cochran compare in their section 6, played on the same worlds.

The draws of a world depend neither on the chirps allowed nor on the clutter's density, so runs pair across all of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from tqdm import tqdm

from wavegym.errors import choice, whole
from wavegym.evaluation.comparison import CHUNK
from wavegym.evaluation.worlds import draw_worlds, world_seeds
from wavegym.schedulers.myopic import Myopic
from wavegym.schedulers.policy import Policy
from wavegym.schedulers.progressive import Progressive
from wavegym.schedulers.simple import Fixed
from wavegym.schedulers.tuning import best_fixed
from wavegym.systems.agile_clutter import AgileClutter

Array = NDArray[Any]

LAWS = ("lfm", "pfm:3", "hfm:0.5", "efm:0.5")
AGILE: dict[str, tuple[str, ...]] = {  # the paper's search, over these phase functions
    "fully agile": LAWS,
    "agile LFM": ("lfm",),
    "agile PFM": ("pfm:3",),
    "agile HFM": ("hfm:0.5",),
    "agile EFM": ("efm:0.5",),
}
FULL, LINEAR, BEST_FIXED, LIBRARY = "fully agile", "agile LFM", "best fixed", "library myopic"
POLICIES = (*AGILE, BEST_FIXED, LIBRARY)
TRACKERS = ("jpda", "particle")
CLUTTER = {"clutter": 1e-4, "no clutter": 0.0}  # false returns per m (m/s)
PARTICLES = 1000
TUNING_WORLDS = 100
# Tuning by a particle filter takes twenty minutes over the whole library, where short, narrow pulses let much clutter
# in; the best one was among the longest and widest of each law whenever the whole library was tried.
WIDEST: dict[str, Any] = {"durations": (100e-6,), "sweeps": (15e6,)}


class Case(NamedTuple):
    """Who tracks, in what, with whose choices."""

    tracker: str
    clutter: str
    policy: str


class Runs(NamedTuple):
    """What one policy did, axis 0 = run."""

    squared_error: Array  # (run, k, target) m^2, weighted with Lambda; NaN while the target is absent
    cost: Array  # (run, k) the tracker's own trace(Lambda P), m^2
    law: Array  # (run, k, sensor) int, index into LAWS
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
        root: the seed of it all.
        runs: what each policy did, by case; axis 0 is the same world in all of them.
        fixed: for each (tracker, clutter) the index of the best constant, and its waveforms, one a sensor.
    """

    root: int
    runs: Mapping[Case, Runs]
    fixed: Mapping[tuple[str, str], tuple[int, tuple[str, ...]]]

    @property
    def settings(self) -> list[tuple[str, str]]:
        """The (tracker, clutter) played."""
        return list(self.fixed)

    def of(self, tracker: str, clutter: str) -> dict[str, Runs]:
        """Every policy's runs in one setting."""
        return {policy: self.runs[Case(tracker, clutter, policy)] for policy in POLICIES}


def play(
    trackers: Sequence[str] = ("jpda",),
    *,
    runs: int = 200,
    root: int = 0,
    jobs: int = -1,
    tuning: int = TUNING_WORLDS,
) -> Study:
    """Play every policy on the same worlds, in clutter and without; the result does not depend on ``jobs``.

    Args:
        trackers: "jpda", "particle".
        runs: Monte Carlo runs; the paper has 500.
        root: the seed from which worlds and tuning worlds follow.
        jobs: processes; -1 = one for each core.
        tuning: worlds on which the best constant is found, none of them played afterwards.

    Raises:
        InputError: an unknown tracker, or a number out of range.
    """
    whole("runs", runs, 1)
    whole("tuning", tuning, 1)
    if jobs != -1:
        whole("jobs", jobs, 1)
    for tracker in trackers:
        choice("tracker", tracker, TRACKERS)
    seeds = world_seeds(root, "test", runs)
    settings = [(tracker, clutter) for tracker in trackers for clutter in CLUTTER]
    cases = [Case(*setting, policy) for setting in settings for policy in POLICIES]
    for case in cases:  # kernels get compiled here, not by several processes at once
        _play(case, 0, world_seeds(root, "tune", 1), steps=1)
    chunks = [seeds[start : start + CHUNK] for start in range(0, runs, CHUNK)]
    first = [delayed(_tuned)(setting, root, tuning) for setting in settings]
    first += [delayed(_play)(case, 0, chunk) for case in cases if case.policy != BEST_FIXED for chunk in chunks]
    found = iter(_each(jobs, "playing", first))
    fixed = {setting: next(found) for setting in settings}
    second = [delayed(_play)(Case(*setting, BEST_FIXED), fixed[setting], c) for setting in settings for c in chunks]
    constant = iter(_each(jobs, BEST_FIXED, second))
    played = {case: _merged([next(constant if case.policy == BEST_FIXED else found) for _ in chunks]) for case in cases}
    return Study(root, played, {setting: (index, _waveforms(setting, index)) for setting, index in fixed.items()})


def scene(case: Case) -> AgileClutter:
    """The closed loop that a case is played in."""
    tracker, clutter, policy = case
    settings: dict[str, Any] = {"tracker": tracker, "particles": PARTICLES, "clutter_density": CLUTTER[clutter]}
    if policy in AGILE:
        return AgileClutter(action="box", laws=AGILE[policy], **settings)
    if policy == BEST_FIXED and tracker == "particle":
        settings |= WIDEST
    return AgileClutter(laws=LAWS, **settings)


def laws(system: AgileClutter, actions: Array) -> Array:
    """The phase functions that ``actions`` (in form "library" or "box") transmit, (..., sensor) index into LAWS."""
    menu = system.menu
    if menu.form == "library":
        local = actions // (len(menu.library) // len(menu.laws))
    elif len(menu.laws) == 1:
        local = np.zeros((*actions.shape[:-1], menu.sensors), np.int64)
    else:
        values = menu.box.decode(actions).reshape(*actions.shape[:-1], menu.sensors, -1)
        local = values[..., 0].astype(np.int64)
    return np.array([LAWS.index(law) for law in menu.laws])[local]


def _waveforms(setting: tuple[str, str], index: int) -> tuple[str, ...]:
    """The constant's waveforms by label, one a sensor."""
    system = scene(Case(*setting, BEST_FIXED))
    return tuple(system.menu.library.labels[i] for i in system.constants()[index])


def _tuned(setting: tuple[str, str], root: int, count: int) -> int:
    system = scene(Case(*setting, BEST_FIXED))
    return best_fixed(system, draw_worlds(system, world_seeds(root, "tune", count)))


def _policy(name: str, fixed: int) -> Policy:
    if name in AGILE:
        return Progressive()
    return Fixed(fixed) if name == BEST_FIXED else Myopic()


def _play(case: Case, fixed: int, seeds: Sequence[int], steps: int | None = None) -> Runs:
    """One batch of worlds, to the end or for so many ``steps``."""
    system, policy = scene(case), _policy(case.policy, fixed)
    world = draw_worlds(system, seeds)
    state = system.begin(world)
    policy.begin(system, len(seeds), np.random.default_rng(0))  # none of these policies draws
    kept: list[tuple[Array, ...]] = []
    for _ in range(steps or system.horizon):
        action = policy.act(state.public, None, None)
        state = system.advance(state, action, world)
        figures = system.metrics(state)
        squared = np.where(figures["present"], figures["squared_error"], np.nan)
        kept.append((squared, system.cost(state.public), laws(system, action), figures["clutter"]))
    squared_error, cost, law, clutter = (np.stack(arrays, axis=1) for arrays in zip(*kept, strict=True))
    return Runs(squared_error, cost, law, clutter, figures["lost"])


def _each(jobs: int, title: str, work: Sequence[Any]) -> list[Any]:
    """The results of joblib's delayed calls in their order, with a bar on a terminal."""
    results: Iterable[Any] = Parallel(n_jobs=jobs, return_as="generator")(work)
    return list(tqdm(results, total=len(work), desc=title, unit="batch", disable=None))


def _merged(parts: Sequence[Runs]) -> Runs:
    return Runs(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
