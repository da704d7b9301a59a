"""Train an agent; the same as ``wavegym train``.

python train.py KershawEvansPosition-v0 --algo ppo --seed 0 --out runs/ppo/seed0
"""

from __future__ import annotations

import sys

from wavegym.cli.train import main

if __name__ == "__main__":
    sys.exit(main())
