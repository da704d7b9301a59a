"""Train missing agents and rebuild the tables under results/: ``python -m agents.experiment [EXPERIMENT ...]``.

``results/experiments.toml`` defines the experiments. Runs are in ``results/runs/EXPERIMENT/AGENT/seedN``: a killed run
is resumed, a finished run is kept. Comparisons are written to ``results/EXPERIMENT``, their tables also to
``docs/results.md``.
"""

from __future__ import annotations

import os
import shutil
import sys
import tomllib
from dataclasses import field
from pathlib import Path
from typing import Any

import gymnasium as gym
from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from agents import blocks
from wavegym.core.command_line import Parser, guarded, named_values
from wavegym.core.errors import InputError, check_choice
from wavegym.core.work import Call, run_all
from wavegym.evaluation import compare, write_report

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "results"
PAGE = ROOT / "docs" / "results.md"
CLOSED = ConfigDict(extra="forbid")


@dataclass(frozen=True, config=CLOSED)
class Agent:
    """An agent, trained once for each seed.

    Attributes:
        algo: "ppo" or "dqn".
        settings: training settings that replace those of wavegym/learning/settings.toml, ``["gamma=0"]``.
        parameters: of the environment, in training, ``["q=1"]``. The agent is in tables with the same parameters only,
            because it may have other actions.
        seeds: training seeds; if none are given, those of the experiment.
    """

    algo: str
    settings: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    seeds: tuple[int, ...] = ()


@dataclass(frozen=True, config=CLOSED)
class Experiment:
    """One table: policies on the same worlds.

    Attributes:
        env: id of the environment.
        worlds: number of test worlds; with 0 the agents are only trained, and ``make leaderboard`` compares them.
        policies: names of schedulers.
        seeds: training seeds.
        agents: by name.
        parameters: of the environment, in training and comparison, ``["action=joint"]``.
        trained_in: another experiment, whose agents are also compared here.
        tracks: a recording, relative to the repository.
        radar: position of the radar.
        shifts: changed parameters by name, ``{"process noise x4": ["q=4"]}``; ``agents.distribution_shift`` plays them.
    """

    env: str
    worlds: int = 0
    policies: tuple[str, ...] = ()
    seeds: tuple[int, ...] = ()
    agents: dict[str, Agent] = field(default_factory=dict)
    parameters: tuple[str, ...] = ()
    trained_in: str | None = None
    tracks: Path | None = None
    radar: tuple[float, ...] | None = None
    shifts: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def all_parameters(self) -> dict[str, Any]:
        """The environment's parameters, with the recorded targets."""
        given = named_values(self.parameters)
        if self.tracks is None:
            return given
        return {**given, "targets": "recorded", "tracks": os.path.relpath(ROOT / self.tracks), "radar": self.radar}


def load_experiments(file: Path = FOLDER / "experiments.toml") -> dict[str, Experiment]:
    """All experiments of a file; InputError if the file is not valid."""
    try:
        return TypeAdapter(dict[str, Experiment]).validate_python(tomllib.loads(file.read_text(encoding="utf-8")))
    except (ValidationError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{file}: {' '.join(str(error).split())}") from None


def train_missing(name: str, experiment: Experiment, jobs: int) -> None:
    """Train every agent of an experiment with every seed, ``jobs`` at a time."""
    # Compile the kernels once here, not in each process.
    envs: Any = gym.make_vec(experiment.env, num_envs=2, **named_values(experiment.parameters))
    envs.reset(seed=0)
    envs.step(envs.unwrapped.policy("myopic")())
    work = [
        Call(_train, (experiment.env, experiment.parameters, agent, seed, run_folder(name, label) / f"seed{seed}"))
        for label, agent in experiment.agents.items()
        for seed in agent.seeds or experiment.seeds
    ]
    run_all(work, jobs)


def _train(env: str, shared: tuple[str, ...], agent: Agent, seed: int, folder: Path) -> None:
    from wavegym.learning.settings import load_settings
    from wavegym.learning.train import train
    from wavegym.learning.training_run import TrainingRun
    from wavegym.policies.runs import RUN

    if (folder / RUN).exists():
        return
    parameters = {**named_values(shared), **named_values(agent.parameters)}
    settings = load_settings(env, agent.algo, named_values(agent.settings), parameters)
    run = TrainingRun(env, agent.algo, seed, settings)
    train(run, folder, checkpoint_every=200_000, resume=(folder / "training.json").exists(), progress=False)


def run_folder(experiment: str, agent: str) -> Path:
    """The folder with the runs of an agent, one folder for each seed."""
    return FOLDER / "runs" / experiment / agent


def run(name: str, experiments: dict[str, Experiment], jobs: int) -> str:
    """Train and compare one experiment; returns its table."""
    experiment = experiments[name]
    train_missing(name, experiment, jobs)
    policies: dict[str, Any] = dict.fromkeys(experiment.policies)
    for source in filter(None, (name, experiment.trained_in)):
        for label, agent in experiments[source].agents.items():
            if agent.parameters == experiment.parameters:
                policies[label] = run_folder(source, label)
    common: dict[str, Any] = {"worlds": experiment.worlds, "jobs": jobs, "keep": FOLDER / name}
    comparison = compare(experiment.env, policies, **common, **experiment.all_parameters())
    table = write_report(comparison, FOLDER / name)
    shutil.copyfile(FOLDER / name / "comparison.png", PAGE.parent / "images" / f"{name}.png")
    begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    blocks.renew(PAGE, begin, end, table.strip())
    return table


def main() -> None:
    """The command."""
    parser = Parser(prog="python -m agents.experiment", description="Rebuild the tables under results/.")
    parser.add_argument("experiments", nargs="*", metavar="EXPERIMENT", help="which (default: all)")
    parser.add_argument("--train", action="store_true", help="train missing agents, compare nothing")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    options = parser.read(None)
    experiments = load_experiments()
    for name in options.experiments or experiments:
        check_choice("experiment", name, experiments)
        if options.train or not experiments[name].worlds:
            train_missing(name, experiments[name], options.jobs)
            continue
        print(f"\n## {name}\n\n{run(name, experiments, options.jobs)}")


if __name__ == "__main__":
    sys.exit(guarded(main))
