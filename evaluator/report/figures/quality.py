"""Figures of measurement quality: scale check, lost frames, uncertainty of the camera over the field."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from calibration.camera import Camera
from evaluator.report.pages.colors import BLUE, INK, SOFT, VERMILLION
from evaluator.report.runs import RunView, column
from evaluator.report.style import Figure, drawing

MOST_RUNS = 40  # rows of a figure that fits a screen


def scale_check(runs: Sequence[RunView]) -> Figure | None:
    """Measured over nominal distance of the marks, run by run."""
    off, sigma = 100 * (column(runs, "mark_spacing_ratio") - 1), 100 * column(runs, "mark_spacing_ratio_sigma")
    if not np.isfinite(off).any():
        return None
    order = np.arange(len(runs))
    with drawing("scale-check") as canvas:
        (axes,) = canvas.axes
        axes.axhline(0, color=INK, lw=0.8)
        axes.errorbar(order, off, 1.96 * sigma, color=BLUE, marker="o", ls="none", capsize=2.5, lw=1.2)
        few = order if len(runs) <= 12 else order[:: -(-len(runs) // 12)]
        axes.set_xticks(few, [runs[index].id for index in few], rotation=35, ha="right", rotation_mode="anchor")
        axes.set_ylabel("distance of the marks, % from robot.toml")
    return Figure(
        "scale-check",
        "Scale check",
        "Measured distance of the two marks, relative to robot.toml. If all runs deviate by the same amount, "
        "calibration, mark height or robot.toml is wrong; if one run does, inspect its video. Bars: 95 % for "
        "independent frames.",
        (canvas.svg,),
        pd.DataFrame({"run": [run.id for run in runs], "off_percent": off, "sigma_percent": sigma}),
    )


def lost_frames(runs: Sequence[RunView]) -> Figure | None:
    """Times without a pose, of the runs that have most of them; None if every frame has one."""
    found = [(run, run.poses["time_s"][run.poses["x_mm"].isna()].to_numpy()) for run in runs]
    found = [(run, times) for run, times in found if len(times)]
    if not found:
        return None
    worst = sorted(range(len(found)), key=lambda k: -len(found[k][1]))[:MOST_RUNS]
    lost = [found[k] for k in sorted(worst)]
    with drawing("lost-frames", height=1.0 + 0.24 * len(lost)) as canvas:
        (axes,) = canvas.axes
        for row, (run, times) in enumerate(lost):
            axes.hlines(-row, 0, run.poses["time_s"].iloc[-1], color=SOFT, lw=0.8)
            strokes = np.repeat(times, 3), np.tile([-row - 0.3, -row + 0.3, np.nan], len(times))
            axes.plot(*strokes, color=VERMILLION, lw=1.0, marker="", solid_capstyle="butt")  # one line, not thousands
        axes.set_yticks(-np.arange(len(lost)), [run.id for run, _ in lost])
        axes.set_ylim(-len(lost) + 0.4, 0.6)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("time, s")
    rows = [(run.id, time, status) for run, times in lost for time, status in _reasons(run, times)]
    return Figure(
        "lost-frames",
        "Frames without a pose",
        "Each stroke is a frame in which a mark was not found or was rejected; the data give each reason. Strokes at "
        "one position on the plate suggest glare or the edge of the image."
        + (f" Of {len(found)} runs these {len(lost)} lost most frames." if len(found) > len(lost) else ""),
        (canvas.svg,),
        pd.DataFrame(rows, columns=["run", "time_s", "reason"]),
    )


def camera_uncertainty(camera: Camera, height_mm: float) -> Figure:
    """Standard uncertainty of a position on the plane of the marks, from the covariance of the camera alone."""
    width, height = camera.size_px
    across, down = np.linspace(0, width - 1, 33), np.linspace(0, height - 1, 25)
    pixel = np.stack(np.meshgrid(across, down), axis=-1)
    sensitivity = camera.plate_sensitivity(pixel, height_mm)
    covariance = sensitivity @ camera.covariance @ np.swapaxes(sensitivity, -1, -2)
    sigma_um = 1000 * np.sqrt(np.trace(covariance, axis1=-2, axis2=-1) / 2)
    place = camera.plate_from_image(pixel, height_mm)
    with drawing("camera-uncertainty") as canvas:
        (axes,) = canvas.axes
        lines = axes.contour(place[..., 0], place[..., 1], sigma_um, 7, colors=[BLUE], linewidths=1.0)
        axes.clabel(lines, fontsize=8, fmt="%.3g µm")
        edge = np.concatenate([place[0], place[:, -1], place[-1, ::-1], place[::-1, 0]])
        axes.plot(edge[:, 0], edge[:, 1], color=INK, lw=0.9)
        axes.set_aspect("equal")
        axes.set_xlabel("x, mm")
        axes.set_ylabel("y, mm")
    return Figure(
        "camera-uncertainty",
        "Uncertainty of the camera",
        f"Standard uncertainty of a coordinate on the plane {height_mm:g} mm above the plate, from the calibration "
        "alone; more frames do not reduce it. The frame is the edge of the image.",
        (canvas.svg,),
        pd.DataFrame(
            {
                "x_px": pixel[..., 0].ravel(),
                "y_px": pixel[..., 1].ravel(),
                "x_mm": place[..., 0].ravel(),
                "y_mm": place[..., 1].ravel(),
                "sigma_um": sigma_um.ravel(),
            }
        ),
    )


def _reasons(run: RunView, times: np.ndarray) -> list[tuple[float, str]]:
    status = run.poses.set_index("time_s")["status"]
    return [(float(time), str(status.loc[time])) for time in times]
