"""Doors to other packages. Each package needs its extra: ``pip install 'wavegym[NAME]'``."""
