"""Planners swept over depth, futures and base against CPU time, on tuning worlds within a budget of CPU seconds."""

from __future__ import annotations

import csv
import io
import json
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.files import csv_text
from wavegym.core.policy import Policy
from wavegym.core.shortcuts import delay
from wavegym.core.system import System
from wavegym.schedulers.lookahead import Lookahead
from wavegym.schedulers.registry import planner_builder
from wavegym.schedulers.rollout import rollout

DEPTHS, FUTURES = (5, 10, 20, 40, 80), (4, 16, 32)
MANY, DOUBT = 64, 2.0  # futures and standard errors of a cautious planner: of many plans one looks better by chance
HOLDS = ((1,), (1, 4))
ROUNDS = (1, 4)
LOOKAHEADS = (2, 3, 4, 6, 10)
LIMITS = (1.0, 10.0, 100.0, np.inf)  # CPU milliseconds of a decision
LARGEST = 0.25  # share of the budget that one planner may be expected to take
SKIPPED = "not played: CPU budget"
COLUMNS = (
    "planner", "base", "depth", "futures", "settings", "worlds", "cost_vs_best_simple_percent",
    "standard_error_percent", "cpu_ms_per_decision", "best_within_ms", "note",
)  # fmt: skip


class Setting(NamedTuple):
    """A planner with its settings; without a base it has none."""

    planner: str  # "rollout:20", or "" for the base alone
    base: str
    settings: Mapping[str, Any]

    @property
    def depth(self) -> int | None:
        """Steps of a future."""
        family, _, number = self.planner.partition(":")
        return int(number) if family in ("rollout", "lookahead") else self.settings.get("depth")

    @property
    def work(self) -> float:
        """The work of a decision, in units that depend on the family."""
        depth = float(self.depth or 1)
        if self.planner.startswith("lookahead"):  # as a system's own plan grows; sequences are tried for few depths
            return depth * depth
        plans = len(self.settings.get("holds", (1,))) * max(self.settings.get("rounds", 1), 1)
        return depth * plans * self.settings.get("futures", 1)


class Swept(NamedTuple):
    """The cost of a setting, relative to the best heuristic on the same worlds."""

    setting: Setting
    worlds: int
    log_ratio: float  # mean over worlds of the logarithm of the ratio of mean costs; NaN if not played
    error: float  # its standard error
    cpu_ms: float  # CPU time of a decision
    note: str = ""


class Timed:
    """A policy whose decisions are timed, in CPU seconds of this process.

    Args:
        policy: the policy.
    """

    def __init__(self, policy: Policy) -> None:
        self.policy, self.seconds, self.decisions = policy, 0.0, 0

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        self.policy.begin(system, num_envs, rng)

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        start = time.process_time()
        action = self.policy.act(belief, observation, mask)
        self.seconds += time.process_time() - start
        self.decisions += len(belief.step)
        return action


def settings_to_sweep(system: System, bases: Sequence[str], recorded: Sequence[Setting] = ()) -> list[Setting]:
    """All settings for a system, those on record first, then those of least work.

    ``rollout:H`` and ``receding-horizon`` with every base, several depths and, where outcomes are random, numbers of
    futures, the most of them with a gain of two standard errors; where set-ups take time first actions are also held;
    ``lookahead:H``; ``plan-once``.
    """
    depths = [depth for depth in DEPTHS if depth < system.horizon] or [system.horizon]
    futures = FUTURES if np.prod(system.outcome_shape) else (1,)
    found: list[Setting] = []
    for base in bases:
        for depth in depths:
            for holds in HOLDS if delay.of(system) and depth > 4 else HOLDS[:1]:
                found += [Setting(f"rollout:{depth}", base, {"holds": holds, "futures": count}) for count in futures]
                if len(futures) > 1:
                    cautious = {"holds": holds, "futures": MANY, "errors": DOUBT}
                    found.append(Setting(f"rollout:{depth}", base, cautious))
        for depth in dict.fromkeys((*depths[1:3], system.horizon)):
            found += [
                Setting("receding-horizon", base, {"depth": depth, "rounds": rounds, "first": 10, "asks": False})
                for rounds in ROUNDS
            ]
    found += [Setting(f"lookahead:{depth}", "", {}) for depth in LOOKAHEADS if depth < system.horizon]
    if system.horizon <= max(DEPTHS):
        found.append(Setting("plan-once", bases[0], {"rounds": 20}))
    first = [setting for setting in recorded if setting.planner]
    return [*first, *sorted((s for s in found if s not in first), key=lambda setting: setting.work)]


def made(setting: Setting, bases: Mapping[str, Policy]) -> Policy:
    """The policy of a setting."""
    if setting.planner.startswith("lookahead:"):
        return Lookahead(int(setting.planner.partition(":")[2]))
    if not setting.planner:
        return bases[setting.base]
    return planner_builder(setting.planner)(bases[setting.base], **setting.settings)


def sweep(
    system: System,
    bases: Mapping[str, Policy],
    worlds: Any,
    seconds: float,
    recorded: Sequence[Setting] = (),
    progress: bool = True,
) -> list[Swept]:
    """Play as many settings as the budget allows.

    A setting is played if its expected time is at most a quarter of the budget and at most the remaining budget. The
    last setting of its family gives the expectation. The cheapest setting of each family is first tried on two worlds.

    Args:
        system: the closed loop.
        bases: base policies by name, the best heuristic first.
        worlds: tapes for tuning, axis 0 = world.
        seconds: CPU seconds for all.
        recorded: settings that are tried first.
        progress: whether a line for each is printed.

    Returns:
        The bases alone, then every setting, those that were not played included.
    """
    start = time.process_time()
    names, rows = list(bases), []
    floor = None  # of the best heuristic, the first
    for name in names:
        row, logs = _played(system, Setting("", name, {}), bases, worlds, floor)
        floor = logs if floor is None else floor
        rows.append(row)
    rates: dict[str, float] = {}
    count = rows[0].worlds
    for setting in settings_to_sweep(system, names, recorded):
        family = setting.planner.partition(":")[0]
        left = seconds - (time.process_time() - start)
        if family not in rates and left > 0.0:
            with suppress(InputError, NotImplementedError):
                rates[family] = _trial(system, setting, bases, worlds)
        if family not in rates:
            if left <= 0.0:
                rows.append(Swept(setting, 0, np.nan, np.nan, np.nan, SKIPPED))
            continue
        expected = rates[family] * setting.work * count
        if expected > min(left, LARGEST * seconds):
            rows.append(Swept(setting, 0, np.nan, np.nan, np.nan, SKIPPED))
            continue
        with suppress(InputError, NotImplementedError):
            began = time.process_time()
            row, _ = _played(system, setting, bases, worlds, floor)
            rates[family] = (time.process_time() - began) / count / setting.work
            rows.append(row)
            if progress:
                what = f"{setting.planner}@{setting.base} {dict(setting.settings)}"
                print(f"  {what}: {_percent(row.log_ratio):+.2f} %, {row.cpu_ms:.3g} ms", flush=True)
    return rows


def _trial(system: System, setting: Setting, bases: Mapping[str, Policy], worlds: Any) -> float:
    """CPU seconds of one world per unit of work, from two worlds."""
    began = time.process_time()
    _played(system, setting, bases, trees.first(worlds, 2), None)
    return (time.process_time() - began) / 2.0 / setting.work


def _played(
    system: System, setting: Setting, bases: Mapping[str, Policy], worlds: Any, floor: Array | None
) -> tuple[Swept, Array]:
    timed = Timed(made(setting, bases))
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        logs = np.log(rollout(system, timed, worlds).mean_cost)
    ratios = logs - (logs if floor is None else floor)
    error = float(ratios.std(ddof=1) / np.sqrt(len(ratios))) if len(ratios) > 1 else np.nan
    mean = float(ratios.mean())
    ms = 1e3 * timed.seconds / max(timed.decisions, 1)
    return Swept(setting, len(logs), mean if np.isfinite(mean) else np.inf, error, ms), logs


def best_within(rows: Sequence[Swept], limit: float) -> Swept:
    """The row of least cost among those whose decisions take at most ``limit`` CPU milliseconds.

    Raises:
        InputError: none is so quick; the quickest is named.
    """
    played = [row for row in rows if not np.isnan(row.log_ratio)]
    quick = [row for row in played if row.cpu_ms <= limit]
    if not quick:
        least = min((row.cpu_ms for row in played), default=np.nan)
        raise InputError(f"limit is {limit!r} ms, expected at least {least:.3g} ms, which the quickest policy takes")
    return min(quick, key=lambda row: row.log_ratio)


def as_csv(rows: Sequence[Swept]) -> str:
    """The rows as CSV; ``best_within_ms`` lists the limits within which a row is the best."""
    best: dict[int, list[str]] = {}
    for limit in LIMITS:
        with suppress(InputError):
            chosen = best_within(rows, limit)
            best.setdefault(id(chosen), []).append(limit_name(limit))
    lines = []
    for row in rows:
        setting = row.setting
        cells = ["", "", ""]
        if not np.isnan(row.log_ratio):
            cells = [f"{_percent(row.log_ratio):.3f}", f"{100.0 * row.error:.3f}", f"{row.cpu_ms:.4g}"]
        own = [setting.planner, setting.base, setting.depth or "", setting.settings.get("futures", "")]
        what = json.dumps(dict(setting.settings)) if setting.settings else ""
        lines.append([*own, what, row.worlds, *cells, ";".join(best.get(id(row), [])), row.note])
    return csv_text(COLUMNS, lines)


def limit_name(limit: float) -> str:
    """A limit in milliseconds as the file names it."""
    return "unlimited" if np.isinf(limit) else f"{limit:g}"


def best_by_limit(text: str) -> dict[str, dict[str, str]]:
    """The row of ``as_csv`` that is the best within each limit, in milliseconds or "unlimited"."""
    rows = list(csv.DictReader(io.StringIO(text)))
    return {limit: row for row in rows for limit in row["best_within_ms"].split(";") if limit}


def read_sweep(text: str) -> list[Swept]:
    """The rows of ``as_csv`` that were played."""
    rows = [row for row in csv.DictReader(io.StringIO(text)) if not row["note"]]
    return [
        Swept(
            Setting(row["planner"], row["base"], json.loads(row["settings"] or "{}")),
            int(row["worlds"]),
            float(np.log1p(float(row["cost_vs_best_simple_percent"]) / 100.0)),
            float(row["standard_error_percent"]) / 100.0,
            float(row["cpu_ms_per_decision"]),
        )
        for row in rows
    ]


def _percent(log: float) -> float:
    return 100.0 * float(np.expm1(log))
