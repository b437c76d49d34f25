"""The gauge as the images show it: printers stretch a sheet by up to a percent along the paper's way.

A stretch is one number common to all images, the ratio of the distances of dots along columns and along rows. It
differs from pixels that are not square if the gauge is turned between images, and from a tilt in any two images.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.assignment.gauge_in_image import Sighting, view_of
from calibration.errors import CalibrationError
from calibration.estimation.bundle_adjustment import (
    Fit,
    Prior,
    View,
    places_of_view,
    solve,
    view_rows,
    with_disc_offsets,
)
from calibration.estimation.flatness import QUADRATIC, TERMS
from calibration.estimation.gauge_tolerance import by_plane, with_tolerance
from calibration.estimation.initial_values import rough_start
from calibration.estimation.model_choice import Trial, chance, choose_model
from calibration.estimation.robust import OUTLIER, huber_weights
from calibration.gauge.geometry import Gauge

# Residual, as a share of the pitch, that no lens explains: with the right gauge file the worst real set (a bent sheet
# of paper) has 0.7 %; a wrong pitch ratio or layout gives 5 %.
FOREIGN_PITCH = 0.02


def as_printed(sightings: Sequence[Sighting], stated: Gauge, prior: Prior) -> tuple[Gauge, list[View], list[Trial]]:
    """The gauge, stretched one way if it then predicts held-out dots better, with its views and trials, best first.

    The ratio of the pixels' sides is free, so that a camera whose pixels are not square is no stretched gauge.
    """
    views, trials = _trials(sightings, stated, prior)
    if len(views) == 1:  # a tilt, a stretch and pixels that are not square look alike
        return stated, views, trials
    excess, sigma = _stretch(views, trials[0].fit, prior, stated)
    if not OUTLIER * sigma < abs(excess) < FOREIGN_PITCH:
        return stated, views, trials
    gauge = stretched(stated, excess)
    stretched_views, stretched_trials = _trials(sightings, gauge, prior)
    if not stretched_trials[0].held_out < trials[0].held_out - chance(trials[0], views):
        return stated, views, trials
    # The lens of the first step had taken up a part of the stretch.
    excess += _stretch(stretched_views, stretched_trials[0].fit, prior, gauge)[0]
    gauge = stretched(stated, excess)
    return gauge, *_trials(sightings, gauge, prior)


def _stretch(views: list[View], fit: Fit, prior: Prior, gauge: Gauge) -> tuple[float, float]:
    """The `stretch` beside pixels of any shape."""
    free = fit.state.free if "aspect" in fit.state.free else (*fit.state.free, "aspect")
    return stretch(views, solve(views, replace(fit.state, free=free), prior), gauge)


def _trials(sightings: Sequence[Sighting], gauge: Gauge, prior: Prior) -> tuple[list[View], list[Trial]]:
    """Views of a gauge, and the models tried on them, best first."""
    views = [view_of(sighting, gauge, on_plate=k == 0) for k, sighting in enumerate(sightings)]
    rough = rough_start(views, sightings[0].dots.size_px, prior)
    if not rough:
        raise CalibrationError(
            f"{sightings[0].name}: no camera model fits the dots; do all images show the gauge {gauge.name!r}?"
        )
    views = with_tolerance(views, rough[0].state, gauge.tolerance)
    views = with_disc_offsets(views, rough[0].state)
    return views, choose_model(views, rough, prior, _faces(gauge, len(views)))


def _faces(gauge: Gauge, views: int) -> tuple[int, ...]:
    """Numbers of terms of the gauge's face to try.

    If flatness is stated, all terms are free within it. Otherwise cross-validation decides, except for a single image,
    which cannot distinguish a bent gauge from lens distortion.
    """
    if gauge.tolerance.flatness_mm is not None:
        return (TERMS,)
    return (0, QUADRATIC, TERMS) if views > 1 else (0,)


def stretch(views: list[View], fit: Fit, gauge: Gauge) -> tuple[float, float]:
    """How much farther apart dots are along columns than along rows, over what the gauge file says, minus 1; its sigma.

    All unknowns of the fit adapt to it, so that what the lens explains as well leaves sigma large.
    """
    place = gauge.positions_mm()
    lies_on_its_side = abs(place[0, 1, 1] - place[0, 0, 1]) > abs(place[0, 1, 0] - place[0, 0, 0])
    by_stretch = place.reshape(-1, 2) * ([-0.5, 0.5] if lies_on_its_side else [0.5, -0.5])
    cross, own, downhill = np.zeros(len(fit.normal)), 0.0, 0.0
    for k, view in enumerate(views):
        _, white, by_parameter = view_rows(view, fit.state, k)
        weight = huber_weights(white, fit.scale)
        by_dot = view.whitening @ by_plane(view, fit.state, k)
        rows = (by_dot @ by_stretch[view.site][:, :, None])[..., 0]
        cross[places_of_view(fit.state, k)] += np.einsum("n,nap,na->p", weight, by_parameter, rows)
        own += float(np.sum(weight[:, None] * rows**2))
        downhill += float(np.sum(weight[:, None] * rows * white))
    # The fit is at its minimum: the other unknowns have no slope of their own.
    information = own - float(cross @ np.linalg.solve(fit.normal, cross))
    return downhill / information, float(np.sqrt(max(fit.variance, 1.0) / information))


def stretched(gauge: Gauge, excess: float) -> Gauge:
    """A gauge whose dots are farther apart by a relative excess along columns than along rows.

    Images do not show which of the two is as stated: their mean is kept, and half the excess is its uncertainty.
    """
    along, down = gauge.pitch_mm
    pitch = along * (1.0 + excess / 2), down * (1.0 - excess / 2)
    scale = float(np.hypot(gauge.scale_sigma, excess / 2))
    dots = gauge.dots.model_copy(update={"pitch_mm": pitch})
    return gauge.model_copy(update={"dots": dots, "tolerance": gauge.tolerance.model_copy(update={"scale": scale})})


def excess_found(found: Gauge, stated: Gauge) -> float | None:
    """The excess with which `stretched` makes the gauge of a calibration from that of a file; None if none does.

    0 for two equal gauges.
    """
    if found == stated:
        return 0.0
    along, down = np.array(found.pitch_mm) / stated.pitch_mm
    excess = float(along - down)
    made = stretched(stated, excess)
    # Rounding of the quotients is 1e-16; the smallest stretch that images show is 1e-5.
    if not np.allclose((*made.pitch_mm, made.scale_sigma), (*found.pitch_mm, found.scale_sigma), rtol=1e-9, atol=0.0):
        return None
    dots = made.dots.model_copy(update={"pitch_mm": found.dots.pitch_mm})
    tolerance = made.tolerance.model_copy(update={"scale": found.tolerance.scale})
    return excess if made.model_copy(update={"dots": dots, "tolerance": tolerance}) == found else None
