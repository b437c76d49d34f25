"""Status of a run in one sentence: wrong scale, straight run, varying radius."""

from __future__ import annotations

import numpy as np

from evaluator.pose import Poses
from evaluator.turning.motion.fit import TurnFit
from evaluator.turning.phases import STEADY_SHARE
from evaluator.turning.sustained import Sustained
from evaluator.wording import MM_PER, with_bounds

OK = "ok"
# Positions of marks err by some hundredths of a millimetre, at most a few percent of their distance. Lengths that are
# off by more than a fifth are in another unit, or of another gauge or robot.
SPACING_SHARE = 0.2
PX_FAR = 50.0  # coordinates in px extend beyond this, and are not negative
# A radius is stated if its 95 % bounds are within a factor of three: the curvature is then four standard uncertainties
# from zero, so that a straight run counts as a turn once in 16,000, not once in 20.
LEAST_CERTAIN = 0.5
UNCERTAIN = "straight or hardly turning"  # of a run that is less certain, but whose interval excludes a straight path
LEAST_TURN_DEG = 1.0  # a smaller turn looks straight, and no calibration is certain to distinguish it
VARIES_SHARE = STEADY_SHARE  # of the mean curvature: largest standard deviation within a steady turn


def spacing_fault(poses: Poses) -> str:
    """Sentence on lengths that contradict the distance of the marks, with the likely unit; "" if plausible."""
    ratio, _ = poses.spacing_ratio()
    if poses.geometry is None or not np.isfinite(ratio) or abs(np.log(ratio)) < np.log1p(SPACING_SHARE):
        return ""
    nominal = poses.geometry.spacing_mm
    found = f"the marks are {ratio * nominal:.4g} mm apart where robot.toml says {nominal:.4g} mm"
    for unit, size_mm in MM_PER.items():
        if abs(np.log(ratio * size_mm)) < np.log1p(SPACING_SHARE):
            word = {"inch": "inches", "um": "µm"}.get(unit, unit)
            return f"wrong unit: {found}; lengths look like {word}, not mm"
    x, y = poses.x_mm[poses.measured], poses.y_mm[poses.measured]
    if ratio > 1 and min(x.min(), y.min()) >= 0 and max(x.max(), y.max()) > PX_FAR:
        return f"wrong unit: {found}; lengths look like px, not mm"
    times = f"{ratio:.3g} times too far apart" if ratio > 1 else f"{1 / ratio:.3g} times too near"
    return (
        f"wrong scale: {found}, {times}; are the positions of the marks in robot.toml, their height and the pitch of "
        "the gauge right?"
    )


def straightness(fit: TurnFit) -> str:
    """Reason why a run has no radius; "" if it has one. A turn on the spot has radius zero.

    A run whose interval excludes a straight path is not called straight: it may turn, or be one of 20 straight runs.
    """
    curvature, length = fit.curvature(), fit.motion.length_mm
    value, low, high = with_bounds(1000 * curvature.value, 1000 * curvature.low, 1000 * curvature.high)
    text = f"curvature {value} 1/m, 95 % from {low} to {high} 1/m"
    nearest = min(abs(curvature.low), abs(curvature.high))
    if curvature.straight:
        return f"straight: {text}"
    if np.arctan(length * nearest) < LEAST_CERTAIN * np.arctan(length * abs(curvature.value)):
        return f"{UNCERTAIN}: {text}"
    turned = float(np.degrees(fit.motion.turn_rad))
    return f"turns too little: by {turned:.2g} degrees; {text}" if turned < LEAST_TURN_DEG else ""


def variation(sustained: Sustained) -> str:
    """Sentence on a radius that varies; "" if it does not."""
    if not sustained.varies:
        return ""
    share = abs(sustained.spread_per_mm / sustained.mean.value) if sustained.mean.value else np.inf
    if share < VARIES_SHARE:
        return ""
    return f"varies: the curvature scatters by {100 * min(share, 9.99):.0f} % from stretch to stretch"
