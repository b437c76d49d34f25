"""How much of each pixel a disc or a polygon covers, as the lens blurs it.

Image frame, px. Perspective and distortion make the image of a disc differ from an ellipse. Its edge is therefore
computed on the plane: pixels are split into n × n parts; each part takes its plate coordinates from the second-order
expansion of the plane map about its pixel, and its coverage is the exact share of a square cut by a straight edge. Blur
and pixel aperture then act as one separable filter. Tests compare this with brute force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.compilation import compiled

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Kernel:
    """Lens blur (Gaussian) and square pixel aperture, sampled at the parts of a pixel.

    parts: parts of a pixel along an axis; margin: whole pixels that the filter reaches; weights: (2·margin + 1)·parts,
    summing to 1.
    """

    blur_px: float
    parts: int
    margin: int
    weights: Array


def blur_kernel(blur_px: float) -> Kernel:
    """Build the filter of a lens whose Gaussian blur has standard deviation blur_px.

    The coverage of a part is an average over that part: a filter of variance 1/(12 parts²), which is subtracted from
    the variance of the Gaussian. Sharp images need finer parts: 8 below 1 px of blur, 4 below 3 px, else 2.
    """
    parts = 8 if blur_px < 1 else 4 if blur_px < 3 else 2
    margin = math.ceil(4 * blur_px + 0.5)  # beyond lies 3e-5 of the light
    at = (np.arange((2 * margin + 1) * parts) + 0.5) / parts - margin - 0.5
    rest = math.sqrt(max(blur_px**2 - 1 / (12 * parts**2), 0.0))
    if rest < 0.25 / parts:
        weights = (np.abs(at) < 0.5).astype(float)
    else:
        edge = np.array([math.erf(x / (math.sqrt(2) * rest)) for x in np.concatenate([at + 0.5, at - 0.5])])
        weights = edge[: len(at)] - edge[len(at) :]
    return Kernel(blur_px, parts, margin, weights / weights.sum())


@compiled()
def _ramp(x: float) -> float:
    return 0.5 * x * x if x > 0 else 0.0


@compiled()
def square_share(distance: float, a: float, b: float) -> float:
    """Share of a square on the inner side of a straight edge.

    distance: of the square's centre inside the edge; a, b: half the square's side times the parts of the edge's unit
    normal along the axes, not negative. The share is a box of width 2a smoothed by a box of width 2b, integrated.
    """
    if distance >= a + b:
        return 1.0
    if distance <= -a - b:
        return 0.0
    if a < b:
        a, b = b, a
    if b < 1e-6 * a:
        return min(max(0.5 + 0.5 * distance / a, 0.0), 1.0)
    total = _ramp(distance + a + b) - _ramp(distance + a - b) - _ramp(distance - a + b) + _ramp(distance - a - b)
    return min(max(total / (4 * a * b), 0.0), 1.0)


@compiled(fastmath=True)
def _split_pixel(
    map_x: Array, map_y: Array, row: int, column: int, disc: tuple[float, float, float, float], parts: int, out: Array
) -> None:
    """Fill out (parts × parts) with the light of a disc (x, y, radius, shading) in one pixel of a plane map."""
    x0, y0, radius, shading = disc
    xc, yc = map_x[row, column] - x0, map_y[row, column] - y0
    xu = 0.5 * (map_x[row, column + 1] - map_x[row, column - 1])
    xv = 0.5 * (map_x[row + 1, column] - map_x[row - 1, column])
    yu = 0.5 * (map_y[row, column + 1] - map_y[row, column - 1])
    yv = 0.5 * (map_y[row + 1, column] - map_y[row - 1, column])
    xuu = map_x[row, column + 1] + map_x[row, column - 1] - 2 * map_x[row, column]
    xvv = map_x[row + 1, column] + map_x[row - 1, column] - 2 * map_x[row, column]
    yuu = map_y[row, column + 1] + map_y[row, column - 1] - 2 * map_y[row, column]
    yvv = map_y[row + 1, column] + map_y[row - 1, column] - 2 * map_y[row, column]
    xuv = 0.25 * (
        map_x[row + 1, column + 1]
        - map_x[row + 1, column - 1]
        - map_x[row - 1, column + 1]
        + map_x[row - 1, column - 1]
    )
    yuv = 0.25 * (
        map_y[row + 1, column + 1]
        - map_y[row + 1, column - 1]
        - map_y[row - 1, column + 1]
        + map_y[row - 1, column - 1]
    )
    reach = 0.51 * (math.hypot(xu, yu) + math.hypot(xv, yv))  # mm from a pixel's centre to its corners, at most
    rho = math.hypot(xc, yc)
    if rho > radius + reach or (rho < radius - reach and shading == 0.0):
        out[:] = 0.0 if rho > radius else 1.0
        return
    half = 0.5 / parts
    for i in range(parts):
        v = (2 * i + 1) * half - 0.5
        for j in range(parts):
            u = (2 * j + 1) * half - 0.5
            x = xc + xu * u + xv * v + 0.5 * xuu * u * u + xuv * u * v + 0.5 * xvv * v * v
            y = yc + yu * u + yv * v + 0.5 * yuu * u * u + yuv * u * v + 0.5 * yvv * v * v
            rho = math.sqrt(x * x + y * y) + 1e-12
            gu = (x * (xu + xuu * u + xuv * v) + y * (yu + yuu * u + yuv * v)) / rho
            gv = (x * (xv + xuv * u + xvv * v) + y * (yv + yuv * u + yvv * v)) / rho
            slope = math.sqrt(gu * gu + gv * gv) + 1e-12
            share = square_share((radius - rho) / slope, abs(gu) / slope * half, abs(gv) / slope * half)
            inside = min(rho / radius, 1.0)
            out[i, j] = share * (1.0 - shading * inside * inside)


@compiled(fastmath=True)
def _add_filtered(fine: Array, parts: int, weights: Array, share: float, out: Array) -> None:
    """Filter parts of pixels along both axes and add the result, times share, to the pixels of out."""
    tall, wide = out.shape
    smooth = np.zeros((tall, fine.shape[1]))
    for row in range(fine.shape[0]):
        first, last = 0, fine.shape[1]
        while first < last and fine[row, first] == 0.0:
            first += 1
        while last > first and fine[row, last - 1] == 0.0:
            last -= 1
        # The filter of image row r spans the parts from r·parts on.
        for r in range(max(0, (row - len(weights)) // parts + 1), min(tall, row // parts + 1)):
            weight = share * weights[row - r * parts]
            for column in range(first, last):
                smooth[r, column] += weight * fine[row, column]
    for row in range(tall):
        for column in range(wide):
            total = 0.0
            for k in range(len(weights)):
                total += weights[k] * smooth[row, column * parts + k]
            out[row, column] += total


@compiled(fastmath=True)
def add_disc(
    map_x: Array,
    map_y: Array,
    pad: int,
    box: tuple[int, int, int, int],
    disc: tuple[float, float, float, float],
    parts: int,
    weights: Array,
    share: float,
    out: Array,
) -> None:
    """Add a disc's blurred coverage times share to out.

    map_x, map_y: plane coordinates at pixel centres, mm, with pad more pixels on every side than the image; box:
    pixels of the image that out covers, (left, top, right, bottom), right and bottom excluded; disc: (x_mm, y_mm,
    radius_mm, shading), where shading is the loss of light at the rim; parts, weights: of a Kernel whose margin is at
    least one less than pad.
    """
    left, top, right, bottom = box
    margin = (len(weights) // parts - 1) // 2
    tall, wide = bottom - top + 2 * margin, right - left + 2 * margin
    fine = np.zeros((tall * parts, wide * parts))
    for row in range(tall):
        for column in range(wide):
            _split_pixel(
                map_x,
                map_y,
                row + top - margin + pad,
                column + left - margin + pad,
                disc,
                parts,
                fine[row * parts : (row + 1) * parts, column * parts : (column + 1) * parts],
            )
    _add_filtered(fine, parts, weights, share, out)


@compiled()
def _edges(corners_px: Array) -> Array:
    """Edges of a clockwise polygon, (n, 3): edge · (column, row, 1) is the distance inside of it, px."""
    edges = np.empty((len(corners_px), 3))
    count = 0
    for k in range(len(corners_px)):
        ax, ay = corners_px[k, 0], corners_px[k, 1]
        bx, by = corners_px[(k + 1) % len(corners_px), 0] - ax, corners_px[(k + 1) % len(corners_px), 1] - ay
        length = math.hypot(bx, by)
        if length > 0:
            # One by one: the assignment of a row brings the compiler's texts of errors with it, 1.8 s of compiling.
            edges[count, 0], edges[count, 1] = -by / length, bx / length
            edges[count, 2] = (by * ax - bx * ay) / length
            count += 1
    return edges[:count]


@compiled()
def _span(edges: Array, row: float, depth: float, first: float, last: float) -> tuple[float, float]:
    """Columns of a row, between first and last, that lie at least depth inside every edge; empty if last < first."""
    for k in range(len(edges)):
        slope, rest = edges[k, 0], edges[k, 1] * row + edges[k, 2] - depth
        if slope > 1e-9:
            first = max(first, -rest / slope)
        elif slope < -1e-9:
            last = min(last, -rest / slope)
        elif rest < 0:
            last = first - 1
    return first, last


@compiled()
def add_polygon(corners_px: Array, blur_px: float, box: tuple[int, int, int, int], share: float, out: Array) -> None:
    """Add a convex polygon's blurred coverage times share to out.

    corners_px: (n, 2), clockwise on the image (y down). Edges are exact; corners are more rounded than by true blur,
    which suffices for bodies and sheets. blur_px: standard deviation of blur and pixel aperture as one Gaussian.
    """
    left, top, right, bottom = box
    wide = math.sqrt(2 * (blur_px**2 + 1 / 12))
    edges = _edges(corners_px)
    for row in range(top, bottom):
        first, last = _span(edges, row, -4 * wide, left, right - 1)
        inner, outer = _span(edges, row, 4 * wide, left, right - 1)
        for column in range(math.ceil(first), math.floor(last) + 1):
            if inner <= column <= outer:
                out[row - top, column - left] += share
                continue
            nearest = 4 * wide
            for k in range(len(edges)):
                nearest = min(nearest, edges[k, 0] * column + edges[k, 1] * row + edges[k, 2])
            out[row - top, column - left] += share * 0.5 * (1 + math.erf(nearest / wide))
