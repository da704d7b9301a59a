"""A step of each environment here and in another checkout: ``python -m research.benchmarks.environments OTHER [ID]``.

OTHER is the folder of another commit. A separate process plays each checkout, with the Python that runs this command.
The two are timed in turn, so that changes of the machine's speed cancel in the ratio.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

from research.benchmarks.timing import Ratio, summed_up
from wavegym.registration import SYSTEMS

HERE = Path(__file__).parents[2]
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


def compared(other: Path, env_id: str, count: int) -> Ratio:
    """Microseconds of a step here, and in the other checkout as the peer."""
    ours, theirs = Player(HERE, env_id, count), Player(other, env_id, count)
    found = summed_up([(ours.step_us(), theirs.step_us()) for _ in range(ROUNDS)])
    ours.close()
    theirs.close()
    return found


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(prog="python -m research.benchmarks.environments", description=__doc__)
    parser.add_argument("other", type=Path, help="folder of another commit")
    parser.add_argument("ids", nargs="*", metavar="ID", help="environments (default: all of the suite)")
    read = parser.parse_args()
    print(
        "| environment | batch | there (us) | here (us) | there / here | least..greatest |\n|---|---|---|---|---|---|"
    )
    for env_id in read.ids or SYSTEMS:
        for count in BATCHES[:1] if "Signal" in env_id else BATCHES:
            r = compared(read.other.resolve(), env_id, count)
            times = f"{r.peer_us:.3g} | {r.ours_us:.3g} | {r.ratio:.3g} | {r.low:.3g}..{r.high:.3g}"
            print(f"| {env_id} | {count} | {times} |", flush=True)


if __name__ == "__main__":
    main()
