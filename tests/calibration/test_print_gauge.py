"""The printed sheet is the gauge of the file, in true scale."""

from __future__ import annotations

import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from calibration.errors import CalibrationError
from calibration.gauge.geometry import Gauge
from calibration.gauge.printing import Bar, Disc, Sheet, Text, _rgb, gauge_sheet, pdf, svg
from evaluator.cli.camera.gauge import gauge as command
from tests.calibration.drawing import gauge_of

GAUGE = Gauge.model_validate(
    {
        "format": 1,
        "name": "staggered",
        "dots": {"columns": 5, "rows": 7, "pitch_mm": [8.0, 6.0], "diameter_mm": 3.0, "layout": "staggered"},
        "fiducial": [{"column": 2, "row": 3, "diameter_mm": 5.0}],
    }
)


def test_sheet_repeats_the_positions_of_the_gauge() -> None:
    discs = [shape for shape in gauge_sheet(GAUGE).shapes if isinstance(shape, Disc)]
    placed = np.array([(disc.x, -disc.y) for disc in discs])
    wanted = GAUGE.positions_mm().reshape(-1, 2)
    assert np.allclose(placed - placed[0], wanted - wanted[0])
    assert sorted({disc.diameter for disc in discs}) == [3.0, 5.0]


def of(sheet: Sheet, kind: type) -> list[Any]:
    return [shape for shape in sheet.shapes if isinstance(shape, kind)]


@pytest.mark.parametrize(
    ("columns", "rows", "page"),
    [
        (22, 20, (210, 297)), (23, 20, (211, 213)), (23, 19, (297, 210)), (20, 30, (210, 297)), (20, 31, (187, 301)),
        (33, 19, (297, 210)), (34, 19, (299, 205)), (3, 60, (80, 533)),
    ],
)  # fmt: skip
def test_a_sheet_is_a_page_of_a4_either_way_up_or_as_large_as_the_gauge_needs(
    columns: int, rows: int, page: tuple[float, float]
) -> None:
    """Dots of 3 mm every 8 mm, half a pitch of white around, margins of 12 mm, a foot of 26 mm."""
    sheet = gauge_sheet(gauge_of(columns=columns, rows=rows, pitch_mm=8.0, diameter_mm=3.0))
    assert (sheet.width, sheet.height) == pytest.approx(page)
    discs = np.array([(disc.x, disc.y) for disc in of(sheet, Disc)])
    np.testing.assert_allclose((discs.min(axis=0) + discs.max(axis=0)) / 2, [sheet.width / 2, (sheet.height - 26) / 2])


def test_a_ruler_in_millimetres_stands_at_the_foot_with_what_to_do() -> None:
    sheet = gauge_sheet(GAUGE)
    line, *ticks = of(sheet, Bar)
    assert (line.x, line.y, line.width, line.height) == (30.0, 277.0, 150, 0.15)
    assert len(ticks) == 151
    for mm, tick in enumerate(ticks):
        tall = 4.0 if mm % 10 == 0 else 2.8 if mm % 5 == 0 else 1.8
        assert (tick.x, tick.y, tick.width, tick.height) == pytest.approx((30 + mm - 0.075, 277 - tall, 0.15, tall))
    *numbers, about, advice = of(sheet, Text)
    assert [(text.text, text.x, text.y) for text in numbers] == [
        (str(mm), 30.0 + mm, pytest.approx(280.6)) for mm in range(0, 151, 10)
    ]
    assert about.text == "staggered: staggered, 5 × 7 dots of 3 mm, pitch 8 × 6 mm"
    assert (about.x, about.y, advice.x, advice.y) == (105.0, pytest.approx(285.2), 105.0, pytest.approx(289.2))
    assert advice.text.startswith("Print at 100 %. If the 150 mm above are wrong")
    narrow = gauge_sheet(gauge_of(columns=3, rows=60, pitch_mm=8.0, diameter_mm=3.0))
    assert of(narrow, Bar)[0].width == 50  # of a page of 80 mm without its margins


def test_a_coloured_sheet_has_its_ground_under_the_dots_and_fiducials_their_colour() -> None:
    gauge = gauge_of(background="yellow", fiducial=[{"column": 1, "row": 2, "color": "red"}])
    ground, *_ = of(sheet := gauge_sheet(gauge), Bar)
    assert (ground.color, ground.width, ground.height) == ("yellow", 12 * 3 + 1.2 + 3, pytest.approx(8 * 3 + 1.2 + 3))
    assert (ground.x + ground.width / 2, ground.y + ground.height / 2) == pytest.approx(
        (sheet.width / 2, (sheet.height - 26) / 2)
    )
    assert [k for k, disc in enumerate(of(sheet, Disc)) if disc.color == "red"] == [2 * 13 + 1]
    assert _rgb("red") == (1.0, 0.0, 0.0)
    assert len(of(gauge_sheet(gauge_of()), Bar)) == 152  # none on white


def discs_mm(paths: list[str]) -> np.ndarray:
    """Centre and diameter (n, 3), mm, of the drawn paths that are about as wide as high and curved; points in them."""
    found = []
    for path in paths:
        points = np.array(re.findall(r"-?[\d.]+", path), dtype=float).reshape(-1, 2) * 25.4 / 72
        low, high = points.min(axis=0), points.max(axis=0)
        found.append([*(low + high) / 2, *(high - low)])
    return np.array(found)


def test_svg_read_back_has_the_dots_of_the_gauge_in_millimetres() -> None:
    text = svg(gauge_sheet(GAUGE)).decode()
    assert re.search(r'width="595\.27\d*pt" height="841\.88\d*pt" viewBox="0 0 595\.27\d* 841\.88\d*"', text)  # A4
    paths = re.findall(r'<path d="([^"]*)"', text)
    discs = discs_mm([path for path in paths if "C" in path])
    wanted = GAUGE.positions_mm().reshape(-1, 2) * (1, -1)
    assert np.allclose(discs[:, :2] - discs[0, :2], wanted - wanted[0], atol=1e-4)
    assert np.allclose(discs[:, 2:], GAUGE.diameters_mm().reshape(-1, 1), atol=1e-4)


def test_pdf_read_back_has_the_page_and_the_dots_in_points_of_true_scale() -> None:
    document = pdf(gauge_sheet(GAUGE))
    box = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+) ?\]", document)
    assert box is not None
    assert np.allclose([float(box[1]), float(box[2])], [210 * 72 / 25.4, 297 * 72 / 25.4], atol=1e-3)
    streams = [zlib.decompress(found) for found in re.findall(rb"stream\r?\n(x.*?)\r?\nendstream", document, re.DOTALL)]
    page = max(streams, key=len).decode("latin-1")
    paths = re.findall(r"[-\d.]+ [-\d.]+ m\n(?:(?:[-\d.]+ ){6}c\n)+", page)
    discs = discs_mm(paths)
    wanted = GAUGE.positions_mm().reshape(-1, 2)
    assert np.allclose(discs[:, :2] - discs[0, :2], wanted - wanted[0], atol=1e-3)
    assert np.allclose(discs[:, 2:], GAUGE.diameters_mm().reshape(-1, 1), atol=1e-3)


def test_pdf_asks_to_be_printed_unscaled_in_a_catalog_that_its_last_table_points_to() -> None:
    document = pdf(gauge_sheet(GAUGE))
    table = document[int(document.rsplit(b"startxref", 1)[1].split()[0]) :]
    number, place = re.match(rb"xref\n(\d+) 1\n(\d{10})", table).groups()  # type: ignore[union-attr]
    assert b"/Root %s 0 R" % number in table
    assert re.match(rb"%s 0 obj\n<< /Type /Catalog .*/PrintScaling /None" % number, document[int(place) :])
    earlier = int(re.search(rb"/Prev (\d+)", table)[1])  # type: ignore[index]
    assert document[earlier:].startswith(b"xref")


def test_gauge_without_a_file_writes_the_file_calibrate_needs(tmp_path: Path) -> None:
    out = tmp_path / "sheet.pdf"
    run = CliRunner().invoke(
        command, ["--columns", "17", "--rows", "13", "--pitch-mm", "3", "--diameter-mm", "1", "-o", str(out)]
    )
    assert run.exit_code == 0, run.output
    from calibration.gauge.geometry import load_gauge

    assert load_gauge(tmp_path / "sheet.toml").dots.columns == 17
    assert out.read_bytes().endswith(b"%%EOF\n")


MADE = ["--columns", "7", "--rows", "5", "--pitch-mm", "3", "--diameter-mm", "1"]


def test_a_gauge_file_that_was_edited_is_not_replaced_by_another_sheet(tmp_path: Path) -> None:
    out = ["-o", str(tmp_path / "gauge.pdf")]
    assert CliRunner().invoke(command, [*MADE, *out]).exit_code == 0
    assert CliRunner().invoke(command, [*MADE, *out]).exit_code == 0  # the same again
    edited = (tmp_path / "gauge.toml").read_text(encoding="utf-8").replace("pitch_mm = 3.0", "pitch_mm = 3.004")
    (tmp_path / "gauge.toml").write_text(edited, encoding="utf-8")
    (tmp_path / "gauge.svg").unlink()
    refused = CliRunner().invoke(command, [*MADE, *out])
    assert "gauge.toml: is there with another content" in str(refused.exception)
    assert (tmp_path / "gauge.toml").read_text(encoding="utf-8") == edited
    assert not (tmp_path / "gauge.svg").exists()
    assert CliRunner().invoke(command, [str(tmp_path / "gauge.toml"), *out]).exit_code == 0


def test_a_sheet_is_written_under_the_name_that_was_given(tmp_path: Path) -> None:
    refused = CliRunner().invoke(command, [*MADE, "-o", str(tmp_path / "gauge.docx")])
    assert "gauge.docx: a sheet is written as PDF and SVG" in str(refused.exception)
    assert not list(tmp_path.iterdir())
    assert CliRunner().invoke(command, [*MADE, "-o", str(tmp_path / "sheet.SVG")]).exit_code == 0
    assert {path.name for path in tmp_path.iterdir()} == {"sheet.pdf", "sheet.svg", "sheet.toml"}


@pytest.mark.parametrize(
    ("pitch_mm", "why"),
    [("0.5", "gauge.toml: dots of 1.0 mm touch each other"), ("1e6", "7000025 mm × 5000051 mm is larger than a page")],
)
def test_a_sheet_that_cannot_be_drawn_leaves_no_file(tmp_path: Path, pitch_mm: str, why: str) -> None:
    """A gauge.toml was left whose dots touch, and refused a sheet of another pitch under the same name."""
    out = ["-o", str(tmp_path / "gauge.pdf")]
    refused = CliRunner().invoke(command, [*MADE, "--pitch-mm", pitch_mm, *out])
    assert why in str(refused.exception)
    assert not list(tmp_path.iterdir())
    assert CliRunner().invoke(command, [*MADE, *out]).exit_code == 0


def test_the_largest_sheet_is_the_largest_page_of_pdf() -> None:
    """A page of 14,400 points, 200 inches."""
    sides = {"columns": 2, "rows": 2, "diameter_mm": 3.0}
    assert gauge_sheet(gauge_of(**sides, pitch_mm=2513.0)).height == pytest.approx(2 * 2513 + 3 + 24 + 26)
    with pytest.raises(CalibrationError, match="larger than a page of PDF can be, 5080 mm; is the pitch given in mm"):
        gauge_sheet(gauge_of(**sides, pitch_mm=2514.0))
