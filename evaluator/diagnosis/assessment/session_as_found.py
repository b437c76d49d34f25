"""Robot and commands with the quantities common to the session as fitted, for predictions from the start pose.

Quantities that a laboratory knows to a tolerance (start of motion, clock, scale, level, wheels, positions of the marks)
have one value for all runs. It is estimated from the fitted runs and applied to the held-out runs, like an effect.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from evaluator.diagnosis.likelihood.known_to import (
    CLOCK,
    GRAVITY,
    LATER,
    LEVEL,
    RADIUS_DIFFERENCE,
    SCALE,
    START,
    TURNS,
    Quantity,
    mark_shifts,
)
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.robot_geometry import reference_line, reference_places
from simulator.effects.entry import EffectEntry
from simulator.robot import Robot

FACTORS = ("time-base", "plane-scale", "drive-speed-mismatch", "drive-speed-scale")


def as_driven(data: Sequence[RunData], known: Sequence[Quantity], point: Point) -> tuple[RunData, ...]:
    """The runs with their commands delayed by the fitted start of motion, and with the fitted turns of the wheels."""
    found = _found(known, point)
    late_s, factors = found.get(START, 0.0), _turns(found)
    if not late_s and factors == (1.0, 1.0):
        return tuple(data)
    result = []
    for run in data:
        log = run.run_command.later(late_s)
        log = replace(log, command=log.command.geared(*factors))
        result.append(replace(run, start_s=run.start_s + late_s, log=log))
    return tuple(result)


def with_session(robot: Robot, run: RunData, known: Sequence[Quantity], point: Point) -> Robot:
    """The robot of a run with the quantities of the session at a fitted point, each as the equivalent effect."""
    found = _found([item for item in known if not item.since or item.key in run.systematic], point)
    added: dict[str, dict[str, float]] = {}
    if CLOCK in found:
        added["time-base"] = {"factor": 1 + found[CLOCK]}
    if SCALE in found:
        added["plane-scale"] = {"factor": 1 + found[SCALE]}
    half = found.get(RADIUS_DIFFERENCE, 0.0) / 2
    left, right = (share / turns for share, turns in zip((1 + half, 1 - half), _turns(found), strict=True))
    if left != right:
        added["drive-speed-mismatch"] = {"left_over_right": left / right}
    if any(key in found for key in TURNS):
        added["drive-speed-scale"] = {"factor": (left + right) / 2}
    x, y = (found.get(key, 0.0) for key in LEVEL)
    if x or y:
        added["plate-tilt"] = {"angle_deg": math.hypot(x, y), "azimuth_deg": math.degrees(math.atan2(y, x))}
    x, y = (found.get(key, 0.0) for key in GRAVITY)
    if x or y:
        added["mass-offset"] = {"x_mm": x, "y_mm": y}
    if moved := _moved_marks(robot, found):
        added["mark-offset"] = moved
    return robot.model_copy(update={"effect": _together(robot.effect, added)})


def _together(entries: Sequence[EffectEntry], added: Mapping[str, Mapping[str, float]]) -> tuple[EffectEntry, ...]:
    """Entries of a robot and of its session; an effect that is in both is combined to one entry.

    A robot may have each effect only once, and a found effect may be the one equivalent to a quantity of the session.
    """
    given = {entry.id: entry.given for entry in entries}
    both = {name: _sum(name, given[name], more) if name in given else more for name, more in added.items()}
    kept = tuple(entry for entry in entries if entry.id not in both)
    return (*kept, *(EffectEntry.model_validate({"id": name, **values}) for name, values in both.items()))


def _sum(effect: str, one: Mapping[str, float], other: Mapping[str, float]) -> dict[str, float]:
    """Combine two entries: factors multiply, slopes add as vectors, offsets add (to first order with rotated marks)."""
    if effect == "plate-tilt":
        slopes = (cmath.rect(tilt["angle_deg"], math.radians(tilt.get("azimuth_deg", 0.0))) for tilt in (one, other))
        angle, azimuth = cmath.polar(sum(slopes))
        return {"angle_deg": angle, "azimuth_deg": math.degrees(azimuth)}
    if effect in FACTORS:
        return {name: one.get(name, 1.0) * other.get(name, 1.0) for name in {*one, *other}}
    return {name: one.get(name, 0.0) + other.get(name, 0.0) for name in {*one, *other}}


def _turns(found: Mapping[str, float]) -> tuple[float, float]:
    """Turns of the left and the right driving wheels over those commanded."""
    left, right = (1 + found.get(key, 0.0) for key in TURNS)
    return left, right


def _found(known: Sequence[Quantity], point: Point) -> dict[str, float]:
    """Quantities with a deviation at a point, in their units, each with its change within the session."""
    found: dict[str, float] = {}
    for item in known:
        if value := point.nominal.get(item.key, 0.0):
            key = item.key.removesuffix(LATER)
            found[key] = found.get(key, 0.0) + value * item.per_unit
    return found


def _moved_marks(robot: Robot, found: dict[str, float]) -> dict[str, float]:
    """Shifts of the two marks as a rotation about the robot's centre and a common shift; empty if there are none.

    The remainder, a change of their distance, affects neither the midpoint nor the direction.
    """
    shifts = mark_shifts(robot, found)
    if not any(shifts):
        return {}
    first, second = (complex(*shifts[k : k + 2]) for k in (0, 2))
    line = complex(*map(float, reference_line(robot)))
    angle = cmath.phase((line + first - second) / line)
    places = [complex(*map(float, place)) for place in reference_places(robot)]
    moved = (first + second) / 2 - (cmath.exp(1j * angle) - 1) * sum(places) / len(places)
    return {"x_mm": moved.real, "y_mm": moved.imag, "angle_deg": math.degrees(angle)}
