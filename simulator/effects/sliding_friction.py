"""Friction that opposes the velocity at which wheels slide."""

from __future__ import annotations

from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter


def _act(draft: Draft, values: Values) -> None:
    draft.sliding_share = min(draft.sliding_share + values["share"], 1.0)


EFFECT = Effect(
    id="sliding-friction",
    name="friction opposes the sliding of the wheels",
    sentence="The given share of the friction of each wheel opposes the sliding velocity of its contact; the rest "
    "follows slip ratio and slip angle.",
    law="F = (1 − share) · F(s, α) + share · F(σ_x, σ_y), (σ_x, σ_y) = (u − r·φ', v) / max(√(u² + v²), |r·φ'|)",
    source="theoretical slip (Pacejka 2012, Tire and Vehicle Dynamics, section 4.2)",
    limits="The two laws agree if wheels hardly slide sideways, but not in a turn on the spot, where the slip angle "
    "of a wheel's centre does not depend on how fast the wheel spins.",
    kind="dynamics",
    parameters=(Parameter("share", "", 0.0, 0.05, 0.0, 1.0, at_least=0.0, closed=True),),
    act=_act,
    of_ground=True,
)
