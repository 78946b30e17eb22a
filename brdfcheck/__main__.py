"""``python -m brdfcheck`` is the command ``brdfcheck``."""

from __future__ import annotations

from brdfcheck.cli import script

if __name__ == "__main__":
    script()
