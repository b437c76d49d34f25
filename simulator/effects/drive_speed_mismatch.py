"""Driving wheels of unequal surface speed."""

from __future__ import annotations

from typing import Any

import numpy as np

from simulator.effects.definition import Draws, Effect, SingleCause, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter


def _act(draft: Draft, values: Values) -> None:
    left, right = _shares(values["left_over_right"])
    draft.speed_factor *= (left, right)


def _shares(ratio: Any) -> tuple[Any, Any]:
    """Factors on the left and the right speed with the given ratio and mean 1."""
    return 2 * ratio / (1 + ratio), 2 / (1 + ratio)


def _one_wheel(draws: Draws) -> str:
    """Name the single faulty wheel: its speed differs from the command (95 %), that of the other wheel may not."""
    left_sound, right_sound = (
        bool(np.percentile(speed, 2.5) <= 1.0 <= np.percentile(speed, 97.5))
        for speed in (draws["factor"] * share for share in _shares(draws["left_over_right"]))
    )
    if left_sound == right_sound:
        return ""
    return f"the {'left' if right_sound else 'right'} wheel alone is off"


EFFECT = Effect(
    id="drive-speed-mismatch",
    name="the driving wheels differ in surface speed at equal command",
    sentence="At equal command the left driving wheel's surface is left_over_right times as fast as the right one's; "
    "their mean is kept.",
    law="v_left = 2q/(1 + q) · r·ω_left, v_right = 2/(1 + q) · r·ω_right, q = left_over_right",
    source="rolling, v = r·ω, with unequal r or unequal gain of the motors (unequal wheel diameters of odometry: "
    "Borenstein & Feng 1996, IEEE Trans. Robotics and Automation 12, 869)",
    limits="The same ratio at all speeds and loads. Unequal radii and unequal motor gains look alike from above. The "
    "tilt of a robot with unequal wheels, and the change of their loads, are left out.",
    kind="dynamics",
    parameters=(Parameter("left_over_right", "", 1.0, 0.005, 0.5, 2.0, at_least=0.01),),
    act=_act,
    single_cause=SingleCause("drive-speed-scale", _one_wheel),
)
