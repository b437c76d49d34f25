"""A plate that is not level."""

from __future__ import annotations

import math

from simulator.dynamics.terms import COS, FORCE_PLATE_X, FORCE_PLATE_Y, MOMENT, ONE, SIN, Term
from simulator.effects.coordinates import polar
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter

ANGLE = Parameter("angle_deg", "deg", 0.0, 0.2, 0.0, 45.0, shown=20.0)
AZIMUTH = Parameter("azimuth_deg", "deg", 0.0, 5.0, 0.0, 360.0, period=360.0, shown=90.0)


def _act(draft: Draft, values: Values) -> None:
    angle, azimuth = math.radians(values["angle_deg"]), math.radians(values["azimuth_deg"])

    def pull(complete: Draft) -> None:
        weight, (x, y) = complete.robot.weight_uN * math.sin(angle), complete.gravity_mm
        pull_x, pull_y = weight * math.cos(azimuth), weight * math.sin(azimuth)
        complete.add(
            Term(FORCE_PLATE_X, ONE, pull_x),
            Term(FORCE_PLATE_Y, ONE, pull_y),
            Term(MOMENT, COS, x * pull_y - y * pull_x),
            Term(MOMENT, SIN, -x * pull_x - y * pull_y),
        )

    draft.finally_do(pull)


EFFECT = Effect(
    id="plate-tilt",
    name="the plate is not level",
    sentence="The plate slopes by angle_deg and descends toward azimuth_deg, counter-clockwise from +x of the plate.",
    law="F = m·g·sin(angle_deg) toward azimuth_deg, at the centre of gravity",
    source="weight on an inclined plane; g = 9.8 m/s², as in the paper",
    limits="The loads of the wheels keep their level values: cos(angle_deg) takes 0.4 % of the weight at 5 degrees, "
    "and the height of the centre of gravity over the wheelbase shifts some of it downhill; beside the magnetic "
    "attraction both are small.",
    kind="dynamics",
    of_plate=True,
    parameters=(ANGLE, AZIMUTH),
    act=_act,
    fitted=lambda _: polar("plate-tilt", ANGLE, AZIMUTH),
)
