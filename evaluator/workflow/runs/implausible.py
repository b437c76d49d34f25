"""Values of robot files that no robot has: another unit, a decimal point in a wrong place."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import numpy as np

from evaluator.errors import InputError
from evaluator.settings import Experiment, load_any_robot
from simulator.dynamics.model import lifted_wheels
from simulator.errors import SimulationError
from simulator.robot import Robot

# Mean density of the box around a robot, kg/m³: from foam to platinum. A Husky has 190, the paper's robot 1,700.
LIGHTEST, HEAVIEST = 10.0, 21_500.0
# Attraction of the strongest wheel over the weight: less does not hold a robot, more presses it flat. The paper's
# wheels have 0.6 to 4; a factor of a thousand between units leads out of the range from any value between.
WEAKEST, STRONGEST = 0.01, 300.0
# Friction of wheels: a quarter of that of ice on ice, and twice that of racing tires. A forgotten point is beyond.
SMOOTHEST, ROUGHEST = 0.005, 4.0
VAGUEST = 1.0  # tolerance, relative: a value that is not known to its own size is not known
WIDEST = 3.0  # distance of wheel centres over the larger side of the body: nine robots here have 0.4 to 0.8


def doubts_of_robots(experiment: Experiment) -> Iterator[str]:
    """Values of robot files that seem to be in another unit, and supports without load, of robots with a body."""
    for name, robot in _robots(experiment):
        yield from (
            f"{name}: {doubt}"
            for doubt in (*implausible_values(robot), *unloaded_wheels(robot), *vague_tolerances(robot))
        )


def refuse_implausible(experiment: Experiment) -> None:
    """Raise InputError for robots that cannot exist: a diagnosis would report the value as an effect."""
    for name, robot in _robots(experiment):
        for doubt in implausible_values(robot):
            raise InputError(f"{name}: {doubt}")


def _robots(experiment: Experiment) -> Iterator[tuple[str, Robot]]:
    for name in dict.fromkeys([experiment.robot, *(run.robot for run in experiment.run if run.robot)]):
        robot = load_any_robot(Path(name))
        if isinstance(robot, Robot):
            yield name, robot


def implausible_values(robot: Robot) -> Iterator[str]:
    """Sentences about a density, an attraction, a friction or places of wheels that no robot has."""
    body, weight_mN = robot.body, robot.weight_uN / 1000
    sizes = body.length_mm, body.width_mm, body.height_mm
    density = 1e6 * body.mass_g / math.prod(sizes)
    box = " x ".join(f"{size:g}" for size in sizes)
    if not LIGHTEST < density < HEAVIEST:
        yield f"{body.mass_g:g} g in a box of {box} mm are {density:.2g} kg/m3; is the mass or a size in another unit?"
        return
    strongest_mN = max(wheel.attraction_mN for wheel in robot.all_wheels)
    if strongest_mN and not WEAKEST < strongest_mN / weight_mN < STRONGEST:
        share = f"{strongest_mN / weight_mN:.2g} of its weight of {weight_mN:.3g} mN"
        yield f"magnets attract a wheel with {strongest_mN:.3g} mN, {share}; is the attraction in another unit?"
    for name in ("longitudinal_friction", "lateral_friction"):
        if not SMOOTHEST < (friction := getattr(robot.slip, name)) < ROUGHEST:
            yield f"slip.{name} = {friction:g}; wheels have {SMOOTHEST:g} to {ROUGHEST:g}: is a decimal point wrong?"
    if max(robot.extent_mm) > WIDEST * max(body.length_mm, body.width_mm):
        apart = " x ".join(f"{extent:g}" for extent in robot.extent_mm)
        yield f"wheel centres {apart} mm apart, of a body of {box} mm; is one of the sizes in another unit?"
    yield from _overlapping(robot)


def _overlapping(robot: Robot) -> Iterator[str]:
    """A sentence about the first two wheels in one line that overlap."""
    places = zip(robot.wheel_names, robot.all_wheels, strict=True)
    for (name, wheel), (other_name, other) in combinations(places, 2):
        apart, radii = abs(wheel.x_mm - other.x_mm), wheel.radius_mm + other.radius_mm
        if np.isclose(wheel.y_mm, other.y_mm) and apart < radii:
            yield (
                f"{name} and {other_name} are {apart:g} mm apart, less than their radii of {wheel.radius_mm:g} and "
                f"{other.radius_mm:g} mm together; are wheelbase and radius right?"
            )
            return


def unloaded_wheels(robot: Robot) -> Iterator[str]:
    """Sentences about wheels that do not press on the plate, and about a robot that tips over."""
    try:
        lifted = lifted_wheels(robot)
    except SimulationError as error:
        yield str(error)
        return
    if lifted:
        verb = "carries" if len(lifted) == 1 else "carry"
        yield f"{', '.join(lifted)} {verb} no load; are the centre of gravity and the places of the wheels right?"


def vague_tolerances(robot: Robot) -> Iterator[str]:
    """Sentences about tolerances that are larger than their values."""
    for key, share in robot.tolerance.items():
        if share > VAGUEST:
            yield f"tolerance of {key} = {share:g}, which is {100 * share:g} %; is it given in percent? It is a share"
