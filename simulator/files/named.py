"""Files that other files name: relative to these, and within the sandbox if there is one."""

from __future__ import annotations

import errno
import os
from pathlib import Path

# Environment variable, which other processes inherit: the folder outside of which no named file may lie.
SANDBOX = "TURNSCOPE_SANDBOX"


def named_in(file: Path | str, name: Path | str) -> Path:
    """The path of a file that another file names, relative to the folder of that one.

    Raises PermissionError, before anything is read, if the variable TURNSCOPE_SANDBOX holds a folder and the path, with
    all links followed, is outside of it.
    """
    found = Path(file).resolve().parent / name
    root = os.environ.get(SANDBOX)
    if root and not found.resolve().is_relative_to(root):
        raise PermissionError(errno.EACCES, f"{name} lies outside of the sandbox {root}", str(file))
    return found
