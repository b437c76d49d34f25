"""Detection of input files that change while they are read, for example during copying or editing.

Results are stored under the hash of their inputs (`validity`). If a file changes between the computation of its hash
and its last reading, they belong to neither content and must not be stored.
"""

from __future__ import annotations

import stat
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

CHANGED = "changed while it was read; wait until it is complete, then run the command again"

State = tuple[object, ...] | None  # None: does not exist


@dataclass(frozen=True)
class AsFound:
    """Files at one moment: location on disk, size and time of the last write. Devices never change.

    Every write changes one of the three, and reading them takes microseconds even for recordings of gigabytes.
    """

    states: dict[Path, State]

    @staticmethod
    def of(paths: Iterable[Path]) -> AsFound:
        """Files, or folders of images, as they are now."""
        return AsFound({path: _state(path) for path in paths})

    def __or__(self, others: AsFound) -> AsFound:
        """These files and others, each in its earliest state."""
        return AsFound(others.states | self.states)

    def changed(self) -> list[Path]:
        """Files that were written, replaced or removed since."""
        return [path for path, state in self.states.items() if _state(path) != state]


def _state(path: Path) -> State:
    try:
        if path.is_dir():
            return tuple((file.name, _state(file)) for file in sorted(path.iterdir()))
        found = path.stat()
    except OSError:
        return None
    if not stat.S_ISREG(found.st_mode):  # a camera, a pipe
        return None
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns
