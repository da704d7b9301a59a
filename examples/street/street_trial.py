"""Is there a decision for the street in which planning gains 5 %? The figures of docs/street.md.

    cd examples/street && python street_trial.py --choices "turning beam,energy" --page ../../docs/street.md

Three choices of ``street.py``. The best heuristic is chosen on tuning worlds and is the base of the planners. All
policies play the same test worlds.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from street import Street

from wavegym.core.worlds import draw_worlds, word, world_seeds
from wavegym.schedulers.heuristics.index_policies import CostOfDelay
from wavegym.schedulers.heuristics.price_policies import LagrangianPrice
from wavegym.schedulers.lookahead import Lookahead
from wavegym.schedulers.myopic import Myopic
from wavegym.schedulers.planners.rollout import RolloutPlanner
from wavegym.schedulers.simple import Cycle, RandomChoice

TRIALS = {
    "turning beam": {"kind": "revisit", "dead_scans": 4},
    "energy": {"kind": "energy"},
    "time": {"kind": "time"},
}
HEAD = (
    "| choice | policy | mean cost, m² | cost against the best heuristic, % (95 %) | squared GOSPA, % (95 %) |",
    "|:--|:--|--:|--:|--:|",
)
BEGIN, END = "<!-- made by `street_trial.py`: -->", "<!-- street to here -->"


def simple_rules(system: Street) -> Iterator[tuple[str, Any]]:
    """Cycles, the one-step scheduler, and an index or price heuristic with several constants."""
    yield "myopic", Myopic()
    if system.kind == "energy":
        for every in (4, 5, 6):
            yield f"one scan in {every}", Cycle(np.array([0] + [1] * (every - 1)))
        for price, ahead, power in product((10.0, 100.0, 1000.0), (8,), (0.0, 1.0)):
            yield f"lagrangian-price({price:g}, {ahead}, {power:g})", LagrangianPrice(price, ahead, power)
        return
    for scans in (1, 2, 3, 4, 5, 6, 7, 8, 10, 12):
        yield f"{scans} scan{'s' * (scans > 1)} each", Cycle(np.repeat([0, 1], scans))
    if system.kind == "time":
        yield "always both", Cycle(np.array([2]))
    for alpha, ahead, power in product((0.3,), (8, 20), (0.4, 1.3)):
        yield f"cost-of-delay({alpha:g}, {ahead}, {power:g})", CostOfDelay(alpha, 4, ahead, power, 0.2)


def planners(base: Any) -> Iterator[tuple[str, Any]]:
    """Planners on the best heuristic, and one without a base."""
    yield "lookahead:3", Lookahead(3)
    yield "rollout:12", RolloutPlanner(base, 12, holds=(1, 4), futures=4)


def played(system: Street, policy: Any, worlds: Any) -> tuple[Any, Any]:
    """Mean cost by belief and mean squared GOSPA distance of each world, (world,) m^2."""
    state, cost, error = system.initial(worlds), [], []
    policy.begin(system, len(worlds.key), np.random.default_rng(word("policy")))
    for _ in range(system.horizon):
        state = system.transition(state, policy.act(state.belief, None, system.mask(state.belief)), worlds)
        cost.append(system.cost(state.belief))
        error.append(system.state_info(state)["squared_gospa"])
    return np.mean(cost, axis=0), np.mean(error, axis=0)


def against(values: Any, reference: Any) -> str:
    """Geometric mean of the paired ratios less 1, in per cent, with its 95 % bootstrap interval."""
    logs, rng = np.log(values / reference), np.random.default_rng(0)
    means = logs[rng.integers(len(logs), size=(2000, len(logs)))].mean(axis=1)
    middle, low, high = (100.0 * np.expm1(v) for v in (logs.mean(), *np.quantile(means, (0.025, 0.975))))
    return f"{middle:+.1f} ({low:+.1f} to {high:+.1f})"


def rows(name: str, tunings: int, count: int) -> Iterator[str]:
    """The lines of one choice in the table."""
    system = Street(**TRIALS[name])
    tuning, test = (draw_worlds(system, world_seeds(0, split, n)) for split, n in (("tune", tunings), ("test", count)))
    rules = dict(simple_rules(system))
    costs = {rule: float(np.log(played(system, policy, tuning)[0]).mean()) for rule, policy in rules.items()}
    best = min(costs, key=lambda rule: costs[rule])
    reference = played(system, rules[best], test)
    yield f"| {name} | best-simple: {best} | {reference[0].mean():.0f} | 0 | 0 |"
    for policy, choice in (("random", RandomChoice()), ("myopic", Myopic()), *planners(rules[best])):
        cost, error = played(system, choice, test)
        by_belief, by_truth = against(cost, reference[0]), against(error, reference[1])
        yield f"| | {policy} | {cost.mean():.0f} | {by_belief} | {by_truth} |"


def renew(page: Path, name: str, lines: list[str]) -> None:
    """Put the lines of one choice into the page's table; the lines of other choices stay."""
    before, _, rest = page.read_text().partition(BEGIN)
    table, _, after = rest.partition(END)
    kept: dict[str, list[str]] = {}
    choice = ""
    for line in table.strip().splitlines()[len(HEAD) :]:
        choice = line.split("|")[1].strip() or choice
        kept.setdefault(choice, []).append(line)
    kept[name] = lines
    made = [line for choice in TRIALS for line in kept.get(choice, [])]
    page.write_text(f"{before}{BEGIN}\n\n" + "\n".join((*HEAD, *made)) + f"\n\n{END}{after}")


def main() -> None:
    """The command."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--worlds", type=int, default=100, help="test worlds (default: 100)")
    options.add_argument("--tuning", type=int, default=20, help="tuning worlds (default: 20)")
    options.add_argument("--choices", default=",".join(TRIALS), help="of the trial (default: all)")
    options.add_argument("--page", type=Path, default=None, help="a page whose table is renewed")
    given = options.parse_args()
    for name in given.choices.split(","):
        lines = []
        for line in rows(name, given.tuning, given.worlds):
            print(line, flush=True)
            lines.append(line)
        if given.page:
            renew(given.page, name, lines)


if __name__ == "__main__":
    main()
