"""The one door to recordings."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

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
    """Open a recording: a video file, a folder of pictures, or a live source.

    path: a file; a folder (rate_hz is then needed); "-" for a stream on standard input; a camera device (/dev/video0)
    or an address (rtsp://…, udp://…). fields: whether pictures are woven of two fields and which comes first; "auto"
    sees for itself. threads: of the decoder, 0 for one per core. Raises InputError with one sentence where there is no
    recording.
    """
    name = str(path)
    if name == "-":
        return Recording("pipe:0", live=True, fields=fields, threads=threads)
    if "://" in name:
        return Recording(name, live=True, fields=fields, threads=threads)
    place = Path(name)
    if not place.exists():
        raise InputError(f"{name}: no such file")
    if place.is_dir():
        if rate_hz is None:
            raise InputError(f"{name}: a folder of pictures has no clock: say its rate (pictures a second)")
        if rate_hz <= 0:
            raise InputError(f"{name}: the rate must be above 0 pictures a second, not {float(rate_hz):g}")
        return ImageSequence(place, Fraction(rate_hz).limit_denominator(1001))
    if place.is_char_device():
        return Recording(name, live=True, format_name="v4l2", fields=fields, threads=threads)
    if place.is_fifo():
        return Recording(name, live=True, fields=fields, threads=threads)
    if place.stat().st_size == 0:
        raise InputError(f"{name}: the file is empty")
    return Recording(name, fields=fields, threads=threads)
