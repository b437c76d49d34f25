"""Driven wheels that resist rolling."""

from __future__ import annotations

from simulator.dynamics.terms import DRAG, SIGN_U, Term
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter


def _act(draft: Draft, values: Values) -> None:
    def brake(complete: Draft) -> None:
        _, load = complete.loads_uN()
        for wheel in complete.layout.rolling.nonzero()[0]:
            only = tuple(float(number == wheel) for number in range(len(load)))
            complete.add(Term(DRAG, SIGN_U, -values["coefficient"] * float(load[wheel]), only))

    draft.finally_do(brake)


EFFECT = Effect(
    id="rolling-drag",
    name="the driven wheels resist rolling",
    sentence="Each driven wheel is braked along its rolling direction by coefficient times its load, against its "
    "motion.",
    law="F_x = −coefficient · f_z · sign(u), u: forward speed of the wheel",
    source="rolling resistance (Wong, Theory of Ground Vehicles)",
    limits="Independent of speed; rounded off at rest. The brake does not reduce the lateral grip of the wheel, which "
    "is true if coefficient is far below the friction coefficient. Casters and balls, which roll in any direction, "
    "are not braked.",
    kind="dynamics",
    parameters=(Parameter("coefficient", "", 0.0, 0.002, 0.0, 0.5, at_least=0.0, shown=0.3),),
    act=_act,
)
