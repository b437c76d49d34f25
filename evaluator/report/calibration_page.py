"""Pictures of a calibration: what was found, what remains, where it is good."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.assign_grid import Lattice
from calibration.detect_dots import Dots
from evaluator.files import written_whole


def write_annotated(picture: NDArray[np.generic], dots: Dots, lattice: Lattice, path: Path) -> None:
    """Write the picture with assigned dots ringed in two colours (like a chessboard) and others crossed in red."""
    low, high = float(picture.min()), float(picture.max())
    shown = ((picture.astype(np.float32) - low) * (255 / max(high - low, 1e-9))).astype(np.uint8)
    shown = np.repeat(shown[:, :, None], 3, axis=2) if shown.ndim == 2 else shown
    unit = max(1, round(max(shown.shape[:2]) / 1000))
    assigned = set(lattice.dot.tolist())
    for k, center in enumerate(dots.centers_px):
        if k not in assigned:
            place = tuple(int(v) for v in np.rint(center))
            cv2.drawMarker(shown, place, (60, 60, 230), cv2.MARKER_TILTED_CROSS, 8 * unit, unit)
    for k, index in zip(lattice.dot, lattice.index, strict=True):
        color = ((90, 180, 40), (220, 130, 30))[int(index.sum()) % 2]
        radius = max(2.0 * unit, 0.5 * float(dots.diameter_px[k]) + 1.5 * unit)
        # four fractional bits keep the ring centred on the sub-pixel centre
        place = tuple(int(v) for v in np.rint(16 * dots.centers_px[k]))
        cv2.circle(shown, place, int(16 * radius), color, unit, cv2.LINE_AA, 4)
    with written_whole(path) as temporary:
        temporary.write_bytes(cv2.imencode(".png", shown)[1].tobytes())
