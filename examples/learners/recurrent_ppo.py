"""RecurrentPPO of sb3-contrib: it observes the measurements, not the belief, so it needs a memory."""

from __future__ import annotations

from typing import Any

from against_myopic import main
from sb3_contrib import RecurrentPPO

from wavegym.envs.sb3 import SB3VecEnv


def train(env_id: str, steps: int, seed: int) -> Any:
    """The model after ``steps`` environment steps; one episode is one sequence of the LSTM."""
    envs = SB3VecEnv(env_id, num_envs=64, reward="relative", observation="measurements")
    network = {"lstm_hidden_size": 64, "net_arch": [64], "shared_lstm": True, "enable_critic_lstm": False}
    model = RecurrentPPO(
        "MlpLstmPolicy", envs, n_steps=50, batch_size=800, n_epochs=10, learning_rate=1e-3, gamma=0.9,
        policy_kwargs=network, seed=seed, device="cpu",
    )  # fmt: skip
    return model.learn(steps)


if __name__ == "__main__":
    main(train, 640_000, observation="measurements")
