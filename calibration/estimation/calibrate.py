"""Gauge images → camera model with covariance and a verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.assignment.gauge_in_image import FEWEST_DOTS, Sighting, sight
from calibration.assignment.neighbours import nearest
from calibration.assignment.wrong_gauge import does_not_fit
from calibration.camera import PARAMETERS, POSE, Camera
from calibration.errors import CalibrationError, ImageError
from calibration.estimation.bundle_adjustment import (
    POSE_COUNT,
    Fit,
    Prior,
    View,
    outliers,
    solve,
    solve_discs,
)
from calibration.estimation.flatness import (
    QUADRATIC,
    Flatness,
    bend_scale,
    coefficient_sigma,
    flatness_of,
    rest_covariance,
)
from calibration.estimation.focal_of_images import covariance_by_focal, focal_difference
from calibration.estimation.gauge_as_printed import FOREIGN_PITCH, as_printed, stretch
from calibration.estimation.gauge_tolerance import change_by_pitch, covariance_with_tolerance
from calibration.estimation.initial_values import rough_prior
from calibration.estimation.model_choice import Trial, focal_of_lens_models
from calibration.gauge.geometry import Gauge

Array = NDArray[np.float64]
# Largest share of outlying dots in an image: glare and dirt affect a tenth of the dots; a third means another camera,
# another plate or a bent one.
MOST_LEFT_OUT = 1 / 3
FEWEST_IMAGES = 3  # that must remain if others are left out: fewer do not show which one is wrong


@dataclass(frozen=True, repr=False)
class Calibration:
    """A camera with the evidence for its quality.

    camera: in the frame of the plate image. gauge: as the images show it; stated: as its file says. sightings: per
    image. fit: solved bundle over the dots used; views: those dots. trials: lens models tried, best first. rejected:
    per image, count of dots left out as outliers. distance_mm: measured height of the lens and its sigma, if given.
    flatness: of the gauge; None for a single image of a gauge without stated flatness, which does not determine it.
    left_out: images that were not used, with the reason.
    """

    camera: Camera
    gauge: Gauge
    stated: Gauge
    sightings: tuple[Sighting, ...]
    views: tuple[View, ...]
    fit: Fit
    trials: tuple[Trial, ...]
    rejected: tuple[int, ...]
    plate_index: int = 0
    distance_mm: tuple[float, float] | None = None
    flatness: Flatness | None = None
    left_out: tuple[tuple[str, str], ...] = ()

    def __repr__(self) -> str:
        """One line: the images used, the residual and the camera."""
        return f"Calibration({len(self.views)} images, residual {self.rms_px:.3f} px RMS; {self.camera!r})"

    @property
    def excess(self) -> float:
        """Relative length of the gauge along columns over that along rows, minus 1; 0 if it is as its file says."""
        (along, down), (stated_along, stated_down) = self.gauge.pitch_mm, self.stated.pitch_mm
        return (along / stated_along) / (down / stated_down) - 1.0

    @property
    def excess_sigma(self) -> float:
        """Standard uncertainty of the excess."""
        return stretch(list(self.views), self.fit, self.gauge)[1]

    @property
    def focal_difference(self) -> float:
        """Clearest relative difference of the focal lengths of two images; 0 if they have one."""
        return focal_difference(self.views, self.fit)

    @property
    def rms_px(self) -> float:
        """Root mean square of the residuals, per axis, px."""
        return float(np.sqrt(np.mean(np.concatenate([r.ravel() for r in self.fit.residual_px]) ** 2)))


def calibrate(
    images: Sequence[NDArray[np.generic]],
    gauge: Gauge,
    plate_index: int = 0,
    *,
    names: Sequence[str] = (),
    distance_mm: tuple[float, float] | None = None,
    strict: bool = True,
    left_out: Sequence[tuple[str, str]] = (),
) -> Calibration:
    """Solve the camera from images of the gauge.

    images: (h, w) or (h, w, 3) BGR each, all of one size. plate_index: the image in which the gauge lies on the
    plate; it defines the plate frame. names: of the images, for messages. distance_mm: measured height of the lens
    above the plate and its standard uncertainty, if known. strict: whether an unusable image is an error; otherwise it
    is left out and named, unless it is that of the plate or fewer than FEWEST_IMAGES remain. left_out: further images
    already left out, with the reason. Raises CalibrationError if images and gauge do not determine a camera.
    """
    if not images:
        raise CalibrationError("no images given; calibration needs at least one image of the gauge on the plate")
    names = list(names) or [f"image {k + 1}" for k in range(len(images))]
    plate = names[plate_index]
    faults = Faults(plate, len(images) + len(left_out), strict=strict, known=left_out)
    if strict:
        _check_sizes(images, names)
    sightings = {}
    for image, name in zip(images, names, strict=True):
        try:
            sightings[name] = _sight(image, gauge, name, plate, images[plate_index])
        except ImageError as error:
            faults.add(error)
    while True:
        order = [sightings[plate], *(each for name, each in sightings.items() if name != plate)]
        try:
            return _solved(order, gauge, distance_mm, plate_index, faults.found)
        except ImageError as error:
            faults.add(error)
            del sightings[error.image]


class Faults:
    """The images of a set that cannot be used."""

    def __init__(self, plate: str, count: int, *, strict: bool, known: Sequence[tuple[str, str]] = ()) -> None:
        """plate: name of the image that is required. count: of all images. known: faults so far, name and reason."""
        self._plate, self._count, self._strict = plate, count, strict
        self.found: tuple[tuple[str, str], ...] = tuple(known)

    def add(self, error: ImageError) -> None:
        """Record an image that is left out; raises its error if it is required or too few images remain."""
        if self._strict or self._count == 1:
            raise error
        if error.image == self._plate:
            end = "" if str(error).endswith("?") else "."
            raise CalibrationError(
                f"{error}{end} This image defines the plate frame and cannot be left out: take it again or name"
                " another with --plate"
            ) from error
        self.found = (*self.found, (error.image, error.reason))
        if self._count - len(self.found) < FEWEST_IMAGES:
            listed = "; ".join(f"{name}: {reason}" for name, reason in self.found)
            raise CalibrationError(
                f"{len(self.found)} of {self._count} images cannot be used, and at least {FEWEST_IMAGES} must remain: "
                f"{listed}"
            ) from error


def _size(image: NDArray[np.generic]) -> str:
    return f"{image.shape[1]}×{image.shape[0]}"


def _sight(
    image: NDArray[np.generic], gauge: Gauge, name: str, plate: str, plate_image: NDArray[np.generic]
) -> Sighting:
    if image.shape[:2] != plate_image.shape[:2]:
        raise ImageError(name, f"{_size(image)} pixels, but {plate} has {_size(plate_image)}")
    return sight(image, gauge, name)


def _check_sizes(images: Sequence[NDArray[np.generic]], names: Sequence[str]) -> None:
    if len({image.shape[:2] for image in images}) > 1:
        listed = ", ".join(f"{name} {_size(image)}" for name, image in zip(names, images, strict=True))
        raise CalibrationError(f"images differ in size: {listed}; all must be from one camera mode")


def _solved(
    sightings: Sequence[Sighting],
    gauge: Gauge,
    distance_mm: tuple[float, float] | None,
    plate_index: int,
    left_out: tuple[tuple[str, str], ...],
) -> Calibration:
    """The camera from sightings of the gauge, that of the plate first. Raises ImageError for an unusable one."""
    _check_extent(sightings, gauge)
    size_px = sightings[0].dots.size_px
    prior = replace(rough_prior(size_px), distance_mm=distance_mm, face_mm=coefficient_sigma(gauge))
    stated = gauge
    gauge, views, trials = as_printed(sightings, stated, prior)
    fit, used = _without_outliers(views, trials[0].fit, prior)
    _check_pitch(fit, used, gauge)
    flatness = _flatness(fit, used, gauge, prior)
    return Calibration(
        camera=_camera(fit, used, gauge, flatness, size_px, trials),
        gauge=gauge,
        stated=stated,
        sightings=tuple(sightings),
        views=tuple(used),
        fit=fit,
        trials=tuple(trials),
        rejected=tuple(len(each.match) - len(part) for each, part in zip(sightings, used, strict=True)),
        plate_index=plate_index,
        distance_mm=distance_mm,
        flatness=flatness,
        left_out=left_out,
    )


def _check_extent(sightings: Sequence[Sighting], gauge: Gauge) -> None:
    """Raise if the array ends before that of the gauge in some images, and no image shows the rest."""
    for axis in (0, 1):
        short = [sighting for sighting in sightings if sighting.match.extent[axis] == "short"]
        if short and not any(sighting.match.extent[axis] == "whole" for sighting in sightings):
            raise CalibrationError(f"{short[0].name}: {does_not_fit(short[0].lattice, gauge)}")


def _flatness(fit: Fit, views: list[View], gauge: Gauge, prior: Prior) -> Flatness | None:
    """The gauge's face from the images; if it was assumed to be flat, the bend that they cannot exclude."""
    used = len(fit.state.face_mm) > 0
    if not used:
        if len(views) == 1:
            return None
        fit = solve(views, replace(fit.state, face_mm=np.zeros(QUADRATIC)), prior)
    face = slice(len(fit.state.free), fit.state.shared)
    covariance = np.asarray(np.linalg.inv(fit.normal)[face, face] * max(fit.variance, 1.0), dtype=float)
    return flatness_of(gauge, fit.state.face_mm, covariance, used=used)


def _check_pitch(fit: Fit, views: list[View], gauge: Gauge) -> None:
    """Raise if residuals are larger than any lens or sheet explains, which means that it is another gauge."""
    for residual, view in zip(fit.residual_px, views, strict=True):
        pitch_px = float(np.median(nearest(view.centers_px, 1)[0]))
        rms = float(np.sqrt(np.mean(residual**2)))
        if rms > FOREIGN_PITCH * pitch_px:
            raise ImageError(
                view.name,
                f"the dots lie {rms:.1f} px RMS ({100 * rms / pitch_px:.0f} % of their distance) from "
                f'where the gauge "{gauge.name}" has them; are pitch_mm and layout in its file those of this plate?',
            )


def _without_outliers(views: list[View], chosen: Fit, prior: Prior) -> tuple[Fit, list[View]]:
    """Solve the chosen model, remove outliers and solve again."""
    fit, used = solve_discs(views, chosen.state, prior)
    for _ in range(3):
        keep = outliers(fit)
        if all(part.all() for part in keep):
            break
        used = [view.take(part) for view, part in zip(used, keep, strict=True)]
        _check_left_out(views, used)
        fit, used = solve_discs(used, fit.state, prior)
    return fit, used


def _check_left_out(views: list[View], used: list[View]) -> None:
    """Raise for an image in which too many dots are outliers."""
    for view, part in zip(views, used, strict=True):
        left_out = len(view) - len(part)
        if left_out > MOST_LEFT_OUT * len(view) or len(part) < FEWEST_DOTS // 2:
            rest = "the other images" if len(views) > 1 else "any camera"
            raise ImageError(
                view.name,
                f"{left_out} of {len(view)} dots contradict {rest}; are all images from one camera, was the "
                "gauge flat, and are pitch_mm and layout of its file right? Leave this image out or take it again",
            )


def _camera(
    fit: Fit,
    views: list[View],
    gauge: Gauge,
    flatness: Flatness | None,
    size_px: tuple[int, int],
    trials: Sequence[Trial],
) -> Camera:
    free = fit.state.free_index
    bent = flatness if flatness is not None and flatness.used else None
    scale = gauge.scale_sigma if bent is None else float(np.hypot(gauge.scale_sigma, bend_scale(bent)))
    joint = covariance_with_tolerance(views, fit, gauge.tolerance)
    rows = np.concatenate([POSE_COUNT + free, np.arange(POSE_COUNT)])
    known = np.concatenate([np.arange(len(free)), fit.state.shared + np.arange(POSE_COUNT)])
    covariance, pitch_error = np.zeros((len(PARAMETERS), len(PARAMETERS))), np.zeros(len(PARAMETERS))
    pitch_error[rows] = scale * change_by_pitch(views, fit)[known]
    covariance[np.ix_(rows, rows)] = joint[np.ix_(known, known)]
    covariance += np.outer(pitch_error, pitch_error)
    if bent is not None:
        covariance[POSE, POSE] += rest_covariance(bent, gauge, fit.state.poses[0])
    for difference in (focal_difference(views, fit), focal_of_lens_models(trials, views)):
        covariance += covariance_by_focal(difference, fit.state.parameters(0))
    return Camera(
        size_px=size_px,
        parameters=fit.state.parameters(0),
        lens=fit.state.model,
        covariance=covariance,
        pitch_error=pitch_error,
    )
