"""What a policy is shown of a belief: scaled fields, and forecasts of each candidate."""
