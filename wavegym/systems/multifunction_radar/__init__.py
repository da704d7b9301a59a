"""A multifunction radar: one agile beam tracks dozens of targets and searches for others, one dwell after another."""
