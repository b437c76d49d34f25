"""Measured times are the true ones times factor, as from a wrong frame rate."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.effects.view import View


def _view(view: View, values: Values) -> None:
    view.time_factor *= values["factor"]


EFFECT = Effect(
    id="time-base",
    name="seconds are off by a factor",
    kind="observation",
    where="observation",
    depends="constant",
    pattern="common",
    parameters=(Parameter("factor", "", 1.0, 0.9, 1.1, 0.001, at_least=0.01),),
    view=_view,
)
