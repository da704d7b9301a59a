"""Play several policies on the same worlds, on all cores."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from wavegym.core import shortcuts
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, InputWarning, check_choice, check_int, check_positive
from wavegym.core.policy import Policy
from wavegym.core.work import Call, Parts, kept_parts, run_all
from wavegym.core.worlds import tuning_tapes, word, world_seeds
from wavegym.evaluation import statistics
from wavegym.evaluation.adapters import Given, as_policies
from wavegym.evaluation.play import EpisodeResults, Played, Task, make_task, merged, play, results_of
from wavegym.schedulers.registry import is_scheduler
from wavegym.waveforms.chirp_laws import CHIRP_LAWS

BASELINE = "myopic"
FLOOR = "random"
MOST_OUTSIDE = 0.1  # share of decisions on observations outside a policy's training without a warning
CHUNK = 50  # worlds in one batch, for any number of jobs: a network's last bits depend on its batch
MOST_WORLDS = 5000  # that a wanted width may take
HALVES = ("belief", "truth")


@dataclass(frozen=True, repr=False)
class Comparison:
    """Several policies, played on the same worlds.

    Attributes:
        task: the environment and its parameters.
        seed: all other seeds follow from it.
        seeds: of the worlds, for ``env.reset(seed=[...])``.
        played: for each policy the record of each member.
    """

    task: Task
    seed: int
    seeds: list[int]
    played: Mapping[str, Sequence[Played]]

    def __repr__(self) -> str:
        """What was compared, without its figures."""
        return f"Comparison({self.task.env_id!r}, {list(self.played)}, worlds={len(self.seeds)}, seed={self.seed})"

    def cost(self, name: str) -> Array:
        """Mean cost per step, (member, world)."""
        return np.stack([member.episode_cost() for member in self.played[name]])

    def results(self, name: str) -> EpisodeResults:
        """Every figure of every episode, (member, world) each."""
        return results_of(self.played[name])

    def by_policy(self) -> dict[str, EpisodeResults]:
        """The results of all policies, by name."""
        return {name: self.results(name) for name in self.played}

    def against(self, name: str, reference: str = BASELINE, by: str = "belief") -> statistics.Estimate:
        """The geometric mean of the ratios of two policies on the same worlds, in per cent; negative = cheaper.

        Args:
            name, reference: the policies.
            by: "belief": of their costs; "truth": of their squared errors.

        Raises:
            InputError: a policy that was not played, or another ``by``.
        """
        check_choice("by", by, HALVES)
        own, other = (self.results(check_choice("policy", each, self.played)) for each in (name, reference))
        values = (own.cost, other.cost) if by == "belief" else (own.squared_error, other.squared_error)
        return statistics.difference(*values, np.random.default_rng([self.seed, word("bootstrap")])).geometric


def compare(
    env_id: str,
    policies: Mapping[str, Given | None] | Sequence[str],
    *,
    worlds: int = 200,
    until: float | None = None,
    by: str = "belief",
    seed: int = 0,
    jobs: int = -1,
    progress: bool = True,
    trust: bool = False,
    keep: Path | None = None,
    **parameters: Any,
) -> Comparison:
    """Play every policy on the same test worlds.

    The numbers do not depend on ``jobs``, nor on the other policies. Work is handed out through joblib: inside
    ``joblib.parallel_config("ray")`` the same call runs on a Ray cluster.

    Args:
        env_id: a registered id.
        policies: by name, each anything that ``as_policy`` takes, or a sequence of it: the training runs of one agent.
            None stands for the scheduler, the saved agent, or the system's baseline, of that name; a list of names is
            short for that. The baseline ``myopic`` is added if absent.
        worlds: how many.
        until: play on, ``worlds`` or more, until the 95 % interval of every policy against ``myopic`` is at most this
            many per cent wide on either side, or ``MOST_WORLDS`` are played. Only widths are looked at, not results.
            More worlds do not narrow the part of an interval that is due to training runs.
        by: which interval ``until`` means: of the cost by "belief", or of the squared error by "truth".
        seed: worlds, tuning worlds and the policies' own randomness follow from it.
        jobs: processes; -1 = one for each core.
        progress: show a bar on a terminal.
        trust: whether code in saved models and in ``"package.module:factory"`` may run.
        keep: a folder for results. Until the call ends, a hidden folder in it keeps the finished parts, so that the
            same call continues after an interruption.
        **parameters: of the system, other than the registered ones; ``forecasts`` and ``candidates``, as in
            ``gym.make``, are what functions see and choose from.

    Raises:
        InputError: an unknown id, parameter or scheduler (nearest named), a number out of range, ``by`` without
            ``until``, a policy whose actions do not fit (named), or parameters with which a policy's costs are not
            finite.
    """
    check_int("worlds", worlds, 1)
    if jobs != -1:
        check_int("jobs", jobs, 1)
    if check_choice("by", by, HALVES) != HALVES[0] and until is None:
        raise InputError(f"by is {by!r}, expected until, whose interval it names (nearest: Comparison.against)")
    if until is not None:
        check_positive("until", until)
        worlds = CHUNK * math.ceil(worlds / CHUNK)  # so that batches are the same in one call and in several
    task = make_task(env_id, parameters)
    given = by_name(policies)
    members = members_of(task, given, seed, trust)
    with kept_parts(keep, Played) as parts:
        comparison = Comparison(task, seed, [], {name: [] for name in members})
        while len(comparison.seeds) < worlds:
            comparison = _played_on(comparison, members, worlds, jobs, progress, parts)
            if until is not None:
                widths = _widths(comparison, by)
                worlds = _enough_worlds(worlds, max(widths.values()), until)
    _check_finite(comparison)
    if until is not None:
        _check_widths(worlds, widths, until)
    _warn(comparison, _learned(given, task))
    return comparison


def _played_on(
    earlier: Comparison, members: Members, worlds: int, jobs: int, progress: bool, parts: Parts | None
) -> Comparison:
    """The comparison in this many worlds, of which some were played earlier."""
    seeds = world_seeds(earlier.seed, "test", worlds)
    further = seeds[len(earlier.seeds) :]
    laws, chunks = dict(CHIRP_LAWS.added), range(0, len(further), CHUNK)
    work = [
        Call(_play_warm, (own, name, policy, further[start : start + CHUNK], laws))
        for name, (own, those) in members.items()
        for policy in those
        for start in chunks
    ]
    with tqdm(total=len(work), desc="comparing", unit="batch", disable=None if progress else True) as bar:
        done = iter(run_all(work, jobs, bar.update, parts))
    played = {}
    for name, (_, those) in members.items():
        before = [[record] for record in earlier.played[name]] or [[] for _ in those]
        played[name] = [merged([*own, *(next(done) for _ in chunks)]) for own in before]
    return Comparison(earlier.task, earlier.seed, seeds, played)


def _widths(comparison: Comparison, by: str) -> dict[str, float]:
    """The wider side of each policy's interval against the baseline, in per cent.

    Raises:
        InputError: an interval is undefined.
    """
    widths = {}
    for name in comparison.played:
        value, ends = comparison.against(name, by=by)
        if value is None or ends is None:
            raise InputError("until was given, expected two worlds or more, and costs and errors > 0 in each of them")
        widths[name] = max(value - ends[0], ends[1] - value)
    return widths


def _enough_worlds(count: int, widest: float, until: float) -> int:
    """The number of worlds after which every interval is likely to be at most ``until`` wide on either side.

    ``widest``: the wider side of the widest interval after ``count`` worlds.
    """
    if not widest > until:
        return count
    wanted = max(count * (widest / until) ** 2, count + 1)
    return max(count, min(CHUNK * math.ceil(wanted / CHUNK), MOST_WORLDS))


def _check_widths(count: int, widths: Mapping[str, float], until: float) -> None:
    """Warn of the widest interval where it is still too wide."""
    widest = max(widths, key=widths.__getitem__)
    if widths[widest] > until:
        text = f"the interval of {widest!r} is {widths[widest]:.3g} % wide on one side after {count} worlds"
        warnings.warn(f"{text}, expected {until:g} %", InputWarning, stacklevel=3)


def _learned(given: Mapping[str, Given | None], task: Task) -> list[str]:
    """The policies that are neither schedulers nor baselines of the system, by their names."""
    known = shortcuts.baselines(task.system)
    sources = {name: name if source is None else source for name, source in given.items()}
    return [
        name
        for name, source in sources.items()
        if not (isinstance(source, str) and (source in known or is_scheduler(source)))
    ]


def by_name(policies: Any) -> Mapping[str, Given | None]:
    """The policies by name, the baseline among them. InputError for anything but a dictionary or names."""
    if isinstance(policies, (list, tuple)) and all(isinstance(name, str) for name in policies):
        policies = dict.fromkeys(policies)
    if not isinstance(policies, Mapping):
        raise InputError(f"policies is {policies!r}, expected names such as ['myopic'] or a dictionary by name")
    return policies if BASELINE in policies else {BASELINE: None, **policies}


def _check_finite(comparison: Comparison) -> None:
    """Raise an InputError for a policy with a cost that is not finite."""
    for name in comparison.played:
        cost = comparison.cost(name)
        broken = int((~np.isfinite(cost)).any(axis=0).sum())
        if broken:
            raise InputError(
                f"policy {name!r} has a cost that is not finite in {broken} of {cost.shape[1]} worlds, "
                f"expected finite costs: parameters of {comparison.task.env_id} are probably out of range"
            )


def _warn(comparison: Comparison, learned: Sequence[str]) -> None:
    """Warn of policies that often leave their training, and of ``learned`` ones that cost more than the baseline."""
    for name, members in comparison.played.items():
        share = float(np.mean([member.outside for member in members]))
        if share > MOST_OUTSIDE:
            text = f"{share:.0%} of its decisions on observations outside the range of its training"
            warnings.warn(f"policy {name!r} takes {text}", InputWarning, stacklevel=3)
    for name in learned:
        more = comparison.against(name)
        if more.value is not None and more.ci is not None and more.ci[0] > 0.0:
            low, high = more.ci
            known = f"policy {name!r} costs {more.value:.3g} % [{low:.3g}, {high:.3g}] more than {BASELINE!r}"
            warnings.warn(f"{known}, which needs no training", InputWarning, stacklevel=3)


Members = dict[str, tuple[Task, Sequence[Policy]]]


def members_of(task: Task, policies: Mapping[str, Given | None], seed: int, trust: bool) -> Members:
    """Every policy's members and the task that they play.

    Each plays one step here, so that mistakes show before the work begins, and kernels are compiled by one process.
    """
    loops, tapes = shortcuts.baselines(task.system), tuning_tapes(task.system.belief_model, seed)
    members: Members = {}
    for name, given in policies.items():
        source: Any = name if given is None else given
        changed: dict[str, Any] = {}
        if isinstance(source, str) and source in loops:
            source, changed = loops[source]
        try:
            own = make_task(task.env_id, {**task.parameters, **changed}) if changed else task
            members[name] = own, as_policies(source, own, name, trust=trust, tapes=tapes)
            for policy in members[name][1]:
                _warm_up(own, name, policy)
        except NotImplementedError as error:
            missing = f"{type(task.system).__name__} does not offer what it needs"
            raise InputError(f"policy {name!r} cannot play {task.env_id}: {missing}") from error
    return members


def _warm_up(task: Task, name: str, policy: Policy) -> None:
    """One step on one world that is not of the test: loads or compiles every kernel."""
    play(task, policy, world_seeds(0, "tune", 1), max_steps=1, name=name)


def _play_warm(task: Task, name: str, policy: Policy, seeds: Sequence[int], laws: dict[str, Any]) -> Played:
    """Play, with the loading of compiled code left out of the decision times.

    ``laws``: the chirp laws that the calling process has registered, which another process may lack.
    """
    CHIRP_LAWS.added.update(laws)
    _warm_up(task, name, policy)
    return play(task, policy, seeds, name=name)
