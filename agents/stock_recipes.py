"""What Stable-Baselines3's PPO reaches with its defaults: ``python -m agents.stock_recipes [NAME ...]``.

Each recipe differs in how the environment is made, never in the learner. The learned policies play worlds that no
training drew. Results go to results/stock_recipes, the table to docs/how_to/train_with_sb3.md. A training takes about
two minutes. A recipe that an environment does not offer is left out. ``--tables`` renews the page without training.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from agents import blocks
from agents.leaderboard import ROOT
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import InputError
from wavegym.core.files import write_whole
from wavegym.evaluation import compare
from wavegym.evaluation.summary import named
from wavegym.evaluation.table import interval, signed, tabulated
from wavegym.registration import full_id, stem

NAMES = ("CameraSlew", "BeamAllocation", "SectorSetup", "EnergyBudgetKnown", "AgileClutter", "KershawEvansPosition")
RECIPES: dict[str, dict[str, Any]] = {
    "all defaults": {},
    '`reward="scaled"`': {"reward": "scaled"},
    "and `forecasts=True`": {"reward": "scaled", "forecasts": True},
}
OPPONENTS = ("myopic", "best-simple")
STEPS, NUM_ENVS, WORLDS, SEED = 300_000, 8, 100, 1  # the seed of the worlds
FOLDER, PAGE = ROOT / "results" / "stock_recipes", ROOT / "docs" / "how_to" / "train_with_sb3.md"
START, END = "<!-- made by `python -m agents.stock_recipes`: -->", "<!-- stock recipes to here -->"


def learned(env_id: str, settings: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Cost of the trained policy against each opponent, in per cent, as plain types."""
    from stable_baselines3 import PPO

    from wavegym.envs.sb3 import SB3VecEnv

    model: Any = PPO("MlpPolicy", SB3VecEnv(env_id, num_envs=NUM_ENVS, **settings), seed=seed)
    model.learn(STEPS)
    found = compare(env_id, {"mine": model, "best-simple": None}, worlds=WORLDS, seed=SEED, jobs=1, progress=False)
    return {name: named("percent", "ci", found.against("mine", name)) for name in OPPONENTS}


def table(results: Mapping[str, Mapping[str, Any]]) -> str:
    """A line for each environment and recipe."""
    head = ["environment", "recipe", "cost against `myopic` %", "95 %", "against `best-simple` %", "95 %"]
    rows = []
    for name, by_recipe in results.items():
        for recipe, figures in by_recipe.items():
            cells = [
                cell
                for each in OPPONENTS
                for cell in (signed(figures[each]["percent"]), interval(figures[each]["ci"], signed))
            ]
            rows.append([name if recipe == next(iter(by_recipe)) else "", recipe, *cells])
    return tabulated(head, rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = Parser(prog="python -m agents.stock_recipes", description="PPO with its defaults, by several recipes.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of environments (default: {' '.join(NAMES)})")
    parser.add_argument("--seed", type=int, default=0, help="of the training (default: 0)")
    parser.add_argument("--tables", action="store_true", help="only renew the page")
    given = parser.read(arguments)
    for env_id in () if given.tables else [full_id(f"{name}-v0") for name in given.names or NAMES]:
        file = FOLDER / f"{stem(env_id)}.json"
        for recipe, settings in RECIPES.items():
            try:
                found = blocks.read_results(file) | {recipe: learned(env_id, settings, given.seed)}
            except InputError as error:  # no forecasts here
                print(env_id, recipe, f"left out: {error}", flush=True)
                continue
            write_whole(FOLDER, {file.name: (json.dumps(found, indent=1) + "\n").encode()})
            print(env_id, recipe, *(found[recipe][name]["percent"] for name in OPPONENTS), flush=True)
    results = {name: found for name in NAMES if (found := blocks.read_results(FOLDER / f"{name}.json"))}
    blocks.renew(PAGE, START, END, table(results))


if __name__ == "__main__":
    sys.exit(guarded(main))
