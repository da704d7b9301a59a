"""Training on Stable-Baselines3: settings, imitation, checkpoints, export to NumPy. Needs the extra ``agents``."""
