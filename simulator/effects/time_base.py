"""Seconds that are off by a factor."""

from __future__ import annotations

from simulator.effects.definition import Effect, Values
from simulator.effects.parameter import OF_SECONDS, Parameter
from simulator.effects.view import View


def _view(view: View, values: Values) -> None:
    view.time_factor *= values["factor"]


EFFECT = Effect(
    id="time-base",
    name="seconds are off by a factor",
    sentence="Measured times are factor times the true ones.",
    law="t measured = factor · t",
    source="a frame rate that is not the stated one: factor = true rate / stated rate",
    limits="One factor for all runs. start_s and stop_s are times of the recording; a command log that begins at 0 has "
    "the true clock of its controller. The effect does not describe dropped frames or a clock that drifts.",
    kind="observation",
    parameters=(Parameter("factor", "", 1.0, 0.005, 0.5, 2.0, at_least=0.01, on_ground=OF_SECONDS),),
    view=_view,
)
