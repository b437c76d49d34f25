"""Opening of recordings of every kind."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import partial
from pathlib import Path

from calibration.image_file import count_images
from evaluator.errors import InputError
from evaluator.recording.fields import Fields
from evaluator.recording.images import ImageSequence
from evaluator.recording.video import Recording


def open_recording(
    path: str | Path,
    *,
    rate_hz: float | Fraction | None = None,
    fields: Fields = "auto",
    threads: int = 0,
) -> Recording | ImageSequence:
    """Open a recording: a video file, a folder of images, or a live source.

    path: a file; a folder or a TIFF stack of images; "-" for a stream on standard input; a camera device (/dev/video0)
    or an address (rtsp://…, udp://…). rate_hz: of images, or of a recording without times; not used if there are
    times. fields: whether frames are interlaced and which field is first; "auto" determines it from the frames.
    threads: of the decoder, 0 for one per core. Raises InputError with one sentence if there is no recording.
    """
    name = str(path)
    if rate_hz is not None and not 0 < rate_hz < math.inf:
        raise InputError(f"{name}: the rate must be above 0 frames a second, not {float(rate_hz):g}")
    rate = None if rate_hz is None else Fraction(rate_hz).limit_denominator(1001)
    opened = partial(Recording, fields=fields, threads=threads, rate_hz=rate)
    if name == "-":
        return opened("pipe:0", live=True)
    if "://" in name:
        return opened(name, live=True)
    place = Path(name)
    if not place.exists():
        raise InputError(f"{name}: no such file")
    if has_no_clock(place):
        if rate is None:
            kind = "a folder" if place.is_dir() else "a stack"
            raise InputError(
                f"{name}: {kind} of images has no time stamps; give the frame rate (--rate, or rate_hz of a run)"
            )
        return ImageSequence(place, rate)
    if place.is_char_device():
        return opened(name, live=True, format_name="v4l2")
    if place.is_fifo():
        return opened(name, live=True)
    if place.stat().st_size == 0:
        raise InputError(f"{name}: the file is empty")
    return opened(name)


def has_no_clock(place: Path) -> bool:
    """Whether a recording is a folder or TIFF stack of images, for which the user must give the rate."""
    return place.is_dir() or (place.is_file() and count_images(place) > 1)
