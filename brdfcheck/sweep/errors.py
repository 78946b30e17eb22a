"""What ends a sweep that was asked for correctly."""

from __future__ import annotations


class SweepError(Exception):
    """The machine or the store stands in the way: disk full, a damaged store, a lost cluster. One line that says what to do.

    What is already in the store stays there.
    """
