"""What learners of Stable-Baselines3 reach from rewards alone: ``python -m agents.stock_recipes [NAME ...]``.

A recipe is a few lines of code: those that run here are those that the pages show. The learned policies play worlds
that no training drew. Results go to results/stock_recipes, a table to docs/how_to/train_with_sb3.md; ``python -m
research.pages`` puts the recipes of an environment on its page. A training takes two to ten minutes. ``--recipes``
trains some of them, ``--tables`` renews the page without training.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from time import process_time
from typing import Any

from agents import blocks
from agents.leaderboard import ROOT
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import check_choice
from wavegym.evaluation import compare
from wavegym.evaluation.summary import named
from wavegym.evaluation.table import interval, signed, tabulated
from wavegym.registration import full_id, stem

NAMES = (
    "CameraSlew", "SectorSetup", "EnergyBudgetKnown", "SharedSpectrum", "BeamAllocation", "AgileClutter",
    "KershawEvansPosition",
)  # fmt: skip
PPO = """from stable_baselines3 import PPO
from wavegym.envs.sb3 import SB3VecEnv

envs = SB3VecEnv("{env_id}", num_envs=8{settings})
model = PPO("MlpPolicy", envs, seed=0)
model.learn({steps})
"""
SCORER = """from stable_baselines3 import PPO
from wavegym.envs.sb3 import SB3VecEnv
from wavegym.learning.scorer import Layout, ScorerPolicy

envs = SB3VecEnv("{env_id}", num_envs=128{settings})
model = PPO(
    ScorerPolicy,
    envs,
    policy_kwargs={{"layout": Layout.of_environments(envs)}},
    n_steps=50,
    batch_size=1600,
    gamma=0.97,
    gae_lambda=0.95,
    learning_rate=lambda left: 1e-3 * left,
    seed=0,
)
model.learn({steps})
"""
DQN = """from stable_baselines3 import DQN
from wavegym.envs.sb3 import SB3VecEnv
from wavegym.learning.scorer import Layout, ScorerDQNPolicy

envs = SB3VecEnv("{env_id}", num_envs=8{settings})
model = DQN(
    ScorerDQNPolicy,
    envs,
    policy_kwargs={{"layout": Layout.of_environments(envs)}},
    train_freq=1,
    batch_size=128,
    buffer_size=300_000,
    gamma=0.95,
    learning_rate=1e-3,
    target_update_interval=1000,
    exploration_fraction=0.3,
    exploration_final_eps=0.02,
    seed=0,
)
model.learn({steps})
"""
LISTED = ', reward="scaled", candidates=64'
RECIPES = {
    "PPO, all defaults": (PPO, "", 300_000),
    'and `reward="scaled"`': (PPO, ', reward="scaled"', 300_000),
    "and `candidates=64`": (PPO, LISTED, 300_000),
    "and the scorer": (SCORER, LISTED, 1_000_000),
    "DQN and the scorer, on the same environment": (DQN, LISTED, 300_000),
}
HEADINGS = {  # on the environments' pages
    "and `candidates=64`": "PPO, all defaults",
    "and the scorer": "PPO with the scorer",
    "DQN and the scorer, on the same environment": "DQN with the scorer",
}
HEADS = ("cost against `myopic` %", "95 %", "against `best-simple` %", "95 %")
OPPONENTS = ("myopic", "best-simple")
WORLDS, SEED = 100, 1  # the seed of the worlds
FOLDER, PAGE = ROOT / "results" / "stock_recipes", ROOT / "docs" / "how_to" / "train_with_sb3.md"
START, END = "<!-- made by `python -m agents.stock_recipes`: -->", "<!-- stock recipes to here -->"


def code(recipe: str, env_id: str) -> str:
    """The lines of a recipe."""
    template, settings, steps = RECIPES[recipe]
    return template.format(env_id=env_id, settings=settings, steps=f"{steps:_}")


def learned(recipe: str, env_id: str) -> dict[str, Any]:
    """Cost of the trained policy against each opponent, in per cent, and the CPU time, as plain types."""
    namespace: dict[str, Any] = {}
    began = process_time()
    exec(compile(code(recipe, env_id), recipe, "exec"), namespace)
    took = process_time() - began
    policies = {"mine": namespace["model"], "best-simple": None}
    found = compare(env_id, policies, worlds=WORLDS, seed=SEED, jobs=1, progress=False)
    against = {name: named("percent", "ci", found.against("mine", name)) for name in OPPONENTS}
    return {**against, "cpu_seconds": round(took)}


def table(results: Mapping[str, Mapping[str, Any]]) -> str:
    """A line for each environment and recipe."""
    rows = []
    for name, by_recipe in results.items():
        known = [recipe for recipe in RECIPES if recipe in by_recipe]
        rows += [[name if recipe == known[0] else "", recipe, *_cells(by_recipe[recipe])] for recipe in known]
    return tabulated(["environment", "recipe", *HEADS], rows)


def _cells(figures: Mapping[str, Any]) -> list[str]:
    return [
        cell for each in OPPONENTS for cell in (signed(figures[each]["percent"]), interval(figures[each]["ci"], signed))
    ]


def section(env_id: str) -> str:
    """The recipes on an environment's page; "" where none was tried."""
    results = blocks.read_results(FOLDER / f"{stem(env_id)}.json")
    timed = [recipe for recipe in HEADINGS if "cpu_seconds" in results.get(recipe, {})]
    if not timed:
        return ""
    rows = [
        [HEADINGS[recipe], f"{results[recipe]['cpu_seconds'] / 60.0:.0f}", *_cells(results[recipe])] for recipe in timed
    ]
    listings = [f"{HEADINGS[recipe]}:\n\n```python\n{code(recipe, env_id)}```" for recipe in timed]
    about = (
        f"From rewards alone, one training seed, {WORLDS} test worlds. `candidates=64` shows the expected cost of each "
        "choice; the scorer is one network for all choices."
    )
    return "\n\n".join(["## Train it", about, tabulated(["recipe", "CPU minutes", *HEADS], rows), *listings])


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = Parser(prog="python -m agents.stock_recipes", description="Learners of Stable-Baselines3, by recipes.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of environments (default: {' '.join(NAMES)})")
    parser.add_argument("--recipes", nargs="*", default=[*RECIPES], metavar="RECIPE", help="which (default: all)")
    parser.add_argument("--tables", action="store_true", help="only renew the page")
    given = parser.read(arguments)
    for name in () if given.tables else given.names or NAMES:
        env_id, file = full_id(check_choice("environment", name, NAMES)), FOLDER / f"{name}.json"
        for recipe in given.recipes:
            found = learned(check_choice("recipe", recipe, RECIPES), env_id)
            blocks.add_result(file, recipe, found)
            print(env_id, recipe, *(found[name]["percent"] for name in OPPONENTS), flush=True)
    results = {name: found for name in NAMES if (found := blocks.read_results(FOLDER / f"{name}.json"))}
    blocks.renew(PAGE, START, END, table(results))


if __name__ == "__main__":
    sys.exit(guarded(main))
