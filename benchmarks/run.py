"""Run all benchmarks and print their tables: ``make benchmarks``.

Times are CPU times of one thread. Both sides of a ratio are measured in one run: ratios hold on other machines too.
"""

from __future__ import annotations

import torch

from benchmarks import association, dwells, kalman, particle, planners, rf_eo, scheduling, training, urban

PEERS = (
    ("filterpy", kalman.run),
    ("Stone Soup", association.run),
    ("NumPy + filterpy resampling", particle.run),
    ("filterpy", scheduling.run),
    ("filterpy", rf_eo.against_filterpy),
    ("Stone Soup", rf_eo.against_stone_soup),
    ("filterpy", urban.run),
)


def main() -> None:
    """Print Markdown tables."""
    torch.set_num_threads(1)
    print("| work | ours (us) | peer (us) | ratio | least..greatest | wanted |\n|---|---|---|---|---|---|")
    for peer, measure in PEERS:
        for name, (r, wanted) in measure().items():
            row = f"{r.ours_us:.3f} | {r.peer_us:.1f} | {r.ratio:.3g} | {r.low:.3g}..{r.high:.3g}"
            print(f"| {name}; {peer} | {row} | {'' if wanted is None else f'>= {wanted:g}'} |")
    print("\n| urban scan | us |\n|---|---|")
    for name, us in urban.scans().items():
        print(f"| {name} | {us:.0f} |")
    dwells.report()
    print("\n| planner | batch | us per decision | peak MiB |\n|---|---|---|---|")
    for name, decisions in (planners.run() | planners.rollouts() | rf_eo.lookaheads()).items():
        for d in decisions:
            print(f"| {name} | {d.batch} | {d.cpu_us:.1f} | {d.peak_mib:.1f} |")
    print(f"\nOne-step decision of RfEo on its grid, single: {rf_eo.decision_us():.0f} us, wanted <= 1000 us.")
    for name in ("KershawEvansPosition-v0", "RfEo-v0"):
        share, speed = training.run(f"wavegym/{name}")
        print(f"The share of {name} in PPO's wall time at 64 environments: {share:.1%}, wanted <= 10 %;")
        print(f"training speed: {speed:.0f} steps/s.")


if __name__ == "__main__":
    main()
