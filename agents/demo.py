"""Train PPO to schedule waveforms, then compare it with the analytic schedulers; takes about a minute.

The training is shorter than that of the agent in wavegym, and uses only the environment's defaults.

    python -m agents.demo --out out/demo

The trained run is written to DIR/ppo, the comparison to DIR/summary.json, episodes.csv, table.md and comparison.png. No
file is overwritten: if DIR is not empty, the results are written to DIR-2, then DIR-3, ...
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import count
from pathlib import Path

from wavegym.core.command_line import Parser, guarded

ENV = "wavegym/SharedSpectrum-v0"
SCHEDULERS = "random,best-fixed,sense-and-avoid,claim,myopic,myopic:context-tree,myopic:lags,myopic:stepped"
STEPS = 480_000
CHECKPOINT_EVERY = 100_000


def parser() -> Parser:
    """The options."""
    options = Parser(prog="python -m agents.demo", description=__doc__.partition("\n")[0])
    options.add_argument("--out", type=Path, default=Path("out/demo"), metavar="DIR", help="default: %(default)s")
    options.add_argument(
        "--worlds", type=int, default=200, metavar="N", help="number of test worlds (default: %(default)s)"
    )
    options.add_argument("--steps", type=int, default=STEPS, metavar="N", help="training steps (default: %(default)s)")
    return options


def unused(folder: Path) -> Path:
    """``folder`` if it is new or empty, else the first of folder-2, folder-3, ... that is new or empty."""
    names = (folder if n == 1 else folder.with_name(f"{folder.name}-{n}") for n in count(1))
    return next(path for path in names if not path.exists() or (path.is_dir() and not any(path.iterdir())))


def demo(arguments: Sequence[str] | None) -> None:
    """Train, compare, print."""
    options = parser().read(arguments)
    from wavegym.cli.evaluate import evaluate
    from wavegym.learning.settings import load_settings
    from wavegym.learning.train import train
    from wavegym.learning.training_run import TrainingRun

    out = unused(options.out.absolute())
    settings = load_settings(ENV, "ppo", {"steps": options.steps, "variants": ()})
    print(f"training PPO on {ENV} for {settings.steps} steps, half a minute or more", flush=True)
    train(TrainingRun(ENV, "ppo", 0, settings), out / "ppo", CHECKPOINT_EVERY)
    print(f"comparing it with the analytic schedulers on {options.worlds} test worlds", flush=True)
    evaluate([ENV, "--policies", f"{SCHEDULERS},{out / 'ppo'}", "--worlds", str(options.worlds), "--out", str(out)])
    print(f"the picture: {out / 'comparison.png'}")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its exit status."""
    return guarded(lambda: demo(arguments))


if __name__ == "__main__":
    sys.exit(main())
