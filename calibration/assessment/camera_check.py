"""Check of whether a calibration still holds, with one new image of the gauge on the plate, in sigmas.

The gauge may lie anywhere on the plate, so three parameters of its pose are free. The other three, tilt and distance of
the plate, must be unchanged; and with the pose fitted, the residuals must not show a changed lens. Both tests include
the uncertainties of the calibration and of the new image. Neither detects a change of focal length that is compensated
by a change of distance; the check states how much this could hide.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import special

from calibration.assessment.quality import SCALE_TOLERANCE
from calibration.assignment.gauge_in_image import sight, view_of
from calibration.camera import PARAMETERS, Camera
from calibration.errors import CalibrationError
from calibration.estimation.bundle_adjustment import (
    Prior,
    State,
    View,
    outliers,
    places_of_view,
    solve_discs,
    view_rows,
)
from calibration.estimation.initial_values import rough_pose, rough_prior
from calibration.gauge.geometry import Gauge

Array = NDArray[np.float64]
Outcome = Literal["holds", "changed", "no longer holds"]
ALARM_SIGMA = 4.0  # of two tests: one false alarm in 16 000 checks
HIGHEST_SIGMA = 37.0  # beyond it the probability underflows, and the report says "more than"
# Refocusing from infinity to ten focal lengths changes the image distance by 10 %: two sigmas.
FOCUSING = 0.05
LENS = tuple(name for name in PARAMETERS[6:] if name not in {"p1", "p2"})


@dataclass(frozen=True)
class Check:
    """outcome: "changed" means significantly, but not by enough to matter for lengths.

    pose_sigma, lens_sigma: significance of a change of the camera's tilt and distance, and of its lens.
    length_change: relative change of lengths at mark height where it is largest. tilt_deg, distance_mm: change of the
    plate's tilt and distance. shift_mm: of the gauge on the plate (no fault). dots: count used. rms_px: residual with
    the lens of the calibration. unseen: relative change of lengths at mark height (95 %) that refocusing with another
    distance could hide from this image.
    """

    outcome: Outcome
    pose_sigma: float
    lens_sigma: float
    length_change: float
    tilt_deg: float
    distance_mm: float
    shift_mm: float
    dots: int
    rms_px: float
    unseen: float

    @property
    def summary(self) -> str:
        """The verdict in words, with the next step."""
        lens = self.lens_sigma > ALARM_SIGMA
        what = (
            "the lens has changed (refocused, zoomed or another lens)"
            if lens
            else "the camera has moved, or the lens has changed slightly"
        )
        size = (
            f"pose {_sigmas(self.pose_sigma)} ({self.tilt_deg:.3f} degrees, {_signed(self.distance_mm)} mm), "
            f"lens {_sigmas(self.lens_sigma)}, lengths by up to {_signed(100 * self.length_change)} %"
        )
        if self.outcome == "holds":
            return f"the calibration holds: {size}{self._hidden}"
        if self.outcome == "changed":
            return f"{what}, but not significantly for lengths: {size}{self._hidden}"
        return f"the calibration no longer holds, {what}: {size}; calibrate again with new images"

    @property
    def _hidden(self) -> str:
        """The change of lengths that the image cannot exclude, if it is relevant."""
        if self.unseen < SCALE_TOLERANCE:
            return ""
        return (
            "; one image without tilt cannot show refocusing combined with a change of distance, which could change "
            f"lengths at mark height by up to {100 * self.unseen:.2g} %; if the lens was touched, calibrate again"
        )


def _sigmas(value: float) -> str:
    """A significance in words; beyond HIGHEST_SIGMA, "more than" this value."""
    return f"more than {HIGHEST_SIGMA:.0f} sigma" if value >= HIGHEST_SIGMA else f"{value:.1f} sigma"


def _signed(value: float) -> str:
    """A change with three decimals and its sign; without a sign if it rounds to 0."""
    text = f"{value:+.3f}"
    return "0.000" if float(text) == 0 else text.replace("-", "−")


def check_camera(
    camera: Camera,
    gauge: Gauge,
    image: NDArray[np.generic],
    *,
    name: str = "image",
    gauge_is_known: bool = True,
    variance: float = 1.0,
    height_mm: float = 6.5,
    face_mm: tuple[float, ...] = (),
) -> Check:
    """Compare a camera with a new image of the gauge on the plate.

    gauge_is_known: whether it is the gauge of the calibration, so that both have the same pitch error. variance: of
    unit weight of the calibration. height_mm: plane on which lengths are compared. face_mm: coefficients of the gauge's
    face, if the calibration found it bent. Raises CalibrationError for an image that does not show the gauge or has
    another size.
    """
    if image.shape[1::-1] != camera.size_px:
        raise CalibrationError(
            f"{name}: the image has {image.shape[1]}×{image.shape[0]} pixels, the calibration holds for "
            f"{camera.size_px[0]}×{camera.size_px[1]}"
        )
    camera = camera.with_exact_pitch() if gauge_is_known else camera
    sighting = sight(image, gauge, name)
    view = view_of(sighting, gauge, on_plate=True)
    bend = view.terms[:, : len(face_mm)] @ np.array(face_mm)
    view = replace(view, points_mm=view.points_mm + bend[:, None] * [0.0, 0.0, 1.0])
    state, view, residual, noise = _pose(camera, view)
    noise = max(noise, variance)
    change, covariance = _pose_change(camera, state, view, noise)
    try:
        pose_sigma = _sigma(float(change @ np.linalg.solve(covariance, change)), 3)
    except np.linalg.LinAlgError as error:
        raise CalibrationError(
            "the covariance of the camera.json is not that of a calibration; calibrate again"
        ) from error
    lens_sigma = _lens_sigma(camera, state, view, noise)
    moved = replace(camera, parameters=state.parameters(0))
    length_change = _length_change(moved, camera, height_mm)
    significant = max(pose_sigma, lens_sigma) > ALARM_SIGMA
    # a changed lens falsifies lengths by more than the changed pose shows
    matters = not abs(length_change) < SCALE_TOLERANCE or lens_sigma > ALARM_SIGMA
    middle = camera.plate_from_image(np.array(camera.size_px) / 2, gauge.dots.height_mm)
    now = moved.plate_from_image(np.array(camera.size_px) / 2, gauge.dots.height_mm)
    return Check(
        outcome="holds" if not significant else "no longer holds" if matters else "changed",
        pose_sigma=pose_sigma,
        lens_sigma=lens_sigma,
        length_change=length_change,
        tilt_deg=float(np.degrees(np.hypot(change[0], change[1]))),
        distance_mm=float(change[2]),
        shift_mm=float(np.hypot(*(now - middle))),
        dots=len(view),
        rms_px=float(np.sqrt(np.mean(residual**2))),
        unseen=_unseen(moved, state, view, noise, height_mm),
    )


def _pose(camera: Camera, view: View) -> tuple[State, View, Array, float]:
    """Pose of the gauge under the calibrated lens, without outliers; residual (n, 2) px and variance of unit weight."""
    prior = Prior(camera.lens_parameters, rough_prior(camera.size_px).sigma)
    start = State(rough_pose(view, camera)[None], camera.lens_parameters, camera.lens, ())
    fit, (view,) = solve_discs([view], start, prior)
    keep = outliers(fit)[0]
    fit, (view,) = solve_discs([view.take(keep)], fit.state, prior)
    return fit.state, view, fit.residual_px[0], fit.variance


def _unseen(camera: Camera, state: State, view: View, noise: float, height_mm: float) -> float:
    """Change of lengths at a height that the image cannot exclude if focal length and pose change together."""
    rows = view_rows(view, replace(state, free=("focal_px",)), 0)[2]
    flat = rows.reshape(-1, rows.shape[-1])
    normal = flat.T @ flat / noise
    normal[0, 0] += (FOCUSING * state.lens[0]) ** -2
    free = np.array([PARAMETERS.index("focal_px"), *range(6)])
    covariance = np.zeros((len(PARAMETERS), len(PARAMETERS)))
    covariance[np.ix_(free, free)] = np.linalg.inv(normal)
    return 1.96 * replace(camera, covariance=covariance).scale_sigma(height_mm)


def _plane(pose: Array) -> Array:
    """Tilt (two angles, rad) and distance, mm, of the plane z = 0 as the camera sees it: (3,)."""
    rotation = cv2.Rodrigues(np.ascontiguousarray(pose[:3]))[0]
    normal = rotation[:, 2]
    return np.array([normal[0], normal[1], -normal @ pose[3:]])


def _plane_slope(pose: Array) -> Array:
    step = 1e-6
    return np.stack([(_plane(pose + d) - _plane(pose - d)) / (2 * step) for d in step * np.eye(6)], axis=1)


def _pose_change(camera: Camera, state: State, view: View, noise: float) -> tuple[Array, Array]:
    """Change of the plane (3,) and its covariance, from the old pose and lens and from the noise of the new image."""
    _, _, by_pose, by_lens = _rows(state, view)
    inverse = np.linalg.inv(by_pose.T @ by_pose)
    follows = -inverse @ by_pose.T @ by_lens  # derivative of the fitted pose by an error of the lens
    old, new = _plane_slope(camera.pose), _plane_slope(state.poses[0])
    lens = [PARAMETERS.index(name) for name in LENS]
    joint = np.zeros((3, len(PARAMETERS)))
    joint[:, :6] = -old
    joint[:, lens] = new @ follows
    covariance = joint @ camera.covariance @ joint.T + noise * new @ inverse @ new.T
    return _plane(state.poses[0]) - _plane(camera.pose), covariance


def _lens_sigma(camera: Camera, state: State, view: View, noise: float) -> float:
    """Significance of a change of the lens in the residuals, given the uncertainties of pose and calibration."""
    white, _, by_pose, by_lens = _rows(state, view)
    q = np.linalg.qr(by_pose)[0]
    beyond = by_lens - q @ (q.T @ by_lens)
    # lens parameters, as directions, that this image determines, in units of its noise
    u, strength, vt = np.linalg.svd(beyond, full_matrices=False)
    seen = strength > 1e-9 * strength.max(initial=1e-300)
    score = u[:, seen].T @ (white - q @ (q.T @ white))
    lens = [PARAMETERS.index(name) for name in LENS]
    spread = strength[seen, None] * vt[seen]
    expected = noise * np.eye(int(seen.sum())) + spread @ camera.covariance[np.ix_(lens, lens)] @ spread.T
    return _sigma(float(score @ np.linalg.solve(expected, score)), int(seen.sum()))


def _rows(state: State, view: View) -> tuple[Array, State, Array, Array]:
    """Whitened residuals (2n,), and whitened derivatives by pose (2n, 6) and by the lens (2n, len(LENS))."""
    free = replace(state, free=LENS)
    _, white, rows = view_rows(view, free, 0)
    flat = rows.reshape(-1, len(places_of_view(free, 0)))
    return white.ravel(), free, flat[:, len(LENS) :], flat[:, : len(LENS)]


def _sigma(statistic: float, freedom: int) -> float:
    """Two-sided normal sigmas with the probability of a chi-square."""
    probability = float(special.chdtrc(freedom, statistic))
    return -float(special.ndtri(probability / 2)) if probability > sys.float_info.min else HIGHEST_SIGMA


def _length_change(now: Camera, before: Camera, height_mm: float) -> float:
    """Largest relative change of lengths over the image; a tilt changes them most at its rim."""
    width, height = before.size_px
    arm = 0.05 * min(width, height)
    middle = np.stack(np.meshgrid(np.linspace(0.1, 0.9, 5) * width, np.linspace(0.1, 0.9, 5) * height), axis=-1)
    ends = middle[..., None, :] + arm * np.array([[-1, 0], [1, 0], [0, -1], [0, 1]])
    lengths = []
    for camera in (before, now):
        placed = camera.plate_from_image(ends, height_mm)
        lengths.append(np.hypot(*np.moveaxis(placed[..., 1::2, :] - placed[..., ::2, :], -1, 0)))
    change = (lengths[1] / lengths[0] - 1).ravel()
    change = change[np.isfinite(change)]
    return float(change[np.abs(change).argmax()]) if len(change) else float("nan")
