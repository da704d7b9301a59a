"""Compare policies on the same worlds; the same as ``wavegym evaluate``.

python evaluate.py KershawEvansPosition-v0 --policies best-fixed,random,lookahead:2 --worlds 200 --out DIR
"""

from __future__ import annotations

import sys

from wavegym.cli.evaluate import main

if __name__ == "__main__":
    sys.exit(main())
