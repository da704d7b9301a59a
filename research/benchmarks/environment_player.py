"""Time steps of an environment: ``python environment_player.py ID COUNT``.

Reads seconds, one number a line. Plays COUNT environments with random actions for at least this time and prints the CPU
microseconds of a step of one environment, resets included. Imports nothing of this package, so that it can play the
environments of another checkout.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import gymnasium as gym

import wavegym  # noqa: F401  (registers the environments)


def player(env_id: str, count: int) -> Callable[[float], float]:
    """A function of the least seconds to play; kernels are compiled."""
    envs = gym.make_vec(env_id, num_envs=count)
    envs.action_space.seed(0)
    envs.reset(seed=0)
    actions = [envs.action_space.sample() for _ in range(32)]

    def play(least: float) -> float:
        steps, begun = 0, time.process_time()
        while steps == 0 or time.process_time() - begun < least:
            for action in actions:
                envs.step(action)
            steps += len(actions) * count
        return (time.process_time() - begun) / steps * 1e6

    play(0.0)
    return play


if __name__ == "__main__":
    played = player(sys.argv[1], int(sys.argv[2]))
    for line in sys.stdin:
        print(played(float(line)), flush=True)
