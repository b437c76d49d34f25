"""Driving wheels that are attracted unequally."""

from __future__ import annotations

from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter


def _act(draft: Draft, values: Values) -> None:
    ratio = values["left_over_right"]
    draft.attraction_factor[draft.layout.left] *= 2 * ratio / (1 + ratio)
    draft.attraction_factor[draft.layout.right] *= 2 / (1 + ratio)


EFFECT = Effect(
    id="magnet-imbalance",
    name="the driving wheels are attracted unequally",
    sentence="The left driving wheels are attracted left_over_right times as strongly as the right ones; their mean "
    "attraction is kept.",
    law="A_left = 2q/(1 + q) · A, A_right = 2/(1 + q) · A, q = left_over_right, A: stated attraction of a driving "
    "wheel",
    source="balance of forces: the load of a wheel is its weight share plus its attraction",
    limits="The attraction is constant over place and time: a plate of even thickness and permeability.",
    kind="dynamics",
    parameters=(Parameter("left_over_right", "", 1.0, 0.02, 0.2, 5.0, at_least=0.01, shown=4.0),),
    act=_act,
)
