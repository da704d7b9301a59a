"""Every opponent in a shared band: ``python -m agents.shared_band [SCENARIO ...]``.

Plays rules, predictors, the saved agents and two opponents that know the other users in several scenarios, and with a
price on collisions. Constants of the rules and the agents are those of the default scenario; the best fixed band is
found anew. Results are written to results/shared_band, tables and picture to docs/shared_band.md. ``--tables`` renews
the page without playing.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents import blocks
from agents.leaderboard import ROOT, saved
from wavegym.core.arrays import Array
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import check_choice
from wavegym.core.files import write_whole
from wavegym.core.shortcuts import Recursion
from wavegym.core.work import add_worker_options, workers
from wavegym.core.worlds import draw_worlds
from wavegym.evaluation import compare, make_task, statistics
from wavegym.evaluation.adapters import AGENTS
from wavegym.evaluation.comparison import Comparison
from wavegym.evaluation.picture import as_png
from wavegym.evaluation.summary import named, us_per_decision
from wavegym.evaluation.table import interval, number, signed, tabulated
from wavegym.schedulers.optimum import best_schedule
from wavegym.schedulers.registry import make_policy
from wavegym.systems.shared_spectrum import SharedSpectrum
from wavegym.systems.shared_spectrum.privileged import Clairvoyant, Informed

ENV_ID = "wavegym/SharedSpectrum-v0"
FOLDER, PAGE = ROOT / "results" / "shared_band", ROOT / "docs" / "shared_band.md"
PICTURE = ROOT / "docs" / "images" / "shared_band.png"
README = ROOT / "README.md"
START, END = "<!-- made by `python -m agents.shared_band`: -->", "<!-- shared band to here -->"
WORLDS, SEED = 300, 0
REFERENCE, AGENT = "sense-and-avoid", "ppo"
RULES = (
    "random", "fixed:full-band", REFERENCE, "sense-and-hold", "claim", "multi-objective-sensing",
    "thompson", "ucb", "searched-rule", "myopic",
)  # fmt: skip
FOUND_ANEW = (  # the best band of each scenario, and predictors, which have no constants of a scenario
    "best-fixed", "myopic:counts", "myopic:reactions", "myopic:lags", "myopic:stepped", "myopic:context-tree",
)  # fmt: skip
KNOWING = {"informed": Informed, "clairvoyant": Clairvoyant}
SCENARIOS: dict[str, dict[str, Any]] = {
    "mixture": {},
    "reactive": {"users": ("listening",) * 4},
    "hoppers": {"users": ("stepped", "stepped", "hopping")},
    "patterns-and-reactions": {"users": ("stepped", "hopping", "listening", "listening")},
    "eight-users": {"users": ("static", "bursts", "bursts", "stepped", "stepped", "hopping", "listening", "listening")},
    "drift": {"takeover": 0.1},
    "late-and-noisy": {"sensing": 3.0, "sensing_delay": 1},
    "short-train": {"pulses": 12, "reference_range": 65.8e3},  # with 12 / 50 of the energy
    "stronger-users": {"user_power": (25.0, 35.0)},
}
ABOUT = {
    "mixture": "the default: one user each of the kinds static, bursts, stepped and listening",
    "reactive": "four listening users",
    "hoppers": "two stepped users and one that hops",
    "patterns-and-reactions": "one stepped user, one that hops, two that listen",
    "eight-users": "more users than free channels",
    "drift": "a user begins anew in a tenth of its steps",
    "late-and-noisy": "noise is measured to 3 dB and known one step late",
    "short-train": "12 pulses in place of 50",
    "stronger-users": "users of 25 to 35 dB in place of 15 to 25 dB",
}
BOUNDED = ("hoppers",)  # scenarios in which no user reacts
VAGUE, UNSEEN = 1e4, 1e9  # variances of an estimate, and of a missed target
PRICES = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0, 10.0)  # m^2 for each occupied channel in the band
FRONT = {  # policies of README, and what they know
    "sense-and-avoid": "the last step: the widest clear band",
    "myopic": "Markov chains, counted in the episode",
    "myopic:lags": "the last 10 steps of each channel",
    "myopic:stepped": "the same, and how stepped users move",
    "dqn": "rewards alone",
    "ppo": "rewards alone",
    "informed": "all users, but not their next choices",
}
PRICED = ("myopic", "myopic:lags")
TICKS = (0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5)
FARTHEST_SHOWN = 1.6  # costs over that of the reference, in the picture


def scenario(name: str, jobs: int) -> dict[str, Any]:
    """The figures of every policy in one scenario."""
    default, parameters = make_task(ENV_ID, {}).system, SCENARIOS[name]
    policies: dict[str, Any] = {rule: make_policy(rule, default, None) for rule in RULES}
    policies |= dict.fromkeys(FOUND_ANEW)
    policies |= {kind: make() for kind, make in KNOWING.items()} | saved(ENV_ID)
    found = compare(ENV_ID, policies, worlds=WORLDS, seed=SEED, jobs=jobs, keep=FOLDER, **parameters)
    rows = {policy: figures(found, policy, REFERENCE) for policy in found.played}
    result: dict[str, Any] = {"worlds": WORLDS, "policies": rows}
    if AGENT in found.played:
        for policy, row in ((each, row) for each, row in rows.items() if each != AGENT):
            row["agent"] = against(found, AGENT, policy)
    if name in BOUNDED:
        system: Any = found.task.system
        least = bound(system, draw_worlds(system, found.seeds))
        gap = statistics.difference(least[None], found.results(REFERENCE).cost, np.random.default_rng(SEED))
        result["bound"] = {"cost": float(least.mean()), **named("percent", "ci", gap.geometric)}
    return result


def priced(jobs: int) -> dict[str, Any]:
    """Policies that know the price, at each price."""
    rows = {}
    for price in PRICES:
        policies = [REFERENCE, *PRICED]
        found = compare(ENV_ID, policies, worlds=WORLDS, seed=SEED, jobs=jobs, keep=FOLDER, price=price)
        rows[f"{price:g}"] = {policy: figures(found, policy, REFERENCE) for policy in PRICED}
    return rows


def bound(system: SharedSpectrum, worlds: Any) -> Array:
    """Mean cost per step of the best bands of each world for one who knows all of its noise and echoes, (world,).

    For users that never react. The SNR of the errors is taken at the true range, not at the estimate, which changes
    them by some 1e-4: errors are metres, and ranges tens of kilometres.
    """
    (truth, belief), count, bands = system.initial(worlds), len(worlds.start), len(system.bands.width)
    F, Q = system.motion.F, system.motion.Q
    vague = np.broadcast_to(VAGUE * np.eye(2), (count, 2, 2))
    before = np.linalg.inv(F @ vague @ F.T + Q)
    R = np.empty((count, system.horizon, bands, 2, 2))
    for k in range(system.horizon):
        truth = system.move(truth, np.full(count, k), worlds)
        exact = truth.targets @ np.linalg.inv(F).T  # so that the estimate is predicted to be the truth
        belief = belief._replace(step=np.full(count, k), mean=exact, covariance=vague)
        for band in range(bands):
            action = np.full(count, band)
            after = system.track(belief, action, system.measure(truth, belief, action, worlds))
            R[:, k, band] = np.linalg.inv(np.linalg.inv(after.covariance) - before + np.eye(2) / UNSEEN)
    P0 = np.broadcast_to(np.diag(system.prior_variance), (count, 2, 2))
    found = best_schedule(Recursion(P0, F, Q, np.eye(2), R, np.array(system.weights)), tolerance=1e-3)
    return found.lower_bound / system.horizon


def against(found: Comparison, policy: str, reference: str) -> dict[str, Any]:
    """Cost by ``belief`` and squared error by ``truth`` against the reference, as plain types."""
    return {by: named("percent", "ci", found.against(policy, reference, by=by)) for by in ("belief", "truth")}


def figures(found: Comparison, policy: str, reference: str) -> dict[str, Any]:
    """Cost and error by truth, each against the reference, and what others suffer, as plain types."""
    own = found.results(policy)
    return {
        "cost": float(own.cost.mean()),
        **against(found, policy, reference),
        "nees": float(own.nees.mean()),
        "collisions": float(own.collisions.mean()),
        "share": float(own.share.mean()),
        "us": us_per_decision(found, policy),
    }


def read(name: str, folder: Path = FOLDER) -> dict[str, Any]:
    """The results of a scenario, or {}."""
    return blocks.read_results(folder / f"{name}.json")


def scenario_table(found: Mapping[str, Any]) -> str:
    """A line for each policy, the cheapest first."""
    head = ["policy", "mean cost m²", "cost %", "95 %", "squared error %", "95 %", "PPO against it %", "95 %",
            "by truth %", "95 %", "NEES", "collisions", "share %", "µs"]  # fmt: skip
    rows = []
    policies = found["policies"]
    for name in sorted(policies, key=lambda name: policies[name]["belief"]["percent"]):
        policy = policies[name]
        row = [f"`{name}`", number(policy["cost"])]
        for half in ("belief", "truth"):
            row += [signed(policy[half]["percent"]), interval(policy[half]["ci"], signed)]
        for estimate in policy["agent"].values() if "agent" in policy else [{"percent": None, "ci": None}] * 2:
            row += [signed(estimate["percent"]), interval(estimate["ci"], signed)]
        row += [f"{policy['nees']:.2f}", f"{policy['collisions']:.2f}", f"{100.0 * policy['share']:.0f}"]
        rows.append([*row, f"{policy['us']:.0f}"])
    if least := found.get("bound"):
        cells = [number(least["cost"]), signed(least["percent"]), interval(least["ci"], signed)]
        rows.insert(0, ["lower bound", *cells, *[""] * (len(head) - 4)])
    return tabulated(head, rows)


def price_table(found: Mapping[str, Any]) -> str:
    """A line for each price and policy."""
    head = ["price m²", "policy", "collisions", "share %", "squared error %", "95 %"]
    rows = [
        [price if policy == PRICED[0] else "", f"`{policy}`", f"{row['collisions']:.3f}", f"{100.0 * row['share']:.0f}",
         signed(row["truth"]["percent"]), interval(row["truth"]["ci"], signed)]
        for price, policies in found.items()
        for policy, row in policies.items()
    ]  # fmt: skip
    return tabulated(head, rows)


def page(folder: Path = FOLDER) -> str:
    """The generated part of the page."""
    parts = []
    for name, parameters in SCENARIOS.items():
        if found := read(name, folder):
            given = ", ".join(f"{parameter}={value!r}" for parameter, value in parameters.items())
            about = f"{ABOUT[name]}{f' (`{given}`)' if given else ''}; {found['worlds']} worlds."
            parts.append(f"### {name}\n\n{about[0].upper()}{about[1:]}\n\n{scenario_table(found)}")
    if found := read("price", folder):
        parts.append(f"### A price on occupied channels\n\nIn the mixture; {WORLDS} worlds.\n\n{price_table(found)}")
    return "\n\n".join(parts)


def picture(results: Mapping[str, Mapping[str, Any]]) -> bytes:
    """Cost of the policies in each scenario against the reference, with intervals, as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 6.4), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, (name, found) in zip(figure.subplots(2, 2).flat, results.items(), strict=False):
        ratios = {policy: 1.0 + row["belief"]["percent"] / 100.0 for policy, row in found["policies"].items()}
        shown = sorted((policy for policy in ratios if ratios[policy] < FARTHEST_SHOWN), key=lambda each: -ratios[each])
        for place, policy in enumerate(shown):
            low, high = (1.0 + end / 100.0 for end in found["policies"][policy]["belief"]["ci"])
            colour = "tab:red" if policy in AGENTS else "0.55" if policy in KNOWING else "tab:blue"
            axes.plot([low, high], [place] * 2, color=colour, linewidth=1.2)
            axes.plot([ratios[policy]], [place], "o", color=colour, markersize=4)
        axes.set_yticks(range(len(shown)), shown, fontsize=6)
        axes.set(xscale="log", title=name, xlabel=f"cost over that of {REFERENCE}")
        axes.minorticks_off()
        low, high = axes.get_xlim()
        ticks = [tick for tick in TICKS if low < tick < high]
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    return as_png(figure)


def front(found: Mapping[str, Any]) -> str:
    """README's table: what rewards alone teach, between the rules and an opponent that knows the users."""
    head = ["policy", "what it knows", "cost %", "95 %", "true squared error of range %", "95 %"]
    rows = []
    for name, knows in FRONT.items():
        policy = found["policies"][name]
        row = [f"`{name}`", knows]
        for half in ("belief", "truth"):
            row += [signed(policy[half]["percent"]), interval(policy[half]["ci"], signed)]
        rows.append(row)
    return tabulated(head, rows)


def renew(folder: Path = FOLDER) -> None:
    """Renew the page, its picture and README's table from all results."""
    blocks.renew(PAGE, START, END, page(folder))
    if found := read("mixture", folder):
        blocks.renew(README, START, END, front(found))
    shown = {name: found for name in ("mixture", "reactive", "hoppers", "eight-users") if (found := read(name, folder))}
    if shown:
        write_whole(PICTURE.parent, {PICTURE.name: picture(shown)})


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = Parser(prog="python -m agents.shared_band", description="Opponents in a shared band.")
    parser.add_argument(
        "scenarios", nargs="*", metavar="SCENARIO", help=f"{', '.join(SCENARIOS)}, price; all by default"
    )
    parser.add_argument("--tables", action="store_true", help="only renew the page")
    add_worker_options(parser)
    given = parser.read(arguments)
    names = [check_choice("scenario", name, (*SCENARIOS, "price")) for name in given.scenarios or (*SCENARIOS, "price")]
    if not given.tables:
        with workers(given):
            for name in names:
                found = priced(given.jobs) if name == "price" else scenario(name, given.jobs)
                write_whole(FOLDER, {f"{name}.json": (json.dumps(found, indent=1) + "\n").encode()})
                print(f"{name}: written", flush=True)
    renew()


if __name__ == "__main__":
    sys.exit(guarded(main))
