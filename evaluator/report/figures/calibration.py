"""Figures of a calibration: residuals, coverage, lens distortion and flatness of the gauge."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from calibration.assessment.next_image import NextImage
from calibration.camera import Camera
from calibration.estimation.calibrate import Calibration
from calibration.estimation.flatness import face_terms
from calibration.lens import undistort
from evaluator.report.pages.colors import BLUE, INK, SOFT, VERMILLION
from evaluator.report.style import GROUPS, Figure, drawing

NO_SHIFT_PX = 1e-6  # a thousandth of the best dot centre's uncertainty
MOST_STRETCH = 10_000.0  # an arrow of 10 px is then 0.001 px, the uncertainty of the best dots


def residual_vectors(calibration: Calibration) -> Figure:
    """Residual of every used dot from all images, magnified."""
    points = np.concatenate([view.centers_px for view in calibration.views])
    residual = np.concatenate(calibration.fit.residual_px)
    width = calibration.camera.size_px[0]
    typical = float(np.median(np.hypot(*residual.T)))
    stretch = min(_round_down(0.025 * width / max(typical, NO_SHIFT_PX)), MOST_STRETCH)
    with drawing("residual-vectors") as canvas:
        (axes,) = canvas.axes
        axes.quiver(
            *points.T, *(stretch * residual.T), angles="xy", scale_units="xy", scale=1, color=BLUE, width=0.0022
        )
        _image_axes(axes, calibration.camera)
    names = np.repeat([view.name for view in calibration.views], [len(view) for view in calibration.views])
    return Figure(
        "residual-vectors",
        "Residuals",
        f"Measured minus predicted position of each dot, {stretch:g} times enlarged; RMS {calibration.rms_px:.3g} px "
        "per axis. Random arrows are noise. If neighbouring arrows agree, the gauge is bent or the lens model does not "
        "fit.",
        (canvas.svg,),
        pd.DataFrame({"image": names, "x_px": points[:, 0], "y_px": points[:, 1]}).assign(
            residual_x_px=residual[:, 0], residual_y_px=residual[:, 1]
        ),
    )


def coverage_map(calibration: Calibration, best: NextImage | None = None) -> Figure:
    """Dots of every image, the principal point with its 95 % interval, and the outline of the image to take next."""
    camera = calibration.camera
    with drawing("coverage") as canvas:
        (axes,) = canvas.axes
        for k, view in enumerate(calibration.views):
            look = GROUPS[k % len(GROUPS)]
            axes.plot(*view.centers_px.T, color=look.color, marker=look.marker, ls="none", ms=2.2, mew=0.6)
        at = camera.value("principal_x_px"), camera.value("principal_y_px")
        reach = 1.96 * camera.sigma("principal_x_px"), 1.96 * camera.sigma("principal_y_px")
        axes.errorbar(*at, reach[1], reach[0], color=INK, marker="+", ms=12, mew=1.6, lw=1.2, capsize=2.5)
        _draw_plate_axes(axes, camera)
        if best is not None:
            axes.add_patch(Polygon(best.outline_px, closed=True, fill=False, ec=INK, ls=(0, (4, 3)), lw=1.2))
        _image_axes(axes, camera)
    rows = [(view.name, *point) for view in calibration.views for point in view.centers_px]
    return Figure(
        "coverage",
        "Coverage",
        "Dots of all images, one colour and marker per image. Outside of them, distortion is extrapolated. Cross: "
        "principal point with its 95 % interval. Arrows: x and y of the plate frame."
        + ("" if best is None else " Dashed: the gauge in the most useful further image."),
        (canvas.svg,),
        pd.DataFrame(rows, columns=["image", "x_px", "y_px"]),
    )


def plate_axes_px(camera: Camera, height_mm: float = 0.0) -> NDArray[np.float64]:
    """Axes of the plate frame in the image: ends (2, 2, 2) of the x and the y arrow, from and to, px.

    They start at the origin if it is well in view, otherwise at the middle of the image; length: a seventh of it.
    """
    size = np.array(camera.size_px, dtype=float)
    start = camera.image_from_plate([0.0, 0.0, height_mm])
    inside = np.isfinite(start).all() and (start > 0.15 * size).all() and (start < 0.85 * size).all()
    at = np.zeros(2) if inside else camera.plate_from_image(size / 2, height_mm)
    side = camera.plate_from_image(size / 2 + [size.min() / 7, 0], height_mm)
    length = float(np.hypot(*(side - camera.plate_from_image(size / 2, height_mm))))
    ends = at + np.array([[[0.0, 0.0], [length, 0.0]], [[0.0, 0.0], [0.0, length]]])
    return camera.image_from_plate(np.concatenate([ends, np.full((2, 2, 1), height_mm)], axis=2))


def _draw_plate_axes(axes: Axes, camera: Camera) -> None:
    ends = plate_axes_px(camera)
    if not np.isfinite(ends).all():
        return
    for (start, end), name in zip(ends, ("x", "y"), strict=True):
        axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": VERMILLION, "lw": 1.6})
        axes.annotate(name, end, xytext=(4, 4), textcoords="offset points", color=VERMILLION, fontweight="bold")


def gauge_face(calibration: Calibration) -> Figure | None:
    """Height of the gauge's face over its mean plane; None if it was assumed flat."""
    found, gauge = calibration.flatness, calibration.gauge
    if found is None or not found.used:
        return None
    place = gauge.positions_mm()
    height_um = 1000 * (face_terms(gauge)[..., : len(found.coefficients_mm)] @ found.coefficients_mm)
    with drawing("gauge-face") as canvas:
        (axes,) = canvas.axes
        axes.plot(*place.reshape(-1, 2).T, color=SOFT, marker=".", ls="none", ms=2.5)
        lines = axes.contour(place[..., 0], place[..., 1], height_um, 8, colors=[BLUE], linewidths=1.0)
        axes.clabel(lines, fontsize=8, fmt="%.3g µm")
        axes.set_aspect("equal")
        axes.set_xlabel("x on the gauge, mm")
        axes.set_ylabel("y on the gauge, mm")
    return Figure(
        "gauge-face",
        "Flatness of the gauge",
        f"Height of its face above its mean plane (dashed: below), estimated from all images; peak to valley "
        f"{found.peak_to_valley_mm:.3g} mm ({found.low_mm:.3g} to {found.high_mm:.3g}, 95 %).",
        (canvas.svg,),
        pd.DataFrame({"x_mm": place[..., 0].ravel(), "y_mm": place[..., 1].ravel(), "height_um": height_um.ravel()}),
    )


def distortion_map(camera: Camera) -> Figure:
    """Displacement of each point by lens distortion."""
    width, height = camera.size_px
    grid = np.stack(np.meshgrid(np.linspace(0, width - 1, 17), np.linspace(0, height - 1, 13)), axis=-1).reshape(-1, 2)
    normalised = (grid - camera.principal_px) / camera.focal_xy_px
    straight = undistort(normalised, camera.distortion, camera.lens) * camera.focal_xy_px + camera.principal_px
    shift = grid - straight
    shift[np.hypot(*shift.T) < NO_SHIFT_PX] = 0.0  # rounding errors are no distortion
    largest = float(np.nanmax(np.hypot(*shift.T), initial=0.0))
    stretch = _stretch(largest, width)
    with drawing("distortion") as canvas:
        (axes,) = canvas.axes
        axes.quiver(
            *grid.T,
            *(stretch * shift.T),
            angles="xy",
            scale_units="xy",
            scale=1,
            color=VERMILLION,
            width=0.003,
            pivot="tip",
        )
        _image_axes(axes, camera)
    factor = "at true length" if stretch == 1 else f"drawn {stretch:g} times too long"
    return Figure(
        "distortion",
        "Lens distortion",
        f"Arrows ({factor}) lead from the position without distortion to the distorted one, at most {largest:.3g} px."
        if largest > 0
        else "The selected lens model has no distortion.",
        (canvas.svg,),
        pd.DataFrame({"x_px": grid[:, 0], "y_px": grid[:, 1], "shift_x_px": shift[:, 0], "shift_y_px": shift[:, 1]}),
    )


def _stretch(largest_px: float, width_px: float) -> float:
    """Factor that makes the longest arrow visible, at most MOST_STRETCH."""
    if largest_px <= 0 or 0.02 * width_px <= largest_px <= 0.06 * width_px:
        return 1.0
    return min(_round_down(0.06 * width_px / largest_px), MOST_STRETCH)


def _image_axes(axes: Axes, camera: Camera) -> None:
    """The image's frame: y down, the rim drawn."""
    width, height = camera.size_px
    axes.plot([0, width, width, 0, 0], [0, 0, height, height, 0], color=SOFT, lw=0.9)
    axes.set_aspect("equal")
    axes.invert_yaxis()
    axes.set_xlabel("x, px")
    axes.set_ylabel("y, px")


def _round_down(value: float) -> float:
    """Largest of 1, 2, 5 times a power of ten that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1, 2, 5) if step <= value / power * (1 + 1e-9)))
