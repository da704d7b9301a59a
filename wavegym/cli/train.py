"""Train a waveform scheduler.

    python train.py KershawEvansPosition-v0 --algo ppo --seed 0 --out runs/ppo/seed0

A run that was killed goes on with the same command and --resume, to the same weights. DIR is then a policy for
evaluate.py, with the learning curve in DIR/curve.csv and TensorBoard's files in DIR/tensorboard.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from wavegym.core.command_line import Parser, guarded, settings
from wavegym.core.errors import check_choice
from wavegym.core.registry import import_package


def parser() -> Parser:
    """The options."""
    options = Parser(prog="train.py", description=__doc__.partition("\n")[0])
    options.add_argument("env", metavar="ENV", help="id of the environment, with or without wavegym/")
    options.add_argument("--algo", required=True, metavar="ALGO", help="ppo or dqn")
    steps = (
        "environment steps, rounded up to whole rollouts of all environments (default: wavegym/learning/settings.toml)"
    )
    options.add_argument("--steps", type=int, metavar="N", help=steps)
    options.add_argument("--seed", type=int, default=0, metavar="S", help="number of the run (default: %(default)s)")
    options.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the run")
    several: Any = {"nargs": "+", "action": "extend", "default": [], "metavar": "KEY=VALUE"}
    options.add_argument("--set", **several, help="settings other than in wavegym/learning/settings.toml")
    options.add_argument("--environment", **several, help="parameters of the environment other than its defaults")
    options.add_argument(
        "--checkpoint-every", type=int, default=50_000, metavar="N", help="steps (default: %(default)s)"
    )
    tune = "instead of one training, search settings until there are N trials; DIR/best.toml has the best"
    options.add_argument("--tune", type=int, metavar="N", help=tune)
    options.add_argument("--resume", action="store_true", help="go on with the run in DIR, from its last checkpoint")
    packages = "import a package that registers environments, schedulers, rewards or chirp laws; may be repeated"
    options.add_argument("--import", action="append", default=[], dest="packages", metavar="PACKAGE", help=packages)
    options.add_argument("--quiet", action="store_true", help="no progress bar")
    return options


def train(arguments: Sequence[str] | None) -> None:
    """Read the options and the settings, then train."""
    options = parser().read(arguments)
    check_choice("algorithm", options.algo, ["ppo", "dqn"])
    for package in options.packages:
        import_package(package)
    # Seconds of imports that a misspelt option need not wait for.
    from wavegym.evaluation import full_id
    from wavegym.learning.settings import load_settings
    from wavegym.learning.training.run_spec import RunSpec
    from wavegym.learning.training.train import train as run

    env_id, changes = full_id(options.env), settings(options.set)
    if options.steps is not None:
        changes["steps"] = options.steps
    if options.tune is not None:
        from wavegym.learning.training.hyperparameters import tune

        best = tune(
            env_id, options.algo, options.tune, options.seed, changes, settings(options.environment), options.out
        )
        print(f"{best}written to {options.out}: best.toml, trials.csv, trials.log")
        return
    chosen = load_settings(env_id, options.algo, changes, settings(options.environment))
    spec = RunSpec(env_id, options.algo, options.seed, chosen)
    run(spec, options.out, options.checkpoint_every, options.resume, progress=not options.quiet)
    print(f"written to {options.out}: policy.npz, model.zip, run.json, curve.csv")
    if chosen.environment:
        same = shlex.join(f"{name}={value}" for name, value in chosen.environment.items())
        print(f"trained with {same}: evaluate.py takes the same as --set {same}")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its exit status."""
    return guarded(lambda: train(arguments))
