"""Left and right driving wheels are attracted unequally: left_over_right is the ratio, the mean attraction is kept."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    ratio = values["left_over_right"]
    draft.attraction_factor[0] *= 2 * ratio / (1 + ratio)
    draft.attraction_factor[1] *= 2 / (1 + ratio)


EFFECT = Effect(
    id="magnet-imbalance",
    name="the driving wheels are attracted unequally",
    kind="dynamics",
    where="contact",
    depends="constant",
    pattern="left-right",
    parameters=(Parameter("left_over_right", "", 1.0, 0.3, 3.0, 0.02, at_least=0.01),),
    act=_act,
)
