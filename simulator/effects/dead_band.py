"""Motors that do not turn at small commands."""

from __future__ import annotations

from simulator.effects.coordinates import Candidate, Parameters, Scene, coordinate
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter

RPM = Parameter("rpm", "rpm", 0.0, 1.0, 0.0, 1e3, at_least=0.0)


def _act(draft: Draft, values: Values) -> None:
    draft.dead_band_rpm = max(draft.dead_band_rpm, values["rpm"])


def _fitted(scene: Scene) -> Candidate:
    """The band lies between two levels that commands hold or pass, or above the largest; no run determines it better.

    On open ground it is not tried above the largest command: there the noise is estimated from the misfit of the model,
    so that a robot that never moves could be the best of several bad models although every recording shows motion.
    """
    passed = scene.passed_rpm or scene.command_levels_rpm
    levels = sorted({round(level, 6) for level in passed if level > 0})
    gaps = tuple(zip(levels, [*levels[1:], 2 * levels[-1]], strict=True)) if levels else ()
    gaps = gaps[:-1] if scene.size.on_ground else gaps

    def physical(values: tuple[float, ...]) -> Parameters:
        return {"rpm": float(values[0])}

    starts = tuple(((low + high) / 2,) for low, high in gaps)
    return Candidate("dead-band", (coordinate(RPM),), physical, starts, stepwise=True, between=gaps)


EFFECT = Effect(
    id="dead-band",
    name="the motors do not turn at small commands",
    sentence="A motor does not turn while its command is below rpm in size; from there on it turns as commanded.",
    law="n = 0 where |n_commanded| < rpm, else n = n_commanded",
    source="dead zone of a motor with static friction (Olsson et al. 1998, European Journal of Control 4, 176)",
    limits="The same for both motors and directions, without hysteresis: a real motor that turns already keeps "
    "turning below the command at which it starts.",
    kind="command",
    parameters=(RPM,),
    act=_act,
    fitted=_fitted,
)
