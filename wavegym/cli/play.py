"""The subcommands ``play``, one episode with one policy, and ``dataset``, episodes as a Minari dataset."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wavegym.cli.environments import environment_parser, read_environment
from wavegym.core.command_line import Parser
from wavegym.core.errors import InputError, check_int

FRAME_MS = 200  # how long a GIF shows each step


def play_parser() -> Parser:
    """The options of ``play``."""
    options = environment_parser("play", "Play one episode with a policy and print its cost.")
    options.add_argument(
        "--policy", default="myopic", metavar="NAME", help="one that wavegym policies ENV lists (default: %(default)s)"
    )
    options.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the world (default: %(default)s)")
    options.add_argument("--gif", type=Path, metavar="FILE", help="write a picture of every step")
    return options


def play(arguments: Sequence[str]) -> None:
    """Play and print."""
    options = play_parser().read(arguments)
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


def one_policy(name: str) -> tuple[str, Path | None]:
    """The policy that ``--policy`` names, as ``wavegym.cli.evaluate.policies`` gives it. InputError for several."""
    from wavegym.cli.evaluate import policies

    found = policies(name)
    if len(found) > 1:
        raise InputError(f"--policy is {name!r}, expected one name (nearest: {next(iter(found))!r})")
    ((key, source),) = found.items()
    return key, source


def _policy(name: str, task: Any, seed: int) -> Any:
    """The policy called ``name``; of several training runs the first."""
    from wavegym.core.worlds import tuning_tapes
    from wavegym.evaluation.adapters import as_policies

    key, source = one_policy(name)
    return as_policies(source or key, task, key, tapes=tuning_tapes(task.system, seed))[0]


def _episode(task: Any, policy: Any, seed: int, draw: bool) -> tuple[list[float], list[Any]]:
    """Costs after each step, and a frame at its beginning and after each step if ``draw``."""
    from wavegym.envs import WaveformVectorEnv

    env = WaveformVectorEnv(
        task.system, 1, max_episode_steps=task.max_episode_steps, render_mode="rgb_array" if draw else None
    )
    env.reset(seed=[seed])
    choose = env.policy(policy, seed)
    costs: list[float] = []
    frames = [env.render()[0]] if draw else []  # type: ignore[index]
    ended = False
    while not ended:
        _, _, terminated, truncated, info = env.step(choose())
        costs.append(float(info["cost"][0]))
        frames += [env.render()[0]] if draw else []  # type: ignore[index]
        ended = bool(terminated[0] or truncated[0])
    return costs, frames


def _write(frames: list[Any], file: Path) -> None:
    from PIL import Image

    first, *rest = (Image.fromarray(frame) for frame in frames)
    first.save(file, format="GIF", save_all=True, append_images=rest, duration=FRAME_MS, loop=0)


def dataset_parser() -> Parser:
    """The options of ``dataset``."""
    options = environment_parser("dataset", "Write episodes of a policy as a Minari dataset.")
    known = "a policy as `wavegym evaluate --policies` takes it (default: %(default)s)"
    options.add_argument("--policy", default="myopic", metavar="NAME", help=known)
    options.add_argument("--episodes", type=int, default=100, metavar="N", help="(default: %(default)s)")
    options.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the datasets")
    options.add_argument("--name", default="", help="of the dataset (default: from environment and policy)")
    exploration = "probability of an action drawn uniformly from those allowed (default: %(default)s)"
    options.add_argument("--exploration", type=float, default=0.0, metavar="P", help=exploration)
    others = "comma-separated policies whose choices are recorded too"
    options.add_argument("--would-choose", default="", metavar="NAMES", help=others)
    returns = "also play every other action of every step, and record its return"
    options.add_argument("--all-returns", action="store_true", help=returns)
    options.add_argument("--seed", type=int, default=0, metavar="S", help="episode i plays reset(seed=S + i)")
    return options


def dataset(arguments: Sequence[str]) -> None:
    """Play, write, print what was written."""
    options = dataset_parser().read(arguments)
    name, source = one_policy(options.policy)
    env_id, parameters = read_environment(options.env, options.set)
    from wavegym.integrations.minari import collect

    written = collect(
        env_id,
        source or name,
        options.episodes,
        out=options.out,
        name=options.name,
        exploration=options.exploration,
        would_choose=[other.strip() for other in options.would_choose.split(",") if other.strip()],
        all_returns=options.all_returns,
        seed=options.seed,
        **parameters,
    )
    print(f"{written.id}: {written.total_episodes} episodes, {written.total_steps} steps, written to {options.out}")
