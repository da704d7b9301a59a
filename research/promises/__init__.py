"""Commands that test what is promised and are too long for the test suite; docs/promises.md has the results."""
