"""The multifunction radar: dwells per second, time of a decision; ``python -m research.benchmarks.dwells`` alone."""

from __future__ import annotations

import time
from statistics import median
from typing import Any

import gymnasium as gym
import numpy as np

import wavegym
from research.benchmarks.timing import cpu_us
from wavegym.core.arrays import Array
from wavegym.core.policy import Policy
from wavegym.schedulers import RandomChoice
from wavegym.schedulers.tuned_constants import tuned_heuristic
from wavegym.systems.multifunction_radar.system import MultifunctionRadar

ENV_ID = "wavegym/MultifunctionRadar-v1"
SHAPES = ((1, 64), (64, 16), (64, 64), (64, 256))  # environments, slots
HEURISTICS = ("van-keuk-blackman", "gain-per-second", "searched-dwell")
WARM, STEPS, ROUNDS = 200, 100, 7


class Loop:
    """Environments under a policy that has played ``WARM`` dwells, so that there are tracks."""

    def __init__(self, policy: Policy, count: int, slots: int) -> None:
        self.envs: Any = gym.make_vec(ENV_ID, num_envs=count, slots=slots).unwrapped
        self.observation, _ = self.envs.reset(seed=0)
        self.policy, self.count = policy, count
        policy.begin(self.envs.system, count, np.random.default_rng(0))
        for _ in range(WARM):
            self.step(self.decide())

    def decide(self) -> Array:
        """The next dwell of each environment."""
        return self.policy.act(self.envs.belief, self.observation, self.envs.action_masks())

    def step(self, actions: Array) -> int:
        """CPU nanoseconds of a step."""
        begin = time.process_time_ns()
        self.observation = self.envs.step(actions)[0]
        return time.process_time_ns() - begin

    def dwells_per_second(self) -> float:
        """Of all environments together, resets included, without the decisions; the median of all rounds."""
        spent = [sum(self.step(self.decide()) for _ in range(STEPS)) for _ in range(ROUNDS)]
        return 1e9 * STEPS * self.count / median(spent)

    def decision_us(self) -> float:
        """CPU microseconds of a decision of one environment; the median of all rounds."""
        belief, mask = self.envs.belief, self.envs.action_masks()

        def decide() -> int:
            for _ in range(STEPS):
                self.policy.act(belief, self.observation, mask)
            return STEPS * self.count

        return median(cpu_us(decide) for _ in range(ROUNDS))


def speeds() -> dict[str, float]:
    """Dwells per second with random allowed actions, at the registered load."""
    return {
        f"{count} environments, {slots} slots": Loop(RandomChoice(), count, slots).dwells_per_second()
        for count, slots in SHAPES
    }


def decisions() -> dict[str, float]:
    """Microseconds of a decision in one environment of the registered size."""
    system = MultifunctionRadar()
    policies = {heuristic: tuned_heuristic(heuristic, system, None) for heuristic in HEURISTICS}
    policies["ppo"] = wavegym.load_agent(ENV_ID, "ppo")
    return {name: Loop(policy, 1, system.slots).decision_us() for name, policy in policies.items()}


def report() -> None:
    """Print Markdown tables."""
    print("\n| multifunction radar | dwells per second |\n|---|---|")
    for name, speed in speeds().items():
        print(f"| {name} | {speed:.0f} |")
    print("\n| decision, one environment, 64 slots | us |\n|---|---|")
    for name, us in decisions().items():
        print(f"| {name} | {us:.0f} |")


if __name__ == "__main__":
    report()
