"""``python -m brdfcheck`` is the command ``brdfcheck``."""

from __future__ import annotations

import sys

from brdfcheck.cli import main

if __name__ == "__main__":
    sys.exit(main())
