"""Friction that changes across the plate."""

from __future__ import annotations

from dataclasses import replace

from simulator.dynamics.terms import FRICTION, Term, X, Y
from simulator.effects.coordinates import Candidate, Scene, plain
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter

PER_MM = (
    Parameter("per_mm_x", "1/mm", 0.0, 1e-3, -0.05, 0.05, shown=-0.05),
    Parameter("per_mm_y", "1/mm", 0.0, 1e-3, -0.05, 0.05, shown=0.05),
)


def _act(draft: Draft, values: Values) -> None:
    draft.add(
        Term(FRICTION, X, values["per_mm_x"]),
        Term(FRICTION, Y, values["per_mm_y"]),
    )


def _fitted(scene: Scene) -> Candidate:
    """Coordinates bounded where friction would double or vanish within reach, if that is more than by size.

    Large robots drive over fewer of their lengths: by size alone, friction might change by a third over half a metre.
    """
    most = 1.0 / scene.reach_mm if scene.reach_mm > 0 else 0.0
    sized = [item.sized(scene.size) for item in PER_MM]
    return plain("friction-gradient", [replace(p, low=min(p.low, -most), high=max(p.high, most)) for p in sized])


EFFECT = Effect(
    id="friction-gradient",
    name="friction changes across the plate",
    sentence="The friction of a wheel at (x, y) of the plate is the nominal one times 1 + per_mm_x·x + per_mm_y·y.",
    law="μ(x, y) = μ_nominal · (1 + per_mm_x·x + per_mm_y·y)",
    source="Taylor series of a coefficient that varies with place, cut after its linear term",
    limits="Only changes over the whole plate; the effect does not describe a stain or a scratch. Friction never falls "
    "below 2 % of the nominal one. The stiffness for small slip does not change. Of two changes of friction by "
    "different effects, such as this one and friction-grain, the factors are multiplied.",
    kind="dynamics",
    of_plate=True,
    parameters=PER_MM,
    act=_act,
    fitted=_fitted,
)
