"""The printed sheet is the gauge of the file, in true scale."""

from __future__ import annotations

import re
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


def test_pdf_page_and_pitch_are_in_points_of_true_scale() -> None:
    text = pdf(gauge_sheet(GAUGE)).decode("latin-1")
    assert "/MediaBox [0 0 595.2756 841.8898]" in text  # A4
    assert text.startswith("%PDF-1.7")
    scale = float(re.search(r"stream\n([\d.]+) 0 0", text)[1])  # type: ignore[index]
    assert np.isclose(scale, 72 / 25.4)


def test_svg_is_in_millimetres() -> None:
    text = svg(gauge_sheet(GAUGE))
    assert 'width="210mm" height="297mm" viewBox="0 0 210 297"' in text
    assert text.count("<circle") == 35


def test_gauge_without_a_file_writes_the_file_calibrate_needs(tmp_path: Path) -> None:
    out = tmp_path / "sheet.pdf"
    run = CliRunner().invoke(
        command, ["--columns", "17", "--rows", "13", "--pitch-mm", "3", "--diameter-mm", "1", "-o", str(out)]
    )
    assert run.exit_code == 0, run.output
    from calibration.gauge.geometry import load_gauge

    assert load_gauge(tmp_path / "sheet.toml").dots.columns == 17
    assert out.read_bytes().endswith(b"%%EOF\n")
