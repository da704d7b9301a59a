"""The command ``wavegym``."""
