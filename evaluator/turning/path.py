"""Path radius and speed of a single mark, without a heading.

The circle is fitted by its signed distance in a form that includes straight paths. Let q be the position relative to an
anchor, w its component across the path, a the distance of the path from the anchor, and k its curvature. The distance
is N / (1 + sqrt(1 - k N)) with N = 2 (w - a) + k (2 w a - q² - a²).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.robust import PER_MEDIAN, robust_sigma
from evaluator.turning.motion.curvature import Curvature
from evaluator.turning.motion.fit import COVERED, FEWEST_FRAMES
from evaluator.turning.motion.least_squares import Block, averaged_least_squares
from evaluator.turning.phases import find_phases
from evaluator.turning.status import LEAST_CERTAIN, LEAST_TURN_DEG, UNCERTAIN, VARIES_SHARE
from evaluator.wording import with_bounds

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
NAN = float("nan")
JUMP_SIGMA = 6.0  # robust standard deviations: Gaussian noise exceeds them at one position of 5e8
PIECES = 4  # quarters of a path, which show a change of curvature in one direction, and one there and back
LEAST_BACK = 0.02  # share of the path: a smaller return is the play of wheels that stop


@dataclass(frozen=True)
class PointPath:
    """Path of one point: radius with 95 % bounds (NaN with a reason in status), speed in length units per s.

    Speed is never negative, because without a heading the directions forward and backward look alike. turned_deg:
    change of the direction of travel. scatter: RMS distance of the positions from the circle.
    """

    status: str = "ok"
    radius: float = NAN
    low: float = NAN
    high: float = NAN
    speed: float = NAN
    turned_deg: float = NAN
    scatter: float = NAN

    @property
    def straight(self) -> bool:
        """Whether the path has no radius because it is nearly a line; status then gives its curvature."""
        return self.status.startswith("straight")

    def summary(self, unit: str) -> str:
        """Text of one line; unit: of lengths."""
        if not np.isfinite(self.radius):
            if not np.isfinite(self.speed):
                return self.status
            ending = f" 1/{unit}; {self.scatter:.2g} {unit} RMS from its line, at" if self.straight else ";"
            return f"{self.status}{ending} {self.speed:.3g} {unit}/s"
        said = "" if self.status == "ok" else f"{self.status}; "
        radius, low, high = with_bounds(self.radius, self.low, self.high)
        return (
            f"{said}path radius {radius} {unit}, 95 % from {low} to {high};"
            f" {self.turned_deg:.0f} degrees at {self.speed:.3g} {unit}/s"
        )


def measure_path(
    time_s: Array, places: Array, start_s: float | None = None, stop_s: float | None = None, scale_sigma: float = 0.0
) -> PointPath:
    """Measure the path of a point: time_s (n,), places (n, 2), right-handed, NaN where missing.

    scale_sigma: relative standard uncertainty of the unit of length; it widens the bounds.
    """
    there = np.isfinite(places).all(axis=1)
    if there.sum() < 2 * FEWEST_FRAMES:
        return PointPath(f"{int(there.sum())} frames with the mark; {2 * FEWEST_FRAMES} are needed")
    time, place = time_s[there], places[there]
    sigma = _noise(place)
    flat = np.column_stack([place, np.zeros(len(place))])
    phases = find_phases(time, flat, sigma, start_s, stop_s)
    if phases.reason:
        return PointPath(phases.reason)
    steady = phases.names(time) == "steady"
    if steady.sum() < 2 * FEWEST_FRAMES:
        return PointPath(f"steady motion of {int(steady.sum())} frames; {2 * FEWEST_FRAMES} are needed")
    along_line = place @ _ahead(place - place.mean(axis=0))
    time, place = time[steady], place[steady]
    curvature, along, residual = _circle(time, place)
    turned = float(np.degrees(abs(curvature.value) * np.ptp(along)))
    speed = abs(float(np.polyfit(time - time[0], along, 1)[0]))
    found = PointPath("ok", speed=speed, turned_deg=turned, scatter=float(np.sqrt(np.mean(residual**2))))
    nearest = min(abs(curvature.low), abs(curvature.high))
    if curvature.straight or nearest < LEAST_CERTAIN * abs(curvature.value) or turned < LEAST_TURN_DEG:
        value, least, most = with_bounds(curvature.value, curvature.low, curvature.high)
        kind = "straight" if curvature.straight or turned < LEAST_TURN_DEG else UNCERTAIN
        if _returns(along_line, sigma):
            kind, leg = "straight, out and back", _longer_leg(along)
            speed = abs(float(np.polyfit(time[leg] - time[0], along[leg], 1)[0]))
        reason = f"{kind}: curvature {value}, 95 % from {least} to {most}"
        return PointPath(reason, speed=speed, turned_deg=turned, scatter=found.scatter)
    spread = _spread(time, place)
    status = (
        f"varies: the curvature scatters by {100 * spread:.0f} % from quarter to quarter"
        if spread > VARIES_SHARE
        else "ok"
    )
    wider = curvature.with_systematic(abs(curvature.value) * float(np.hypot(scale_sigma, spread)))
    radius, low, high = wider.radius_mm()
    if not np.isfinite(radius):
        status += "; no single radius"
    return PointPath(status, radius, low, high, speed, turned, found.scatter)


def _noise(place: Array) -> float:
    """Noise of a coordinate from second differences, which are near zero for a smooth path; always positive."""
    second = place[2:] - 2 * place[1:-1] + place[:-2]
    robust = PER_MEDIAN * np.median(np.abs(second - np.median(second, axis=0)))  # of three values: sqrt(6) of one
    return float(max(robust / np.sqrt(6), 1e-9 * np.ptp(place, axis=0).max(), 1e-12))


def _returns(along: Array, sigma: float) -> bool:
    """Whether a point on a line moves back by more than its noise, so that a single speed does not describe it."""
    back = np.ptp(along) - abs(along[-1] - along[0])
    return bool(back > max(JUMP_SIGMA * sigma, LEAST_BACK * np.ptp(along)))


def _longer_leg(along: Array) -> slice:
    """Positions before or after the one farthest from the first, whichever are more."""
    farthest = int(np.argmax(np.abs(along - along[0])))
    return slice(0, farthest + 1) if 2 * farthest >= len(along) else slice(farthest, None)


def _ahead(q: Array) -> Array:
    """Direction of largest spread of positions about their mean (n, 2)."""
    return np.asarray(np.linalg.svd(q, full_matrices=False)[2][0])


def _circle(time: Array, place: Array) -> tuple[Curvature, Array, Array]:
    """Curvature of the path with 95 % bounds, positions along it and distances from it."""
    anchor = place.mean(axis=0)
    parameters = _first_guess(place - anchor)
    used = np.ones(len(place), dtype=bool)
    for attempt in range(40):
        residual, design = _linearised(place - anchor, parameters)
        if attempt > 2:
            limit = JUMP_SIGMA * robust_sigma(residual)
            used = np.abs(residual - np.median(residual)) <= max(limit, 1e-12)
        step = np.linalg.lstsq(design[used], -residual[used], rcond=1e-13)[0]
        parameters = parameters + step
        if attempt > 4 and np.abs(step[2]) <= 1e-10 * np.abs(parameters[2]):
            break
    residual, design = _linearised(place - anchor, parameters)
    direction = parameters[1] + parameters[2] * _along(place - anchor, parameters)
    interval = float(np.median(np.diff(time)))
    block = Block(time[used] / interval, direction[used], -residual[used, None], design[used, None, :])
    averaged = averaged_least_squares(block)
    way = np.array([0.0, 0.0, 1.0])
    value = float(parameters[2] + averaged.mean()[2])
    low, high = parameters[2] + averaged.quantiles(way, COVERED)
    sigma = float(np.sqrt(averaged.spread()[2, 2]))
    curvature = Curvature(value, min(float(low), value), max(float(high), value), sigma)
    return curvature, _along(place - anchor, parameters), residual


def _first_guess(q: Array) -> Array:
    """Distance, direction and curvature: the better of an algebraic circle (Kasa 1976) and a straight line."""
    ahead = _ahead(q)
    line = np.array([0.0, float(np.arctan2(ahead[1], ahead[0])), 0.0])
    center = np.linalg.lstsq(np.column_stack([2 * q, np.ones(len(q))]), (q**2).sum(axis=1), rcond=None)[0]
    squared, reach = float(center[2] + center[:2] @ center[:2]), float(np.hypot(*center[:2]))
    if squared <= 0:
        return line
    radius, normal = np.sqrt(squared), center[:2] / reach if reach else np.array([0.0, 1.0])
    # Counter-clockwise about the centre, which is to the left of the direction of travel.
    circle = np.array([reach - radius, float(np.arctan2(-normal[0], normal[1])), 1 / radius])
    return min((line, circle), key=lambda guess: float(np.square(_distance(q, guess)).sum()))


def _distance(q: Array, parameters: Array) -> Array:
    a, angle, k = parameters
    w = -q[:, 0] * np.sin(angle) + q[:, 1] * np.cos(angle)
    n = 2 * (w - a) + k * (2 * w * a - (q**2).sum(axis=1) - a * a)
    return np.asarray(n / (1 + np.sqrt(np.maximum(1 - k * n, 0))))


def _linearised(q: Array, parameters: Array) -> tuple[Array, Array]:
    """Distances, (n,), and their derivative by the three parameters, (n, 3)."""
    size = float(np.abs(q).max()) or 1.0
    steps = 1e-6 * np.array([size, 1.0, 1 / size])
    columns = [
        (_distance(q, parameters + step) - _distance(q, parameters - step)) / (2 * step.sum())
        for step in np.diag(steps)
    ]
    return _distance(q, parameters), np.stack(columns, axis=1)


def _along(q: Array, parameters: Array) -> Array:
    """Path length of every position from the foot of the anchor, unwrapped."""
    a, angle, k = parameters
    forward = q[:, 0] * np.cos(angle) + q[:, 1] * np.sin(angle)
    w = -q[:, 0] * np.sin(angle) + q[:, 1] * np.cos(angle) - a
    if abs(k) * float(np.abs(q).max()) < 1e-6:
        return np.asarray(forward)
    return np.asarray(np.unwrap(np.arctan2(k * forward, 1 - k * w)) / k)


def _spread(time: Array, place: Array) -> float:
    """Relative standard deviation of the curvature between quarters of the path, noise subtracted."""
    parts = np.array_split(np.arange(len(time)), PIECES)
    if len(parts[0]) < 2 * FEWEST_FRAMES:
        return 0.0
    found = [_circle(time[part], place[part])[:2] for part in parts]
    # to the left of the motion: a fit that begins with a line may run against it
    values = np.array([curvature.value * np.sign(along[-1] - along[0]) for curvature, along in found])
    noise = float(np.mean([curvature.sigma**2 for curvature, _ in found]))
    variance = float(np.var(values, ddof=1)) - 2 * noise  # twice: a few values scatter by chance
    return float(np.sqrt(max(variance, 0.0)) / abs(values.mean())) if values.mean() else 0.0
