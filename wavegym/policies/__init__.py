"""Saved policies in plain NumPy: loading, checking and playing them needs no torch."""
