"""The comparison of O'Rourke and Swindlehurst, section V, on the same worlds; also for far targets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple, cast

import numpy as np
from joblib import Memory, delayed

from research.papers.seeds import POLICY, TEST, TUNE
from research.papers.work import check_jobs, run_all
from wavegym.core import shortcuts
from wavegym.core.arrays import Array
from wavegym.core.errors import check_int
from wavegym.core.policy import Policy
from wavegym.core.system import State
from wavegym.core.worlds import draw_worlds, word, world_seeds
from wavegym.schedulers.registry import make_policy
from wavegym.schedulers.simple import Cycle
from wavegym.sensors import platform_measurement
from wavegym.sensors.platform import Penalty
from wavegym.systems.rf_eo.system import RfEo, RfEoFar

TRACKERS = ()  # the user has no choice of tracker
PUBLISHED, FAR = "published", "far"
SCENES: dict[str, type[RfEo]] = {PUBLISHED: RfEo, FAR: RfEoFar}
VANISHING: dict[str, Any] = {"folding": False, "prf": RfEo.prf}  # as in the paper, echoes do not fold
PROPOSED, CONSTANT, CYCLE = "fixed:proposed", "tuned-constant", "tuned-cycle"
ADAPTIVE, INFORMATION = "myopic", "myopic-information"
MARGIN = {PUBLISHED: "myopic-margin:2", FAR: "myopic-margin:0"}  # a margin other than the scene's own
DEPTHS = (1, 2, 3, 5, 10)
TUNED = (CONSTANT, CYCLE)
POLICIES = {  # the far targets are always beyond the range of the proposed settings: no comparison is possible
    scene: (*fixed, *TUNED, ADAPTIVE, INFORMATION, MARGIN[scene], *(f"lookahead:{H}" for H in DEPTHS), "random")
    for scene, fixed in ((PUBLISHED, (PROPOSED,)), (FAR, ()))
}
PENALTIES = ("logistic", "hard", "deadzone", "huber", "log-barrier")
TUNING_WORLDS = 64
CHUNK = 5  # worlds played as one batch


class Case(NamedTuple):
    """The scene, the policy, the penalty in its prediction, and the number of steps (0: the horizon of the scene)."""

    scene: str
    policy: str
    penalty: str = PENALTIES[0]
    horizon: int = 0


class Runs(NamedTuple):
    """The runs of one policy, axis 0 = run."""

    cost: Array  # (run, k) trace(W P) summed over the targets, m^2
    error: Array  # (run, k, target) position error, m
    nees: Array  # (run, k, target) normalised estimation error squared, expected 4
    below: Array  # (run, k) bool: some target is predicted less information than t, with the scene's margin
    missed: Array  # (run, k) int: quantities in view of the predicted target but not of the true one
    settings: Array  # (run, k, platform, 3) PRF in Hz, bandwidth in Hz, pixel angle in rad
    rival: Array  # the settings that the paper's objective chooses for the same belief; only in runs of the least trace
    truth: Array  # (run, k, target, 2) true position, m
    estimate: Array  # (run, k, target, 2) estimated position, m
    seconds: Array  # (run,) time of the decisions

    @property
    def mean_cost(self) -> Array:
        """Per step, (run,)."""
        mean: Array = self.cost.mean(axis=1)
        return mean


@dataclass(frozen=True)
class Study:
    """All that was played.

    Attributes:
        seed: of all worlds.
        runs: the runs of each policy, by case; axis 0 is the same world in all cases of a scene.
        tuned: settings (slot, platform, 3) of the tuned policies.
    """

    seed: int
    runs: Mapping[Case, Runs]
    tuned: Mapping[Case, Array]

    def of(self, scene: str, policy: str, penalty: str = PENALTIES[0]) -> Runs:
        """One policy's runs."""
        return next(runs for case, runs in self.runs.items() if case[:3] == (scene, policy, penalty))

    def horizon(self, scene: str) -> int:
        """Steps of each run."""
        return self.of(scene, ADAPTIVE).cost.shape[1]


def play(
    runs: int,
    seed: int = 0,
    jobs: int = -1,
    *,
    store: Path | None = None,
    tuning: int = TUNING_WORLDS,
    horizon: int = 0,
) -> Study:
    """Play every policy on the same worlds; only the decision times depend on ``jobs``.

    Args:
        runs: Monte Carlo runs of each policy.
        seed: of the worlds and of the tuning worlds.
        jobs: processes; -1 = one for each core.
        store: folder for partial results; the same call continues from them after an interruption.
        tuning: number of worlds on which constants and cycles are tuned; they are not played afterwards.
        horizon: steps of each run; 0 for the horizon of the scene.

    Raises:
        InputError: a number out of range.
    """
    check_int("runs", runs, 1)
    check_int("tuning", tuning, 1)
    check_jobs(jobs)
    check_int("horizon", horizon, 0)
    seeds = world_seeds(seed, TEST, runs)
    cases = [Case(scene, policy, horizon=horizon) for scene in SCENES for policy in POLICIES[scene]]
    cases += [Case(scene, ADAPTIVE, penalty, horizon) for scene in SCENES for penalty in PENALTIES[1:]]
    for case in cases:  # compiles the kernels once, not in several processes at the same time
        _play(case, None, world_seeds(seed, TUNE, 1), steps=2)
    memory = Memory(store, verbose=0)
    tune, part = memory.cache(_tuned), memory.cache(_play)
    wanted, plain = ([case for case in cases if (case.policy in TUNED) == is_tuned] for is_tuned in (True, False))
    chunks = [seeds[start : start + CHUNK] for start in range(0, runs, CHUNK)]
    work = [delayed(tune)(case, world_seeds(seed, TUNE, tuning)) for case in wanted]
    work += [
        delayed(part)(case, None, chunk) for case in plain for chunk in chunks
    ]  # together with the tuning, which takes long
    done = run_all(jobs, "tuning, playing", work)
    tuned: dict[Case, Array] = dict(zip(wanted, done, strict=False))
    work = [delayed(part)(case, tuned[case], chunk) for case in wanted for chunk in chunks]
    played = iter(done[len(wanted) :] + run_all(jobs, "playing tuned policies", work))
    parts = {case: [next(played) for _ in chunks] for case in (*plain, *wanted)}
    joined = {case: Runs(*(np.concatenate(a) for a in zip(*parts[case], strict=True))) for case in cases}
    return Study(seed, joined, {case: system(case).action_set.settings(slots) for case, slots in tuned.items()})


def system(case: Case) -> RfEo:
    """The closed loop in which a case is played."""
    given: dict[str, Any] = {**VANISHING, "penalty": cast("Penalty", case.penalty)}
    if case.horizon:
        given["horizon"] = case.horizon
    return SCENES[case.scene](**given)


def _tuned(case: Case, seeds: Sequence[int]) -> Array:
    """The actions that a tuned policy transmits in turn, (slot, 3 * platform)."""
    loop = system(case)
    policy: Any = make_policy(case.policy, loop, draw_worlds(loop, seeds))
    return np.asarray(policy.actions)


def _policy(case: Case, loop: RfEo, tuned: Array | None) -> Policy:
    """The policy of a case; a tuned one transmits ``tuned``, or any constant before it is tuned."""
    if case.policy in TUNED:
        return Cycle(shortcuts.constants(loop)[:1] if tuned is None else tuned)
    return make_policy(case.policy, loop, None)


def _play(case: Case, tuned: Array | None, seeds: Sequence[int], steps: int = 0) -> Runs:
    """One batch of worlds, to the end or for this number of ``steps``."""
    loop = system(case)
    world, policy = draw_worlds(loop, seeds), _policy(case, loop, tuned)
    state = loop.initial(world)
    policy.begin(loop, len(seeds), np.random.default_rng([word(POLICY), seeds[0]]))
    asks = case.policy == ADAPTIVE and case.penalty == PENALTIES[0]
    kept: list[tuple[Array, ...]] = []
    seconds = 0.0
    for k in range(steps or loop.horizon):
        start = perf_counter()
        action = policy.act(state.belief, None, None)
        seconds += (perf_counter() - start) * (k > 0)  # the first one loads compiled code
        settings = loop.action_set.settings(action)
        rival = loop.action_set.settings(shortcuts.most_information(loop, state.belief)[0]) if asks else settings[:, :0]
        before, state = state, loop.transition(state, action, world)
        figures = loop.state_info(state)
        missed = _missed(loop, before, state, settings)
        places = (state.truth.targets[..., ::2], state.belief.mean[..., ::2])
        measured = (figures["position_error"], figures["nees"], figures["below_threshold"], missed)
        kept.append((loop.cost(state.belief), *measured, settings, rival, *places))
    decided = np.full(len(seeds), seconds / len(seeds))
    return Runs._make([*(np.stack(arrays, axis=1) for arrays in zip(*kept, strict=True)), decided])


def _missed(loop: RfEo, before: State, after: State, settings: Array) -> Array:
    """Number of quantities, over all targets, that were in view by the prediction but not by the truth, (env,) int."""
    there, here = (in_view(loop, x, settings) for x in (before.belief.mean @ loop.motion.F.T, after.truth.targets))
    count: Array = (there & ~here).sum(axis=(1, 2, 3))
    return count


def in_view(loop: RfEo, x: Array, settings: Array) -> Array:
    """Which quantities (range, range-rate, azimuth) of states x a platform gets, (env, target, platform, 3) bool.

    The rules are those of the loop: nothing nearer than ``nearest_range``, the misprints of ``as_printed``, and with
    ``out_of_view="inflated"`` everything that is not too near.

    Args:
        loop: the closed loop.
        x: states (env, target, 4).
        settings: PRF in Hz, bandwidth in Hz and pixel angle in rad, (env, platform, 3).
    """
    _, low, high = (edge[:, None] for edge in loop.action_set.view(settings))  # (env, 1, platform, 3)
    z = platform_measurement(x[..., None, :], loop.places, loop.as_printed)
    inside = (low <= z) & (z <= high) | (loop.out_of_view == "inflated")
    seen: Array = inside & (z[..., :1] >= loop.nearest_range)
    return seen
