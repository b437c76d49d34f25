"""Forward and backward turns: Section 6.1 and Figures 19 to 22; and results of the paper that are not computed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simulator.paper import tables
from simulator.paper.checks import Check, out_of_scope, statement

if TYPE_CHECKING:
    from simulator.steady import SteadyTurn

TIGHTER = 1e-3  # relative; a measurement could not show a smaller difference of radius


def direction_checks() -> list[Check]:
    """Figures 19 to 22, 14.4 rpm left and 33.3 rpm right, barrel wheels, forward and backward."""
    forward, backward = tables.prototype_turn(1), tables.prototype_turn(-1)
    off = backward.radius_mm / forward.radius_mm - 1
    radii = f"{forward.radius_mm:.3f} forward, {backward.radius_mm:.3f} mm backward"
    equal = "every friction force reverses with the motion, so both ways are one path"
    return [
        statement("Fig. 19, 22", "backward turn against forward turn", "tighter", f"{radii}: equal", off < -TIGHTER),
        statement("Fig. 19", "smoothness of the two turns", "forward is smoother", equal, holds=False),
        *_skid_checks("Fig. 20", forward, "14.4 / 33.3 rpm"),
        *_skid_checks("Fig. 21", backward, "-14.4 / -33.3 rpm"),
    ]


def _skid_checks(source: str, turn: SteadyTurn, command: str) -> list[Check]:
    """Statements of Section 6.1 about the wheels; left and right as seen in the direction of travel."""
    way = np.sign(turn.u_mm_s)
    slip, angle = way * turn.wheels.slip_ratio, way * np.degrees(turn.wheels.slip_angle_rad)
    return [
        statement(
            source,
            f"{command}: driving wheel 1 (inner) over its input, 2 (outer) under",
            "faster, slower",
            f"by {slip[0]:+.3f}, {slip[1]:+.3f} of the larger speed",
            slip[0] > 0 > slip[1],
        ),
        statement(
            source,
            f"{command}: skid of the driving and of the driven wheels",
            "to the left, to the right",
            "slip angles " + ", ".join(f"{value:+.1f}°" for value in angle),
            (angle[:2] > 0).all() and (angle[2:] < 0).all(),
        ),
    ]


def scope() -> list[Check]:
    """Published results that are not computed, each with the reason."""
    return [
        out_of_scope(
            "Eq. (2), Fig. 2",
            "moments n_j of the ground on the wheels: about the vertical (aligning torque), about the axle",
            "terms without a law",
            "taken as 0; the effects scrub-torque and rolling-drag put them in",
        ),
        out_of_scope(
            "Fig. 16 to 18, 22",
            "points measured with the prototype",
            "figures only",
            "no numbers are published; only the words on them are checked",
        ),
        out_of_scope("Sec. 5.1", "climbing a vertical wall", "six magnetic wheels", "motion on a level plate alone"),
        out_of_scope("Sec. 5.1", "micro-connectors, flaw-detection device", "described", "no part in the motion"),
    ]
