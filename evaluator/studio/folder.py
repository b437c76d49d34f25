"""The folder of the studio: its files by identifier, and no access outside of it."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

from evaluator.errors import InputError

MOST_FILES = 20_000  # looked at below the folder: who opens the studio on a whole disk is not to wait for it
DEPTH = 6
VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".ts", ".mts", ".wmv", ".flv")
IMAGES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")


class Folder:
    """Files below a folder; an identifier says nothing but which of them is meant.

    A link that leads out of the folder is no file of it.
    """

    def __init__(self, root: Path) -> None:
        """Open a folder that is there."""
        self.root = root.resolve(strict=True)
        self._known: dict[str, str] = {}

    def id_of(self, path: Path) -> str:
        """Identifier of a file or folder within. Raises InputError for one outside."""
        relative = self.relative(path)
        identifier = hashlib.blake2b(relative.encode("utf-8", "surrogateescape"), digest_size=8).hexdigest()
        self._known[identifier] = relative
        return identifier

    def relative(self, path: Path) -> str:
        """Its path from the folder on. Raises InputError for a file outside."""
        inside = self.inside(path)
        return inside.relative_to(self.root).as_posix()

    def inside(self, path: Path) -> Path:
        """The path with all links followed. Raises InputError where that is outside the folder."""
        resolved = (self.root / path).resolve()
        if not resolved.is_relative_to(self.root):
            raise InputError(
                f"{path}: lies outside the folder of the studio; open `turnscope studio` on a folder that holds it"
            )
        return resolved

    def path(self, identifier: str) -> Path:
        """The file or folder of an identifier. Raises InputError where there is none (any more)."""
        if identifier not in self._known:
            for path in self.files():
                self.id_of(path)
        relative = self._known.get(identifier)
        found = None if relative is None else self.inside(self.root / relative)
        if found is None or not found.exists():
            raise InputError("this file no longer exists; go back to the first screen")
        return found

    def files(self, endings: tuple[str, ...] = ()) -> Iterator[Path]:
        """Files below the folder, hidden ones and those behind links that lead out left out; in order."""
        count = 0
        for place, folders, names in os.walk(self.root):
            here = Path(place)
            deep = len(here.relative_to(self.root).parts) >= DEPTH
            folders[:] = [] if deep else sorted(name for name in folders if not name.startswith((".", "__")))
            for name in sorted(names):
                count += 1
                if count > MOST_FILES:
                    return
                path = here / name
                wanted = not name.startswith(".") and (not endings or path.suffix.lower() in endings)
                if wanted and path.resolve().is_relative_to(self.root):
                    yield path
