"""Training: from a run specification to a run's folder, through kills, with lessons from a scheduler and a search for
settings."""
