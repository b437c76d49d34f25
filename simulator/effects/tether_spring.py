"""A wire that pulls toward a fixed anchor."""

from __future__ import annotations

from dataclasses import replace

from simulator.dynamics.terms import FORCE_PLATE_X, FORCE_PLATE_Y, ONE, UN_PER_MN, Term, X, Y
from simulator.effects.coordinates import Candidate, Coordinate, Parameters, Scene, coordinate
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter

STIFFNESS = Parameter("stiffness_mN_mm", "mN/mm", 0.0, 0.005, 0.0, 10.0, at_least=0.0, shown=0.1)
ANCHOR = (Parameter("anchor_x_mm", "mm", 0.0, 2.0, shown=0.0), Parameter("anchor_y_mm", "mm", 0.0, 2.0, shown=30.0))
PULL_STEP_MN = 0.05  # as of tether-pull: a force of this size is visible in the marks
SOFTEST_MN_MM = 1e-9  # a constant force is the limit of a soft spring with a distant anchor


def _act(draft: Draft, values: Values) -> None:
    stiffness = UN_PER_MN * values["stiffness_mN_mm"]
    draft.add(
        Term(FORCE_PLATE_X, ONE, stiffness * values["anchor_x_mm"]),
        Term(FORCE_PLATE_X, X, -stiffness),
        Term(FORCE_PLATE_Y, ONE, stiffness * values["anchor_y_mm"]),
        Term(FORCE_PLATE_Y, Y, -stiffness),
    )


def _fitted(scene: Scene) -> Candidate:
    """Coordinates: stiffness, and force at the origin, in which the response is linear; stiffness 0 has no anchor.

    A force without stiffness is not a spring but the effect tether-pull; a fit that reaches it has reached a bound.
    """
    size = scene.size
    softest_mN_mm = SOFTEST_MN_MM * size.of(STIFFNESS.unit)

    def physical(values: tuple[float, ...]) -> Parameters:
        stiffness, pull_x, pull_y = values
        softest = max(stiffness, softest_mN_mm)
        return {"stiffness_mN_mm": softest, "anchor_x_mm": pull_x / softest, "anchor_y_mm": pull_y / softest}

    pulls = tuple(Coordinate(name, 0.0, PULL_STEP_MN * size.of("mN")) for name in ("pull_x", "pull_y"))
    stiffness = replace(coordinate(STIFFNESS.sized(size)), low=-softest_mN_mm)
    return Candidate("tether-spring", (stiffness, *pulls), physical)


EFFECT = Effect(
    id="tether-spring",
    name="a wire pulls toward a fixed anchor",
    sentence="A spring without slack pulls the robot's centre toward the anchor (anchor_x_mm, anchor_y_mm) of the "
    "plate.",
    law="F = stiffness_mN_mm · (anchor − centre)",
    source="Hooke's law, of a spring with no length of its own: a long coil, or a thin wire that hangs in a bow",
    limits="No slack and no natural length: a straight wire with a free length pulls only beyond it. It acts at the "
    "robot's centre: no moment. Weight and bending of the wire are left out.",
    kind="dynamics",
    of_plate=True,
    parameters=(STIFFNESS, *ANCHOR),
    act=_act,
    fitted=_fitted,
)
