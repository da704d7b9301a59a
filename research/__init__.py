"""The figures of four papers, tests of what is promised, benchmarks, pages of the docs; not in the wheel."""
