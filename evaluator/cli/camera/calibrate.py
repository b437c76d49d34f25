"""turnscope calibrate, check-camera, dots."""

from __future__ import annotations

from pathlib import Path

import click

from evaluator.wording import counted

FILE = click.Path(path_type=Path, dir_okay=False)


@click.command(
    epilog="\b\nExample:\n  turnscope calibrate plate.png tilt1.png tilt2.png --gauge gauge.toml -o camera.json",
)
@click.argument("image_files", metavar="IMAGES...", nargs=-1, required=True, type=FILE)
@click.option("--gauge", "gauge_file", required=True, type=FILE, help="The gauge.toml that describes the dots.")
@click.option(
    "--plate",
    type=FILE,
    help="The image with the gauge lying on the plate; it defines the plate frame.  [default: the first]",
)
@click.option("-o", "--out", type=FILE, default=Path("camera.json"), show_default=True, help="Camera file to write.")
@click.option("--distance-mm", nargs=2, type=float, help="Measured height of the lens above the plate, and its sigma.")
@click.option(
    "--mark-height",
    "mark_height_mm",
    type=click.FloatRange(min=0),
    default=6.5,
    show_default=True,
    help="Height of the marks above the plate, mm.",
)
@click.option(
    "--tolerance-um",
    type=click.FloatRange(min=0, min_open=True),
    default=10.0,
    show_default=True,
    help="Required 95 % uncertainty of a coordinate, drawn in the maps of the page.",
)
@click.option("--strict", is_flag=True, help="Stop at the first unusable image. [default: leave it out and report it]")
@click.option("--page/--no-page", default=True, show_default=True, help="Write a page with maps beside camera.json.")
def calibrate(
    image_files: tuple[Path, ...],
    gauge_file: Path,
    plate: Path | None,
    out: Path,
    distance_mm: tuple[float, float] | None,
    mark_height_mm: float,
    tolerance_um: float,
    strict: bool,
    page: bool,
) -> None:
    """Calibrate the camera from images of a dot gauge.

    Finds the dots, assigns grid indices, selects the lens model by cross-validation and writes the camera with its
    covariance and a verdict.
    """
    from calibration.assessment.next_image import image_notes
    from evaluator.workflow import calibrate as solve

    if plate is not None and plate not in image_files:
        image_files = (plate, *image_files)
    done = solve(
        image_files,
        gauge_file,
        plate=0 if plate is None else image_files.index(plate),
        distance_mm=distance_mm,
        mark_height_mm=mark_height_mm,
        strict=strict,
    )
    found, verdict = done.calibration, done.verdict
    done.save(out)
    dots = sum(len(view) for view in found.views)
    lens = ", ".join(name for name in found.fit.state.free if name[0] in "kp" and len(name) == 2) or "no distortion"
    click.echo(
        f"{counted(len(found.views), 'image')}, {counted(dots, 'dot')}, residual {found.rms_px:.3f} px RMS, "
        f"{found.fit.state.model} lens, {lens}"
    )
    click.echo(verdict.summary)
    for step in verdict.next_steps:
        click.echo(f"next: {step}")
    if done.advice.sentence:
        click.echo(f"another image would help: {done.advice.sentence}")
    for note in (*verdict.notes, *image_notes(done.advice, [view.name for view in found.views])):
        click.echo(f"note: {note}")
    written = str(out)
    if page:
        from evaluator.report.pages.calibration import write_calibration_page

        write_calibration_page(found, verdict, done.advice, out.with_suffix(".html"), tolerance_um)
        written += f", {out.with_suffix('.html')}"
    click.echo(f"written: {written}")


@click.command(epilog="\b\nExample:\n  turnscope dots plate.png --annotate found/")
@click.argument("image_files", metavar="IMAGES...", nargs=-1, required=True, type=FILE)
@click.option("--annotate", type=click.Path(path_type=Path, file_okay=False), help="Folder for annotated images (PNG).")
def dots(image_files: tuple[Path, ...], annotate: Path | None) -> None:
    """Find the dots in images and assign grid indices, without a gauge file."""
    import numpy as np

    from calibration.assignment.array_in_image import find_array
    from calibration.assignment.lattice import array_size
    from calibration.detection.image import read_image

    for path in image_files:
        image = read_image(path)
        found, lattice = find_array(image)
        if not len(lattice):
            click.echo(f"{path}: {len(found)} dots found, none assigned: they do not form a regular array")
            continue
        layout, columns, rows = array_size(lattice, found.centers_px[lattice.dot])
        sigma = float(np.sqrt(np.trace(found.covariance_px2[lattice.dot], axis1=1, axis2=2) / 2).mean())
        click.echo(
            f"{path}: {len(found)} dots found, {len(lattice)} assigned to a {layout} array of {columns} × {rows}, "
            f"diameter {np.median(found.diameter_px[lattice.dot]):.1f} px, centres to {sigma:.3f} px"
        )
        if annotate is not None:
            from evaluator.report.pages.calibration import write_annotated

            target = annotate / f"{path.stem}-dots.png"
            write_annotated(image, found, lattice, target)
            click.echo(f"written: {target}")


@click.command(epilog="\b\nExample:\n  turnscope check-camera camera.json today.png")
@click.argument("camera_file", type=FILE)
@click.argument("image_file", metavar="IMAGE", type=FILE)
@click.option("--gauge", "gauge_file", type=FILE, help="gauge.toml, if not the gauge of the calibration.")
@click.option("--annotate", type=FILE, help="PNG to write, with the axes of the plate frame drawn.")
@click.pass_context
def check_camera(
    context: click.Context, camera_file: Path, image_file: Path, gauge_file: Path | None, annotate: Path | None
) -> None:
    """Check whether a calibration still holds, with a new image of the gauge on the plate.

    Deviations are given in sigmas. Exit status: 0, the calibration holds; 1, it does not.
    """
    from calibration.assessment.camera_check import check_camera as check
    from calibration.detection.image import read_image
    from calibration.estimation.gauge_as_printed import excess_found
    from calibration.gauge.geometry import load_gauge
    from calibration.store import load_camera_file
    from evaluator.files import read_with

    stored = read_with(load_camera_file, camera_file)
    gauge = stored.gauge if gauge_file is None else read_with(load_gauge, gauge_file)
    excess = excess_found(stored.gauge, gauge)
    gauge = gauge if excess is None else stored.gauge
    bent = stored.flatness is not None and stored.flatness.used and excess is not None
    image = read_image(image_file)
    if annotate is not None:
        from evaluator.report.pages.calibration import write_plate_axes

        write_plate_axes(image, stored.camera(), annotate)
    found = check(
        stored.camera(),
        gauge,
        image,
        name=str(image_file),
        gauge_is_known=excess is not None,
        variance=stored.variance,
        height_mm=stored.verdict.mark_height_mm,
        face_mm=stored.flatness.coefficients_mm if bent and stored.flatness is not None else (),
    )
    click.echo(
        f"{image_file}: {found.dots} dots, residual {found.rms_px:.3f} px RMS, gauge moved {found.shift_mm:.2f} mm"
    )
    click.echo(found.summary)
    if annotate is not None:
        click.echo(f"written: {annotate}")
    if excess:
        longer, shorter = ("columns", "rows") if excess > 0 else ("rows", "columns")
        click.echo(
            f"note: the gauge of {gauge_file} was {100 * abs(excess):.2g} % longer along {longer} than {shorter} in "
            "the images of the calibration; the check takes it as they showed it"
        )
    if stored.verdict.level != "sound":
        click.echo(f"note: the calibration itself is {stored.verdict.summary}")
    context.exit(1 if found.outcome == "no longer holds" else 0)
