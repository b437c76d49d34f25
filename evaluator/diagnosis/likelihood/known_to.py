"""Quantities known to a tolerance, as parameters: start of motion, clock, scale, geometry, level.

The start of the motors is not known to the millisecond, a wheel not to the micrometre, and a plate is not exactly
level. A diagnosis that took these quantities for exact would report their errors as effects. Here each is a parameter
with a Gaussian prior, common to all runs of the session; the start also has one number per run (mixed_model.SCATTER).
The fit adjusts them within their tolerances and reports the values that the data prefer.

Some act in the simulation (start, clock, wheels, level, centre of gravity), others only on the observation (scale,
positions of the marks), which needs no further simulation.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.candidates.coordinates import size_of
from evaluator.diagnosis.likelihood.run_data import SHARED_UNIT, RunData, is_shared
from evaluator.robot_geometry import reference_pair
from evaluator.settings import KnownTo
from evaluator.wording import name_of_value
from simulator.robot import Robot

Floats = NDArray[np.float64]

START, CLOCK = "start_common_s", "time_base"
RADIUS_DIFFERENCE = "wheel_radius_difference"
LEVEL = ("plate_level_x_deg", "plate_level_y_deg")
GRAVITY = ("center_of_gravity_x_mm", "center_of_gravity_y_mm")
TURNS = ("left_wheel_turns", "right_wheel_turns")
SIMULATED = (START, CLOCK, RADIUS_DIFFERENCE, *LEVEL, *GRAVITY, *TURNS)
# Seen from above, a faster motor is a larger wheel, unless the angle of the wheel is seen as well.
BESIDE = dict.fromkeys(TURNS, "speed-ripple")  # the effect beside which a quantity acts
SCALE = "plane_scale"
LATER = "_later"  # suffix of the key of a change of a quantity within the session
# Knowledge of geometry where robot.toml says nothing: of a robot of the paper's size; of one of a metre, which is
# measured with a tape, in proportion. Callipers may err by 0.02 to 0.03 mm (ISO 13385-1), and a wheel touches the plate
# somewhere within its width. A machinist's level reads 0.3 degrees.
CALLIPERS_MM = 0.02  # one standard deviation of wheelbase and track
RADIUS_SHARE = 0.005  # of a wheel's radius: half of that of a diameter of a millimetre
MOTOR_SHARE = 0.01  # of a wheel's turns, assumed: twice what its radius is known to
MASS_SHARE = 0.02
ATTRACTION_SHARE = 0.05  # pull-off forces repeat to some per cent
# Computers that log commands and poses keep one clock to some hundredths of a second, however seldom a sensor measures.
# A tenth of a second, the interval of a lidar, would hide motors that follow late.
STAMPED_S = 0.02
FRAMES_COMMON, FRAMES_PER_RUN = 1.0, 0.5  # knowledge of the start where experiment.toml says nothing, in frames


@dataclass(frozen=True)
class Quantity:
    """One quantity known to a tolerance.

    key: of the deviation in the fit. name, unit: for people and diagnosis.json. sigma: standard deviation in that unit.
    per_unit: size in the unit of a deviation of 1 in the fit. since: of a change of a value within the session, the
    first run after it.
    """

    key: str
    name: str
    unit: str
    sigma: float
    per_unit: float
    since: str = ""

    @property
    def tolerance(self) -> float:
        """Standard deviation of the deviation in the fit."""
        return self.sigma / self.per_unit


def quantities(known: KnownTo, robot: Robot, data: Sequence[RunData]) -> tuple[Quantity, ...]:
    """All quantities known to a tolerance that are not in the robot's [tolerance]; exact ones are omitted."""
    geometry = robot.known_to
    common_s = known.start_common_s
    if common_s is None:
        common_s = FRAMES_COMMON * min(frame_interval_s(data), _stamped_s(data))
    length = size_of(robot).length
    level, callipers = geometry.plate_level_deg, length * CALLIPERS_MM
    stated_as = geometry.model_fields_set  # the defaults are those of a robot of the paper's size
    place, gravity = (
        getattr(geometry, name) * (1.0 if name in stated_as else length)
        for name in ("mark_position_mm", "center_of_gravity_mm")
    )
    found = [
        _shared(START, "start of motion in all runs", "s", common_s),
        _shared(CLOCK, "clock rate of the recording", "1", known.time_base),
        _shared(SCALE, "scale of lengths on the plate", "1", known.plane_scale),
        *(
            _shared(key, f"level of the plate along {axis}", "deg", level)
            for key, axis in zip(LEVEL, "xy", strict=True)
        ),
        *(
            _shared(key, f"centre of gravity along {axis}", "mm", gravity)
            for key, axis in zip(GRAVITY, "xy", strict=True)
        ),
        *(_shared(key, f"{point} along {axis} of the robot", "mm", place) for key, point, axis in _points(robot, data)),
    ]
    radius = robot.driving_radius_mm
    radius_sigma = RADIUS_SHARE * radius if geometry.wheel_radius_mm is None else geometry.wheel_radius_mm
    # errors of a pair of wheels may be equal (one calliper) or independent: the mean is not known better than each
    found.append(
        _shared(RADIUS_DIFFERENCE, "radius of the left over the right wheel", "1", 2**0.5 * radius_sigma / radius)
    )
    motor_sigma = MOTOR_SHARE if radius_sigma else 0.0  # who knows the wheels exactly knows how they turn
    found += [
        _shared(key, f"turns of the {side} driving wheels at an equal surface speed", "1", motor_sigma)
        for key, side in zip(TURNS, ("left", "right"), strict=True)
    ]
    mass = robot.body.mass_g
    lengths: list[tuple[str, float, float | None]]
    lengths = [("body.mass_g", mass, MASS_SHARE * mass if geometry.mass_g is None else geometry.mass_g)]
    wheelbase_mm, track_mm = (float(part) for part in np.ptp(robot.wheel_positions_mm(), axis=0))
    keys = ("wheels.radius_mm", "wheels.wheelbase_mm", "wheels.track_mm")
    if not robot.wheels:  # of a list the radii, or all x, or all y, in one ratio
        keys = ("wheel.radius_mm", "wheel.x_mm", "wheel.y_mm")
    lengths[:0] = [
        (keys[0], radius, radius_sigma),
        (keys[1], wheelbase_mm, geometry.wheelbase_mm),
        (keys[2], track_mm, geometry.track_mm),
    ]
    attraction = robot.magnetic_attraction
    forces = (
        ("magnetic_attraction.driving_wheel_mN", attraction.driving_wheel_mN),
        ("magnetic_attraction.driven_wheel_mN", attraction.driven_wheel_mN),
    )
    for key, value, sigma in (*lengths, *((key, value, ATTRACTION_SHARE * value) for key, value in forces)):
        stated = callipers if sigma is None else sigma
        if value and key not in robot.tolerance:
            found.append(Quantity(key, name_of_value(key), key.rpartition("_")[2], stated, value))
    return tuple(item for item in found if item.sigma > 0)


def acting(tolerance: Mapping[str, float], effects: Collection[str]) -> dict[str, float]:
    """Tolerances without those of quantities that act only beside an effect that is not among effects."""
    return {key: value for key, value in tolerance.items() if BESIDE.get(key) in (None, *effects)}


def start_per_run_s(known: KnownTo, data: Sequence[RunData]) -> float:
    """Standard deviation of the start of single runs, s; default half a frame."""
    usual_s = FRAMES_PER_RUN * min(frame_interval_s(data), _stamped_s(data))
    return usual_s if known.start_per_run_s is None else known.start_per_run_s


def _stamped_s(data: Sequence[RunData]) -> float:
    """Agreement of the clocks of commands and poses, s, if both are computer logs; otherwise infinite."""
    return STAMPED_S if all(run.log is not None and run.from_poses for run in data) else np.inf


def frame_interval_s(data: Sequence[RunData]) -> float:
    """Median time between frames of all runs, s."""
    return float(np.median([np.median(np.diff(run.time_s)) for run in data]))


def mark_shifts(robot: Robot, found: Mapping[str, float]) -> tuple[float, ...]:
    """Shifts of the two marks in the fitted quantities: x, y of the first and of the second, mm, body frame."""
    return tuple(found.get(key, 0.0) for key, _, _ in _mark_keys(robot))


def mark_keys(robot: Robot) -> tuple[str, ...]:
    """Keys of the positions of a robot's reference pair, x, y of the first, then of the second; empty for one mark."""
    return tuple(key for key, _, _ in _mark_keys(robot))


def _points(robot: Robot, data: Sequence[RunData]) -> list[tuple[str, str, str]]:
    """Key, point and axis of the positions of the reference pair: marks, or points that stand for the poses."""
    keys, poses = _mark_keys(robot), bool(data) and all(run.from_poses for run in data)
    names = [
        f"tracked point {number // 2 + 1} of 2" if poses else f"{mark} mark" for number, (_, mark, _) in enumerate(keys)
    ]
    return [(key, name, axis) for (key, _, axis), name in zip(keys, names, strict=True)]


def _mark_keys(robot: Robot) -> list[tuple[str, str, str]]:
    return [(f"{mark}_{axis}_mm", mark, axis) for mark in reference_pair(robot) or () for axis in "xy"]


def _shared(key: str, name: str, unit: str, sigma: float) -> Quantity:
    return Quantity(key, name, unit, sigma, sigma / SHARED_UNIT if sigma else 1.0)


def amount_of(nominal: Mapping[str, float], key: str, known: Mapping[str, float]) -> float:
    """Deviation of a quantity known to a tolerance, in its unit; nominal: as in Task, known: predicted_sigmas."""
    return nominal.get(key, 0.0) * known.get(key, 0.0)


def predicted_sigmas(found: Sequence[Quantity]) -> Mapping[str, float]:
    """For quantities that change the prediction: size, in their unit, of a deviation of 1 in the fit."""
    return {item.key: item.per_unit for item in found if is_shared(item.key)}
