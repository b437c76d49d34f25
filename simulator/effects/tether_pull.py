"""A wire that pulls with a force fixed in the body."""

from __future__ import annotations

from simulator.dynamics.terms import FORCE_FORWARD, FORCE_LEFT, ONE, UN_PER_MN, Term
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter


def _act(draft: Draft, values: Values) -> None:
    draft.add(
        Term(FORCE_FORWARD, ONE, UN_PER_MN * values["x_mN"]),
        Term(FORCE_LEFT, ONE, UN_PER_MN * values["y_mN"]),
    )


EFFECT = Effect(
    id="tether-pull",
    name="a wire pulls with a force fixed in the body",
    sentence="A wire pulls at the robot's centre with a force fixed in the body: x_mN forward, y_mN to the left.",
    law="F = (x_mN, y_mN) in the body frame",
    source="balance of forces: a stiff wire that moves with the robot exerts a constant force in the robot's frame",
    limits="The force does not depend on pose, speed or time. Its line of action passes through the robot's centre: no "
    "moment.",
    kind="dynamics",
    parameters=(
        Parameter("x_mN", "mN", 0.0, 0.05, -20.0, 20.0, shown=0.0),
        Parameter("y_mN", "mN", 0.0, 0.05, -20.0, 20.0, shown=3.0),
    ),
    act=_act,
)
