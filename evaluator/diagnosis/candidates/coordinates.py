"""Candidate effects in coordinates that a linear fit can walk through.

A direction and a size (tilt and azimuth, stiffness and anchor, amplitude and phase) become Cartesian components, which
are smooth where the size is zero. Everything else keeps the parameters of the effect. Bounds say what is physical.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Parameters = dict[str, float]


@dataclass(frozen=True)
class Coordinate:
    """One number of a term: its value where the effect is absent, a small visible step, and physical bounds."""

    name: str
    neutral: float
    step: float
    low: float = -np.inf
    high: float = np.inf


@dataclass(frozen=True)
class Term:
    """A candidate: effect id, coordinates, the effect's own parameters from them, and starting points besides neutral.

    leaps: the response has no derivative, only the starts can be tried.
    starts: full coordinate vectors at which a linear fit is worth beginning where neutral says nothing (the place of an
    attraction whose force is zero).
    """

    id: str
    coordinates: tuple[Coordinate, ...]
    physical: Callable[[tuple[float, ...]], Parameters]
    starts: tuple[tuple[float, ...], ...] = ()
    leaps: bool = False
    between: tuple[tuple[float, float], ...] = ()  # of a term that leaps: the gaps in which it may lie

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    @property
    def neutral(self) -> tuple[float, ...]:
        """Coordinates where the effect is absent."""
        return tuple(item.neutral for item in self.coordinates)

    def clipped(self, values: tuple[float, ...]) -> tuple[float, ...]:
        """Values moved inside the physical bounds."""
        return tuple(float(np.clip(v, c.low, c.high)) for v, c in zip(values, self.coordinates, strict=True))


def _plain(effect: str, *coordinates: Coordinate) -> Term:
    names = [item.name for item in coordinates]
    return Term(effect, coordinates, lambda values: dict(zip(names, map(float, values), strict=True)))


def _polar(effect: str, size: str, angle: str, step: float, limit: float, fold: int = 1) -> Term:
    """Size and direction as components; fold: how often the direction repeats in a turn."""

    def physical(values: tuple[float, ...]) -> Parameters:
        x, y = values
        turned = np.degrees(np.arctan2(y, x)) / fold % (360.0 / fold)
        return {size: float(np.hypot(x, y)), angle: float(turned)}

    along, across = Coordinate("along", 0.0, step, -limit, limit), Coordinate("across", 0.0, step, -limit, limit)
    return Term(effect, (along, across), physical)


def _spring(values: tuple[float, ...]) -> Parameters:
    stiffness, pull_x, pull_y = values
    softest = max(stiffness, 1e-9)  # a pull without stiffness is a soft spring from afar
    return {"stiffness_mN_mm": softest, "anchor_x_mm": pull_x / softest, "anchor_y_mm": pull_y / softest}


def _lag(values: tuple[float, ...]) -> Parameters:
    """Wheels follow late by the sum of dead time and time constant; which of them it is shows in the constant's square.

    (In the two themselves every fit without a time constant is a stationary point.)
    """
    delay, share = values
    return {"dead_time_s": delay * (1 - share**0.5), "time_constant_s": delay * share**0.5}


def _magnets(values: tuple[float, ...]) -> Parameters:
    """A slip law that scales with the load tells the balance of the axles; of the level, weight and inertia over it."""
    weakness, balance = values
    return {"driving_factor": 1.0 / weakness, "driven_factor": balance / weakness}


def named_terms(reach_mm: float, command_levels_rpm: tuple[float, ...]) -> dict[str, Term]:
    """Every effect of the contract as a term.

    reach_mm: how far from the origin the robot moved, for the places an attraction may sit. command_levels_rpm: the
    different |rpm| that were commanded; a dead band can only lie between them.
    """
    places = [
        (r * reach_mm * np.cos(a), r * reach_mm * np.sin(a)) for r in (0.5, 1.2) for a in np.arange(8) * np.pi / 4
    ]
    levels = sorted({round(level, 6) for level in command_levels_rpm if level > 0})
    gaps = tuple(zip(levels, [*levels[1:], 2 * levels[-1]], strict=True)) if levels else ()
    far = 4 * reach_mm  # a point farther away pulls like a slope: that is plate-tilt's to say
    factor = {"low": 0.2, "high": 5.0}
    terms = (
        _plain("drive-speed-mismatch", Coordinate("left_over_right", 1.0, 0.005, 0.5, 2.0)),
        _plain("drive-speed-scale", Coordinate("factor", 1.0, 0.005, 0.5, 2.0)),
        _plain("motor-droop", Coordinate("rpm_per_uN_mm", 0.0, 2e-4, 0.0, 0.1)),
        Term(
            "command-lag", (Coordinate("delay_s", 0.0, 0.01, 0.0, 2.0), Coordinate("share", 0.0, 0.1, 0.0, 1.0)), _lag
        ),
        _polar("speed-ripple", "amplitude", "phase_deg", 0.01, 0.5),
        Term(
            "dead-band",
            (Coordinate("rpm", 0.0, 1.0, 0.0, 1e3),),
            lambda v: {"rpm": float(v[0])},
            tuple(((low + high) / 2,) for low, high in gaps),
            leaps=True,
            between=gaps,
        ),
        _plain("speed-drift", Coordinate("per_run", 0.0, 5e-4, -0.05, 0.05)),
        _plain("magnet-imbalance", Coordinate("left_over_right", 1.0, 0.02, **factor)),
        Term(
            "magnet-strength",
            (Coordinate("weakness", 1.0, 0.02, 0.2, 20.0), Coordinate("driven_over_driving", 1.0, 0.02, 0.0, 20.0)),
            _magnets,
        ),
        _plain("friction-level", Coordinate("factor", 1.0, 0.01, **factor)),
        _plain("wheel-toe", Coordinate("left_deg", 0.0, 0.2, -30, 30), Coordinate("right_deg", 0.0, 0.2, -30, 30)),
        _plain("rolling-drag", Coordinate("coefficient", 0.0, 0.002, 0.0, 0.5)),
        _plain("scrub-torque", Coordinate("radius_mm", 0.0, 0.005, 0.0, 2.0)),
        _plain("axle-compliance", Coordinate("deg_per_mN", 0.0, 0.05, -20, 20)),
        _plain("mass-offset", Coordinate("x_mm", 0.0, 0.05, -1.9, 1.9), Coordinate("y_mm", 0.0, 0.05, -1.9, 1.9)),
        _polar("plate-tilt", "angle_deg", "azimuth_deg", 0.2, 45.0),
        _plain("tether-pull", Coordinate("x_mN", 0.0, 0.05, -20, 20), Coordinate("y_mN", 0.0, 0.05, -20, 20)),
        Term(
            "tether-spring",
            (
                Coordinate("stiffness", 0.0, 0.005, 0.0, 10.0),
                Coordinate("pull_x", 0.0, 0.05),
                Coordinate("pull_y", 0.0, 0.05),
            ),
            _spring,
        ),
        _plain(
            "viscous-drag",
            Coordinate("force_mN_s_mm", 0.0, 0.01, 0.0, 10.0),
            Coordinate("moment_uN_mm_s", 0.0, 50.0, 0.0, 1e6),
        ),
        _plain(
            "friction-gradient",
            Coordinate("per_mm_x", 0.0, 1e-3, -0.05, 0.05),
            Coordinate("per_mm_y", 0.0, 1e-3, -0.05, 0.05),
        ),
        _polar("friction-grain", "amplitude", "direction_deg", 0.01, 0.9, fold=2),
        Term(
            "stray-magnet",
            (
                Coordinate("force_mN", 0.0, 0.05, 0.0, 20),
                Coordinate("x_mm", 0.0, 0.5, -far, far),
                Coordinate("y_mm", 0.0, 0.5, -far, far),
            ),
            lambda v: {"force_mN": float(v[0]), "x_mm": float(v[1]), "y_mm": float(v[2])},
            tuple((0.0, float(x), float(y)) for x, y in places),
        ),
        _plain(
            "mark-offset",
            Coordinate("x_mm", 0.0, 0.02, -3, 3),
            Coordinate("y_mm", 0.0, 0.02, -3, 3),
            Coordinate("angle_deg", 0.0, 0.2, -45, 45),
        ),
        _plain("plane-scale", Coordinate("factor", 1.0, 0.005, 0.5, 2.0)),
        _plain("time-base", Coordinate("factor", 1.0, 0.005, 0.5, 2.0)),
        _plain(
            "camera-tilt",
            Coordinate("per_mm_x", 0.0, 1e-4, -0.02, 0.02),
            Coordinate("per_mm_y", 0.0, 1e-4, -0.02, 0.02),
        ),
    )
    return {term.id: term for term in terms}
