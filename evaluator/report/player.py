"""Data of the trajectory player: curves thinned and rounded, and frames within a budget, for a page of limited size."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from math import ceil
from typing import Any

import cv2
import numpy as np
import pandas as pd

from evaluator.report.figures.trajectory import legend_of, thinned
from evaluator.report.numbers import true_minus
from evaluator.report.runs import RunView, unit_of
from evaluator.report.style import mark_lines
from simulator.robot import Robot

IMAGE_BUDGET_BYTES = 1_800_000  # of JPEG; base64 adds a third, and the page must stay below 5 MB
# Every so many frames of a run, this large: of the twelve of a run, from all down to one of 120 pixels for 1,000 runs.
FRAMES = ((1, 1.0), (2, 1.0), (2, 0.75), (3, 0.75), (3, 0.5), (6, 0.5), (12, 0.5), (12, 0.375))
POINT_BUDGET = 20_000  # points of all runs together, each some 60 characters


def player_data(runs: Sequence[RunView], robot: Robot) -> str:
    """JSON for page.js; safe inside a script element."""
    points = max(40, min(240, POINT_BUDGET // max(1, len(runs))))
    thumbnails = _fitted([run.thumbnails for run in runs])
    unit, seen = unit_of(runs), {name for run in runs for name in run.mark_names}
    content = {
        "unit": {"name": unit.name, "mm": unit.mm},
        "robot": {
            "length": robot.body.length_mm,
            "width": robot.body.width_mm,
            "marks": [
                {"color": line.color, "place": mark.place_mm, "size": mark.diameter_mm}
                for mark, line in zip(robot.layout, mark_lines([mark.name for mark in robot.layout]), strict=True)
                if mark.name in seen
            ],
        },
        "lines": [{"color": line.color, "width": line.width, "dash": line.dash} for line in legend_of(runs)],
        "runs": [_run(run, points, chosen) for run, chosen in zip(runs, thumbnails, strict=True)],
    }
    return json.dumps(content, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")


def _run(run: RunView, points: int, thumbnails: list[tuple[float, str]]) -> dict[str, Any]:
    marks, poses, simulated = (thinned(table, points) for table in (run.marks, run.poses, run.simulated))
    circle = [run.value(name) for name in ("center_x_mm", "center_y_mm", "radius_mm")]
    radius = f"radius {run.unit.text(run.value('radius_mm'))}" if run.turns else str(run.turning["radius_status"])
    return {
        "label": f"{run.id}: {run.command}" + (f" ({run.group})" if run.group else ""),
        "note": true_minus(f"{run.command}, {radius}."),
        "t": _rounded(poses["time_s"], 3),
        "x": _rounded(poses["x_mm"], 2),
        "y": _rounded(poses["y_mm"], 2),
        "heading": _rounded(poses["heading_deg"], 1),
        "marks": [[_rounded(marks[f"{name}_{axis}_mm"], 2) for axis in "xy"] for name in run.mark_names],
        "sx": _rounded(simulated["x_mm"], 2),
        "sy": _rounded(simulated["y_mm"], 2),
        "circle": [round(value, 3) for value in circle] if np.isfinite(circle).all() else None,
        "thumbnails": thumbnails,
    }


def _rounded(values: pd.Series[float], digits: int) -> list[float | None]:
    return [round(float(value), digits) if np.isfinite(value) else None for value in values]


def _fitted(thumbnails: Sequence[list[dict[str, Any]]]) -> list[list[tuple[float, str]]]:
    """Frames per run within the budget: their number is reduced before their size, and last the runs that have any."""
    total = sum(len(item["jpeg"]) * 3 // 4 for chosen in thumbnails for item in chosen)
    every, scale, size = 1, 1.0, 0.0
    for every, scale in FRAMES:
        size = total / every * scale**1.6  # bytes grow a little slower than the area
        if size <= IMAGE_BUDGET_BYTES:
            break
    apart = max(1, ceil(size / IMAGE_BUDGET_BYTES))
    return [
        [(round(item["time_s"], 3), _scaled(item["jpeg"], scale)) for item in chosen[::every]] if k % apart == 0 else []
        for k, chosen in enumerate(thumbnails)
    ]


def _scaled(jpeg: str, scale: float) -> str:
    if scale == 1.0:
        return jpeg
    image = cv2.imdecode(np.frombuffer(base64.b64decode(jpeg), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None  # encoded by turnscope
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return base64.b64encode(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 65])[1].tobytes()).decode()
