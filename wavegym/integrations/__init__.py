"""wavegym inside other packages. Each needs its extra: ``pip install 'wavegym[NAME]'``."""
