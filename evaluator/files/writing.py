"""Writing files whole or not at all: a reader never finds half a file, whatever interrupts the writer."""

from __future__ import annotations

import errno
import math
import os
import secrets
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any

from evaluator.errors import InputError, UnwritableError

if TYPE_CHECKING:  # slow to import, and not needed to write text
    import numpy as np
    from numpy.typing import NDArray

NO_ROOM = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)
REFUSALS, PAUSE_S = 20, 0.05  # a scanner reads a table of some MB in less than this second
IMAGES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield a temporary name beside path, and rename it to path when the block ends without an error.

    The temporary name has the same suffix, by which encoders choose their format. A file that is already at path stays
    until the rename; a symbolic link stays, and its target is replaced. Raises UnwritableError if the writing fails.
    """
    path = Path(path)
    try:
        place = path.resolve() if path.is_symlink() else path
        if place.exists() and not place.is_file():  # the rename would replace a device, if the user may do that
            raise UnwritableError(f"{path}: is a folder, a pipe or a device; give the name of a file")
        place.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:  # names a folder
        raise _unwritable(path, error) from error
    temporary = place.with_name(f".{path.stem}.{secrets.token_hex(4)}{path.suffix}")
    try:
        temporary.touch(exist_ok=False)  # within the block that removes it: an interrupt may come at any moment
        yield temporary
        _replace(temporary, place)
    except OSError as error:  # other errors come from files that the block reads
        if error.errno not in NO_ROOM and str(error.filename) != str(temporary):
            raise
        raise _unwritable(path, error) from error
    finally:
        with suppress(OSError):  # renamed, or never made; a disk that refuses this has said so before
            temporary.unlink()


def require_room_for(path: Path) -> None:
    """Raise UnwritableError if no file can be made where a path leads; folders that it needs are not made yet."""
    try:
        folder = next(parent for parent in path.absolute().parents if parent.exists())
        with TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise _unwritable(path, error) from error


def _replace(temporary: Path, place: Path) -> None:
    """Rename a file.

    Windows refuses while another program has the target open: virus scanners and synchronised folders for a moment.
    """
    for _ in range(REFUSALS if sys.platform == "win32" else 0):
        try:
            temporary.replace(place)
        except PermissionError:
            time.sleep(PAUSE_S)
        else:
            return
    temporary.replace(place)


def _unwritable(path: Path, error: OSError) -> UnwritableError:
    reason = str(error.strerror).lower()
    # Windows refuses to replace a file that another program, a spreadsheet as a rule, has open.
    is_open = sys.platform == "win32" and error.errno == errno.EACCES
    remedy = "close it in other programs or " * is_open + "free space or " * (error.errno in NO_ROOM)
    return UnwritableError(f"{path}: cannot be written ({reason}); {remedy}write elsewhere, and run the command again")


def write_text(path: Path, text: str) -> None:
    """Write a text file completely or not at all."""
    with written_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file completely or not at all."""
    with written_whole(path) as temporary:
        temporary.write_bytes(content)


def write_image(image: NDArray[np.generic], path: Path) -> None:
    """Write an image (h, w) or (h, w, 3) RGB completely or not at all; its suffix is the format. Raises InputError."""
    import cv2
    import numpy as np

    if path.suffix.lower() not in IMAGES:
        raise InputError(f"{path}: an image is written as {', '.join(IMAGES)}")
    stored = image[..., ::-1] if image.ndim == 3 else image  # OpenCV writes blue, green, red
    with written_whole(path) as temporary:
        if not cv2.imwrite(str(temporary), np.ascontiguousarray(stored)):  # without a reason
            raise OSError(errno.EIO, os.strerror(errno.EIO), str(temporary))


def plain(value: Any) -> Any:
    """A value for strict JSON: numbers that are not finite become null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, str | bool | int | float):
        return value
    return str(value)


def named_from(folder: Path, path: Path) -> str:
    """A path as a file in a folder names it: relative, or absolute if it is on another drive of Windows."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()  # noqa: TID251
    except ValueError:
        return path.resolve().as_posix()
