"""The gauge as a printable sheet in true scale, SVG and PDF, with a ruler to check the scale of the print.

Sheet coordinates: mm from the top left corner, x right, y down. Both writers draw the same list of shapes.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from io import BytesIO
from typing import Literal

import numpy as np

from calibration.detection.image import color_bgr
from calibration.errors import CalibrationError
from calibration.gauge.geometry import Gauge

A4_MM = (210.0, 297.0)
MARGIN_MM = 12.0  # unprintable margin of common printers, and room to hold the sheet
FOOT_MM = 26.0  # room for the ruler and the text
MM_PER_INCH = 25.4
POINTS_PER_MM = 72 / MM_PER_INCH
LARGEST_MM = 14_400 / POINTS_PER_MM  # side of a page: a limit of PDF 1.7, Annex C
TEXT_MM = 3.0  # eight and a half points


@dataclass(frozen=True)
class Disc:
    """A filled circle."""

    x: float
    y: float
    diameter: float
    color: str


@dataclass(frozen=True)
class Bar:
    """A filled rectangle from its top left corner."""

    x: float
    y: float
    width: float
    height: float
    color: str = "black"


@dataclass(frozen=True)
class Text:
    """Text from the left end of its baseline, or about its middle."""

    x: float
    y: float
    text: str
    middle: bool = False


@dataclass(frozen=True)
class Sheet:
    """A page, mm, and the shapes on it."""

    width: float
    height: float
    shapes: tuple[Disc | Bar | Text, ...]


def gauge_sheet(gauge: Gauge) -> Sheet:
    """The sheet of a gauge: A4 if it fits, otherwise a page of the size needed.

    Raises CalibrationError if no page is that large.
    """
    places = gauge.sheet_mm() * (1, -1)
    diameters = gauge.diameters_mm()
    reach = np.abs(places).max(axis=(0, 1)) + diameters.max() / 2 + 0.5 * np.array(gauge.pitch_mm)
    need = 2 * reach + 2 * MARGIN_MM + (0, FOOT_MM)
    if need.max() > LARGEST_MM:
        raise CalibrationError(
            f"{gauge.name}: its sheet of {need[0]:.0f} mm × {need[1]:.0f} mm is larger than a page of PDF can be, "
            f"{LARGEST_MM:.0f} mm; is the pitch given in mm?"
        )
    pages = [A4_MM, A4_MM[::-1], (float(max(need[0], 80.0)), float(need[1]))]
    width, height = next(page for page in pages if page[0] >= need[0] - 1e-9 and page[1] >= need[1] - 1e-9)
    center = np.array([width / 2, (height - FOOT_MM) / 2])
    shapes: list[Disc | Bar | Text] = []
    if color_bgr(gauge.dots.background).min() < 1:
        (left, top), (across, down) = (center - reach).tolist(), (2 * reach).tolist()
        shapes.append(Bar(left, top, across, down, gauge.dots.background))
    colors = {(f.column, f.row): f.color or gauge.dots.color for f in gauge.fiducial}
    for row, column in np.argwhere(gauge.present()).tolist():
        x, y = center + places[row, column]
        color = colors.get((column, row), gauge.dots.color)
        shapes.append(Disc(float(x), float(y), float(diameters[row, column]), color))
    return Sheet(width, height, (*shapes, *_ruler(gauge, width, height)))


def _ruler(gauge: Gauge, width: float, height: float) -> list[Bar | Text]:
    """A ruler in millimetres along the foot of the page, with instructions."""
    length = min(10 * int((width - 2 * MARGIN_MM) / 10), 150)
    left, top = (width - length) / 2, height - MARGIN_MM - 8
    shapes: list[Bar | Text] = [Bar(left, top, length, 0.15)]
    for mm in range(length + 1):
        tall = 4.0 if mm % 10 == 0 else 2.8 if mm % 5 == 0 else 1.8
        shapes.append(Bar(left + mm - 0.075, top - tall, 0.15, tall))
        if mm % 10 == 0:
            shapes.append(Text(left + mm, top + 3.6, str(mm), middle=True))
    dots, pitch = gauge.dots, " × ".join(f"{value:g}" for value in dict.fromkeys(gauge.pitch_mm))
    about = (
        f"{gauge.name}: {dots.layout}, {dots.columns} × {dots.rows} dots of {dots.diameter_mm:g} mm, pitch {pitch} mm"
    )
    advice = f"Print at 100 %. If the {length} mm above are wrong, correct the pitch in gauge.toml."
    return [*shapes, Text(width / 2, top + 8.2, about, middle=True), Text(width / 2, top + 12.2, advice, middle=True)]


def svg(sheet: Sheet) -> bytes:
    """Write the sheet as SVG; its page has the size of the sheet."""
    return _written(sheet, "svg", {"Date": None})


def pdf(sheet: Sheet) -> bytes:
    """Write the sheet as a one-page PDF with the preference to print it unscaled."""
    return _asking_for_no_scaling(_written(sheet, "pdf", {"CreationDate": None}))


def _written(sheet: Sheet, kind: str, metadata: dict[str, None]) -> bytes:
    import matplotlib as mpl
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle, Rectangle

    buffer = BytesIO()
    with mpl.rc_context({"svg.hashsalt": "gauge", "svg.fonttype": "none", "font.family": "sans-serif"}):
        page = Figure(figsize=(sheet.width / MM_PER_INCH, sheet.height / MM_PER_INCH))
        axes = page.add_axes((0, 0, 1, 1))
        axes.set(xlim=(0, sheet.width), ylim=(sheet.height, 0))
        axes.set_axis_off()
        for shape in sheet.shapes:
            if isinstance(shape, Disc):
                axes.add_patch(Circle((shape.x, shape.y), shape.diameter / 2, fc=_rgb(shape.color), lw=0))
            elif isinstance(shape, Bar):
                axes.add_patch(Rectangle((shape.x, shape.y), shape.width, shape.height, fc=_rgb(shape.color), lw=0))
            else:
                aligned: Literal["center", "left"] = "center" if shape.middle else "left"
                size = TEXT_MM * POINTS_PER_MM
                axes.text(shape.x, shape.y, shape.text, size=size, ha=aligned, va="baseline", parse_math=False)
        page.savefig(buffer, format=kind, metadata=metadata)
    return buffer.getvalue()


def _asking_for_no_scaling(document: bytes) -> bytes:
    """Append to a PDF an update with the preference to print it unscaled, which matplotlib cannot write."""
    root = re.search(rb"/Root (\d+) 0 R", document)
    before = re.search(rb"startxref\s+(\d+)", document)
    size = re.search(rb"/Size (\d+)", document)
    pages = re.search(rb"/Pages (\d+) 0 R", document)
    assert root is not None
    assert before is not None
    assert size is not None
    assert pages is not None
    place = len(document)
    catalog = b"%s 0 obj\n<< /Type /Catalog /Pages %s 0 R /ViewerPreferences << /PrintScaling /None >> >>\nendobj\n" % (
        root[1],
        pages[1],
    )
    return (
        document
        + catalog
        + b"xref\n%s 1\n%010d 00000 n \ntrailer\n<< /Size %s /Root %s 0 R /Prev %s >>\nstartxref\n%d\n%%%%EOF\n"
        % (root[1], place, size[1], root[1], before[1], place + len(catalog))
    )


def _rgb(color: str) -> tuple[float, float, float]:
    blue, green, red = color_bgr(color).tolist()
    return red, green, blue
