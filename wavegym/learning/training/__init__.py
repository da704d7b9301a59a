"""Training runs: imitation of a scheduler, reinforcement learning, checkpoints, a search for hyperparameters."""
