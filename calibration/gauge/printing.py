"""The gauge as a printable sheet in true scale, SVG and PDF, with a ruler that shows whether the printer kept it.

Sheet coordinates: mm from the top left corner, x right, y down. Both writers draw the same list of shapes.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from xml.sax.saxutils import escape

import numpy as np

from calibration.detection.image import color_bgr
from calibration.gauge.geometry import Gauge

A4_MM = (210.0, 297.0)
MARGIN_MM = 12.0  # what common printers leave blank, and a hand's hold
FOOT_MM = 26.0  # room for the ruler and the text
POINTS_PER_MM = 72 / 25.4
ARC = 4 / 3 * (np.sqrt(2) - 1)  # four Bézier curves of this reach stay within 0.03 % of the circle's radius
TEXT_MM = 3.0


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
    """A page in mm and what is on it."""

    width: float
    height: float
    shapes: tuple[Disc | Bar | Text, ...]


def gauge_sheet(gauge: Gauge) -> Sheet:
    """Lay the gauge out, on A4 where it fits and on a page of its own size where not."""
    places = gauge.sheet_mm() * (1, -1)
    diameters = gauge.diameters_mm()
    reach = np.abs(places).max(axis=(0, 1)) + diameters.max() / 2 + 0.5 * np.array(gauge.pitch_mm)
    need = 2 * reach + 2 * MARGIN_MM + (0, FOOT_MM)
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
    """A scale in millimetres along the foot of the page, and what to do with it."""
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
    advice = f"Print at 100 %. If the {length} mm above measure otherwise, write the true pitch into gauge.toml."
    return [*shapes, Text(width / 2, top + 8.2, about, middle=True), Text(width / 2, top + 12.2, advice, middle=True)]


def svg(sheet: Sheet) -> str:
    """The sheet as SVG text, one user unit a millimetre."""
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{sheet.width:g}mm" height="{sheet.height:g}mm" '
        f'viewBox="0 0 {sheet.width:g} {sheet.height:g}" font-family="Helvetica, sans-serif" font-size="{TEXT_MM}">'
    )
    lines = [
        head,
        f'<rect width="{sheet.width:g}" height="{sheet.height:g}" fill="white"/>',
    ]
    for shape in sheet.shapes:
        if isinstance(shape, Disc):
            r = shape.diameter / 2
            lines.append(f'<circle cx="{shape.x:.6g}" cy="{shape.y:.6g}" r="{r:.6g}" fill="{_hex(shape.color)}"/>')
        elif isinstance(shape, Bar):
            lines.append(
                f'<rect x="{shape.x:.6g}" y="{shape.y:.6g}" width="{shape.width:.6g}" height="{shape.height:.6g}" '
                f'fill="{_hex(shape.color)}"/>'
            )
        else:
            anchor = ' text-anchor="middle"' if shape.middle else ""
            lines.append(f'<text x="{shape.x:.6g}" y="{shape.y:.6g}"{anchor}>{escape(shape.text)}</text>')
    return "\n".join([*lines, "</svg>"]) + "\n"


def pdf(sheet: Sheet) -> bytes:
    """The sheet as a one-page PDF, vector shapes and the viewer's own Helvetica."""
    drawn = [f"{POINTS_PER_MM:.9f} 0 0 {-POINTS_PER_MM:.9f} 0 {sheet.height * POINTS_PER_MM:.6f} cm"]
    drawn += [_pdf_shape(shape) for shape in sheet.shapes]
    stream = "\n".join(drawn).encode("cp1252", errors="replace")
    size = f"{sheet.width * POINTS_PER_MM:.4f} {sheet.height * POINTS_PER_MM:.4f}"
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {size}] /Contents 4 0 R "
        "/Resources << /Font << /F 5 0 R >> >> >>".encode(),
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(stream), stream),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
    ]
    out, offsets = b"%PDF-1.7\n", []
    for number, body in enumerate(objects, start=1):
        offsets.append(len(out))
        out += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    table = b"".join(b"%010d 00000 n \n" % offset for offset in offsets)
    start = len(out)
    return out + b"xref\n0 %d\n0000000000 65535 f \n%strailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (
        len(objects) + 1,
        table,
        len(objects) + 1,
        start,
    )


def _pdf_shape(shape: Disc | Bar | Text) -> str:
    if isinstance(shape, Text):
        # the page is drawn y down; text is turned back
        width = 0.5 * TEXT_MM * len(shape.text) if shape.middle else 0.0
        text = shape.text.replace("\\", "\\\\").replace("(", "\\(").replace(")", "\\)")
        return f"0 0 0 rg BT /F {TEXT_MM} Tf 1 0 0 -1 {shape.x - width / 2:.5f} {shape.y:.5f} Tm ({text}) Tj ET"
    red_green_blue = " ".join(f"{value:.4f}" for value in color_bgr(shape.color)[::-1])
    if isinstance(shape, Bar):
        return f"{red_green_blue} rg {shape.x:.5f} {shape.y:.5f} {shape.width:.5f} {shape.height:.5f} re f"
    r = shape.diameter / 2
    corners = [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 0)]
    path = [f"{shape.x + r:.5f} {shape.y:.5f} m"]
    for (ax, ay), (bx, by) in pairwise(corners):
        control = [ax + ARC * bx, ay + ARC * by, bx + ARC * ax, by + ARC * ay, bx, by]
        at = [f"{(shape.x, shape.y)[k % 2] + r * value:.5f}" for k, value in enumerate(control)]
        path.append(" ".join(at) + " c")
    return f"{red_green_blue} rg {' '.join(path)} f"


def _hex(color: str) -> str:
    return "#" + "".join(f"{round(255 * value):02x}" for value in color_bgr(color)[::-1])
