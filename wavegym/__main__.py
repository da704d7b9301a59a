"""``python -m wavegym`` is the command ``wavegym``."""

from __future__ import annotations

import sys

from wavegym.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
