"""The subcommands ``train``, which trains an agent, and ``export``, which writes one as an ONNX file.

    wavegym train KershawEvansPosition-v0 --algo ppo --seed 0 --out runs/ppo/seed0

The same command with --resume continues a killed run and ends with the same weights; with more --steps it extends
the run. ``wavegym evaluate`` takes DIR as a policy. DIR/curve.csv holds the learning curve, DIR/tensorboard the files
of TensorBoard.
"""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from wavegym.cli.environments import environment_parser, read_environment
from wavegym.core.command_line import Parser, guarded, named_values
from wavegym.core.errors import InputError, check_choice, nearest
from wavegym.core.files import read_toml
from wavegym.core.parameters import parameter_infos
from wavegym.core.registry import import_package
from wavegym.core.work import add_worker_options, workers
from wavegym.registration import NAMESPACE


def parser() -> Parser:
    """The options."""
    options = environment_parser("train", "Train an agent.")
    options.add_argument("--algo", required=True, metavar="ALGO", help="ppo or dqn")
    steps = (
        "environment steps, rounded up to whole rollouts of all environments (default: wavegym/learning/settings.toml)"
    )
    options.add_argument("--steps", type=int, metavar="N", help=steps)
    seed = "training seed: of the network's first weights and of the training worlds (default: %(default)s)"
    options.add_argument("--seed", type=int, default=0, metavar="S", help=seed)
    options.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the run")
    setting = "training settings that replace those of wavegym/learning/settings.toml"
    options.add_argument("--setting", nargs="+", action="extend", default=[], metavar="NAME=VALUE", help=setting)
    options.add_argument(
        "--settings",
        type=Path,
        metavar="FILE.toml",
        help="a file of training settings, such as best.toml of --tune; --setting comes after it",
    )
    options.add_argument(
        "--checkpoint-every",
        type=int,
        default=50_000,
        metavar="N",
        help="steps between checkpoints (default: %(default)s)",
    )
    tune = "search settings until there are N trials, instead of one training; DIR/best.toml holds the best"
    options.add_argument("--tune", type=int, metavar="N", help=tune)
    add_worker_options(options, jobs=1, what="trials of --tune at a time")
    resume = "continue the run in DIR from its last checkpoint; with more --steps than it has, extend it"
    options.add_argument("--resume", action="store_true", help=resume)
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
    # These imports take seconds; a misspelt option is reported before them.
    from wavegym.learning.settings import load_settings
    from wavegym.learning.training_run import TrainingRun
    from wavegym.policies.runs import RUN, environment_of, read_run

    try:
        from wavegym.learning.train import train as train_agent
    except ImportError as error:
        raise InputError(f"training needs the extra: {error}; pip install 'wavegym[agents]'") from None
    env_id, parameters, chosen = _task(options)
    if options.steps is not None:
        chosen["steps"] = options.steps
    if options.tune is not None:
        from wavegym.learning.hyperparameters import tune

        with workers(options):
            best = tune(env_id, options.algo, options.tune, options.seed, chosen, parameters, options.out, options.jobs)
        print(f"{best}written to {options.out}: best.toml, trials.csv, trials.log")
        return
    settings = load_settings(env_id, options.algo, chosen, parameters)
    run = TrainingRun(env_id, options.algo, options.seed, settings)
    train_agent(run, options.out, options.checkpoint_every, options.resume, progress=not options.quiet)
    print(f"written to {options.out}: policy.npz, model.zip, run.json, curve.csv")
    if needed := environment_of(read_run(options.out / RUN)):
        same = shlex.join(f"{name}={value}" for name, value in needed.items())
        print(f"trained with other parameters: wavegym evaluate needs --set {same}")


def _task(options: Any) -> tuple[str, dict[str, Any], dict[str, Any]]:
    """The full id, the parameters of the environment, and the training settings that the options give.

    Of a scenario file, reward, forecasts and candidates are training settings. The run records values, not the file.
    """
    from wavegym.envs.scenario import read_scenario, scenario_differences

    env_id, parameters = read_environment(options.env, options.set)
    chosen = named_values(options.setting)
    _check_places(env_id, options.algo, parameters, chosen)
    settings = {**_settings_of(options.settings, env_id, options.algo), **chosen}
    file = parameters.pop("scenario", None)
    if file:
        stated = read_scenario(file).parameters
        parameters = {**scenario_differences(env_id, file), **parameters}
        shell = ("reward", "forecasts", "candidates")
        settings = {**{name: stated[name] for name in shell if name in stated}, **settings}
    return env_id, parameters, settings


def _check_places(env_id: str, algo: str, parameters: Iterable[str], settings: Iterable[str]) -> None:
    """Raise an InputError for a training setting after --set, or a parameter of the environment after --setting."""
    from wavegym.evaluation import make_task
    from wavegym.learning.settings import ALGORITHMS

    trained = {field.name for field in dataclasses.fields(ALGORITHMS[algo])}
    doubtful = {name: "set" for name in parameters if name in trained}
    doubtful |= {name: "setting" for name in settings if name not in trained}
    if doubtful:  # otherwise the system need not be made
        own = {info.name for info in parameter_infos(type(make_task(env_id, {}).system))}
        for name, option in doubtful.items():
            if (name in own) == (option == "setting"):
                other = "setting" if option == "set" else "set"
                raise InputError(f"--{option} {name}: expected --{other} {name}=VALUE")


def _settings_of(file: Path | None, env_id: str, algo: str) -> dict[str, Any]:
    """The settings in a file for an environment and an algorithm; none without a file."""
    if file is None:
        return {}
    tables = read_toml("settings", file)
    own = tables.get(env_id)
    if not isinstance(own, dict) or not isinstance(own.get(algo), dict):
        raise InputError(f'settings {str(file)!r} has no table, expected ["{env_id}".{algo}]{nearest(env_id, tables)}')
    return dict(own[algo])


def export_parser() -> Parser:
    """The options of ``export``."""
    options = Parser(prog="wavegym export", description="Write an agent as an ONNX file.")
    known = "folder of a finished run, or ENV/ALGO of an agent that comes with the package: RfEo-v0/ppo"
    options.add_argument("policy", metavar="POLICY", help=known)
    options.add_argument("--onnx", type=Path, required=True, metavar="FILE", help="the file to write")
    return options


def export(arguments: Sequence[str]) -> None:
    """Export and print the path of the file."""
    options = export_parser().read(arguments)
    from wavegym.policies.onnx_files import export_onnx

    export_onnx(_folder(options.policy), options.onnx)
    print(f"written to {options.onnx}")


def _folder(policy: str) -> Path:
    if Path(policy).is_dir():
        return Path(policy)
    from wavegym.policies.runs import pretrained_folder

    env_id, _, algo = policy.removeprefix(NAMESPACE).rpartition("/")
    folder = pretrained_folder(NAMESPACE + env_id, algo)
    if folder is None:
        wanted = "the folder of a run, or ENV/ALGO such as RfEo-v0/ppo"
        raise InputError(f"policy is {policy!r}, neither a folder nor an agent of the package, expected {wanted}")
    return folder


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its exit status."""
    return guarded(lambda: train(arguments))
