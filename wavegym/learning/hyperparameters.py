"""A search for training settings with Optuna: ``wavegym train ENV --algo ALGO --tune N --out DIR``.

Every trial trains with settings that the search proposes. Its score is the mean logarithm of its cost over the cost of
the best heuristic on the same tuning worlds; test worlds are never used. DIR/trials.log keeps the trials: the
same command continues an earlier search.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from joblib import effective_n_jobs

from wavegym.core.errors import InputError, check_int
from wavegym.core.files import csv_text, write_whole
from wavegym.core.work import Call, run_all
from wavegym.core.worlds import draw_worlds
from wavegym.evaluation import make_task, world_seeds
from wavegym.evaluation.play import play
from wavegym.learning.settings import load_settings
from wavegym.learning.train import train
from wavegym.learning.training_run import TrainingRun
from wavegym.policies.runs import load_policy
from wavegym.schedulers.registry import make_policy
from wavegym.schedulers.tuned_constants import SIMPLE

TRIALS, TABLE, BEST = "trials.log", "trials.csv", "best.toml"
SEED = 1  # of the worlds that score trials; heuristics are tuned on those of seed 0
WORLDS = 200
HEURISTIC_WORLDS = 50  # for a heuristic without recorded constants

# The search space: for each setting a range (low, high) on a logarithmic scale, or a list of values.
SPACE: dict[str, dict[str, tuple[float, float] | list[Any]]] = {
    "ppo": {
        "learning_rate": (1e-4, 3e-3),
        "gamma": [0.9, 0.95, 0.97, 0.98, 0.99],
        "gae_lambda": [0.8, 0.9, 0.95, 0.98],
        "n_steps": [25, 50, 100],
        "n_epochs": [4, 6, 10],
        "clip_range": [0.1, 0.2, 0.3],
        "ent_coef": (1e-5, 1e-2),
    },
    "dqn": {
        "learning_rate": (1e-4, 3e-3),
        "gamma": [0.9, 0.95, 0.97, 0.98, 0.99],
        "n_steps": [1, 3, 5],
        "batch_size": [128, 256, 512],
        "gradient_steps": [2, 4, 8],
        "target_update_interval": [1_600, 6_400, 25_600],
        "exploration_fraction": [0.1, 0.2, 0.4],
    },
}


def tune(
    env_id: str,
    algo: str,
    trials: int,
    seed: int,
    chosen: Mapping[str, Any],
    parameters: Mapping[str, Any],
    out: Path,
    jobs: int = 1,
) -> str:
    """Search until there are ``trials`` trials in ``out``; the best settings as TOML, also written to best.toml.

    Args:
        env_id: the environment's full id.
        algo: "ppo" or "dqn".
        trials: number of trials, earlier commands included.
        seed: of the search and of every training run.
        chosen: fixed settings, by name.
        parameters: of the environment.
        out: folder of the results.
        jobs: trials at a time, through joblib. A search proposes them together, before it knows their scores, so
            another number searches otherwise; -1 is one for each core.

    Raises:
        InputError: a setting out of range, ``trials`` or ``jobs`` below 1, or Optuna is not installed.
    """
    check_int("tune", trials, 1)
    if jobs != -1:
        check_int("jobs", jobs, 1)
    load_settings(env_id, algo, chosen, parameters)  # report a mistake before the first training
    experiment = _search(f"{env_id} {algo} {seed} {dict(chosen)} {dict(parameters)}", seed, out)
    space = {name: values for name, values in SPACE[algo].items() if name not in chosen}

    def proposed_run(trial: Any) -> TrainingRun:
        proposed = {name: _proposed(trial, name, values) for name, values in space.items()}
        return TrainingRun(env_id, algo, seed, load_settings(env_id, algo, {**chosen, **proposed}, parameters))

    at_once = effective_n_jobs(jobs)
    left = trials - len([t for t in experiment.trials if t.state.is_finished()])
    for first in range(0, left, at_once):
        asked = [experiment.ask() for _ in range(min(at_once, left - first))]
        scores = run_all([Call(judge, (proposed_run(trial),)) for trial in asked], at_once)
        for trial, score in zip(asked, scores, strict=True):
            experiment.tell(trial, score)
            print(f"trial {trial.number}: {100 * (np.exp(score) - 1):+.2f} % of {SIMPLE}", flush=True)
        write_whole(out, {TABLE: _table(experiment.trials).encode(), BEST: _toml(env_id, algo, experiment).encode()})
    return _toml(env_id, algo, experiment)


def _search(name: str, seed: int, out: Path) -> Any:
    """Optuna's study called ``name`` in the folder ``out``, new or continued."""
    try:
        import optuna
        from optuna.storages.journal import JournalFileBackend, JournalStorage
    except ImportError as error:
        raise InputError(f"--tune needs Optuna: {error}; pip install 'wavegym[tune]'") from None
    out.mkdir(parents=True, exist_ok=True)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    return optuna.create_study(
        storage=JournalStorage(JournalFileBackend(str(out / TRIALS))),
        study_name=name,
        sampler=optuna.samplers.TPESampler(seed=seed),
        load_if_exists=True,
    )


def judge(run: TrainingRun) -> float:
    """Train, and score: the mean logarithm of the cost over the best heuristic's on tuning worlds."""
    task = make_task(run.env, dict(run.settings.environment))
    tuning = draw_worlds(task.system, world_seeds(0, "tune", HEURISTIC_WORLDS))
    heuristic = make_policy(SIMPLE, task.system, tuning)
    seeds = world_seeds(SEED, "tune", WORLDS)
    with tempfile.TemporaryDirectory() as folder:
        train(run, Path(folder) / "run", run.settings.steps, progress=False)
        (policy,) = load_policy(Path(folder) / "run", run.env, task.system)
    cost, reference = (play(task, p, seeds).episode_cost() for p in (policy, heuristic))
    return float(np.log(cost / reference).mean())


def _proposed(trial: Any, name: str, values: tuple[float, float] | list[Any]) -> Any:
    if isinstance(values, tuple):
        return float(f"{trial.suggest_float(name, *values, log=True):.3g}")
    suggest: Callable[..., Any] = trial.suggest_categorical
    return suggest(name, values)


def _table(trials: list[Any]) -> str:
    """A row for each finished trial: number, score, settings."""
    names = sorted({name for trial in trials for name in trial.params})
    rows = (
        [trial.number, trial.value, *(trial.params.get(name, "") for name in names)]
        for trial in trials
        if trial.value is not None
    )
    return csv_text(["trial", "log_ratio", *names], rows)


def _toml(env_id: str, algo: str, experiment: Any) -> str:
    """The best settings as a table for wavegym/learning/settings.toml."""
    percent = 100 * (np.exp(experiment.best_value) - 1)
    lines = [f"# {percent:+.2f} % of {SIMPLE} on tuning worlds, the best of {len(experiment.trials)} trials"]
    values = {k: float(f"{v:.3g}") if isinstance(v, float) else v for k, v in experiment.best_params.items()}
    return "\n".join([*lines, f'["{env_id}".{algo}]', *(f"{name} = {value}" for name, value in values.items())]) + "\n"
