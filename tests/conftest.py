"""Stands here so that every test can import ``oracles``."""

from hypothesis import settings

# A property's first example may compile a kernel; how long that takes says nothing about the code.
settings.register_profile("wavegym", deadline=None)
settings.load_profile("wavegym")
