"""The pages of the suite's environments in the docs: ``python -m agents.pages``.

A page is what ``wavegym.describe`` says, below an animated picture (``python -m agents.animations``) and the best
scores known (``python -m agents.leaderboard``), if there are any, and above its steps per second
(``python -m benchmarks.steps``).
"""

from __future__ import annotations

import sys

import gymnasium as gym

from agents.leaderboard import HEADROOM, ROOT, entry, scores
from benchmarks.steps import read as read_speeds
from benchmarks.steps import table as speed_table
from wavegym.core.command_line import Parser, guarded
from wavegym.envs.describe import describe, summary, table
from wavegym.evaluation.account import TABLE
from wavegym.evaluation.files import write_whole
from wavegym.registration import SYSTEMS, stem

FOLDER, IMAGES = ROOT / "docs" / "environments", ROOT / "docs" / "images"


def pages() -> dict[str, str]:
    """Every page by its file name, the index included."""
    rows = []
    texts = {}
    for env_id in SYSTEMS:
        name = f"{env_id.partition('/')[2]}.md"
        env = gym.make(env_id)
        sizes = (str(env.action_space), f"{env.observation_space.shape[0]} fields")  # type: ignore[index]
        rows.append((f"[{env_id}]({name})", *sizes, summary(type(env.unwrapped.system))))  # type: ignore[attr-defined]
        texts[name] = page(env_id)
    overview = table(("environment", "actions", "observation", "description"), rows)
    texts["index.md"] = f"# Environments\n\nGenerated from the environments by `make docs`.\n\n{overview}\n"
    return texts


def page(env_id: str) -> str:
    """The page of one environment."""
    title, line, rest = describe(env_id).split("\n\n", 2)
    parts = [title, line]
    picture = IMAGES / f"{stem(env_id)}.webp"
    if picture.exists():
        parts.append(f"![an episode, step after step](../images/{picture.name})")
    if (HEADROOM / f"{env_id.partition('/')[2]}{TABLE}").exists():
        parts.append(scores(entry(env_id)))
    parts.append(rest)
    if speeds := [speed for speed in read_speeds() if speed.environment == stem(env_id)]:
        parts.append(
            f"## Speed\n\nSteps per second on one core ([how they are measured](../speed.md)).\n\n{speed_table(speeds)}"
        )
    return "\n\n".join(parts)


def main() -> None:
    """The command."""
    Parser(prog="python -m agents.pages", description="Write the pages of the environments.").read(None)
    write_whole(FOLDER, {name: text.encode() for name, text in pages().items()})


if __name__ == "__main__":
    sys.exit(guarded(main))
