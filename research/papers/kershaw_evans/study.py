"""The closed loop of Kershaw and Evans on the same worlds: schedulers of trace and gate, and fixed waveforms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from joblib import Memory, delayed

from research.papers.seeds import TEST, TUNE
from research.papers.work import check_jobs, run_all
from wavegym.core import shortcuts
from wavegym.core.arrays import Array
from wavegym.core.errors import check_int
from wavegym.core.policy import Policy
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.schedulers import Fixed, Myopic, MyopicClosedForm, RoundRobin
from wavegym.schedulers.registry import make_policy
from wavegym.systems.kershaw_evans.system import KershawEvans, KershawEvansPosition

RATE, POSITION = "range and range-rate", "position"
SCENES: dict[str, type[KershawEvans]] = {RATE: KershawEvans, POSITION: KershawEvansPosition}
DRAWN, CLOSING, RECEDING = "drawn", "closing", "receding"  # targets; the last two with the greatest speed of the scene
TARGETS = (DRAWN, CLOSING, RECEDING)

TRACE, GATE = "trace, closed form", "gate, closed form"
GRID_TRACE, GRID_GATE, DETERMINANT = "trace, library", "gate, library", "determinant, library"
BEST, LONG, SHORT, EVERY = "best fixed", "longest pulse", "shortest pulse", "round robin"
BOX = (TRACE, GATE)
POLICIES = (*BOX, GRID_TRACE, GRID_GATE, DETERMINANT, BEST, LONG, SHORT, EVERY)
MOVING = (*BOX, GRID_TRACE)  # played with closing and receding targets
TUNING_WORLDS = 40


class Case(NamedTuple):
    """A scene, its targets and a policy."""

    scene: str
    targets: str
    policy: str


class Runs(NamedTuple):
    """The runs of one case, axis 0 = run; k = 1, 2, ..."""

    cost: Array  # (run, k) trace(Lambda P) after the update
    gate: Array  # (run, k) sqrt(det S) [m^2/s]: area of the validation gate / (pi times its squared size)
    squared_error: Array  # (run, k) m^2, of range
    nees: Array  # (run, k)
    duration: Array  # (run, k) s
    sweep: Array  # (run, k) Hz, negative = down
    predicted: Array  # (run, k, 2, 2) H P H' before the pulse
    eta: Array  # (run, k) at the predicted range
    range: Array  # (run, k) m, true


@dataclass(frozen=True)
class Study:
    """All that was played.

    Attributes:
        seed: of all worlds.
        runs: the runs of each case; axis 0 is the same world for all policies of a scene.
        best: the best fixed waveform of each scene, by its label.
    """

    seed: int
    runs: Mapping[Case, Runs]
    best: Mapping[str, str]

    def of(self, scene: str, policy: str, targets: str = DRAWN) -> Runs:
        """Runs of one policy."""
        return self.runs[Case(scene, targets, policy)]


def cases() -> list[Case]:
    """All that is played."""
    return [Case(s, t, p) for s in SCENES for t in TARGETS for p in (POLICIES if t == DRAWN else MOVING)]


def play(runs: int, seed: int = 0, jobs: int = -1, *, store: Path | None = None) -> Study:
    """Play every case; the result does not depend on ``jobs``.

    Args:
        runs: Monte Carlo runs of each case.
        seed: of the worlds and of the tuning worlds.
        jobs: processes; -1 = one for each core.
        store: folder for partial results; the same call continues from them after an interruption.

    Raises:
        InputError: a number out of range.
    """
    check_int("runs", runs, 1)
    check_jobs(jobs)
    seeds, tune = world_seeds(seed, TEST, runs), world_seeds(seed, TUNE, TUNING_WORLDS)
    for policy in (TRACE, GRID_TRACE):  # compiles the kernels once, not in several processes at the same time
        _play(Case(RATE, DRAWN, policy), 0, tune[:1])
    memory = Memory(store, verbose=0)
    best = {scene: memory.cache(_best)(scene, tune) for scene in SCENES}
    part, listed = memory.cache(_play), cases()
    played = run_all(jobs, "playing", [delayed(part)(case, best[case.scene], seeds) for case in listed])
    labels = {scene: system(Case(scene, DRAWN, BEST)).action_set.library.labels[index] for scene, index in best.items()}
    return Study(seed, dict(zip(listed, played, strict=True)), labels)


def system(case: Case) -> KershawEvans:
    """The closed loop in which a case is played. Ranges and speeds are those of the scene, whatever they are.

    Pulses are received whole, as in the paper: the closed forms do not include eclipsing.
    """
    scene, settings = SCENES[case.scene], dict[str, Any]()
    if case.targets != DRAWN:
        middle, speed = float(np.mean(scene.start_range)), max(abs(end) for end in scene.start_speed)
        speed = -speed if case.targets == CLOSING else speed
        settings = {"start_range": (middle, middle), "start_speed": (speed, speed)}
    return scene(action="box" if case.policy in BOX else "library", eclipsing=False, **settings)


def unmodulated(loop: KershawEvans, longest: bool) -> int:
    """Index of the longest or the shortest pulse of the library with the narrowest sweep."""
    k = int(np.argmax(loop.durations) if longest else np.argmin(loop.durations))
    return k * len(loop.sweeps) + int(np.argmin(np.abs(loop.sweeps)))


def _best(scene: str, seeds: Sequence[int]) -> int:
    loop = system(Case(scene, DRAWN, BEST))
    return int(make_policy("best-fixed", loop, draw_worlds(loop, seeds)).constant)  # type: ignore[attr-defined]


def _policy(case: Case, best: int, loop: KershawEvans) -> Policy:
    named: dict[str, Policy] = {
        TRACE: MyopicClosedForm("trace"), GATE: MyopicClosedForm("gate"), GRID_TRACE: Myopic("trace"),
        GRID_GATE: Myopic("gate"), DETERMINANT: Myopic("determinant"), BEST: Fixed(best),
        LONG: Fixed(unmodulated(loop, True)), SHORT: Fixed(unmodulated(loop, False)),
        EVERY: RoundRobin(),
    }  # fmt: skip
    return named[case.policy]


def _pulses(loop: KershawEvans, action: Array) -> Array:
    """Duration and sweep of actions, (env, 2)."""
    if loop.action == "box":
        return loop.action_set.box.decode(action)
    every = np.array([(k, sweep) for k in loop.durations for sweep in loop.sweeps])
    return np.asarray(every[action])


def _play(case: Case, best: int, seeds: Sequence[int]) -> Runs:
    """All runs of a case."""
    loop = system(case)
    world, policy = draw_worlds(loop, seeds), _policy(case, best, loop)
    state, kept = loop.initial(world), list[tuple[Array, ...]]()
    policy.begin(loop, len(seeds), np.random.default_rng(0))  # no policy here draws random numbers
    for _ in range(loop.horizon):
        action = policy.act(state.belief, None, None)
        P, eta = shortcuts.next_pulse(loop, state.belief)
        gate = np.sqrt(np.linalg.det(shortcuts.innovation_covariance(loop, state.belief, action[:, None])[:, 0]))
        state = loop.transition(state, action, world)
        figures, pulse = loop.state_info(state), _pulses(loop, action)
        kept.append(
            (
                loop.cost(state.belief), gate, figures["position_error"] ** 2, figures["nees"], *pulse.T,
                P[:, :2, :2], eta, state.truth.targets[:, 0],
            )
        )  # fmt: skip
    return Runs(*(np.stack(arrays, axis=1) for arrays in zip(*kept, strict=True)))
