"""A camera that exposes the rows of a frame one after another."""

from __future__ import annotations

from simulator.effects.definition import Effect, Values
from simulator.effects.parameter import Parameter
from simulator.effects.view import View

SLOWEST = 10.0  # ms/mm: rows that take a frame of 30 a second for a robot of a few millimetres


def _view(view: View, values: Values) -> None:
    x, y = view.delay_s_per_mm
    view.delay_s_per_mm = (x + values["x_ms_per_mm"] / 1000, y + values["y_ms_per_mm"] / 1000)


EFFECT = Effect(
    id="rolling-shutter",
    name="the rows of a frame are exposed one after another",
    sentence="A mark is seen later than the time of its frame by x_ms_per_mm times its x plus y_ms_per_mm times its y "
    "in the plate frame (a negative delay: earlier).",
    law="(x, y) measured at t = (x, y) true at t + delay, delay = x_ms_per_mm · x + y_ms_per_mm · y",
    source="rolling shutter: the time of a row is proportional to its number (Meingast, Geyer & Sastry 2005, Geometric "
    "models of rolling-shutter cameras)",
    limits="The time of a frame is that of the row through the origin of the plate frame. Rows are straight lines "
    "on the plate. Not rendered: a rendered camera exposes all rows at once.",
    kind="observation",
    of_plate=True,
    parameters=(
        Parameter("x_ms_per_mm", "ms/mm", 0.0, 0.1, -SLOWEST, SLOWEST, shown=8.0),
        Parameter("y_ms_per_mm", "ms/mm", 0.0, 0.1, -SLOWEST, SLOWEST, shown=8.0),
    ),
    view=_view,
)
