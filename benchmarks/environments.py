"""Time a step of every environment, here and in another checkout: ``python -m benchmarks.environments OTHER [ID ...]``.

OTHER is the folder of another commit. Each checkout is played by a process of its own, with the Python that runs this.
The two are timed in turn, so that changes of the machine's speed cancel in the ratio.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
from pathlib import Path

from wavegym.registration import SYSTEMS

HERE = Path(__file__).parents[1]
BATCHES = (1, 256)
ROUNDS, SECONDS = 7, 0.3


class Player:
    """A process that plays one environment of a checkout."""

    def __init__(self, checkout: Path, env_id: str, count: int) -> None:
        self._process = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("environment_player.py")), env_id, str(count)],
            env={**os.environ, "PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def step_us(self) -> float:
        """CPU microseconds of a step of one environment."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(SECONDS, file=self._process.stdin, flush=True)
        return float(self._process.stdout.readline())

    def close(self) -> None:
        """End the process."""
        self._process.communicate()


def compared(other: Path, env_id: str, count: int) -> tuple[float, float, float, float, float]:
    """Microseconds there and here, and the ratio of here to there: medians, and the least and greatest ratio."""
    players = [Player(checkout, env_id, count) for checkout in (other, HERE)]
    pairs = [tuple(player.step_us() for player in players) for _ in range(ROUNDS)]
    for player in players:
        player.close()
    ratios = [ours / theirs for theirs, ours in pairs]
    theirs, ours = (statistics.median(column) for column in zip(*pairs, strict=True))
    return theirs, ours, statistics.median(ratios), min(ratios), max(ratios)


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.environments", description=__doc__)
    parser.add_argument("other", type=Path, help="folder of another commit")
    parser.add_argument("ids", nargs="*", metavar="ID", help="environments (default: all of the suite)")
    read = parser.parse_args()
    print(
        "| environment | batch | there (us) | here (us) | here / there | least..greatest |\n|---|---|---|---|---|---|"
    )
    for env_id in read.ids or SYSTEMS:
        for count in BATCHES[:1] if "Signal" in env_id else BATCHES:
            theirs, ours, ratio, low, high = compared(read.other.resolve(), env_id, count)
            print(
                f"| {env_id} | {count} | {theirs:.3g} | {ours:.3g} | {ratio:.3g} | {low:.3g}..{high:.3g} |", flush=True
            )


if __name__ == "__main__":
    main()
