"""Text for terminals: names from files reach the screen as text, never as commands to the terminal."""

from __future__ import annotations

import re
from typing import Any, TextIO

# Control characters but tab and line feed (C0, delete, C1), marks that turn the direction of writing, and halves of
# characters, as which file names that are not UTF-8 arrive.
UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def printable(text: str) -> str:
    """Write what is not printable as its code, as Python writes it: a backslash, x1b for an escape character."""
    return UNPRINTABLE.sub(lambda found: found.group().encode("unicode_escape").decode("ascii"), text)


class Printable:
    """A text stream that writes through `printable`; `original` is the stream itself."""

    def __init__(self, original: TextIO) -> None:
        """original: the stream written to; a character that its encoding lacks is written as its code, too."""
        self.original = original

    def write(self, text: str) -> int:
        """Write text; gives how many characters of it were written."""
        encoding = getattr(self.original, "encoding", None) or "utf-8"
        self.original.write(printable(text).encode(encoding, "backslashreplace").decode(encoding))
        return len(text)

    def writelines(self, lines: list[str]) -> None:
        """Write lines one after the other."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        """Give everything else of the stream itself."""
        return getattr(self.original, name)
