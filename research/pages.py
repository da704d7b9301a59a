"""The pages of the suite's environments in the docs: ``python -m research.pages``.

A page has an animated picture (``python -m agents.animations``) and the best known scores (``python -m
agents.leaderboard``), if there are any; then the text of ``wavegym.describe``; then training recipes (``python -m
agents.stock_recipes``) and the steps per second (``python -m research.benchmarks.steps``). README's table of
environments, the policies in docs/how_to/compare_policies.md and the training settings in
docs/how_to/train_with_other_libraries.md are renewed, too.
"""

from __future__ import annotations

import sys
import tomllib

import gymnasium as gym

from agents import blocks
from agents.leaderboard import HEADROOM, ROOT, entry, foresight, scores
from agents.stock_recipes import section as train_it
from research.benchmarks.steps import read as read_speeds
from research.benchmarks.steps import table as speed_table
from wavegym.core.command_line import Parser, guarded
from wavegym.core.files import write_whole
from wavegym.core.registry import load_object
from wavegym.envs.describe import describe, summary, table
from wavegym.evaluation.comparison import BASELINE
from wavegym.evaluation.report import TABLE
from wavegym.evaluation.table import signed
from wavegym.learning.settings import FILE, PPOSettings, load_settings
from wavegym.registration import NAMESPACE, SYSTEMS, TIERS, stem
from wavegym.schedulers.registry import MEANINGS
from wavegym.schedulers.tuned_constants import SIMPLE

FOLDER, IMAGES = ROOT / "docs" / "environments", ROOT / "docs" / "images"
README, HOW_TO = ROOT / "README.md", ROOT / "docs" / "how_to"
START, END = "<!-- made by `make docs`: -->", "<!-- to here -->"


def pages() -> dict[str, str]:
    """Every page by its file name, the index included."""
    rows: dict[str, list[tuple[str, ...]]] = {tier: [] for tier in TIERS}
    texts = {}
    for env_id, record in SYSTEMS.items():
        name = f"{env_id.partition('/')[2]}.md"
        env = gym.make(env_id)
        sizes = (str(env.action_space), f"{env.observation_space.shape[0]} fields")  # type: ignore[index]
        about = summary(type(env.unwrapped.system))  # type: ignore[attr-defined]
        rows[record.tier].append((f"[{env_id}]({name})", *sizes, about))
        texts[name] = page(env_id)
    head = ("environment", "actions", "observation", "description")
    parts = [
        f"## {tier.capitalize()}\n\n{meaning[0].upper()}{meaning[1:]}.\n\n{table(head, rows[tier])}"
        for tier, meaning in TIERS.items()
    ]
    overview = "\n\n".join(["# Environments", "Generated from the environments by `make docs`.", *parts])
    texts["index.md"] = f"{overview}\n"
    return texts


def page(env_id: str) -> str:
    """The page of one environment."""
    title, line, rest = describe(env_id).split("\n\n", 2)
    parts = [title, line]
    picture = IMAGES / f"{stem(env_id)}.webp"
    if picture.exists():
        parts.append(f"![an episode, step by step](../images/{picture.name})")
    if (HEADROOM / f"{env_id.partition('/')[2]}{TABLE}").exists():
        parts.append(scores(entry(env_id)))
    parts.append(rest)
    if recipes := train_it(env_id):
        parts.append(recipes)
    if speeds := [speed for speed in read_speeds() if speed.environment == stem(env_id)]:
        parts.append(
            f"## Speed\n\nSteps per second on one core ([how they are measured](../speed.md)).\n\n{speed_table(speeds)}"
        )
    return "\n\n".join(parts)


def front() -> str:
    """README's table: every environment, its best heuristic against myopic, and whether planning pays."""
    rows = []
    for env_id, record in SYSTEMS.items():
        name, cells = env_id.removeprefix(NAMESPACE), ("", "")
        if (HEADROOM / f"{name}{TABLE}").exists():
            e = entry(env_id)
            cells = f"{signed(e.against(SIMPLE, BASELINE).value)} %", foresight(e)
        about = summary(load_object("system", record.system))
        rows.append((f"[{name}](docs/environments/{name}.md)", record.tier, about, *cells))
    head = ("environment", "tier", "what happens", "best heuristic against myopic", "does foresight pay?")
    return table(head, rows)


def policies_table() -> str:
    """The policies that have a name in every environment."""
    return table(("name", "policy"), [(f"`{name}`", meaning) for name, meaning in MEANINGS.items()])


def settings_table() -> str:
    """The training settings of PPO in every environment that has settings of its own."""
    own = tomllib.loads(FILE.read_text(encoding="utf-8"))
    rows = []
    for env_id in filter(own.__contains__, SYSTEMS):
        found = load_settings(env_id, "ppo")
        assert isinstance(found, PPOSettings)
        forecasts, masks = ("yes" if is_on else "no" for is_on in (found.forecasts, found.masks))
        teacher = f"`{found.teacher}`" if found.teacher else "no"
        name, reward = env_id.removeprefix(NAMESPACE), f"`{found.reward}`"
        rows.append((f"`{name}`", reward, forecasts, f"{found.gamma:g}", teacher, masks, "none"))
    return table(("environment", "reward", "forecasts", "gamma", "imitates first", "masks", "normalisation"), rows)


def main() -> None:
    """The command."""
    Parser(prog="python -m research.pages", description="Write the pages of the environments.").read(None)
    write_whole(FOLDER, {name: text.encode() for name, text in pages().items()})
    blocks.renew(README, START, END, front())
    blocks.renew(HOW_TO / "compare_policies.md", START, END, policies_table())
    blocks.renew(HOW_TO / "train_with_other_libraries.md", START, END, settings_table())


if __name__ == "__main__":
    sys.exit(guarded(main))
