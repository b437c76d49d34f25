"""Numbers of things, as messages say them."""

from __future__ import annotations


def counted(number: int, thing: str) -> str:
    """A number of things in words: 1 run, 2 runs."""
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"
