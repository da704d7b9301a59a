"""The figures of the papers, rebuilt: ``python -m wavegym.reproduce agile_clutter --out DIR``, or ``rf_eo``.

Each paper has modules of its own: what is played, the numbers taken from it, the pictures, and the files.
"""
