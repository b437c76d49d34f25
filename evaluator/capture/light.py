"""Time at which a light in view switches on: a start signal without delay of camera or computer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.errors import InputError
from evaluator.recording import Frame

Array = NDArray[np.float64]
LEAST_CONTRAST = 8.0  # of the step over the noise of a frame: not reached by chance in 10,000 frames
SETTLED = 5  # frames on either side for the brightness of the region without and with the light
PARTIAL = 4.0  # sigmas from both levels beyond which the light was on during a part of the exposure


@dataclass(frozen=True)
class LightRegion:
    """Position of the light in the image: a square about (x_px, y_px), half_px to each side."""

    x_px: float
    y_px: float
    half_px: float = 4.0

    def brightness(self, frame: Frame) -> float:
        """Mean luma of the region, levels. Raises InputError if it is outside the image."""
        width, height = frame.size_px
        left, right = (round(self.x_px + side * self.half_px) for side in (-1, 1))
        top, bottom = (round((self.y_px + side * self.half_px) / frame.row_step) for side in (-1, 1))
        if left < 0 or top < 0 or right >= width or bottom * frame.row_step >= height:
            raise InputError(
                f"the light at ({self.x_px:g}, {self.y_px:g}) px with {self.half_px:g} px to each side is not within "
                f"the image of {width} × {height} px"
            )
        return float(frame.luma[top : bottom + 1, left : right + 1].mean())


def light_on(time_s: Array, brightness: Array, exposure_s: float | None = None) -> tuple[float, float]:
    """Time at which the light went on, and its standard uncertainty, s, on the clock of the frames.

    The time of a frame is the middle of its exposure, as for its marks.
    time_s, brightness: (n,). exposure_s: of a frame; if unknown, uniform between 0 and the interval of the frames.
    If the light goes on during an exposure, the time follows from its share in the exposure; otherwise the uncertainty
    is the time between two exposures. A rolling shutter exposes rows at different times: put the light beside the
    robot. Raises InputError if no light goes on.
    """
    if len(time_s) < 3 * SETTLED:
        raise InputError(f"{len(time_s)} frames; {3 * SETTLED} are needed to detect the light")
    interval = float(np.median(np.diff(time_s)))
    at, low, high, noise = _edge(brightness)
    if not high - low > LEAST_CONTRAST * noise:
        raise InputError(
            f"no light switches on there: brightness steps by {high - low:.3g} levels at most, its noise is "
            f"{noise:.2g}; "
            "is the place right, and does the recording begin before the light?"
        )
    if exposure_s is not None and not 0 < exposure_s <= interval * 1.01:
        raise InputError(f"an exposure of {exposure_s:g} s does not fit frames every {interval:.4g} s")
    share = (float(brightness[at]) - low) / (high - low)
    share_sigma = noise / (high - low)
    if share < 1 - PARTIAL * share_sigma:  # on for this share of the exposure, until its end
        exposure = interval / 2 if exposure_s is None else exposure_s
        unknown = 0.0 if exposure_s is not None else abs(0.5 - share) * interval / np.sqrt(12)
        return float(time_s[at] + (0.5 - share) * exposure), float(np.hypot(share_sigma * exposure, unknown))
    # Between two exposures: uniform over interval less exposure, whose mean square over all exposures is interval²/36.
    gap = interval / 6 if exposure_s is None else (interval - exposure_s) / np.sqrt(12)
    hidden = PARTIAL * share_sigma * interval / np.sqrt(3)  # a smaller part is not distinguished from none
    return float(time_s[at] - interval / 2), float(np.hypot(gap, hidden))


def _edge(brightness: Array) -> tuple[int, float, float, float]:
    """First frame with light, brightness before and after it, and the noise of a frame."""
    windows = np.lib.stride_tricks.sliding_window_view(brightness, SETTLED)
    level = np.median(windows, axis=1)  # from frame k to k + SETTLED - 1
    steps = level[SETTLED + 1 :] - level[: -SETTLED - 1]  # with one frame in between, which may contain a part of it
    first = int(np.argmax(steps))  # if several are equal, the step is within a window of the first
    low, high = float(level[first]), float(level[first + SETTLED + 1])
    quiet = np.delete(np.diff(brightness), slice(first, first + 2 * SETTLED))  # without the step
    noise = float(np.sqrt(np.mean(quiet**2) / 2 + 1 / 12))  # with rounding to integer levels
    noise *= float(np.sqrt(1 + np.pi / 2 / SETTLED))  # of a frame against a level, which is a median of frames
    at = first + int(np.argmax(brightness[first:] > (low + high) / 2))
    if at > 0 and brightness[at - 1] > low + PARTIAL * noise:
        at -= 1
    return at, low, high, noise
