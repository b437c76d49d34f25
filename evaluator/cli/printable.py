"""Text for terminals: names from files reach the screen as text, never as commands to the terminal."""

from __future__ import annotations

import re
from typing import Any, TextIO

# Control characters except tab and line feed (C0, delete, C1), marks that change the direction of writing, and halves
# of characters, which represent file names that are not UTF-8.
UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def printable(text: str) -> str:
    """Replace unprintable characters by their codes as in Python: a backslash and x1b for an escape character."""
    return UNPRINTABLE.sub(lambda found: found.group().encode("unicode_escape").decode("ascii"), text)


class Printable:
    """A text stream that writes through `printable`; `original` is the stream itself."""

    def __init__(self, original: TextIO) -> None:
        """original: the stream to write to; characters that its encoding lacks are written as their codes, too."""
        self.original = original

    def write(self, text: str) -> int:
        """Write text; returns the number of characters."""
        encoding = getattr(self.original, "encoding", None) or "utf-8"
        self.original.write(printable(text).encode(encoding, "backslashreplace").decode(encoding))
        return len(text)

    def writelines(self, lines: list[str]) -> None:
        """Write lines one after the other."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        """All other attributes are those of the stream."""
        return getattr(self.original, name)
