"""The printed sheet is the gauge of the file, in true scale."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

import numpy as np
from click.testing import CliRunner

from calibration.gauge.geometry import Gauge
from calibration.gauge.printing import Disc, gauge_sheet, pdf, svg
from evaluator.cli.gauge import gauge as command

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
