"""What the pictures of several systems share: panels, maps, time lines."""
