"""Motors that follow commands late."""

from __future__ import annotations

from simulator.effects.coordinates import Candidate, Coordinate, Parameters, Scene
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter

DEAD_TIME = Parameter("dead_time_s", "s", 0.0, 0.01, 0.0, 2.0, at_least=0.0, shown=0.5)
TIME_CONSTANT = Parameter("time_constant_s", "s", 0.0, 0.01, 0.0, 2.0, at_least=0.0, shown=0.5)
# Initial values of a fit to a robot of a metre: delay, s, and share. Drives of this size follow within some hundredths
# of a second (servo drives) to half a second (speed controllers with ramps).
DELAYS = ((0.05, 0.5), (0.3, 0.5))
# And to a robot on a plate, whose small motors follow within some milliseconds to hundredths of a second.
DELAYS_ON_PLATE = ((0.02, 0.5),)


def _act(draft: Draft, values: Values) -> None:
    draft.dead_time_s += values["dead_time_s"]
    draft.lag_s += values["time_constant_s"]


def _fitted(scene: Scene) -> Candidate:
    """Coordinates: total delay (dead time + time constant), and the time constant's share of it.

    To first order wheels follow late by the total; the share acts by the square of the time constant, so that in the
    two times themselves every fit at time constant 0 would be a stationary point. At zero delay the share has no slope,
    and the delay that of a later start; hence the initial values. Without them, in a session at 300 rpm whose motors
    lagged by 8 ms, magnets of 3.5 times the strength were named, with a log evidence 45 lower. For a robot of a metre,
    half a second of delay moves the following path too far for a linearization at zero delay.
    """

    def physical(values: tuple[float, ...]) -> Parameters:
        delay, share = values
        return {"dead_time_s": delay * (1 - share**0.5), "time_constant_s": delay * share**0.5}

    delay = Coordinate("delay_s", 0.0, DEAD_TIME.step, DEAD_TIME.low, DEAD_TIME.high)
    starts = DELAYS if scene.size.on_ground else DELAYS_ON_PLATE
    return Candidate("command-lag", (delay, Coordinate("share", 0.0, 0.1, 0.0, 1.0, closed=True)), physical, starts)


EFFECT = Effect(
    id="command-lag",
    name="the motors follow commands late",
    sentence="Both motors wait for dead_time_s, then follow the command with the time constant time_constant_s.",
    law="time_constant_s · dn/dt = n_commanded(t − dead_time_s) − n",
    source="first-order lag with dead time (Åström & Hägglund, Advanced PID Control)",
    limits="Linear and equal for both motors and directions: no limit of current or acceleration. When the run begins, "
    "the motors already turn at the first value of the command.",
    kind="command",
    parameters=(DEAD_TIME, TIME_CONSTANT),
    act=_act,
    fitted=_fitted,
)
