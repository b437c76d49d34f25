"""turnscope gauge."""

from __future__ import annotations

from pathlib import Path

import click

ENDINGS = (".pdf", ".svg", "")
FILE = click.Path(path_type=Path, dir_okay=False)


@click.command(
    epilog="\b\nExamples:\n  turnscope gauge gauge.toml -o sheet.pdf\n"
    "  turnscope gauge --columns 17 --rows 13 --pitch-mm 3 --diameter-mm 1 -o sheet.pdf",
)
@click.argument("gauge_file", metavar="[GAUGE.TOML]", required=False, type=FILE)
@click.option("--columns", type=click.IntRange(2), help="Number of dots along x.")
@click.option("--rows", type=click.IntRange(2), help="Number of dots along y.")
@click.option("--pitch-mm", type=float, help="Distance between the centres of neighbouring dots.")
@click.option("--diameter-mm", type=float, help="Diameter of a dot.")
@click.option(
    "-o", "--out", type=FILE, default=Path("gauge.pdf"), show_default=True, help="PDF to write, with an SVG beside it."
)
def gauge(
    gauge_file: Path | None,
    columns: int | None,
    rows: int | None,
    pitch_mm: float | None,
    diameter_mm: float | None,
    out: Path,
) -> None:
    """Write a printable dot gauge in true scale.

    The gauge comes from a gauge.toml or from the four options. With the options, a gauge.toml for turnscope calibrate
    is written beside the sheet.
    """
    from calibration.gauge.geometry import Gauge, gauge_of, load_gauge
    from calibration.gauge.printing import gauge_sheet, pdf, svg
    from evaluator.errors import InputError
    from evaluator.files import read_with, write_bytes

    numbers = (columns, rows, pitch_mm, diameter_mm)
    if (gauge_file is None) == (None in numbers):
        raise InputError(
            "turnscope gauge: expected either a gauge.toml or all of --columns, --rows, --pitch-mm, --diameter-mm"
        )
    if out.suffix.lower() not in ENDINGS:
        raise InputError(f"{out}: a sheet is written as PDF and SVG; end its name in .pdf or .svg")
    texts = {}
    if gauge_file is None:
        gauge_file = out.with_suffix(".toml")
        text = _toml(f"dot plate, {columns} by {rows}", *numbers)
        if gauge_file.exists() and gauge_file.read_bytes() != text.encode():
            raise InputError(
                f"{gauge_file}: is there with another content; print it with turnscope gauge {gauge_file}, or give -o "
                "another name"
            )
        texts = {gauge_file: text}

    def load(path: Path) -> Gauge:
        return gauge_of(texts[path]) if texts else load_gauge(path)

    sheet = gauge_sheet(read_with(load, gauge_file))
    written = {out.with_suffix(".pdf"): pdf(sheet), out.with_suffix(".svg"): svg(sheet)}
    written |= {path: text.encode() for path, text in texts.items()}
    for path, content in written.items():
        write_bytes(path, content)
    click.echo(f"{sheet.width:.0f} mm × {sheet.height:.0f} mm: " + ", ".join(str(path) for path in written))


def _toml(name: str, columns: int | None, rows: int | None, pitch_mm: float | None, diameter_mm: float | None) -> str:
    return (
        f'format = 1\nname = "{name}"\n\n[dots]\ncolumns = {columns}\nrows = {rows}\npitch_mm = {pitch_mm}\n'
        f'diameter_mm = {diameter_mm}\nlayout = "square"\ncolor = "black"\nbackground = "white"\n'
        "pitch_tolerance_percent = 0.1       # how well the pitch is known, 1 sigma: enters every length\n"
        "height_mm = 0.0                     # of the dots above the plate: thickness of the sheet, spacer\n\n"
        "# [tolerance]                       # of manufacturing, if known: part of every interval\n"
        "# dot_mm = 0.002                    # of each dot about its place, standard deviation\n"
        "# flatness_mm = 0.05                # peak to valley that 95 of 100 such plates keep\n"
    )
