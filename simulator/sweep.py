"""Sweeps: grids and random samples over robot keys, commands, start poses and effects, a row of results per run.

Every run is determined by its number, so that parts can be computed anywhere and in any order.
"""

from __future__ import annotations

import difflib
import math
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationError,
    model_validator,
)

from simulator.errors import SimulationError
from simulator.files.named import named_in
from simulator.nominal_robot import Finite, Positive
from simulator.robot import Robot, load_robot

if TYPE_CHECKING:
    import pandas as pd

COMMAND_KEYS = {"left_rpm": 0.0, "right_rpm": 0.0, "start_s": 0.0}
START_KEYS = {"start.x_mm": 0.0, "start.y_mm": 0.0, "start.heading_deg": 0.0}
EFFECT_PREFIX = "effect."
MOST_RUNS = 10_000_000  # some hours on two cores
RESULTS = ("x_mm", "y_mm", "heading_deg", "speed_mm_s", "yaw_rate_deg_s", "radius_mm")


class Table(BaseModel):
    """A table of a sweep file: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Span(Table):
    """Evenly spaced values, both ends included."""

    low: Finite
    high: Finite
    count: int = Field(ge=1)


class Uniform(Table):
    """Random values between two bounds."""

    low: Finite
    high: Finite

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.low > self.high:
            raise ValueError(f"low = {self.low:g} is above high = {self.high:g}; exchange them")
        return self

    def draw(self, generator: np.random.Generator) -> float:
        """One value."""
        return float(generator.uniform(self.low, self.high))


class Normal(Table):
    """Random values with a mean and a standard deviation."""

    mean: Finite
    sigma: Positive

    def draw(self, generator: np.random.Generator) -> float:
        """One value."""
        return float(generator.normal(self.mean, self.sigma))


def _of_axis(given: Any) -> str:
    return "values" if isinstance(given, list) else "Span"


def _of_distribution(given: Any) -> str:
    return (
        "Normal"
        if isinstance(given, Normal) or (isinstance(given, dict) and {"mean", "sigma"} & set(given))
        else "Uniform"
    )


# With the tag of its kind a value has the faults of one kind, not of both.
Axis = Annotated[Annotated[Span, Tag("Span")] | Annotated[list[Finite], Tag("values")], Discriminator(_of_axis)]
Distribution = Annotated[
    Annotated[Uniform, Tag("Uniform")] | Annotated[Normal, Tag("Normal")], Discriminator(_of_distribution)
]


def _count(axis: Span | list[float]) -> int:
    return axis.count if isinstance(axis, Span) else len(axis)


def _value(axis: Span | list[float], number: int) -> float:
    """One of the values of an axis, by its number from 0."""
    if not isinstance(axis, Span):
        return float(axis[number])
    share = number / max(axis.count - 1, 1)
    return float((1 - share) * axis.low + share * axis.high)


def _flat(table: Any) -> Any:
    """Dotted keys may be quoted or not: nested tables are flattened to dotted keys."""
    if not isinstance(table, dict):
        return table
    flat: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, dict) and not {"low", "high", "mean", "sigma", "count"} & set(value):
            flat |= {f"{key}.{below}": item for below, item in _flat(value).items()}
        else:
            flat[key] = value
    return flat


class Sweep(Table):
    """sweep.toml: every combination of the grid, each with the given number of random samples.

    fixed: value by key. grid: list of values, or low, high, count. random: low and high, or mean and sigma. Keys:
    left_rpm, right_rpm, start_s; start.x_mm, start.y_mm, start.heading_deg; any number of robot.toml by its dotted key;
    effect.ID.PARAMETER.
    """

    format: Literal[1]
    name: str
    robot: str  # shipped robot or robot.toml
    duration_s: Positive
    samples: int = Field(default=1, ge=1)  # random samples of each grid point
    seed: int = 0
    fixed: Annotated[dict[str, Finite], BeforeValidator(_flat)] = Field(default_factory=dict)  # value by key
    grid: Annotated[dict[str, Axis], BeforeValidator(_flat)] = Field(default_factory=dict)
    random: Annotated[dict[str, Distribution], BeforeValidator(_flat)] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _each_key_once(self) -> Self:
        keys = [*self.fixed, *self.grid, *self.random]
        twice = sorted({key for key in keys if keys.count(key) > 1})
        if twice:
            raise ValueError(f"{', '.join(twice)} is in more than one of fixed, grid and random")
        empty = [key for key, axis in self.grid.items() if not _count(axis)]
        if empty:
            raise ValueError(f"grid.{empty[0]} is empty")
        if self.count() > MOST_RUNS:
            raise ValueError(
                f"the grid and its samples are {self.count():.3g} runs; at most {MOST_RUNS:,} are simulated"
            )
        return self

    def count(self) -> int:
        """Number of runs."""
        return math.prod(map(_count, self.grid.values())) * self.samples

    def points(self, start: int, stop: int) -> list[dict[str, float]]:
        """Keys and values of runs start to stop."""
        sizes, found = [*map(_count, self.grid.values())], []
        for number in range(start, stop):
            places = np.unravel_index(number // self.samples, sizes) if sizes else ()
            node = {key: _value(axis, int(k)) for (key, axis), k in zip(self.grid.items(), places, strict=True)}
            generator = np.random.default_rng([self.seed, number])
            drawn = {key: item.draw(generator) for key, item in self.random.items()}
            found.append(self.fixed | node | drawn)
        return found


def load_sweep(path: Path) -> Sweep:
    """Read a sweep file; a robot given as a path is taken relative to it.

    Raises OSError, tomllib.TOMLDecodeError, pydantic.ValidationError.
    """
    path = Path(path)
    sweep = Sweep.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    if sweep.robot.endswith(".toml"):
        return sweep.model_copy(update={"robot": str(named_in(path, sweep.robot))})
    return sweep


def robot_of_sweep(sweep: Sweep) -> Robot:
    """The robot of a sweep, keys checked against it. Raises as load_robot does, and SimulationError for a bad key."""
    robot = load_robot(sweep.robot)
    try:
        changed(robot, sweep.points(0, 1)[0])
    except ValidationError as error:
        fault = error.errors()[0]
        place = ".".join(str(part) for part in fault["loc"])
        raise SimulationError(f"{sweep.name}: {place or sweep.robot}: {fault['msg']}") from error
    return robot


def changed(robot: Robot, point: dict[str, float]) -> Robot:
    """The robot with the keys of a point applied; command and start keys are left alone.

    Raises SimulationError for an unknown key, pydantic.ValidationError for an invalid value.
    """
    keys = {key: value for key, value in point.items() if key not in COMMAND_KEYS and key not in START_KEYS}
    if not keys:
        return robot
    content = robot.model_dump(mode="json", exclude_none=True)
    effects: list[dict[str, Any]] = content["effect"]
    for key, value in keys.items():
        if key.startswith(EFFECT_PREFIX):
            id_, _, parameter = key.removeprefix(EFFECT_PREFIX).partition(".")
            entry = next((item for item in effects if item["id"] == id_), None)
            if entry is None:
                entry = {"id": id_}
                effects.append(entry)
            entry[parameter] = value
            continue
        *above, last = key.split(".")
        table: Any = content
        for part in above:
            table = table.get(part) if isinstance(table, dict) else None
        if not isinstance(table, dict) or isinstance(table.get(last, 0.0), (dict, list, str)):
            raise SimulationError(f"{key} is not a key of a sweep{_nearest(key, robot)}")
        table[last] = value
    try:
        return Robot.model_validate(content)
    except ValidationError as error:
        extra = [
            ".".join(str(p) for p in fault["loc"]) for fault in error.errors() if fault["type"] == "extra_forbidden"
        ]
        if extra:
            raise SimulationError(f"{extra[0]} is not a key of a sweep{_nearest(extra[0], robot)}") from error
        raise


def run_part(sweep: Sweep, robot: Robot, start: int, stop: int) -> pd.DataFrame:
    """Simulate runs start to stop: a row each with its keys and the state at its end.

    radius_mm is that of the path at the end, signed, infinite on a straight line. A run that cannot be simulated has
    the reason in status and NaN results.
    """
    import pandas as pd

    from simulator.command import Command
    from simulator.dynamics.model import compile_robot
    from simulator.simulation import simulate_batch

    points = sweep.points(start, stop)
    status, rows, models = [""] * len(points), [], []
    known: dict[tuple[float, ...], Any] = {}
    for number, point in enumerate(points):
        own = tuple(value for key, value in point.items() if key not in COMMAND_KEYS and key not in START_KEYS)
        try:
            if own not in known:
                known[own] = compile_robot(changed(robot, point))
        except ValidationError as error:
            status[number] = error.errors()[0]["msg"]
        except SimulationError as error:
            status[number] = str(error)
        else:
            models.append(known[own])
            rows.append(number)
    table = pd.DataFrame({"run": range(start, stop), **pd.DataFrame(points).to_dict("list")})
    results = np.full((len(points), len(RESULTS)), np.nan)
    if rows:
        settings = [COMMAND_KEYS | START_KEYS | points[number] for number in rows]
        commands = [Command.constant(item["left_rpm"], item["right_rpm"], item["start_s"]) for item in settings]
        starts = np.zeros((len(rows), 6))
        starts[:, :3] = [
            (item["start.x_mm"], item["start.y_mm"], math.radians(item["start.heading_deg"])) for item in settings
        ]
        batch = simulate_batch(np.concatenate(models), commands, [0.0, sweep.duration_s], starts, summary=True)
        x, y, heading, u, v, yaw_rate = batch.final.T
        with np.errstate(divide="ignore"):
            radius = 1 / batch.curvature_per_mm
        results[rows] = np.stack([x, y, np.degrees(heading), np.hypot(u, v), np.degrees(yaw_rate), radius], axis=1)
        for number, end in zip(rows, x, strict=True):
            if np.isnan(end):
                status[number] = "the motion cannot be simulated"
    return table.assign(**dict(zip(RESULTS, results.T, strict=True)), status=status)


def _nearest(key: str, robot: Robot) -> str:
    tables = {name: value for name, value in robot.model_dump(mode="json").items() if isinstance(value, dict)}
    known = [f"{name}.{item}" for name, table in tables.items() for item in table]
    near = difflib.get_close_matches(key, [*COMMAND_KEYS, *START_KEYS, *known], n=1, cutoff=0.5)
    return f"; did you mean {near[0]}?" if near else ""
