"""Interpretations ("readings") of Eqs. (3) to (8), and the five published radii that each gives.

An independent force balance in which every ambiguous choice can be replaced; the reading "as shipped" is the law of the
kernels. The closest reading measures the slip angle in right angles where Eq. (5) reduces friction:
mu = mu_0·(1 - K_mu·sqrt((2·alpha/pi)² + (s·cos alpha)²)). It gives all five radii within 0.1 % without a fitted number.

This is a conjecture, not a proof, chosen after the radii were known. None of 25,920 combinations of ordinary choices
came below 0.16 %. The remaining difference required about 2/3 of the printed decrease at the driven wheels, and 2/pi is
the natural factor near it; of about sixteen forms tried by hand, a factor of 2/3 at the driven wheels alone also came
below 0.1 %. Four of the five radii differ in the last published digit. The shipped tire keeps Eq. (5) as printed.
Units: mm, s, mN, rad.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simulator.paper.machines import PUBLISHED_TURNS, TURN_RPM, PublishedTurn
from simulator.robot import load_robot

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
DRIVING = np.array([True, True, False, False])


def _sigma(angle: Array, slip: Array) -> Array:
    return np.hypot(np.sin(angle), slip * np.cos(angle))


def _in_right_angles(angle: Array, slip: Array) -> Array:
    return np.hypot(2 * angle / np.pi, slip * np.cos(angle))


@dataclass(frozen=True)
class Reading:
    """One choice for every ambiguity of the paper; the defaults are the shipped reading.

    denominator: of the slip ratio, from |u| and |r·phi'|; decreasing_slip: the slip that Eq. (5) multiplies by K_mu,
    from slip angle and ratio; friction: mu/mu_0 from that product; side_slip: replaces sin(alpha) in Eqs. (4), (7).
    """

    name: str
    denominator: Callable[[Array, Array], Array] = np.maximum
    decreasing_slip: Callable[[Array, Array], Array] = _sigma
    friction: Callable[[Array], Array] = lambda loss: 1 - loss
    side_slip: Callable[[Array], Array] = np.sin
    decrease: float = 0.2
    driven_decrease: float | None = None
    stiffness_follows_load: bool = False
    peak_held: bool = False
    steepness_by_mu: bool = False
    inertia: bool = True
    forward_speed_only: bool = False


AS_SHIPPED = Reading("as shipped: |u| or |r·phi'|, whichever is larger, divides the slip ratio")
RIGHT_ANGLES = Reading("slip angle in right angles in Eq. (5) alone", decreasing_slip=_in_right_angles)
READINGS = (
    AS_SHIPPED,
    Reading("|u| divides the slip ratio, as printed in Eq. (3)", denominator=lambda u, _: u),
    Reading("|r·phi'| divides the slip ratio", denominator=lambda u, w: np.where(DRIVING, w, u)),
    Reading("stiffness 10 × (weight + attraction)", stiffness_follows_load=True),
    Reading("no inertia", inertia=False),
    Reading("radius from forward speed alone, u/r", forward_speed_only=True),
    Reading("tan(alpha) for sin(alpha)", side_slip=np.tan),
    Reading("b = K_y/(mu·f_z)", steepness_by_mu=True),
    Reading("sine of Eq. (6) held at its peak", peak_held=True),
    Reading("no decrease, K_mu = 0", decrease=0.0),
    Reading("K_mu = 0.1", decrease=0.1),
    Reading("decrease by sigma²", decreasing_slip=lambda angle, slip: _sigma(angle, slip) ** 2),
    Reading("decrease by sigma/sqrt 2", decreasing_slip=lambda angle, slip: _sigma(angle, slip) / np.sqrt(2)),
    Reading("mu = mu_0/(1 + K_mu·sigma)", friction=lambda loss: 1 / (1 + loss)),
    Reading("decrease by the slip ratio alone", decreasing_slip=lambda _, slip: np.abs(slip)),
    Reading("K_mu = 0.132 at the driven wheels (fitted)", driven_decrease=0.132),
    RIGHT_ANGLES,
)


def published_radii(reading: Reading) -> Array:
    """Radius in mm of each of PUBLISHED_TURNS in a reading, (5,)."""
    return np.array([_radius(turn, reading) for turn in PUBLISHED_TURNS])


def reading_table() -> pd.DataFrame:
    """reading, radius of each published turn in mm, and the largest deviation from the paper in %."""
    import pandas as pd

    published = np.array([turn.radius_mm for turn in PUBLISHED_TURNS])
    rows = []
    for reading in READINGS:
        radii = published_radii(reading)
        cases = {f"{turn.case} [mm]": radius for turn, radius in zip(PUBLISHED_TURNS, radii, strict=True)}
        off = 100 * np.abs(radii / published - 1).max()
        rows.append({"reading": reading.name, **cases, "largest_deviation_percent": off})
    return pd.DataFrame(rows)


def _radius(turn: PublishedTurn, reading: Reading) -> float:
    from scipy.optimize import root

    robot = load_robot("tire")
    weight, mass = robot.weight_uN / 1000, robot.body.mass_g / 1000  # mN and mN·s²/mm
    place = robot.wheel_positions_mm()
    load = weight * (0.25 + np.where(DRIVING, turn.driving_w, turn.driven_w))
    commanded = np.pi * robot.driving_radius_mm / 30 * np.array([*reversed(TURN_RPM), 0.0, 0.0])

    def balance(velocity: Array) -> list[float]:
        u, v, r = velocity
        wheel_u, wheel_v = u - r * place[:, 1], v + r * place[:, 0]
        surface = np.where(DRIVING, commanded, wheel_u)
        slip = (wheel_u - surface) / reading.denominator(np.abs(wheel_u), np.abs(surface))
        along, across = _friction(np.arctan2(wheel_v, np.abs(wheel_u)), slip, load, weight / 4, reading)
        moment = place[:, 0] @ across - place[:, 1] @ along
        carried = mass * r if reading.inertia else 0.0
        return [along.sum() + carried * v, across.sum() - carried * u, moment]

    forward = commanded[:2].mean()
    guess = forward / turn.radius_mm  # initial value; the root does not depend on it
    pivot = -guess if turn.radius_mm < 30 else 0.0  # sharp turns pivot ahead of the centre
    found: Any = root(balance, [forward, pivot, guess], tol=1e-12)
    u, v, r = found.x
    return float(abs(u / r) if reading.forward_speed_only else np.hypot(u, v) / abs(r))


def _friction(angle: Array, slip: Array, load: Array, share: float, reading: Reading) -> tuple[Array, Array]:
    """Eqs. (4) to (8) in a reading, mu_0 = 0.3, a = 1.2."""
    friction, shape = 0.3, 1.2
    side, slide = reading.side_slip(angle), slip * np.cos(angle)
    sigma = np.hypot(side, slide) + 1e-15  # avoids 0/0 without slip
    decrease = np.full(4, reading.decrease)
    if reading.driven_decrease is not None:
        decrease[~DRIVING] = reading.driven_decrease
    mu = friction * reading.friction(decrease * reading.decreasing_slip(angle, slip))
    stiffness = 10 * (load if reading.stiffness_follows_load else share)
    steepness = stiffness / ((mu if reading.steepness_by_mu else friction) * load)
    phase = shape * np.arctan(steepness * sigma)
    force = mu * load * np.sin(np.minimum(phase, np.pi / 2) if reading.peak_held else phase)
    return -slide / sigma * force, -side / sigma * force
