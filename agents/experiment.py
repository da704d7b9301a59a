"""Rebuild the tables under results/: ``python -m agents.experiment [STUDY ...]`` trains what is missing and compares.

``results/studies.toml`` says what a study is. Runs go to ``results/runs/STUDY/LEARNER/seedN``; one that was killed is
taken up again, a finished one is kept. Comparisons go to ``results/STUDY``, their tables into ``docs/results.md`` too.
"""

from __future__ import annotations

import os
import shutil
import sys
import tomllib
from dataclasses import field
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
from joblib import Parallel, delayed
from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from wavegym.cli.command import Parser, guarded, settings
from wavegym.core.errors import InputError, choice
from wavegym.evaluation import blocks, compare, write_report

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "results"
PAGE = ROOT / "docs" / "results.md"
CLOSED = ConfigDict(extra="forbid")


@dataclass(frozen=True, config=CLOSED)
class Learner:
    """What is trained, once for each seed.

    Attributes:
        algo: "ppo" or "dqn".
        set: settings other than those of wavegym/learning/settings.toml, ``["gamma=0"]``.
        environment: parameters of the environment it is trained in, ``["q=1"]``.
    """

    algo: str
    set: tuple[str, ...] = ()
    environment: tuple[str, ...] = ()


@dataclass(frozen=True, config=CLOSED)
class Study:
    """One table: policies on the same worlds.

    Attributes:
        env: id of the environment.
        worlds: how many; 0 trains the learners for ``make league``, which compares them with the ladder's schedulers.
        policies: schedulers by name.
        seeds: training seeds.
        learners: by name.
        environment: parameters of the environment, in training and comparison, ``["action=joint"]``.
        trained_in: another study whose learners are compared here too.
        tracks: a recording, relative to the repository; radar: where the radar stands.
    """

    env: str
    worlds: int = 0
    policies: tuple[str, ...] = ()
    seeds: tuple[int, ...] = ()
    learners: dict[str, Learner] = field(default_factory=dict)
    environment: tuple[str, ...] = ()
    trained_in: str | None = None
    tracks: Path | None = None
    radar: tuple[float, ...] | None = None

    def parameters(self) -> dict[str, Any]:
        """The environment's parameters."""
        given = settings(self.environment)
        if self.tracks is None:
            return given
        return {**given, "targets": "recorded", "tracks": os.path.relpath(ROOT / self.tracks), "radar": self.radar}


def load_studies(file: Path = FOLDER / "studies.toml") -> dict[str, Study]:
    """All studies of a file; InputError where it is not one."""
    try:
        return TypeAdapter(dict[str, Study]).validate_python(tomllib.loads(file.read_text(encoding="utf-8")))
    except (ValidationError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{file}: {' '.join(str(error).split())}") from None


def train_missing(name: str, study: Study, jobs: int) -> None:
    """Train every learner of a study with every seed, ``jobs`` at a time."""
    # Compile the kernels here, not in several processes at once.
    envs = gym.make_vec(study.env, num_envs=2, reward="relative", **settings(study.environment))
    envs.reset(seed=0)
    envs.step(envs.action_space.sample())
    work = [
        delayed(_train)(study.env, study.environment, learner, seed, run_folder(name, label) / f"seed{seed}")
        for label, learner in study.learners.items()
        for seed in study.seeds
    ]
    Parallel(n_jobs=jobs)(work)


def _train(env: str, shared: tuple[str, ...], learner: Learner, seed: int, folder: Path) -> None:
    from wavegym.learning.settings import load_settings
    from wavegym.learning.training.run_spec import Plan
    from wavegym.learning.training.train import train
    from wavegym.policies.runs import RUN

    if (folder / RUN).exists():
        return
    environment = {**settings(shared), **settings(learner.environment)}
    plan = Plan(env, learner.algo, seed, load_settings(env, learner.algo, settings(learner.set), environment))
    train(plan, folder, checkpoint_every=200_000, resume=(folder / "plan.json").exists(), progress=False)


def run_folder(study: str, learner: str) -> Path:
    """Where the runs of a learner are, one folder for each seed."""
    return FOLDER / "runs" / study / learner


def run(name: str, studies: dict[str, Study], jobs: int) -> str:
    """Train and compare one study; its table."""
    from wavegym.policies.runs import load_policy

    study = studies[name]
    train_missing(name, study, jobs)
    policies: dict[str, Any] = dict.fromkeys(study.policies)
    for source in filter(None, (name, study.trained_in)):
        for learner in studies[source].learners:
            policies[learner] = partial(load_policy, run_folder(source, learner), study.env)
    comparison = compare(study.env, policies, worlds=study.worlds, jobs=jobs, **study.parameters())
    table = write_report(comparison, FOLDER / name)
    shutil.copyfile(FOLDER / name / "comparison.png", PAGE.parent / "images" / f"{name}.png")
    begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    blocks.renew(PAGE, begin, end, table.strip())
    return table


def main() -> None:
    """The command."""
    parser = Parser(prog="python -m agents.experiment", description="Rebuild the tables under results/.")
    parser.add_argument("studies", nargs="*", metavar="STUDY", help="which (default: all)")
    parser.add_argument("--train", action="store_true", help="train what is missing, compare nothing")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    options = parser.read(None)
    studies = load_studies()
    for name in options.studies or studies:
        choice("study", name, studies)
        if options.train or not studies[name].worlds:
            train_missing(name, studies[name], options.jobs)
            continue
        print(f"\n## {name}\n\n{run(name, studies, options.jobs)}")


if __name__ == "__main__":
    sys.exit(guarded(main))
