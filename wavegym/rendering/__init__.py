"""Pictures of episodes: panels, maps and timelines that several scenes share."""
