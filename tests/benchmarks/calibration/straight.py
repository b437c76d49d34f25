"""Straightness of a real image's lines after correction."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from calibration.assignment.neighbours import nearest
from calibration.detection.image import read_image
from calibration.estimation.calibrate import calibrate
from tests.benchmarks.calibration.rig import Array, gauge_of


@click.command()
@click.argument("image", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--columns", default=102, help="Any size that holds the array will do.")
@click.option("--rows", default=80)
def straight(image: Path, columns: int, rows: int) -> None:
    """Distance of dots from straight lines through their rows and columns, before and after correction.

    After correction a pixel is the pitch in the middle of the image divided by its pixels. "All" are the dots that
    were given a place of the gauge, "kept" those that the solver did not leave out as outliers.
    """
    found = calibrate([read_image(image)], gauge_of(1.0, 0.48, columns, rows))
    match, view = found.sightings[0].match, found.views[0]
    centers = found.sightings[0].dots.centers_px[match.dot]
    site = match.row * columns + match.column
    pitch_px = 1 / float(np.median(nearest(found.camera.plate_from_image(centers, 0.0), 1)[0]))
    pitch_px *= float(np.median(nearest(centers, 1)[0]))
    corrected = found.camera.plate_from_image(centers, 0.0) * pitch_px
    kept = np.isin(site, view.site)
    print(
        f"{len(centers)} dots, {int(kept.sum())} kept; lens {found.camera.lens} with {', '.join(found.fit.state.free)}"
    )
    for label, points, own in (
        ("as seen, all", centers, np.ones(len(site), dtype=bool)),
        ("corrected, all", corrected, np.ones(len(site), dtype=bool)),
        ("corrected, kept", corrected, kept),
    ):
        off = np.concatenate([_off_lines(points[own], line[own]) for line in (match.row, match.column)])
        print(
            f"{label:16s} {np.sqrt((off**2).mean()):7.3f} px RMS, {np.median(np.abs(off)):6.3f} median, "
            f"{np.quantile(np.abs(off), 0.99):7.3f} 99 %, {np.abs(off).max():7.3f} largest"
        )


def _off_lines(points: Array, line: NDArray[np.int64]) -> Array:
    """Distances (signed) of points from the least-squares straight line of each line of at least three."""
    found = []
    for k in np.unique(line):
        own = points[line == k] - points[line == k].mean(axis=0)
        if len(own) >= 3:
            found.append(own @ np.linalg.svd(own, full_matrices=False)[2][1])
    return np.concatenate(found)
