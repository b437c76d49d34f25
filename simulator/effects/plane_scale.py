"""Millimetres that are off by a factor."""

from __future__ import annotations

from simulator.effects.definition import Effect, Values
from simulator.effects.parameter import OF_METRES, Parameter
from simulator.effects.view import View


def _view(view: View, values: Values) -> None:
    view.scale *= values["factor"]


EFFECT = Effect(
    id="plane-scale",
    name="millimetres are off by a factor",
    sentence="Measured coordinates are factor times the true ones.",
    law="(x, y) measured = factor · (x, y)",
    source="pinhole camera: a plane nearer by dh at the distance h is seen larger by h/(h − dh); or a gauge whose "
    "pitch is not the stated one",
    limits="The same factor all over the image and in both directions; about the origin of the plate frame.",
    kind="observation",
    parameters=(Parameter("factor", "", 1.0, 0.005, 0.5, 2.0, at_least=0.01, on_ground=OF_METRES),),
    view=_view,
)
