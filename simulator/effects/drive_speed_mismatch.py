"""Left and right driving wheels have different surface speed at equal command.

left_over_right: ratio of the surface speeds; their mean is kept. Unequal radii and unequal motor gains are the same
thing seen from above.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    ratio = values["left_over_right"]
    draft.speed_factor[0] *= 2 * ratio / (1 + ratio)
    draft.speed_factor[1] *= 2 / (1 + ratio)


EFFECT = Effect(
    id="drive-speed-mismatch",
    name="the driving wheels differ in surface speed at equal command",
    kind="dynamics",
    where="actuator",
    depends="constant",
    pattern="left-right",
    parameters=(Parameter("left_over_right", "", 1.0, 0.8, 1.25, 0.002, at_least=0.01),),
    act=_act,
)
