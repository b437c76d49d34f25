"""The one door to recordings."""

from __future__ import annotations

from pathlib import Path

from evaluator.errors import InputError
from evaluator.recording.video import Recording


def open_recording(path: str | Path) -> Recording:
    """Open a recording; raises InputError with one sentence where there is none."""
    name = str(path)
    if "://" not in name:
        place = Path(name)
        if not place.exists():
            raise InputError(f"{name}: no such file")
        if place.is_file() and place.stat().st_size == 0:
            raise InputError(f"{name}: the file is empty")
    return Recording(name)
