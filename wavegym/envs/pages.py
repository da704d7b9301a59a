"""The pages of the suite's environments in the docs: ``python -m wavegym.envs.pages docs/environments``.

A page shows the animated picture ``../images/NAME.webp``, where there is one (``python -m agents.animations``).
"""

from __future__ import annotations

import sys
from pathlib import Path

import gymnasium as gym

from wavegym.envs.describe import describe, summary, table
from wavegym.registration import SYSTEMS, stem


def pages(images: Path) -> dict[str, str]:
    """Every page by its file name, the index included; ``images`` is the folder of the animated pictures."""
    rows = []
    texts = {}
    for id in SYSTEMS:
        name = f"{id.partition('/')[2]}.md"
        env = gym.make(id)
        sizes = (str(env.action_space), f"{env.observation_space.shape[0]} fields")  # type: ignore[index]
        rows.append((f"[{id}]({name})", *sizes, summary(type(env.unwrapped.system))))  # type: ignore[attr-defined]
        texts[name] = _illustrated(describe(id), images / f"{stem(id)}.webp")
    overview = table(("environment", "actions", "observation", "description"), rows)
    texts["index.md"] = f"# Environments\n\nGenerated from the environments by `make docs`.\n\n{overview}\n"
    return texts


def _illustrated(page: str, picture: Path) -> str:
    """The page with the picture below its summary; unchanged without a picture."""
    if not picture.exists():
        return page
    title, line, rest = page.split("\n\n", 2)
    return "\n\n".join([title, line, f"![an episode, step after step](../images/{picture.name})", rest])


def main(arguments: list[str]) -> int:
    """Write all pages into the folder named and print their paths."""
    if len(arguments) != 1:
        print("usage: python -m wavegym.envs.pages FOLDER", file=sys.stderr)
        return 2
    folder = Path(arguments[0])
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in pages(folder.parent / "images").items():
        (folder / name).write_text(text, encoding="utf-8")
        print(folder / name)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
