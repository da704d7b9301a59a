"""Learned waveform schedulers on Stable-Baselines3: settings, training that survives a kill, saved policies.

A folder of the repository, not of the wheel: ``train.py`` is its command line, and ``evaluate.py`` takes the folders
that ``train.py`` makes as policies (``agents.policies.runs.load_policy``).
"""
