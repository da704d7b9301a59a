"""The agile chirps' numbers as tables."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from research.papers.agile_clutter.numbers import WINDOWS
from research.papers.cells import NONE, mean_cells, percent, ratio_cells, share_cells, written
from wavegym.envs.describe import table

HEAD = (
    "tracker", "", "policy", "kept %", "95 %", "MSE, kept runs", "95 %", "NEES, kept runs", "95 %", "MSE, all runs",
    "median, all runs", "ratio, kept by both", "95 %", "ratio, all runs", "95 %",
)  # fmt: skip
CHOICES = ("tracker", "", "policy", "steps", "shares of the phase functions in kept runs, %")
GATES = ("tracker", "policy", "clutter points in the gates, first step", "95 %", "mean of all steps", "95 %")
PARTICLES = ("particles", "runs", "kept %", "95 %", "MSE, kept runs", "95 %", "MSE, all runs", "95 %")
LEAST = 0.005  # smaller shares are not listed


def markdown(summary: dict[str, Any]) -> str:
    """Policies, phase functions, clutter in gates, and numbers of particles if a particle filter was played."""
    parts = [
        table(HEAD, list(_policies(summary))),
        f"Phase functions\n\n{table(CHOICES, list(_choices(summary)))}",
        f"Clutter in the gates\n\n{table(GATES, list(_gates(summary)))}",
    ]
    if summary["convergence"]:
        parts.append(f"Number of particles, library myopic\n\n{table(PARTICLES, list(_particles(summary)))}")
    return "\n\n".join(parts)


def _settings(summary: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Each tracker, clutter and what the summary has for both."""
    for tracker, settings in summary["trackers"].items():
        for clutter, setting in settings.items():
            yield tracker, clutter, setting


def _policies(summary: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    """A row for each tracker, clutter and policy; ratios are to the fully agile scheduler."""
    for tracker, clutter, setting in _settings(summary):
        for name, policy in setting["policies"].items():
            yield tracker, clutter, _name(name, setting), *_cells(policy)


def _name(policy: str, setting: dict[str, Any]) -> str:
    """The policy, and the waveforms of a fixed one."""
    constant = setting["best_fixed"].get(policy)
    return f"{policy} ({', '.join(constant['waveforms'])})" if constant else policy


def _cells(policy: dict[str, Any]) -> list[str]:
    everything = policy["mse_all"]
    cells = [*share_cells(policy["kept"]), *mean_cells(policy["mse_kept"], 0), *mean_cells(policy["nees"])]
    cells += [written(everything["mean"], 0), written(everything["median"], 0)]
    for ratio in (policy["ratio_kept"], policy["ratio_all"]):
        cells += (NONE, NONE) if ratio is None else ratio_cells(ratio)
    return cells


def _choices(summary: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    for tracker, clutter, setting in _settings(summary):
        for policy, found in setting["choices"].items():
            for window, (first, last) in WINDOWS.items():
                steps = f"{first}" if first == last else f"{first} to {last}"
                yield tracker, clutter, policy, steps, _shares(found["share"][window])


def _shares(shares: dict[str, dict[str, Any]]) -> str:
    """The phase functions in order of their shares."""
    found = sorted(((of["mean"] or 0.0, law) for law, of in shares.items()), reverse=True)
    return ", ".join(f"{law} {percent(share)}" for share, law in found if share >= LEAST) or NONE


def _gates(summary: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    for tracker, settings in summary["trackers"].items():
        for name, policy in settings["clutter"]["policies"].items():
            yield tracker, name, *mean_cells(policy["clutter_1"], 0), *mean_cells(policy["clutter"], 0)


def _particles(summary: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    for count, of in summary["convergence"].items():
        yield (
            count, str(of["runs"]), *share_cells(of["kept"]), *mean_cells(of["mse_kept"], 0),
            *mean_cells(of["mse_all"], 0),
        )  # fmt: skip
