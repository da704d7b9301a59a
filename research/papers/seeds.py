"""The strings that seed random numbers in the studies. They are frozen: another string gives other numbers."""

from __future__ import annotations

TEST = "test"  # seeds random numbers: frozen; the worlds that are played
TUNE = "tune"  # seeds random numbers: frozen; the worlds on which constants are tuned
POLICY = "policy"  # seeds random numbers: frozen; the draws of a policy
BOOTSTRAP = "bootstrap"  # seeds random numbers: frozen; the resamples of an interval
