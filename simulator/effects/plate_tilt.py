"""The plate slopes by angle_deg and descends toward azimuth_deg (plate frame, counter-clockwise from +x).

The weight pulls with m·g·sin(angle) toward the descent, at the centre of gravity; loads keep their level values (cos of
a few degrees, and the lever of the height over the wheelbase, change them by less than the attraction's tolerance).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from simulator.dynamics.terms import COS, FORCE_PLATE_X, FORCE_PLATE_Y, MOMENT, ONE, SIN, Term
from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


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
    kind="dynamics",
    where="body force",
    depends="heading",
    pattern="common",
    parameters=(
        Parameter("angle_deg", "deg", 0.0, 0.0, 20.0, 0.1),
        Parameter("azimuth_deg", "deg", 0.0, -180.0, 180.0, 5.0),
    ),
    act=_act,
)
