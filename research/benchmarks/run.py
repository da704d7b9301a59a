"""Run all benchmarks and print their tables: ``make benchmarks``; with ``--quick`` only the comparisons.

``--quick`` ends with an error if a ratio is below half of its target. That is a regression, whatever else the machine
does. Times are CPU times of one thread. Both sides of a ratio are measured in one run, so that the ratio is valid on
other machines.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import torch

from research.benchmarks import association, dwells, kalman, particle, planners, rf_eo, scheduling, training, urban
from research.benchmarks.timing import Ratio
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import InputError

PEERS = (
    ("filterpy", kalman.run),
    ("Stone Soup", association.run),
    ("NumPy + filterpy resampling", particle.run),
    ("filterpy", scheduling.run),
    ("filterpy", rf_eo.against_filterpy),
    ("Stone Soup", rf_eo.against_stone_soup),
    ("filterpy", urban.run),
)


def peers() -> Iterator[tuple[str, Ratio, float | None]]:
    """Every comparison with another library, as soon as it is measured: its name, the ratio, and the target, if any."""
    print("| work | ours (us) | peer (us) | ratio | least..greatest | goal |\n|---|---|---|---|---|---|")
    for peer, measure in PEERS:
        for name, (r, wanted) in measure().items():
            row = f"{r.ours_us:.3f} | {r.peer_us:.1f} | {r.ratio:.3g} | {r.low:.3g}..{r.high:.3g}"
            print(f"| {name}; {peer} | {row} | {'' if wanted is None else f'>= {wanted:g}'} |", flush=True)
            yield name, r, wanted


def main() -> None:
    """Print Markdown tables."""
    parser = Parser(
        prog="python -m research.benchmarks.run", description="Speed beside others, of planners and of training."
    )
    parser.add_argument("--quick", action="store_true", help="only other libraries; an error below half of a target")
    is_quick = parser.read(None).quick
    torch.set_num_threads(1)
    slow = [name for name, r, wanted in peers() if wanted is not None and r.ratio < wanted / 2.0]
    if not is_quick:
        others()
    elif slow:
        raise InputError(f"less than half as fast as the goal: {'; '.join(slow)}")


def others() -> None:
    """Tasks that no other library has: scans, dwells, planners and training."""
    print("\n| urban scan | us |\n|---|---|")
    for name, us in urban.scans().items():
        print(f"| {name} | {us:.0f} |")
    dwells.report()
    print("\n| planner | batch | us per decision | peak MiB |\n|---|---|---|---|")
    for name, decisions in (planners.run() | planners.rollouts() | rf_eo.lookaheads()).items():
        for d in decisions:
            print(f"| {name} | {d.batch} | {d.cpu_us:.1f} | {d.peak_mib:.1f} |")
    print(f"\nOne-step decision of RfEo on its grid, single: {rf_eo.decision_us():.0f} us, goal <= 1000 us.")
    for name in ("KershawEvansPosition-v0", "RfEo-v0"):
        share, speed = training.run(f"wavegym/{name}")
        print(f"The share of {name} in PPO's wall time at 64 environments: {share:.1%}, goal <= 10 %;")
        print(f"training speed: {speed:.0f} steps/s.")


if __name__ == "__main__":
    sys.exit(guarded(main))
