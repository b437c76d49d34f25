"""Column of the luma at which a sample of the colour planes lies.

The standards of H.264, HEVC and MPEG put it at the even columns unless the stream states another place, and cameras
follow them. Programs that convert RGB (OpenCV, FFmpeg's scaler) put it midway between two columns, as JPEG does, in the
same codecs, and state nothing. Half a pixel of the luma matters, because a mark is centred by its colour where it is as
light as the body. So the frame decides: in a window in which the colour follows the luma, it is a multiple of the luma
and of its slope along the row, and the ratio of the two is the distance between the places of their samples.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.robust import PER_MEDIAN

Array = NDArray[np.float64]
Single = NDArray[np.float32]

MIDWAY, COSITED = 0.5, 0.0  # px of the luma, of the first sample
WINDOWS, HALF = 100, 6  # most windows, and half their side in samples: a small mark with its rim
LEAST = 0.25  # levels of 8 bits a sample, mean change of the colour in a window: noise of dim recordings stays below
# Share of the squared variation of a colour plane that luma and slope may leave. In 16 drawn recordings of phones and
# webcams, the windows below it give distances within 0.16 px of the true one if there are more than ten of them; false
# colours of a Bayer sensor on fine lines, and things of equal luma, leave more.
UNEXPLAINED = 0.3
EDGES = 0.17  # px, standard deviation: a camera's gamma moves the flanks of luma and colour apart at a single edge
QUANTIZED = 0.5  # levels² of a sample: rounding, and what a codec leaves
AGREES = 0.2  # px: farther from both places, or less certain, what is measured is not the place of the samples
FEWEST = 4  # windows
OF_MEDIAN = 1.25  # standard error of a median over that of a mean, for normal errors
# Means over the pixels about the middle between columns 2k and 2k + 1, with equal blur: luma, and slope per pixel.
SMOOTH = np.array([[1.0, 7.0, 7.0, 1.0]], np.float32) / 16.0
SLOPE = np.array([[-1.0, -3.0, 3.0, 1.0]], np.float32) / 6.0


def first_column(frame: Frame) -> float:
    """Column of the luma at which the first sample of the colour planes lies, px; see `Frame.cosited`."""
    assert frame.u is not None
    across = int(-(-frame.luma.shape[1] // frame.u.shape[1]))
    if across != 2 or frame.cosited is False:
        return (across - 1) / 2
    usual = COSITED if frame.cosited else MIDWAY
    distance, sigma = _distance_px(frame)
    if sigma > AGREES / 2:
        return usual
    return next((place for place in (MIDWAY, COSITED) if abs(MIDWAY + distance - place) < AGREES), usual)


def _distance_px(frame: Frame) -> tuple[float, float]:
    """Distance of the samples of the colour planes from the middle between two columns, px, and its standard error."""
    assert frame.u is not None
    assert frame.v is not None
    luma = _of_rows(frame)
    smooth, slope = (
        np.asarray(cv2.filter2D(luma, -1, kernel, anchor=(1, 0))[:, ::2], np.float32) for kernel in (SMOOTH, SLOPE)
    )
    planes = [plane.astype(np.float32) for plane in (frame.u, frame.v)]
    distances = [
        one
        for window in _windows(planes, LEAST * 2.0 ** (frame.depth - 8))
        for plane in planes
        if (one := _in_window(plane[window], smooth[window], slope[window])) is not None
    ]
    if len(distances) < FEWEST:
        return 0.0, np.inf
    distance, variance = np.array(sorted(distances)).T
    weight = np.cumsum(1.0 / variance)
    median = float(distance[np.searchsorted(weight, weight[-1] / 2.0)])
    spread = PER_MEDIAN * float(np.median(np.abs(distance - median)))
    return median, OF_MEDIAN * max(spread, EDGES) / np.sqrt(len(distances))


def _of_rows(frame: Frame) -> Single:
    """Luma averaged over the rows that a sample of the colour planes covers, with twice their columns."""
    assert frame.u is not None
    rows, columns = frame.u.shape
    down = -(-frame.luma.shape[0] // rows)
    below, right = rows * down - frame.luma.shape[0], columns * 2 - frame.luma.shape[1]
    luma = cv2.copyMakeBorder(frame.luma, 0, below, 0, right, cv2.BORDER_REPLICATE)
    return np.asarray(luma.reshape(rows, down, -1).mean(axis=1), np.float32)


def _windows(planes: list[Single], least: float) -> list[tuple[slice, slice]]:
    """Windows about the strongest edges of the colour planes along the rows, without overlap of their middles."""
    changes = np.stack([np.abs(cv2.Sobel(plane, -1, 1, 0, scale=1 / 8)) for plane in planes])
    change = cv2.GaussianBlur(np.asarray(changes.sum(axis=0), np.float32), (0, 0), HALF / 2)
    found: list[tuple[slice, slice]] = []
    while len(found) < WINDOWS:
        _, most, _, (x, y) = cv2.minMaxLoc(change)
        if most < least:
            break
        window = slice(max(y - HALF, 0), y + HALF + 1), slice(max(x - HALF, 0), x + HALF + 1)
        change[window] = 0.0
        found.append(window)
    return found


def _in_window(color: Single, luma: Single, slope: Single) -> tuple[float, float] | None:
    """Distance by which the colour lies right of the luma, px, and its variance; None where it does not follow it."""
    left, level, steep = (np.ravel(one - one.mean()).astype(float) for one in (color, luma, slope))
    total, squares = float(left @ left), float(level @ level)
    if min(total, squares) <= 0.0:
        return None
    steep -= level * float(steep @ level) / squares
    steepness = float(steep @ steep)
    if steepness <= 1e-9 * squares:
        return None
    share = float(left @ level) / squares
    left = left - share * level
    moved = float(left @ steep) / steepness
    left = left - moved * steep
    if float(left @ left) > UNEXPLAINED * total or share == 0.0:
        return None
    noise = float(left @ left) / len(left) + QUANTIZED
    # color(x) = share · luma(x + distance): a sample that lies to the left shows what the luma shows there.
    return moved / share, noise / (steepness * share**2) + EDGES**2
