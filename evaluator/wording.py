"""Numbers in sentences."""

from __future__ import annotations


def counted(count: int, noun: str) -> str:
    """Give a number with its noun: "1 frame", "2 frames"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def verb(count: int, one: str, several: str) -> str:
    """Give the form of a verb that agrees with a number."""
    return one if count == 1 else several
