"""The folder of the studio: its files by identifier, and no access outside of it."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

from evaluator.errors import InputError

MOST_FILES = 20_000  # limit of the search below the folder, so that the studio of a whole disk opens quickly
DEPTH = 6  # of folders that are searched below that of the studio
VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".ts", ".mts", ".wmv", ".flv")
IMAGES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")


class Folder:
    """Files below a folder, by opaque identifiers.

    Links that lead out of the folder are excluded.
    """

    def __init__(self, root: Path) -> None:
        """Open an existing folder."""
        self.root = root.resolve(strict=True)
        self._known: dict[str, str] = {}

    def id_of(self, path: Path) -> str:
        """Identifier of a file or folder within. Raises InputError for one outside."""
        relative = self.relative(path)
        identifier = hashlib.blake2b(relative.encode("utf-8", "surrogateescape"), digest_size=8).hexdigest()
        self._known[identifier] = relative
        return identifier

    def relative(self, path: Path) -> str:
        """Path relative to the folder. Raises InputError for a file outside."""
        inside = self.inside(path)
        return inside.relative_to(self.root).as_posix()

    def inside(self, path: Path) -> Path:
        """The path with all links resolved. Raises InputError if it is outside the folder."""
        resolved = (self.root / path).resolve()
        if not resolved.is_relative_to(self.root):
            raise InputError(
                f"{path}: lies outside the folder of the studio; open `turnscope studio` on a folder that holds it"
            )
        return resolved

    def path(self, identifier: str) -> Path:
        """The file or folder of an identifier. Raises InputError if it does not exist (any more)."""
        if identifier not in self._known:
            for path in self.files():
                self.id_of(path)
        relative = self._known.get(identifier)
        found = None if relative is None else self.inside(self.root / relative)
        if found is None or not found.exists():
            raise InputError("this file no longer exists; go back to the first screen")
        return found

    def files(self, endings: tuple[str, ...] = ()) -> Iterator[Path]:
        """Sorted files below the folder, without hidden ones and those behind links that lead out of it."""
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
