"""Observations of a belief: scaled fields, and forecasts of each candidate."""
