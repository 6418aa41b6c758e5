"""``python -m mirelight``."""

from __future__ import annotations

import sys

from mirelight.cli import main

if __name__ == "__main__":
    sys.exit(main())
