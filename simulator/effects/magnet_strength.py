"""Magnetic attraction of the driving and of the driven wheels is off by a factor each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    draft.attraction_factor[:2] *= values["driving_factor"]
    draft.attraction_factor[2:] *= values["driven_factor"]


EFFECT = Effect(
    id="magnet-strength",
    name="magnets are stronger or weaker than stated",
    kind="dynamics",
    where="contact",
    depends="constant",
    pattern="front-rear",
    parameters=(
        Parameter("driving_factor", "", 1.0, 0.3, 3.0, 0.02, at_least=0.0),
        Parameter("driven_factor", "", 1.0, 0.1, 6.0, 0.05, at_least=0.0),
    ),
    act=_act,
)
