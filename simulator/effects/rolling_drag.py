"""Each driven wheel is braked by coefficient · f_z along its rolling direction, against its motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.dynamics.terms import DRAG, SIGN_U, Term
from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    def brake(complete: Draft) -> None:
        _, load = complete.loads_uN()
        for wheel in (2, 3):
            only = tuple(float(number == wheel) for number in range(4))
            complete.add(Term(DRAG, SIGN_U, -values["coefficient"] * float(load[wheel]), only))

    draft.finally_do(brake)


EFFECT = Effect(
    id="rolling-drag",
    name="the driven wheels resist rolling",
    kind="dynamics",
    where="wheel",
    depends="sign v",
    pattern="front-rear",
    parameters=(Parameter("coefficient", "", 0.0, 0.0, 0.15, 0.002, at_least=0.0),),
    act=_act,
)
