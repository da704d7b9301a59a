"""The subcommand ``play``: one episode with one policy."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wavegym.cli.environments import add_environment, read_environment
from wavegym.core.command_line import Parser
from wavegym.core.errors import InputError, check_int
from wavegym.core.policy import Clairvoyant

FRAME_MS = 200  # how long a GIF shows each step


def parser() -> Parser:
    """The options."""
    options = Parser(prog="wavegym play", description="Play one episode with a policy and print its cost.")
    add_environment(options)
    options.add_argument(
        "--policy", default="myopic", metavar="NAME", help="one that wavegym policies ENV lists (default: %(default)s)"
    )
    options.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the world (default: %(default)s)")
    options.add_argument("--gif", type=Path, metavar="FILE", help="write a picture of every step")
    return options


def play(arguments: Sequence[str]) -> None:
    """Play and print."""
    options = parser().read(arguments)
    check_int("seed", options.seed, 0)
    from wavegym.evaluation import make_task

    task = make_task(*read_environment(options.env, options.set))
    policy = _policy(options.policy, task, options.seed)
    costs, frames = _episode(task, policy, options.seed, draw=options.gif is not None)
    if options.gif:
        options.gif.parent.mkdir(parents=True, exist_ok=True)
        _write(frames, options.gif)
    mean = f"mean cost {np.mean(costs):.6g} over {len(costs)} steps"
    print(f"{task.env_id} seed {options.seed}, {options.policy}: {mean}")
    if options.gif:
        print(f"written to {options.gif}")


def _policy(name: str, task: Any, seed: int) -> Any:
    """The policy called ``name``; of several training runs the first."""
    from wavegym.cli.evaluate import policies
    from wavegym.core.worlds import tuning_tapes
    from wavegym.evaluation.adapters import as_policies

    found = policies(name)
    if len(found) > 1:
        raise InputError(f"--policy is {name!r}, expected one name (nearest: {next(iter(found))!r})")
    ((key, source),) = found.items()
    return as_policies(source or key, task, key, tapes=tuning_tapes(task.system, seed))[0]


def _episode(task: Any, policy: Any, seed: int, draw: bool) -> tuple[list[float], list[Any]]:
    """Costs after each step, and a frame at its beginning and after each step if ``draw``."""
    from wavegym.core.worlds import word
    from wavegym.envs import WaveformVectorEnv
    from wavegym.schedulers.rollout import allowed

    env = WaveformVectorEnv(
        task.system, 1, max_episode_steps=task.max_episode_steps, render_mode="rgb_array" if draw else None
    )
    observation, _ = env.reset(seed=[seed])
    policy.begin(task.system, 1, np.random.default_rng([word("policy"), seed]))
    if isinstance(policy, Clairvoyant):
        policy.reveal(env.world)
    costs: list[float] = []
    frames = [env.render()[0]] if draw else []  # type: ignore[index]
    ended = False
    while not ended:
        action = policy.act(env.belief, observation, allowed(task.system, env.belief))
        observation, _, terminated, truncated, info = env.step(action)
        costs.append(float(info["cost"][0]))
        frames += [env.render()[0]] if draw else []  # type: ignore[index]
        ended = bool(terminated[0] or truncated[0])
    return costs, frames


def _write(frames: list[Any], file: Path) -> None:
    from PIL import Image

    first, *rest = (Image.fromarray(frame) for frame in frames)
    first.save(file, format="GIF", save_all=True, append_images=rest, duration=FRAME_MS, loop=0)
