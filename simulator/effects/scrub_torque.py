"""Contact patches that resist spinning about the vertical."""

from __future__ import annotations

from simulator.dynamics.terms import MOMENT, SIGN_YAW, Term
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter


def _act(draft: Draft, values: Values) -> None:
    def resist(complete: Draft) -> None:
        _, load = complete.loads_uN()
        complete.add(Term(MOMENT, SIGN_YAW, -values["radius_mm"] * float(load.sum())))

    draft.finally_do(resist)


EFFECT = Effect(
    id="scrub-torque",
    name="contact patches resist turning on the spot",
    sentence="Every contact patch resists spinning about the vertical by radius_mm times its load, against the yaw "
    "rate: the aligning moments n_j of Eq. (2).",
    law="M = −radius_mm · Σ f_z · sign(yaw rate)",
    source="Coulomb spin of a patch of radius a: radius_mm = 2/3·μ·a at even pressure, 3π/16·μ·a at Hertz's (Johnson, "
    "Contact Mechanics)",
    limits="A patch that slides as well resists its spin less, in proportion to a·(yaw rate)/(sliding speed) once "
    "that is small (Contensou 1963): the law is that of a rolling or standing wheel. Rounded off below 1e-4 rad/s.",
    kind="dynamics",
    parameters=(Parameter("radius_mm", "mm", 0.0, 0.005, 0.0, 2.0, at_least=0.0),),
    act=_act,
)
