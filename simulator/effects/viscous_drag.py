"""Drag that grows with speed."""

from __future__ import annotations

from simulator.dynamics.terms import FORCE_FORWARD, FORCE_LEFT, MOMENT, UN_PER_MN, YAW, Term, U, V
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter


def _act(draft: Draft, values: Values) -> None:
    force = UN_PER_MN * values["force_mN_s_mm"]
    draft.add(
        Term(FORCE_FORWARD, U, -force),
        Term(FORCE_LEFT, V, -force),
        Term(MOMENT, YAW, -values["moment_uN_mm_s"]),
    )


EFFECT = Effect(
    id="viscous-drag",
    name="drag grows with speed, as from an oil film",
    sentence="A drag of force_mN_s_mm opposes the velocity of the robot's centre, and one of moment_uN_mm_s its yaw "
    "rate.",
    law="F = −force_mN_s_mm · v, M = −moment_uN_mm_s · (yaw rate)",
    source="Couette flow in a film of area A and thickness h: force_mN_s_mm = η·A/h, moment = η/h · ∫ρ² dA "
    "(Batchelor, An Introduction to Fluid Dynamics)",
    limits="A film of constant thickness under the whole body, the same in all directions and centred on the robot; no "
    "drag of inertia of the fluid (∝ v²), no meniscus.",
    kind="dynamics",
    parameters=(
        Parameter("force_mN_s_mm", "mN·s/mm", 0.0, 0.01, 0.0, 10.0, at_least=0.0, shown=1.0),
        Parameter("moment_uN_mm_s", "µN·mm·s", 0.0, 50.0, 0.0, 1e6, at_least=0.0, shown=10000.0),
    ),
    act=_act,
)
