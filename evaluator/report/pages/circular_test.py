"""The steady-state circular test: radius and sideslip against lateral acceleration, measured and simulated."""

from __future__ import annotations

import numpy as np

from evaluator.report.numbers import SERIES_HEAD, series_row
from evaluator.report.pages.colors import INK
from evaluator.report.pages.html import Section, Table
from evaluator.report.style import MEASURED, SIMULATED, Figure, drawing
from evaluator.workflow import CircularResult, circular_test_table

CAPTION = (
    "Understeer gradient: additional commanded curvature per m/s² of lateral acceleration, as the equivalent steering "
    "angle at the robot's wheelbase; positive: the faster, the wider the turn. Command over path: curvature of rolling "
    "without slip over the measured curvature, extrapolated to speed 0. In brackets: 95 % interval from the scatter of "
    "the runs about the line."
)


def circular_test_section(found: CircularResult) -> Section | None:
    """The section of a circular test; None if no command and no radius was driven at three speeds."""
    if found.measured is None or not found.measured.series:
        return None
    rows = [
        tuple(series_row(name, test.series[number]))
        for number in range(len(found.measured.series))
        for name, test in (("measured", found.measured), ("simulated", found.simulated))
    ]
    text = "Turns at three speeds or more, by side and direction (ISO 4138, SAE J266)."
    return Section(
        "circular-test",
        "Steady-state circular test",
        (text,),
        (_figure(found),),
        (Table(CAPTION, SERIES_HEAD, tuple(rows)),),
    )


def _figure(found: CircularResult) -> Figure:
    """Radius relative to slow turns, and sideslip at the centre, over lateral acceleration."""
    assert found.measured is not None
    sides = (("measured", MEASURED, found.measured), ("simulated", SIMULATED, found.simulated))
    with drawing("circular-test", width=7.2, columns=2) as canvas:
        wider, sideslip = canvas.axes
        for name, look, test in sides:
            rows = test.points[test.points["series"] >= 0]
            slow = np.array([test.series[number].curvature_per_mm for number in rows["series"]])
            across = rows["lateral_acceleration_mm_s2"].to_numpy()
            wider.plot(across, rows["radius_mm"].to_numpy() * slow, label=name, **look.markers())
            sideslip.plot(across, rows["sideslip_deg"].to_numpy(), **look.markers())
        wider.axhline(1, color=INK, lw=0.6)
        sideslip.axhline(0, color=INK, lw=0.6)
        wider.set_ylabel("radius / radius of slow turns")
        sideslip.set_ylabel("sideslip at the centre, out of the turn, °")
        for axes in canvas.axes:
            axes.set_xlabel("lateral acceleration, mm/s²")
        wider.legend()
    caption = (
        "Rising to the right: understeer. Each point is a run; simulated points are steady turns of the model at the "
        "same commands."
    )
    return Figure(
        "circular-test", "Radius and sideslip against speed", caption, (canvas.svg,), circular_test_table(found)
    )
