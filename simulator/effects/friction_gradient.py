"""Friction of a wheel at plate position (x, y) is nominal · (1 + per_mm_x·x + per_mm_y·y), never below 2 %."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.dynamics.terms import FRICTION, Term, X, Y
from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    draft.add(
        Term(FRICTION, X, values["per_mm_x"]),
        Term(FRICTION, Y, values["per_mm_y"]),
    )


EFFECT = Effect(
    id="friction-gradient",
    name="friction changes across the plate",
    kind="dynamics",
    where="plate field",
    depends="place",
    pattern="common",
    parameters=(
        Parameter("per_mm_x", "1/mm", 0.0, -0.03, 0.03, 0.0005),
        Parameter("per_mm_y", "1/mm", 0.0, -0.03, 0.03, 0.0005),
    ),
    act=_act,
)
