"""An episode of each environment as an animated picture: ``python -m agents.animations [ENVIRONMENT ...]``.

PPO plays (first training seed), or the best heuristic if there is no saved agent. The pictures are written to
docs/images, and the pages of the environments show them.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
from PIL import Image

from agents.leaderboard import ROOT, environment_of, saved
from wavegym.core.command_line import Parser, guarded
from wavegym.evaluation import full_id
from wavegym.policies.runs import load_policy
from wavegym.registration import SYSTEMS, stem
from wavegym.schedulers.tuned_constants import SIMPLE

FOLDER = ROOT / "docs" / "images"
FRAMES, FRAME_MS, LAST_MS = 40, 250, 2000
WIDTH, QUALITY = 720, 60  # pixels; of WebP, 0 to 100
SEED = 0


def frames(env_id: str) -> list[Image.Image]:
    """At most ``FRAMES`` + 1 pictures of one episode, with the last one."""
    every = -(-sum(1 for _ in _episode(env_id)) // FRAMES)
    found = []
    for step, (env, is_over) in enumerate(_episode(env_id), 1):
        if step % every == 0 or is_over:
            found.append(_scaled(Image.fromarray(env.render())))
    return found


def _episode(env_id: str) -> Iterator[tuple[Any, bool]]:
    """The environment after each step of the same episode, and whether it is over."""
    folder = saved(env_id).get("ppo")
    env: Any = gym.make(env_id, render_mode="rgb_array", **(environment_of(folder) if folder else {}))
    loop = env.unwrapped
    env.reset(seed=SEED)
    choose = loop.policy(load_policy(folder, env_id, loop.system)[0] if folder else SIMPLE)
    is_over = False
    while not is_over:
        _, _, terminated, truncated, _ = env.step(choose())
        is_over = terminated or truncated
        yield env, is_over


def _scaled(frame: Image.Image) -> Image.Image:
    return frame.resize((WIDTH, round(WIDTH * frame.height / frame.width)), Image.Resampling.LANCZOS)


def write(pictures: list[Image.Image], file: Path) -> None:
    """Write an animated WebP file; the last picture stays longer."""
    first, *rest = pictures
    durations = [FRAME_MS] * len(rest) + [LAST_MS]
    first.save(file, save_all=True, append_images=rest, duration=durations, loop=0, quality=QUALITY, method=6)


def main() -> None:
    """The command."""
    parser = Parser(prog="python -m agents.animations", description="Animated pictures for the environments' pages.")
    parser.add_argument("ids", nargs="*", metavar="ID", default=list(SYSTEMS), help="environments (default: all)")
    for env_id in map(full_id, parser.read(None).ids):
        file = FOLDER / f"{stem(env_id)}.webp"
        write(frames(env_id), file)
        print(f"{file.relative_to(ROOT)}: {file.stat().st_size // 1024} KiB", flush=True)


if __name__ == "__main__":
    sys.exit(guarded(main))
