"""Statements of the text about the slip characteristics in Figures 3, 7 and 8, compared with the shipped laws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simulator.nominal_robot import Slip
from simulator.paper.checks import FITTED, Check, number, standing, statement
from simulator.paper.machines import TIRE_PEAK_FRICTION, tire_machine
from simulator.robot import load_robot
from simulator.slip.curves import law_parameters, normalized_forces

FLAT_RATIO = 0.4  # Figure 7 (a): flat beyond it
FLATNESS = 0.05  # of the maximum: largest change of a curve that is called flat
SETTLED_ANGLE_DEG = 60.0  # where "afterwards" has been reached; the figures' angles go on to 75 and 90


@dataclass(frozen=True)
class SlipShape:
    """Features of a slip law: longitudinal force at slip angle 0, lateral force at slip ratio 0, over f_z."""

    longitudinal_peak: float
    longitudinal_peak_ratio: float
    longitudinal_end: float
    longitudinal_change: float
    lateral_peak: float
    lateral_peak_deg: float
    lateral_settled: float
    lateral_end: float


def slip_shape(slip: Slip) -> SlipShape:
    """Features of a law's curves as Section 3 describes them."""
    ratios, angles = np.linspace(0.0, 1.0, 1001), np.linspace(0.0, 90.0, 1801)
    along, _ = normalized_forces(law_parameters(slip), ratios, 0.0)
    _, across = normalized_forces(law_parameters(slip), 0.0, np.radians(angles))
    beyond = along[ratios >= FLAT_RATIO]
    return SlipShape(
        longitudinal_peak=float(along.max()),
        longitudinal_peak_ratio=float(ratios[along.argmax()]),
        longitudinal_end=float(along[-1]),
        longitudinal_change=float((beyond.max() - beyond.min()) / along.max()),
        lateral_peak=float(across.max()),
        lateral_peak_deg=float(angles[across.argmax()]),
        lateral_settled=float(np.interp(SETTLED_ANGLE_DEG, angles, across)),
        lateral_end=float(across[-1]),
    )


def slip_checks() -> list[Check]:
    """Figures 3, 7 and 8 in words."""
    tire = slip_shape(tire_machine(friction=TIRE_PEAK_FRICTION).slip)
    column, barrel = slip_shape(load_robot("column").slip), slip_shape(load_robot("barrel").slip)
    fitted = [*_column_checks(column), *_barrel_checks(column, barrel)]
    return [*_tire_checks(tire), *standing(fitted, FITTED)]


def _tire_checks(tire: SlipShape) -> list[Check]:
    at_ratio, at_angle = (
        f"falls beyond {tire.longitudinal_peak_ratio:.2f}",
        f"falls beyond {tire.lateral_peak_deg:.1f}°",
    )
    friction = f"tire, mu_0 = {TIRE_PEAK_FRICTION}"
    peaks = [  # mu_0 was set to them
        number("Fig. 3a", f"longitudinal peak over f_z, {friction}", 0.8, tire.longitudinal_peak, "", 0.1, 3),
        number("Fig. 3b", f"lateral peak over f_z, {friction}", 0.8, tire.lateral_peak, "", 0.1, 3),
    ]
    return [
        *standing(peaks, FITTED),
        statement(
            "Fig. 3a",
            "longitudinal force, tire",
            "falls beyond 0.2",
            at_ratio,
            0.15 < tire.longitudinal_peak_ratio < 0.25,
        ),
        statement("Fig. 3b", "lateral force, tire", "falls beyond 10°", at_angle, 7.5 < tire.lateral_peak_deg < 15),
    ]


def _column_checks(column: SlipShape) -> list[Check]:
    flat = f"changes by {column.longitudinal_change:.1%}"
    after = f"{column.lateral_settled:.3f} at 60°, {column.lateral_end:.3f} at 90°"
    settled = column.lateral_end > 0.145 and column.lateral_settled < 0.205
    return [
        number("Fig. 7a", "longitudinal peak over f_z, column", 0.15, column.longitudinal_peak, "", 0.01, 3),
        statement(
            "Fig. 7a", "beyond slip ratio 0.4, column", "flat", flat, column.longitudinal_change < FLATNESS * 1.01
        ),
        number("Fig. 7b", "lateral peak over f_z, column", 0.25, column.lateral_peak, "", 0.01, 3),
        statement("Fig. 7b", "lateral force after the peak, column", "about 0.15 to 0.2", after, settled),
    ]


def _barrel_checks(column: SlipShape, barrel: SlipShape) -> list[Check]:
    rows = (
        ("Fig. 8a", "longitudinal force at slip ratio 1", column.longitudinal_end, barrel.longitudinal_end),
        ("Fig. 8b", "lateral peak", column.lateral_peak, barrel.lateral_peak),
        ("Fig. 8b", "lateral force at 90°", column.lateral_end, barrel.lateral_end),
    )
    return [
        statement(
            source,
            f"{what}, barrel against column",
            "slightly smaller",
            f"{ours:.3f} against {reference:.3f} ({ours / reference - 1:+.1%})",
            0.9 < ours / reference < 0.995,
        )
        for source, what, reference, ours in rows
    ]
