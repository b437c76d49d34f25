"""Roundness test of dots, because the fit of a blurred ellipse would accept squares and hexagons.

In coordinates in which the fitted ellipse is the unit circle, the rim is 1 + Σ εₙ cos n(θ - θₙ). Orders 0 to 2 belong
to the ellipse; higher ones vanish for discs (perspective leaves (radius/distance)² in the third). All figures of a
gauge are equal, so that averaging the orders over many dots with their phase reduces noise but not a common shape.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from calibration.detection.dots import Dots

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
ORDERS = (3, 4, 5, 6)  # waves around a dot: lower ones are its size, its place and its ellipse
SAMPLE = 40  # dots
FEWEST = 12  # dots
# Largest amplitude of a disc. A square has 0.1 in its fourth order, a hexagon 0.05 in its sixth. Discs rendered with
# blur, noise, JPEG, colour interpolation or motion over most of their width, and real ones, have less than 0.02,
# coarsely drawn discs of 6 px 0.03.
OUT_OF_ROUND = 0.04
NAMES = {3: "triangles", 4: "squares", 5: "pentagons", 6: "hexagons"}


def out_of_round(dots: Dots, dot: Integers) -> tuple[int, float]:
    """Order and amplitude, as a share of the radius, of the strongest common departure of dots (k,) from ellipses."""
    chosen = dot[np.linspace(0, len(dot) - 1, min(len(dot), SAMPLE)).astype(np.int64)]
    found = np.array([_harmonics(dots, k) for k in chosen])
    found = found[np.isfinite(found).all(axis=1)]
    if len(found) < FEWEST:
        return ORDERS[0], 0.0
    amplitude = np.abs(np.median(found.real, axis=0) + 1j * np.median(found.imag, axis=0))
    strongest = int(amplitude.argmax())
    return ORDERS[strongest], float(amplitude[strongest])


def _harmonics(dots: Dots, k: int) -> NDArray[np.complex128]:
    """Amplitudes εₙ exp(i n θₙ) of one dot, least squares on the pixels about its rim; NaN where the image ends."""
    a11, a12, a22 = dots.shape[k]
    center, blur = dots.centers_px[k], dots.blur_px[k]
    half = int(np.ceil(np.sqrt(max(a11, a22) / (a11 * a22 - a12**2)) + 3 * blur))
    left, top = np.rint(center).astype(int) - half
    width, height = dots.size_px
    if left < 0 or top < 0 or left + 2 * half >= width or top + 2 * half >= height:
        return np.full(len(ORDERS), np.nan + 0j)
    y, x = np.mgrid[top : top + 2 * half + 1, left : left + 2 * half + 1]
    dx, dy = x - center[0], y - center[1]
    ux, uy = a11 * dx + a12 * dy, a12 * dx + a22 * dy
    q = np.sqrt(dx * ux + dy * uy) + 1e-9
    slope = np.hypot(ux, uy) + 1e-12
    t = (q * q - q) / slope / blur
    near = np.abs(t) < 3
    edge = dots.contrast[k] * np.exp(-(t[near] ** 2) / 2) / np.sqrt(2 * np.pi) / blur
    # a rim at 1 + ε is displaced outward by ε q / |∇q|
    darker = -edge * (q * q / slope)[near]
    value, vector = np.linalg.eigh([[a11, a12], [a12, a22]])
    root = vector * np.sqrt(value) @ vector.T
    angle = np.arctan2(root[1, 0] * dx + root[1, 1] * dy, root[0, 0] * dx + root[0, 1] * dy)[near]
    waves = [darker * wave(n * angle) for n in ORDERS for wave in (np.cos, np.sin)]
    ground = [np.ones(near.sum()), dx[near], dy[near], ndtr(-t[near]), darker, edge * t[near]]
    light = dots.plane[y[near], x[near]].astype(float)
    fitted = np.linalg.lstsq(np.stack(ground + waves, axis=1), light, rcond=None)[0][len(ground) :]
    return np.asarray(fitted[::2] + 1j * fitted[1::2])
