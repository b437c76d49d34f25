"""Gauge images: every dot is where the truth says, whatever the pose, lens and print."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibration.camera import camera_above
from calibration.gauge.geometry import Gauge
from simulator.errors import SimulationError
from simulator.rendering import GaugePose, gauge_truth, load_scene, render_gauge, render_gauge_image

GAUGE = {"columns": 5, "rows": 4, "pitch_mm": 3.0, "diameter_mm": 0.4}
CAMERA = camera_above(size_px=(320, 240), focal_px=1800, distance_mm=150, k1=-0.3, tilt_deg=3)
QUIET: dict[str, Any] = {"sensor": {"full_well_e": 0.0, "bits": 16}, "optics": {"vignetting": 0.0}}


def gauge(**dots: Any) -> Gauge:
    return Gauge.model_validate({"format": 1, "name": "dots", "dots": GAUGE | dots})


def centroids(image: np.ndarray, at_px: np.ndarray) -> np.ndarray:
    """Centroids of dark dots within 8 px of places; paper is white about them."""
    found = []
    for x, y in at_px:
        left, top = round(x) - 8, round(y) - 8
        patch = image[top : top + 17, left : left + 17].mean(axis=-1)
        dark = patch.max() - patch
        rows, columns = np.indices(dark.shape)
        found.append([left + (dark * columns).sum() / dark.sum(), top + (dark * rows).sum() / dark.sum()])
    return np.array(found)


def test_small_dots_lie_on_their_truth_on_a_tilted_gauge() -> None:
    pose = GaugePose((0.25, -0.2, 0.1), (0.4, -0.3, 9.0))
    image = render_gauge_image(
        CAMERA, gauge(), rotation_rad=pose.rotation_rad, translation_mm=pose.translation_mm, **QUIET
    )
    truth = gauge_truth(CAMERA, gauge(), pose)
    inside = truth[["x_px", "y_px"]].to_numpy()
    # A dot of 5 px seen at 18 degrees has its centroid within 0.01 px of the image of its centre.
    assert np.abs(centroids(image, inside) - inside).max() < 0.01


def test_print_errors_are_in_image_and_truth_and_the_same_in_every_image(tmp_path: Path) -> None:
    (tmp_path / "gauge.toml").write_text(
        'format = 1\nname = "g"\n[dots]\ncolumns = 5\nrows = 4\npitch_mm = 3.0\ndiameter_mm = 0.4\n'
    )
    text = (
        'format = 1\nkind = "gauge"\ngauge = "gauge.toml"\nprint_error_mm = 0.05\n{}\n[sensor]\nfull_well_e = 0.0\n'
        "[optics]\nvignetting = 0.0\n[camera]\nsize_px = [320, 240]\nfocal_px = 1800.0\n"
    )
    tables = []
    for name, more in (("a", "seed = 1"), ("b", "seed = 2\nheight_mm = 4.0")):
        (tmp_path / f"{name}.toml").write_text(text.format(more))
        image, truth = render_gauge(load_scene(tmp_path / f"{name}.toml"))  # type: ignore[arg-type]
        at_px = truth[["x_px", "y_px"]].to_numpy()
        assert np.abs(centroids(image, at_px) - at_px).max() < 0.03
        tables.append(truth)
    assert np.array_equal(tables[0]["x_mm"], tables[1]["x_mm"])
    assert (tables[0]["x_mm"] - gauge().positions_mm()[..., 0].ravel()).std() == pytest.approx(0.05, rel=0.4)


def test_missing_dot_is_not_drawn_and_not_visible(tmp_path: Path) -> None:
    del tmp_path
    missing = [{"column": 2, "row": 1}]
    whole, holed = (render_gauge_image(CAMERA, gauge(), missing=m, **QUIET) for m in ([], missing))
    x, y = CAMERA.image_from_plate([*gauge().positions_mm()[1, 2], 0.0])
    changed = np.abs(whole.astype(float) - holed).max(axis=-1)
    rows, columns = np.nonzero(changed > 300)
    assert np.hypot(columns - x, rows - y).max() < 7
    assert holed[round(y), round(x)].min() > 2 * whole[round(y), round(x)].max()


def test_gauge_out_of_view_and_unknown_colour_are_explained() -> None:
    with pytest.raises(SimulationError, match="outside the image"):
        render_gauge_image(CAMERA, gauge(), translation_mm=(500.0, 0.0, 0.0))
    with pytest.raises(SimulationError, match="#rrggbb"):
        render_gauge_image(CAMERA, gauge(color="blakc"))
    with pytest.raises(SimulationError, match="5 × 4 dots"):
        render_gauge_image(CAMERA, gauge(), missing=[{"column": 9, "row": 1}])


def test_sixteen_bit_grey_and_fisheye_images() -> None:
    camera = camera_above(size_px=(320, 240), focal_px=150, distance_mm=20, lens="fisheye", k1=-0.02)
    image = render_gauge_image(camera, gauge(), sensor={"bits": 16, "color": False})
    assert image.dtype == np.uint16
    assert image.shape == (240, 320)
    assert image.max() > 40_000
