"""Motor commands: rotational frequency of the left and right driving wheels as a function of time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.errors import SimulationError
from simulator.units import line_of, numbers_of, read_table, with_plain_columns

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
RPM_PER_RAD_S = 60.0 / (2.0 * math.pi)
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
RPM = {"rpm": 1.0, "rad_s": RPM_PER_RAD_S}
M_S = {"m_s": 1.0, "mm_s": 1e-3}
YAW_RAD_S = {"rad_s": 1.0, "deg_s": math.pi / 180}
EXPECTED = (
    "a command log has time_s and left_rpm, right_rpm (or _rad_s, _m_s), or forward_m_s, yaw_rate_rad_s of a controller"
)


@dataclass(frozen=True)
class Stretch:
    """An interval of constant command, begin_s to end_s (infinite at an open end), rpm."""

    begin_s: float
    end_s: float
    left_rpm: float
    right_rpm: float

    @property
    def is_driven(self) -> bool:
        """Whether a motor is on."""
        return self.left_rpm != 0.0 or self.right_rpm != 0.0


@dataclass(frozen=True, repr=False)
class Command:
    """Piecewise linear commands with jumps.

    time_s: (n,) knots, not decreasing; two knots at one time are a jump. left_rpm, right_rpm: (n,), negative: backward.
    The first value holds before the first knot, the last value after the last knot, and the later value at a jump.
    Raises SimulationError for knots that are not finite, go back in time or differ in number.
    """

    time_s: Array
    left_rpm: Array
    right_rpm: Array

    def __post_init__(self) -> None:
        """Check the knots and make them read-only."""
        for name in ("time_s", "left_rpm", "right_rpm"):
            values = np.array(getattr(self, name), dtype=float)
            if values.ndim != 1 or len(values) == 0 or not np.isfinite(values).all():
                raise SimulationError(f"a command's {name} must be a list of finite numbers; found {values}")
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        if not len(self.time_s) == len(self.left_rpm) == len(self.right_rpm):
            raise SimulationError(
                f"a command needs as many times as values; found {len(self.time_s)} times, "
                f"{len(self.left_rpm)} left and {len(self.right_rpm)} right"
            )
        back = np.flatnonzero(np.diff(self.time_s) < 0)
        if len(back):
            raise SimulationError(
                f"command times must not decrease; {self.time_s[back[0] + 1]} s comes after later ones"
            )

    def __repr__(self) -> str:
        """One line: number of knots, their times, and the range of both commands."""
        sides = (
            f"{side} {rpm.min():g} to {rpm.max():g} rpm"
            for side, rpm in (("left", self.left_rpm), ("right", self.right_rpm))
        )
        return f"Command({len(self.time_s)} knots from {self.time_s[0]:g} to {self.time_s[-1]:g} s, {', '.join(sides)})"

    @cached_property
    def knots(self) -> Array:
        """(n, 3) time_s, left_rpm, right_rpm, as the kernels read them."""
        return np.stack([self.time_s, self.left_rpm, self.right_rpm], axis=1)

    @classmethod
    def constant(cls, left_rpm: float, right_rpm: float, start_s: float = 0.0, stop_s: float | None = None) -> Command:
        """Motors off, on at start_s, and off again at stop_s if given. Raises SimulationError if it is not later."""
        if stop_s is not None and stop_s <= start_s:
            raise SimulationError(f"stop_s = {stop_s} is not after start_s = {start_s}")
        end = [] if stop_s is None else [(stop_s, 0.0, 0.0)]
        return cls.steps([(start_s, left_rpm, right_rpm), *end])

    @classmethod
    def steps(cls, values: Iterable[tuple[float, float, float]]) -> Command:
        """A sequence of (time_s, left_rpm, right_rpm), each held until the next; motors off before the first."""
        time, left, right = [], [], []
        held = (0.0, 0.0)
        for at, to_left, to_right in values:
            time += [at, at]
            left += [held[0], to_left]
            right += [held[1], to_right]
            held = (to_left, to_right)
        return cls(np.array(time, dtype=float), np.array(left, dtype=float), np.array(right, dtype=float))

    @classmethod
    def ramp(cls, left_rpm: float, right_rpm: float, start_s: float, full_s: float) -> Command:
        """Motors off, rising linearly from start_s to the given speeds at full_s, then held."""
        return cls(np.array([start_s, full_s]), np.array([0.0, left_rpm]), np.array([0.0, right_rpm]))

    @classmethod
    def held(
        cls,
        path: str | Path,
        *,
        starts_at_rest: bool = True,
        wheel_radius_m: float | None = None,
        track_m: float | None = None,
    ) -> Command:
        """Read a command log; each value is held until the next.

        Before the first row the motors are off; if the robot does not start at rest, the first row holds there, too.
        wheel_radius_m, track_m: of the robot's controller, for speeds of wheels or velocities. Raises OSError, and
        SimulationError for a file that is not a command log.
        """
        time, left, right = _columns_of_log(path, wheel_radius_m, track_m)
        try:
            return cls.held_samples(time, np.column_stack([left, right]), starts_at_rest=starts_at_rest)
        except SimulationError as error:
            raise SimulationError(f"{path}: {error}") from error

    @classmethod
    def held_samples(cls, time_s: Array, sides_rpm: Array, *, starts_at_rest: bool = True) -> Command:
        """The command of samples, time_s (n,) and sides (n, 2), each held until the next; start as in held."""
        # A log that repeats a value many times a second has one knot per change, not per row.
        changes = np.r_[True, (np.diff(sides_rpm, axis=0) != 0).any(axis=1)]
        rows = zip(time_s[changes], sides_rpm[changes], strict=True)
        found = cls.steps((float(time), float(left), float(right)) for time, (left, right) in rows)
        # The first knot of steps has the motors off until the first row.
        return found if starts_at_rest else cls(found.time_s[1:], found.left_rpm[1:], found.right_rpm[1:])

    @classmethod
    def always(cls, left_rpm: float, right_rpm: float, stop_s: float | None = None) -> Command:
        """Motors on from the beginning, off at stop_s if given."""
        if stop_s is None:
            return cls(np.zeros(1), np.array([left_rpm]), np.array([right_rpm]))
        return cls(np.full(2, stop_s), np.array([left_rpm, 0.0]), np.array([right_rpm, 0.0]))

    def retimed(self, factor: float = 1.0, later_s: float = 0.0) -> Command:
        """The command with every time multiplied by factor and then shifted by later_s."""
        return Command(factor * self.time_s + later_s, self.left_rpm, self.right_rpm)

    def geared(self, left: float, right: float) -> Command:
        """The command with the speeds of the two sides multiplied by these factors."""
        return Command(self.time_s, left * self.left_rpm, right * self.right_rpm)

    def within(self, begin_s: float, end_s: float) -> Command:
        """The command from one time to a later one; its values at these times hold before and after them."""
        inside = (self.time_s > begin_s) & (self.time_s < end_s)
        ends = np.array([begin_s, end_s])
        time_s = np.r_[begin_s, self.time_s[inside], end_s]
        sides = [
            np.r_[value[0], side[inside], value[1]]
            for side, value in zip((self.left_rpm, self.right_rpm), self.at(ends), strict=True)
        ]
        return Command(time_s, *sides)

    def stretches(self) -> tuple[Stretch, ...]:
        """Intervals of constant command, in order of time; ramps between them are omitted."""
        same = (np.diff(self.left_rpm) == 0) & (np.diff(self.right_rpm) == 0) & (np.diff(self.time_s) > 0)
        edges = [(-math.inf, float(self.time_s[0]), 0)]
        edges += [(float(self.time_s[k]), float(self.time_s[k + 1]), int(k)) for k in np.flatnonzero(same)]
        edges.append((float(self.time_s[-1]), math.inf, len(self.time_s) - 1))
        found: list[Stretch] = []
        for begin, end, knot in edges:
            each = Stretch(begin, end, float(self.left_rpm[knot]), float(self.right_rpm[knot]))
            last = found[-1] if found else None
            if last and last.end_s == begin and (last.left_rpm, last.right_rpm) == (each.left_rpm, each.right_rpm):
                found[-1] = Stretch(last.begin_s, end, each.left_rpm, each.right_rpm)
            else:
                found.append(each)
        return tuple(found)

    def at(self, time_s: ArrayLike) -> tuple[Array, Array]:
        """Left and right rpm at the given times (...,), each (...,); at a jump the later value."""
        time = np.asarray(time_s, dtype=float)
        last = len(self.time_s) - 1
        after = np.clip(np.searchsorted(self.time_s, time, side="right"), 0, last)
        before = np.maximum(np.searchsorted(self.time_s, time, side="right") - 1, 0)
        span = self.time_s[after] - self.time_s[before]
        share = np.where(span > 0, (time - self.time_s[before]) / np.where(span > 0, span, 1.0), 0.0)
        return tuple(  # type: ignore[return-value]
            values[before] + share * (values[after] - values[before]) for values in (self.left_rpm, self.right_rpm)
        )


def _columns_of_log(
    path: str | Path, wheel_radius_m: float | None = None, track_m: float | None = None
) -> tuple[Array, Array, Array]:
    """Time in s and both sides in rpm of a command log. Raises OSError, SimulationError that names line or column.

    Columns: time_s (or _ms, _us, _ns, or timestamp in ISO 8601), and left_rpm, right_rpm (or _rad_s); or speeds of the
    wheels' surface, left_m_s, right_m_s, which need the radius of the wheels; or velocities of the robot, forward_m_s
    and yaw_rate_rad_s, which need its track, too. Other columns are left alone.
    """
    table = with_plain_columns(read_table(Path(path)))
    units: dict[str, Mapping[str, float]] = {"time": SECONDS, "left": RPM, "right": RPM}
    if not any(f"{side}_{unit}" in table for side in ("left", "right") for unit in RPM):
        if any(f"{side}_{unit}" in table for side in ("left", "right") for unit in M_S):
            units |= {"left": M_S, "right": M_S}
        elif any(f"forward_{unit}" in table for unit in M_S):
            units = {"time": SECONDS, "forward": M_S, "yaw_rate": YAW_RAD_S}
    names = [_name(path, table, quantity, known) for quantity, known in units.items()]
    missing = [name for name in names if name not in table]
    if missing:
        found = ", ".join(map(str, table.columns))
        raise SimulationError(f"{path}: lacks {', '.join(missing)}; {EXPECTED} (found: {found})")
    time, first, second = _numbers(path, table, names, units)
    if units.get("left") is RPM:
        return time, first, second
    if wheel_radius_m is None or (track_m is None and "forward" in units):
        needed = "wheel_radius_m" if "left" in units else "wheel_radius_m and track_m"
        raise SimulationError(f"{path}: {names[1]} needs {needed} of the robot's controller in [commands]")
    if "forward" in units:
        half = second * (track_m or math.nan) / 2
        first, second = first - half, first + half
    return time, RPM_PER_RAD_S * first / wheel_radius_m, RPM_PER_RAD_S * second / wheel_radius_m


def _name(path: str | Path, table: pd.DataFrame, quantity: str, units: Mapping[str, float]) -> str:
    """The column of a quantity; if there is none, its name in the first of the units."""
    there = [f"{quantity}_{unit}" for unit in units if f"{quantity}_{unit}" in table]
    if len(there) > 1:
        raise SimulationError(f"{path}: both {there[0]} and {there[1]}; keep one of them")
    return there[0] if there else f"{quantity}_{next(iter(units))}"


def _numbers(
    path: str | Path, table: pd.DataFrame, names: list[str], units: Mapping[str, Mapping[str, float]]
) -> list[Array]:
    """The columns in the first of their units."""
    if not len(table):
        raise SimulationError(f"{path}: holds no row; {EXPECTED}")
    columns = [
        known[name.removeprefix(f"{quantity}_")] * numbers_of(table[name]).to_numpy(dtype=float)
        for name, (quantity, known) in zip(names, units.items(), strict=True)
    ]
    bad = np.flatnonzero(~np.isfinite(columns).all(axis=0))
    if len(bad):
        raise SimulationError(f"{path}: line {line_of(table, bad[0])} holds a value that is not a finite number")
    return columns
