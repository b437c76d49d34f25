"""A mark as light as what it lies on, of which the luma shows next to nothing, is measured by its colour."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from evaluator.recording import open_recording
from evaluator.tracking import track
from tests.evaluator.tracking.plain_video import GREEN, YELLOW, Clip, box, ellipse, finished, loop, paint, texture

AS_LIGHT = (131, 131, 131)  # luma 131 (BT.601); that of GREEN is 137


def error_px(body: tuple[int, int, int], folder: Path) -> float:
    """RMS error of the green mark of a robot with a body of some grey; all of its marks must be found."""
    rng = np.random.default_rng(11)
    floor, frames = texture(rng) + 90.0, []
    path, heading = loop(40, (160.0, 120.0), (70.0, 55.0), 0.05)
    across = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
    truth = {"green": path - 20 * across, "yellow": path + 20 * across}
    for k in range(len(path)):
        canvas = floor.copy()
        paint(canvas, box(70, 40), tuple(path[k]), heading[k] + np.pi / 2, body)
        for name, color in (("green", GREEN), ("yellow", YELLOW)):
            paint(canvas, ellipse(11, 11), tuple(truth[name][k]), 0.0, color)
        frames.append(finished(rng, canvas))
    table = track(open_recording(Clip(frames, truth, 5.5).write(folder)))
    assert (table["green_status"] == "ok").all()
    error = table[["green_x_px", "green_y_px"]].to_numpy() - truth["green"]
    return float(np.sqrt(np.mean(error**2)))


def test_a_mark_that_hardly_shows_in_the_luma_is_measured_by_its_colour(tmp_path: Path) -> None:
    assert error_px(AS_LIGHT, tmp_path) < 0.15  # 0.35 px by its luma


def test_a_mark_that_shows_in_the_luma_is_measured_by_it(tmp_path: Path) -> None:
    assert error_px((40, 40, 40), tmp_path) < 0.06
