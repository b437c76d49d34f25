"""Drag proportional to velocity: force against the velocity of the centre, moment against the yaw rate."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.dynamics.terms import FORCE_FORWARD, FORCE_LEFT, MOMENT, YAW, Term, U, V
from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    force = 1000 * values["force_mN_s_mm"]
    draft.add(
        Term(FORCE_FORWARD, U, -force),
        Term(FORCE_LEFT, V, -force),
        Term(MOMENT, YAW, -values["moment_uN_mm_s"]),
    )


EFFECT = Effect(
    id="viscous-drag",
    name="drag grows with speed, as from an oil film",
    kind="dynamics",
    where="body force",
    depends="v",
    pattern="common",
    parameters=(
        Parameter("force_mN_s_mm", "mN·s/mm", 0.0, 0.0, 2.0, 0.01, at_least=0.0),
        Parameter("moment_uN_mm_s", "µN·mm·s", 0.0, 0.0, 20000.0, 100.0, at_least=0.0),
    ),
    act=_act,
)
