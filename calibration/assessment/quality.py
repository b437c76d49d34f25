"""Quality of a calibration: conditioning, coverage, uncertainty above the plate, verdict.

A low residual shows that the model fits the dots, not that the dots determine the model. The verdict therefore uses the
covariance, the information gained on each parameter beyond its prior, and the coverage of the image.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.assessment.distance import PITCH_STEP, against_distance
from calibration.assessment.verdict import Level, Verdict
from calibration.camera import CHORD, Camera, camera_height
from calibration.errors import CalibrationError
from calibration.estimation.calibrate import Calibration
from calibration.estimation.flatness import REST
from calibration.estimation.initial_values import rough_prior
from calibration.gauge.geometry import Gauge

Array = NDArray[np.float64]

MARK_HEIGHT_MM = 6.5  # of the marks of the robot this project was made for
# Turning radii are to be accurate to 0.5 %; a scale uncertainty above a fifth of that is reported.
SCALE_TOLERANCE = 0.001
# A parameter whose uncertainty is more than a quarter of its prior's is hardly determined by the images.
LEARNED = 0.25
FOCAL_TOLERANCE = 0.01  # 1 % of the 4 % height correction is 0.04 % of a radius; sound sets reach 0.02 %
IMPLAUSIBLE = 3.0  # prior sigmas
# Residuals over their white-noise expectation. Compression and interpolation correlate neighbouring pixels and double
# it; beyond three the model or the gauge file is wrong.
MISFIT = 3.0
TILTED = "tilted by 20 to 40 degrees"  # separates focal length and distance best; TILT_DEG of next_image is its middle
# What to do if the images do not determine the camera, the gauge is stretched, or the height correction is uncertain.
ILL_STEP = f"take five or more images with the gauge {TILTED} in different directions, near enough to fill the image"
MISFIT_STEP = "use a flat, rigid gauge, check pitch and layout in gauge.toml, and state its [tolerance]"
SIZE_STEP = "measure pitch and dot diameter of the plate and correct gauge.toml"
STRETCHED_STEP = "measure the pitch of the gauge along both directions and write pitch_mm = [along columns, along rows]"
DISTURBED = 5  # dots of an image that were left out, and half of all, from which it may be the one that contradicts
FOCAL_STEP = (
    "lock focus and zoom, use the images as the camera wrote them, neither turned nor cropped, and take them again, all"
    " at the focus of the recordings"
)
HEIGHT_STEP = (
    f"for the height correction, add images with the gauge {TILTED}, or lay the gauge on a spacer as high as the marks "
    "(dots.height_mm), or measure the distance of the lens (--distance-mm VALUE SIGMA)"
)
SMALLEST_TILT_DEG = 5.0  # cos 5° = 0.996: foreshortening cannot be separated from the scale of the pose
# Below the first, the corners are judged by their covariance. Below the second, the covariance is not trusted either,
# because the lens model was chosen from the visible part alone.
MODEST_COVERAGE, SMALLEST_COVERAGE = 0.4, 0.2
# Limits of the ratio diameter/distance of the dots over that of gauge.toml. Printing, blur and strong distortion give
# 0.85 to 1.05, ink that spreads by two dots of a 600 dpi printer 1.08 for dots of 1 mm; plates with pitches of 2.5 and
# 3 mm from one maker differ by a factor of 1.2.
NARROWEST, WIDEST = 0.8, 1.15
LEFT_OUT = 0.02  # share of the dots of one image that is worth a note; of sound dots at most some 0.1 % are left out
CELLS = (12, 9)


def assess(calibration: Calibration, mark_height_mm: float = MARK_HEIGHT_MM) -> Verdict:
    """Judge a calibration for a plane mark_height_mm above the plate.

    Raises CalibrationError if that plane is not in view of the camera found.
    """
    camera = calibration.camera
    scale = camera.scale_sigma(mark_height_mm)
    if not np.isfinite(scale):
        raise CalibrationError(_out_of_view(calibration, mark_height_mm))
    plate_scale = camera.scale_sigma(calibration.gauge.dots.height_mm)
    spread = tilt_spread_deg(calibration)
    covered = coverage(calibration)
    reasons, steps, notes = [], [], _notes(calibration)
    ill = len(calibration.views) > 1 and bool(why := _ill_conditioned(calibration, spread))
    if ill:
        reasons += why
        steps.append(ILL_STEP)
    of_size = (_wrong_size(calibration), SIZE_STEP), (against_distance(calibration), PITCH_STEP)
    for wrong, step in ((_misfit(calibration), MISFIT_STEP), *of_size):
        if wrong:
            reasons += wrong
            steps.append(step)
    if changed := _focal_lengths(calibration):
        reasons.append(changed)
        steps.append(FOCAL_STEP)
    elif printed := _stretched(calibration):
        (reasons if abs(calibration.excess) / 2 > calibration.stated.scale_sigma else notes).append(printed)
        steps.append(STRETCHED_STEP)
    unchecked = len(calibration.views) == 1 and calibration.distance_mm is None
    exact = camera.with_exact_pitch()  # an error of the pitch acts equally at every height
    if covered < MODEST_COVERAGE:
        sparse = f"dots cover {100 * covered:.0f} % of the image; distortion is extrapolated elsewhere"
        if covered < SMALLEST_COVERAGE or not worst_scale_sigma(exact, mark_height_mm) < SCALE_TOLERANCE:
            reasons.append(sparse)
            steps.append("move the gauge so that dots reach every part of the image that will be used")
        else:
            notes.append(sparse)
    seen, seen_on_plate = exact.scale_sigma(mark_height_mm), exact.scale_sigma(calibration.gauge.dots.height_mm)
    if seen > 1.5 * seen_on_plate and (unchecked or seen > SCALE_TOLERANCE):
        reasons.append(_height_sentence(calibration, mark_height_mm, seen, seen_on_plate))
        steps += [] if ill else [HEIGHT_STEP]
    level: Level = "ill-conditioned" if ill else "limited" if reasons else "sound"
    doubt = (
        f"lengths and turning radii at {mark_height_mm:g} mm are known to {100 * scale:.2g} % (1 sigma), "
        f"{_pitch_share(calibration.gauge, exact, mark_height_mm)}"
    )
    return Verdict(
        level=level,
        summary="; ".join([f"{level}: {doubt}", *reasons]),
        reasons=tuple(reasons),
        next_steps=tuple(steps),
        notes=tuple(notes),
        mark_height_mm=mark_height_mm,
        scale_sigma=scale,
        plate_scale_sigma=plate_scale,
        tilt_spread_deg=spread,
        coverage=covered,
    )


def _out_of_view(calibration: Calibration, height_mm: float) -> str:
    """Message for a plane that the camera found does not see."""
    return (
        f"{calibration.sightings[0].name}: the plane {height_mm:g} mm above the plate is not in view of the camera "
        f"found, {camera_height(calibration.camera.pose)[0]:.3g} mm above it; is the gauge bent, and are the mark "
        "height and the gauge file right? Add images with the gauge tilted"
    )


def _pitch_share(gauge: Gauge, exact: Camera, height_mm: float) -> str:
    """Part of the verdict's sentence about the tolerance of the gauge's pitch, which no image can check."""
    if gauge.scale_sigma == 0:
        return "if the pitch of the gauge is exact"
    return (
        f"of which {100 * gauge.scale_sigma:.2g} % from the pitch of the gauge (pitch_tolerance_percent) and "
        f"{100 * exact.scale_sigma(height_mm):.2g} % from the images"
    )


def worst_scale_sigma(camera: Camera, height_mm: float) -> float:
    """The largest `Camera.scale_sigma` of the four corners; NaN if the plane is not visible at one of them."""
    width, height = camera.size_px
    arm = CHORD * min(width, height)
    corners = [np.array([x, y]) for x in (arm, width - 1 - arm) for y in (arm, height - 1 - arm)]
    return float(np.max([camera.scale_sigma(height_mm, corner) for corner in corners]))


def tilt_spread_deg(calibration: Calibration) -> float:
    """Largest angle between the normals of the gauge in any two images, and of each to the optical axis, degrees."""
    normals = np.array([cv2.Rodrigues(np.ascontiguousarray(pose[:3]))[0][:, 2] for pose in calibration.fit.state.poses])
    normals = np.vstack([normals, [0.0, 0.0, -1.0]])
    cosine = np.clip(normals @ normals.T, -1, 1)
    return float(np.degrees(np.arccos(cosine.min())))


def coverage(calibration: Calibration) -> float:
    """Share of the image, in cells, within reach of a dot in any image."""
    width, height = calibration.camera.size_px
    hit = np.zeros(CELLS[::-1], dtype=bool)
    for view in calibration.views:
        hull = cv2.convexHull(view.centers_px.astype(np.float32))
        for row in range(CELLS[1]):
            for column in range(CELLS[0]):
                center = ((column + 0.5) * width / CELLS[0], (row + 0.5) * height / CELLS[1])
                hit[row, column] |= cv2.pointPolygonTest(hull, center, measureDist=False) >= 0
    return float(hit.mean())


def _ill_conditioned(calibration: Calibration, spread: float) -> list[str]:
    """Reasons why several images do not determine the camera; empty if they do."""
    camera, why = calibration.camera, []
    width, height = camera.size_px
    prior = rough_prior(camera.size_px)
    x, y = camera.value("principal_x_px"), camera.value("principal_y_px")
    focal, sigma = camera.value("focal_px"), camera.sigma("focal_px")
    if spread < SMALLEST_TILT_DEG:
        why.append(
            f"all images are parallel within {spread:.1f} degrees and do not determine focal length and distance"
        )
    if sigma > FOCAL_TOLERANCE * focal and not calibration.focal_difference:  # which is told by itself
        why.append(
            f"the focal length is known to {100 * sigma / focal:.2g} % only: a long lens ({focal / width:.1f} widths) "
            "with too little tilt shows too little perspective"
        )
    if not (0 <= x < width and 0 <= y < height):
        why.append(f"the principal point ({x:.0f}, {y:.0f}) lies outside the image")
    elif max(abs(x - prior.mean[2]), abs(y - prior.mean[3])) > IMPLAUSIBLE * prior.sigma[2]:
        why.append(f"the principal point ({x:.0f}, {y:.0f}) lies implausibly far from the middle of the image")
    if max(camera.sigma("principal_x_px"), camera.sigma("principal_y_px")) > LEARNED * prior.sigma[2]:
        why.append("the principal point is not determined by these images and is assumed near the middle")
    if abs(camera.value("aspect") - 1) > IMPLAUSIBLE * prior.sigma[1]:
        why.append(f"pixels would be {camera.value('aspect'):.4f} times as high as wide, which no camera has")
    return why


def _wrong_size(calibration: Calibration) -> list[str]:
    """Reasons if dots differ in size from gauge.toml: its pitch may then be wrong as well, which no image can show."""
    ratio = float(np.median([sighting.size_ratio for sighting in calibration.sightings]))
    bloom = 1.0 + float(np.median([sighting.bloom for sighting in calibration.sightings]))
    if not (ratio / bloom > WIDEST or ratio * bloom < NARROWEST):
        return []
    sentence = (
        f"the ratio of dot diameter to pitch is {ratio:.2f} times that of the gauge file: pitch_mm or "
        "diameter_mm is wrong; a wrong pitch makes every length wrong"
    )
    return [sentence]


def _focal_lengths(calibration: Calibration) -> str:
    """Sentence about images of different focal lengths; empty if they have one."""
    found = calibration.focal_difference
    if found == 0.0:
        return ""
    sentence = (
        "the images contradict one lens; focal lengths that differ between them by about "
        f"{100 * found:.1g} % explain it better: the focus or the zoom changed, or a program turned or cropped an image"
        f"{_disturbed_image(calibration)}"
    )
    if calibration.excess == 0.0:
        return sentence
    half = 50 * abs(calibration.excess)
    return f"{sentence}; the gauge then seems stretched one way, and lengths are uncertain by {half:.2g} %"


def _disturbed_image(calibration: Calibration) -> str:
    """The image in which most of the dots were left out that contradict the rest: glare moves others as well."""
    rejected = np.array(calibration.rejected)
    worst = int(rejected.argmax())
    if rejected[worst] <= rejected.sum() / 2 or rejected[worst] < DISTURBED:
        return ""
    shown = len(calibration.views[worst].centers_px) + rejected[worst]
    return (
        f", or glare or dirt moves the dots of {calibration.views[worst].name}, of which {rejected[worst]} of {shown} "
        "were left out: try without it first"
    )


def _stretched(calibration: Calibration) -> str:
    """Sentence about a gauge that is stretched one way; empty if its file agrees with the images."""
    excess = calibration.excess
    if excess == 0.0:
        return ""
    longer, shorter = ("columns", "rows") if excess > 0 else ("rows", "columns")
    size, doubt = 100 * abs(excess), 196 * calibration.excess_sigma
    return (
        f"compared with its file, the gauge is {size:.2g} % (± {doubt:.1g} %) longer along {longer} than {shorter}: "
        f"multiply pitch_mm by {1 + excess:.5g} along columns, or by {1 / (1 + excess):.5g} along rows; "
        f"the images do not show which, so that lengths are uncertain by {size / 2:.2g} %"
    )


def _misfit(calibration: Calibration) -> list[str]:
    """Reasons if residuals are far above the uncertainty of the dots: the model or the gauge file is then wrong."""
    excess = float(np.sqrt(calibration.fit.variance))
    if excess < MISFIT:
        return []
    sentence = (
        f"residuals of {calibration.rms_px:.2g} px are {excess:.0f} times the uncertainty of the dot centres: the "
        "gauge is not flat or does not match its file, or the lens model does not fit"
    )
    return [sentence]


def _height_sentence(calibration: Calibration, height: float, scale: float, plate_scale: float) -> str:
    doubt = f"{100 * scale:.2g} % (1 sigma), on the plane of the gauge by {100 * plate_scale:.2g} %"
    if len(calibration.views) > 1:
        return (
            "these images do not determine the height correction: "
            f"turning radii at {height:g} mm are uncertain by {doubt}"
        )
    if scale > SCALE_TOLERANCE:
        return (
            "a single image without tilt cannot determine the height correction: "
            f"turning radii at {height:g} mm are uncertain by {doubt}"
        )
    return (
        "the height correction relies on the perspective of a single image, without a check: "
        f"turning radii at {height:g} mm are uncertain by {doubt}, if the lens model is exact"
    )


def _notes(calibration: Calibration) -> list[str]:
    notes = [f"left out {name}: {reason}" for name, reason in calibration.left_out]
    left_out, found = np.array(calibration.rejected), np.array([len(s.match) for s in calibration.sightings])
    worst = int(np.argmax(left_out / found))
    if left_out[worst] > LEFT_OUT * found[worst]:
        notes.append(
            f"{left_out.sum()} of {found.sum()} dots left out because of glare, dirt or an edge, or because they "
            f"contradict the rest; most in {calibration.sightings[worst].name}, {left_out[worst]} of {found[worst]}"
        )
    notes += _flatness_notes(calibration)
    plate, gauge = calibration.sightings[0], calibration.gauge
    if not plate.match.certain and gauge.fiducial:
        notes.append(
            f"{plate.name}: the fiducials fit in more than one way, because the array is symmetric or partly out of "
            "view, so the origin of the plate frame may be another dot and x may point the other way (lengths and "
            "radii are not affected); take this image with more of the array in view"
        )
    elif not plate.match.certain and len(plate.match) == int(gauge.present().sum()):
        notes.append(
            f"{plate.name}: the array is symmetric and has no fiducial, so the direction of x and y was "
            "chosen arbitrarily (lengths and radii are not affected)"
        )
    elif not plate.match.certain:
        notes.append(
            f"{plate.name}: part of the array is hidden or out of view and no fiducial shows "
            "which, so the origin of the plate frame may be off by whole pitches (lengths and radii are not affected)"
        )
    return notes


def _flatness_notes(calibration: Calibration) -> list[str]:
    """Notes on the measured, stated or assumed flatness of the gauge."""
    found = calibration.flatness
    if found is None:
        alone = (
            "the gauge was taken as flat: a single image cannot distinguish bending from lens distortion; state "
            "flatness_mm under [tolerance] of gauge.toml to include it, or add images with the gauge tilted"
        )
        return [alone]
    interval = f"{found.low_mm:.3g} to {found.high_mm:.3g} mm, 95 %"
    if not found.used:
        return [
            (
                f"the gauge is flat within the resolution of these images: peak to valley below {found.high_mm:.2g} mm "
                "(95 %)"
            )
        ]
    rest = REST * np.sqrt(found.mean_square_mm2)
    solved = (
        f"the shape of the gauge was estimated: peak to valley {found.peak_to_valley_mm:.3g} mm ({interval}); the "
        f"points on which it rests are unknown, so the plate's height is known to {rest:.2g} mm (1 sigma, included)"
    )
    return [solved]
