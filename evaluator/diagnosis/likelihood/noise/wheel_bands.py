"""Frequencies at which wheels turn: there a wheel out of round or a gear moves the robot, faster than all else does.

The slow modes of a fit end at features.FASTEST_HZ, 180 rpm. Above, ripple of the wheels is no noise of tracking: it is
left out of the estimate of the noise, and its bands are part of the fit. Otherwise wheels at 300 rpm that ripple by a
quarter were a camera that shakes by 0.1 mm, and nothing was missing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simulator.command import Command

Floats = NDArray[np.float64]

LEAST_TURNS = 1.0  # of a wheel at a speed, below which no frequency is defined
LOBES = 2.0  # half width of a band over the resolution, the inverse of the duration: nine tenths of the power of a line

Bands = tuple[tuple[float, float], ...]


def wheel_bands(command: Command, time_s: Floats, direction_rad: Floats) -> Bands:
    """Bands (low, high) in Hz in which the wheels turn between the first and the last frame; those of halts are none.

    direction_rad: (n,) of the marks, NaN where they are missing. The ripple acts along the heading, so that a robot
    that turns shifts it by its own frequency.
    """
    seen = np.isfinite(direction_rad)
    turned = np.abs(np.diff(np.unwrap(direction_rad[seen]))) / np.diff(time_s[seen])
    turning_hz = float(np.median(turned)) / (2 * np.pi) if turned.size else 0.0
    knots_s = np.append(np.clip(command.time_s, time_s[0], time_s[-1]), time_s[-1])
    found = []
    for rpm in (command.left_rpm, command.right_rpm):
        speeds_hz = np.abs(np.append(rpm, rpm[-1])) / 60
        for begin, end, first, last in zip(knots_s[:-1], knots_s[1:], speeds_hz[:-1], speeds_hz[1:], strict=True):
            if (end - begin) * (first + last) / 2 >= LEAST_TURNS:
                around = LOBES / (end - begin) + turning_hz
                found.append((float(min(first, last) - around), float(max(first, last) + around)))
    return tuple(sorted(set(found)))


def within(frequency_hz: Floats, bands: Bands) -> NDArray[np.bool_]:
    """Whether each frequency lies in one of the bands."""
    inside = np.zeros(len(frequency_hz), dtype=np.bool_)
    for low, high in bands:
        inside |= (frequency_hz >= low) & (frequency_hz <= high)
    return inside
