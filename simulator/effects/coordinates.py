"""The coordinates in which effects are fitted.

Gauss-Newton fits need coordinates in which the response is smooth at zero effect. Most effects are fitted in their own
parameters. A size and a direction become Cartesian components, because the direction is undefined at size zero.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from math import inf
from statistics import median

import numpy as np

from simulator.effects.parameter import PAPER_SIZE, Parameter, Size

Parameters = dict[str, float]

WITHOUT_COMMANDS_RPM = 60.0  # scale of a session in which no motor is commanded: one turn per second


@dataclass(frozen=True)
class Coordinate:
    """One number of a candidate: its value where the effect is absent, a small visible step, and physical bounds.

    closed: values beyond the bounds are impossible (a share is 0 to 1), so that a fit may end at a bound. prior_sigma:
    standard deviation from the absent value before any run is seen; of a number that many runs do not show, which would
    otherwise end anywhere.
    """

    name: str
    absent: float
    step: float
    low: float = -inf
    high: float = inf
    closed: bool = False
    prior_sigma: float = inf


PAPER_ATTRACTION = (18.0, 2.0)  # 22.05 and 2.45 mN over a quarter of 4.9 mN, of the barrel robot


@dataclass(frozen=True)
class Scene:
    """Properties of the fitted runs that coordinates may depend on.

    reach_mm: largest distance of the robot from the origin of the plate; command_levels_rpm: distinct values of
    commanded |rpm|; size: of the robot; attraction: of a wheel with and of one without a motor, over the weight on
    a wheel; passed_rpm: distinct values of |rpm| that logs pass as well, if they are known.
    """

    reach_mm: float
    command_levels_rpm: tuple[float, ...]
    size: Size = PAPER_SIZE
    attraction: tuple[float, float] = PAPER_ATTRACTION
    passed_rpm: tuple[float, ...] = ()

    @property
    def usual_rpm(self) -> float:
        """The median of the levels at which a wheel turns."""
        return median(self._turning_rpm)

    @property
    def fast_rpm(self) -> float:
        """Upper quartile of the levels at which a wheel turns, below the highest of them if there are several."""
        return self._turning_rpm[3 * (len(self._turning_rpm) - 1) // 4]

    @property
    def _turning_rpm(self) -> list[float]:
        return sorted(level for level in self.command_levels_rpm if level > 0) or [WITHOUT_COMMANDS_RPM]


@dataclass(frozen=True)
class Candidate:
    """An effect as it is fitted: coordinates, the effect's parameters as a function of them, and initial values.

    The first coordinate is the size; the effect acts where it differs from its absent value. starts: vectors of
    coordinates at which the response is linearized if the one at zero effect carries no information (the position of an
    attraction whose force is zero). begin: initial coordinates besides those from linearization, as found by an earlier
    fit; or empty. stepwise: the response is not differentiable; only the starts are tried, and each stands for the
    interval of `between` around it, (low, high). usual: range of the size in which the effect is accepted; beyond it
    only together with the effect `beside`, which explains the same response. known: quantities that the runs determine
    even where they do not determine the parameters, as a function of the coordinates, by name. alike: coordinates far
    from some with nearly the same response, from which a fit may find a better optimum.
    """

    id: str
    coordinates: tuple[Coordinate, ...]
    physical: Callable[[tuple[float, ...]], Parameters]
    starts: tuple[tuple[float, ...], ...] = ()
    stepwise: bool = False
    between: tuple[tuple[float, float], ...] = ()
    begin: tuple[float, ...] = ()
    usual: tuple[float, float] = (-inf, inf)
    beside: str = ""
    known: Callable[[tuple[float, ...]], Parameters] | None = None
    alike: Callable[[tuple[float, ...]], tuple[tuple[float, ...], ...]] | None = None

    def believed(self, size: float, effects: AbstractSet[str]) -> bool:
        """Whether a size is accepted in a model with these effects; see usual and beside."""
        return self.usual[0] <= size <= self.usual[1] or self.beside in effects

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    @property
    def absent(self) -> tuple[float, ...]:
        """Coordinates where the effect is absent."""
        return tuple(item.absent for item in self.coordinates)

    def acts_at(self, place: tuple[float, ...]) -> bool:
        """Whether the effect acts at these coordinates."""
        return place[0] != self.coordinates[0].absent

    def clipped(self, values: tuple[float, ...]) -> tuple[float, ...]:
        """Values moved inside the physical bounds."""
        return tuple(float(np.clip(v, c.low, c.high)) for v, c in zip(values, self.coordinates, strict=True))


def coordinate(parameter: Parameter) -> Coordinate:
    """The coordinate that is the parameter itself."""
    return Coordinate(parameter.name, parameter.absent, parameter.step, parameter.low, parameter.high, parameter.closed)


def plain(effect_id: str, parameters: Sequence[Parameter]) -> Candidate:
    """An effect fitted in its own parameters."""
    names = [parameter.name for parameter in parameters]
    given = any(parameter.begin is not None for parameter in parameters)
    begin = (parameter.absent if parameter.begin is None else parameter.begin for parameter in parameters)
    return Candidate(
        effect_id,
        tuple(map(coordinate, parameters)),
        lambda values: dict(zip(names, map(float, values), strict=True)),
        begin=tuple(begin) if given else (),
    )


def polar(effect_id: str, size: Parameter, angle: Parameter) -> Candidate:
    """An effect with a size and a direction, fitted in Cartesian components, each within the bounds of the size.

    The direction is in degrees, from 0 to its period. Raises ValueError for an angle without a period.
    """
    if angle.period is None:
        raise ValueError(f"{effect_id}: {angle.name} has no period, so it is no direction")
    period, fold = angle.period, 360.0 / angle.period

    def physical(values: tuple[float, ...]) -> Parameters:
        x, y = values
        turned = np.degrees(np.arctan2(y, x)) / fold % period
        return {size.name: float(np.hypot(x, y)), angle.name: float(turned)}

    components = tuple(Coordinate(name, 0.0, size.step, -size.high, size.high) for name in ("along", "across"))
    return Candidate(effect_id, components, physical)
