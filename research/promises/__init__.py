"""Commands that test what the suite promises, too long for the test suite; docs/promises.md has their results."""
