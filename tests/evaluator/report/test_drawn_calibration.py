"""What figures and tables of a calibration show: residuals, coverage, face and distortion where the camera has them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from calibration.camera import PARAMETERS, camera_above
from calibration.gauge.geometry import Gauge, load_gauge
from evaluator.report.figures import calibration as figures
from evaluator.report.pages import calibration as page
from evaluator.report.pages.html import Page
from evaluator.workflow.samples import sample_folder
from tests.evaluator.report.shown import labels, lines, undrawn

CAMERA = camera_above(size_px=(640, 480), focal_px=2000, distance_mm=150)


@dataclass(frozen=True)
class View:
    """Dots of an image."""

    name: str
    centers_px: Any

    def __len__(self) -> int:
        return len(self.centers_px)


def known(**sigmas: float) -> Any:
    """The camera with standard uncertainties of some parameters."""
    covariance = np.zeros((len(PARAMETERS),) * 2)
    for name, sigma in sigmas.items():
        covariance[(PARAMETERS.index(name),) * 2] = sigma**2
    return replace(CAMERA, covariance=covariance)


@pytest.fixture
def solved() -> Any:
    """A calibration of two images with three dots; residuals of 5, 10 and 20 thousandths of a pixel."""
    views = (View("a/one.png", np.array([[10.0, 20.0], [30.0, 40.0]])), View("two.png", np.array([[50.0, 60.0]])))
    residual = [np.array([[0.003, -0.004], [0.0, 0.01]]), np.array([[0.02, 0.0]])]
    free = ("focal_px", "k1", "k2")
    return SimpleNamespace(
        views=views, camera=known(focal_px=0.25, k1=0.0012, principal_x_px=0.5, principal_y_px=0.25), rms_px=0.01234,
        fit=SimpleNamespace(residual_px=residual, state=SimpleNamespace(free=free)), rejected=(2, 0),
        trials=(SimpleNamespace(model="brown", free=("k1",), face=0, held_out=2.0),), flatness=None,
        gauge=SimpleNamespace(name="plate"),
    )  # fmt: skip


def test_residuals_are_arrows_at_their_dots_so_many_times_enlarged_as_the_caption_says(
    monkeypatch: pytest.MonkeyPatch, solved: Any
) -> None:
    axes = undrawn(monkeypatch, figures)
    found = figures.residual_vectors(solved)
    assert "1000 times enlarged; RMS 0.0123 px" in found.caption  # 0.01 px to at most 2.5 % of 640 px
    x, y, by_x, by_y = axes[0].quiver.call_args.args
    np.testing.assert_allclose((x, y), ([10, 30, 50], [20, 40, 60]))
    np.testing.assert_allclose((by_x, by_y), ([3, 0, 20], [-4, 10, 0]))
    assert found.data.iloc[2].tolist() == ["two.png", 50.0, 60.0, 0.02, 0.0]
    assert found.data["image"].tolist() == ["a/one.png", "a/one.png", "two.png"]
    assert lines(axes[0]) == [([0, 640, 640, 0, 0], [0, 0, 480, 480, 0])]  # the rim of the image, y down
    assert axes[0].invert_yaxis.called
    assert labels(axes[0]) == ("x, px", "y, px")
    solved.fit.residual_px = [np.zeros((2, 2)), np.zeros((1, 2))]
    assert "10000 times enlarged" in figures.residual_vectors(solved).caption


def test_coverage_shows_every_dot_the_principal_point_with_its_interval_and_the_image_to_take(
    monkeypatch: pytest.MonkeyPatch, solved: Any
) -> None:
    axes = undrawn(monkeypatch, figures)
    outline = ((1.0, 2.0), (3.0, 4.0), (5.0, 6.0), (7.0, 8.0))
    found = figures.coverage_map(solved, SimpleNamespace(outline_px=outline))  # type: ignore[arg-type]
    assert lines(axes[0])[:2] == [([10.0, 30.0], [20.0, 40.0]), ([50.0], [60.0])]
    assert len({call.kwargs["color"] for call in axes[0].plot.call_args_list[:2]}) == 2
    x, y, by_y, by_x = axes[0].errorbar.call_args.args
    assert (x, y) == (CAMERA.value("principal_x_px"), CAMERA.value("principal_y_px"))
    assert (by_x, by_y) == pytest.approx((1.96 * 0.5, 1.96 * 0.25))
    np.testing.assert_allclose(axes[0].add_patch.call_args.args[0].get_xy()[:4], outline)
    assert [call.args[0] for call in axes[0].annotate.call_args_list] == ["", "x", "", "y"]
    ends = figures.plate_axes_px(CAMERA)
    for (start, end), call in zip(ends, axes[0].annotate.call_args_list[::2], strict=True):
        np.testing.assert_allclose(call.args[1:], (end, start))
    assert found.data.to_numpy().tolist()[2] == ["two.png", 50.0, 60.0]
    assert found.caption.endswith("Dashed: the gauge in the most useful further image.")
    assert "Dashed" not in figures.coverage_map(solved).caption
    assert not axes[1].add_patch.called


def test_the_face_of_a_gauge_is_drawn_in_micrometres_over_its_places(monkeypatch: pytest.MonkeyPatch) -> None:
    axes = undrawn(monkeypatch, figures)
    gauge = load_gauge(sample_folder() / "gauge.toml")
    flatness = SimpleNamespace(
        used=True, coefficients_mm=np.array([0.0, 0.002, 0.0]), peak_to_valley_mm=0.004, low_mm=0.003, high_mm=0.005
    )
    found = figures.gauge_face(SimpleNamespace(flatness=flatness, gauge=gauge))  # type: ignore[arg-type]
    assert found is not None
    corner = found.data.iloc[[0, -1]]  # y runs down: u·v is −1 in these corners, and 1 in the others
    assert corner["height_um"].tolist() == pytest.approx([-2.0, -2.0])
    assert found.data["height_um"].max() == pytest.approx(2.0)
    assert "peak to valley 0.004 mm (0.003 to 0.005, 95 %)" in found.caption
    place = gauge.positions_mm()
    x, y, height, *_ = axes[0].contour.call_args.args
    np.testing.assert_allclose((x, y), np.moveaxis(place, -1, 0))
    np.testing.assert_allclose(height.ravel(), found.data["height_um"])
    assert lines(axes[0])[0] == (place[..., 0].ravel().tolist(), place[..., 1].ravel().tolist())
    assert labels(axes[0]) == ("x on the gauge, mm", "y on the gauge, mm")
    flatness.used = False
    assert figures.gauge_face(SimpleNamespace(flatness=flatness, gauge=gauge)) is None  # type: ignore[arg-type]
    assert figures.gauge_face(SimpleNamespace(flatness=None, gauge=gauge)) is None  # type: ignore[arg-type]
    assert isinstance(gauge, Gauge)


def test_arrows_of_distortion_end_where_the_lens_moves_a_point(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a first radial term alone, a point at r of the undistorted image moves by k1·r³."""
    axes = undrawn(monkeypatch, figures)
    camera = camera_above(size_px=(640, 480), focal_px=2000, distance_mm=150, k1=0.5)
    found = figures.distortion_map(camera)
    x, y, by_x, by_y = axes[0].quiver.call_args.args
    grid, shift = np.stack([x, y], -1), found.data[["shift_x_px", "shift_y_px"]].to_numpy()
    assert (grid[0].tolist(), grid[-1].tolist(), len(grid)) == ([0.0, 0.0], [639.0, 479.0], 17 * 13)
    before = (grid - shift - camera.principal_px) / camera.focal_xy_px
    np.testing.assert_allclose(shift, camera.focal_xy_px * 0.5 * before * (before**2).sum(1, keepdims=True), atol=1e-6)
    largest = np.hypot(*shift.T).max()
    assert f"at most {largest:.3g} px" in found.caption
    assert "Arrows (drawn 5 times too long)" in found.caption  # of 7.4 px at the corners, at most 6 % of 640 px
    np.testing.assert_allclose(np.stack([by_x, by_y], -1), 5 * shift)
    assert axes[0].quiver.call_args.kwargs["pivot"] == "tip"


@pytest.mark.parametrize(
    ("largest", "factor"), [(0.0, 1), (2.0, 1), (6.0, 1), (1.9, 2), (6.1, 0.5), (0.05, 100), (1e-9, 1e4), (0.6, 10)]
)
def test_an_arrow_is_drawn_at_its_length_where_it_is_seen(largest: float, factor: float) -> None:
    assert figures._stretch(largest, 100.0) == pytest.approx(factor)
    assert [figures._round_down(value) for value in (1.0, 4.9, 5.0, 0.02, 99.0)] == pytest.approx([1, 2, 5, 0.02, 50])


def test_parameters_have_two_digits_of_their_uncertainty_and_images_their_residual(solved: Any) -> None:
    parameters, images, models = page._tables(solved)
    assert parameters.rows == (("focal_px", "2000.00", "0.25"), ("k1", "0.0000", "0.0012"))
    assert images.rows == (("one.png", "2", "2", "0.0056"), ("two.png", "1", "0", "0.0141"))
    assert models.rows == (("brown", "k1", "flat", "1"),)
    assert page._with_uncertainty(1234.5, 30.0) == ("1234", "30")  # no decimals below the second digit


def test_coordinates_are_good_where_95_per_cent_of_both_lie_within_the_tolerance() -> None:
    """A scale known to a thousandth: a coordinate at x is known to 1.96 · x / 1000."""
    camera = known(focal_px=2.0)
    half = 1000 * 1.96e-3 * 319.5 * (150 - 6.5) / 2000  # at the edge of the image, µm
    assert page.measurement_range(camera, 6.5, 1.001 * half) == 1.0
    columns = np.abs(np.linspace(-1, 1, 33)) < 0.5
    rows = np.abs(np.linspace(-1, 1, 25)) * 239.5 / 319.5 < 0.5
    assert page.measurement_range(camera, 6.5, half / 2) == pytest.approx(columns.mean() * rows.mean(), abs=0.01)


def test_the_page_says_how_much_of_the_image_is_good_and_what_to_do_next(
    monkeypatch: pytest.MonkeyPatch, solved: Any, tmp_path: Path
) -> None:
    undrawn(monkeypatch, figures)
    pages: list[Page] = []
    monkeypatch.setattr(page, "page_html", lambda one: pages.append(one) or "")  # type: ignore[func-returns-value]
    monkeypatch.setattr(page, "camera_uncertainty", lambda *_: figures.distortion_map(CAMERA))
    monkeypatch.setattr(page, "image_notes", lambda *_: ("a note",))
    verdict: Any = SimpleNamespace(mark_height_mm=6.5, notes=("bent.",), summary="sound: so", next_steps=("tilt it",))
    advice: Any = SimpleNamespace(sentence="", next=None)
    page.write_calibration_page(solved, verdict, advice, tmp_path / "a.html", 1000.0)
    (found,) = pages
    assert found.facts == ("2 images", "3 dots", "residual 0.0123 px RMS", "brown lens")
    assert found.summary == (
        "Sound: so.", "Coordinates 6.5 mm above the plate are good to 1000 µm (95 %) in 100 % of the image.",
        "Next: tilt it.",
    )  # fmt: skip
    assert [section.name for section in found.sections] == ["trust", "fit", "numbers"]
    assert found.sections[2].text == ("Bent.", "A note.")
    assert [figure.name for figure in found.sections[1].figures] == ["residual-vectors", "distortion"]
    advice.sentence, advice.next = "the left", SimpleNamespace(outline_px=((0, 0), (1, 0), (1, 1)))
    page.write_calibration_page(solved, verdict, advice, tmp_path / "a.html", 1000.0)
    assert pages[1].summary[-1] == "Another image would help: the left."
    assert "Dashed" in pages[1].sections[0].figures[1].caption


def test_an_image_is_shown_in_eight_bits_of_colour_with_rings_at_its_dots(tmp_path: Path) -> None:
    image = np.full((1600, 1000), 1000, np.uint16)
    image[0, 0], image[0, 1] = 0, 4080
    shown, unit = page._shown(image)
    assert (shown.shape, shown.dtype, unit) == ((1600, 1000, 3), np.uint8, 2)
    assert shown[0, :3, 0].tolist() == [0, 255, 62]
    assert page._shown(np.zeros((4, 4)))[1] == 1
    dots: Any = SimpleNamespace(
        centers_px=np.array([[50.0, 60.0], [100.0, 60.0], [150.0, 60.0]]), diameter_px=[20.0] * 3
    )
    lattice: Any = SimpleNamespace(dot=np.array([0, 1]), index=np.array([[0, 0], [0, 1]]))
    page.write_annotated(np.zeros((120, 200), np.uint8), dots, lattice, tmp_path / "a.png")
    drawn = cv2.imread(str(tmp_path / "a.png"))
    assert drawn is not None
    radius = 12  # half of 20 px, and 1.5 px beside it
    assert drawn[60, 50 + radius].max() > 100
    assert drawn[60, 100 - radius].max() > 100
    assert drawn[60, 50 + radius].argmax() != drawn[60, 100 + radius].argmax()  # two colours, like a chessboard
    assert drawn[60, 50].max() == drawn[60 + radius, 150].max() == 0  # rings, and none about what is not assigned
    assert drawn[60, 150].argmax() == 2  # crossed in red


def test_axes_of_the_plate_are_drawn_on_a_gauge_image_in_red_and_green(tmp_path: Path) -> None:
    page.write_plate_axes(np.zeros((480, 640), np.uint8), CAMERA, tmp_path / "a.png")
    drawn = cv2.imread(str(tmp_path / "a.png"))
    assert drawn is not None
    for (start, end), channel in zip(figures.plate_axes_px(CAMERA), (2, 1), strict=True):
        column, row = np.rint((start + end) / 2).astype(int)
        assert drawn[row, column].argmax() == channel  # of blue, green, red
        assert drawn[row, column].max() > 100
        beyond = np.rint(start - 0.3 * (end - start)).astype(int)
        assert drawn[beyond[1], beyond[0]].max() == 0
