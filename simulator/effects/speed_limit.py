"""A drive that limits how fast the wheels turn."""

from __future__ import annotations

from itertools import pairwise

from simulator.effects.coordinates import Candidate, Coordinate, Parameters, Scene
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import NO_LIMIT_RPM, Draft
from simulator.effects.parameter import Parameter

WHEEL, AHEAD, TURN = (
    Parameter(name, "rpm", NO_LIMIT_RPM, 1.0, 0.0, NO_LIMIT_RPM, at_least=0.0, shown=20.0)
    for name in ("wheel_rpm", "ahead_rpm", "turn_rpm")
)
FASTEST = 3  # gaps of the commands in which a fit begins
STEP = 0.005  # relative, of a limit: a speed change of this size is visible in the marks (drive-speed-scale)


def _act(draft: Draft, values: Values) -> None:
    limits = (values[item.name] for item in (WHEEL, AHEAD, TURN))
    draft.limits_rpm = tuple(min(old, new) for old, new in zip(draft.limits_rpm, limits, strict=True))


def _fitted(scene: Scene) -> Candidate:
    """Coordinates: inverses of the three limits, 0 without a limit.

    A limit above all commands has no effect, and one below all commands is the same as a slower drive. A fit begins
    with all three at the median or at the upper quartile of the commanded speeds. Without the second start the limits
    of a Warthog, which concern few of its commands, were never tried, and a drag was found in their place. On a plate,
    whose few commands are far apart, a fit also begins between each of the fastest and the next: from 33 rpm on, a
    limit of 41 of commands of 45 and 60 rpm promised less than gains of the runs by a tenth and a third.
    """
    slowness = 1 / scene.usual_rpm
    levels = sorted({round(level, 6) for level in scene.command_levels_rpm if level >= scene.usual_rpm})
    between = [] if scene.size.on_ground else [2 / sum(pair) for pair in pairwise(levels)][-FASTEST:]
    parts = tuple(
        Coordinate(f"min_per_rev_{item.name.removesuffix('_rpm')}", 0.0, STEP * slowness, 0.0, closed=True)
        for item in (WHEEL, AHEAD, TURN)
    )

    def physical(values: tuple[float, ...]) -> Parameters:
        names = (WHEEL.name, AHEAD.name, TURN.name)
        return {name: 1 / max(item, 1 / NO_LIMIT_RPM) for name, item in zip(names, values, strict=True)}

    starts = tuple((begin,) * 3 for begin in (slowness, 1 / scene.fast_rpm, *between))
    return Candidate("speed-limit", parts, physical, starts)


EFFECT = Effect(
    id="speed-limit",
    name="the drive limits the speed of the wheels",
    sentence="The mean speed of both sides is limited to ahead_rpm and half of their difference to turn_rpm; then each "
    "wheel is limited to wheel_rpm.",
    law="common = clip((n_left + n_right)/2, ±ahead_rpm), half = clip((n_right − n_left)/2, ±turn_rpm), "
    "n = clip(common ∓ half, ±wheel_rpm)",
    source="limits of linear and angular velocity of drive controllers (ros2_controllers, diff_drive_controller) and "
    "of motor controllers; measured on the wheels of a Clearpath Husky and a Warthog (tests/benchmarks)",
    limits="The limits are equal forward and backward, and sharp. If a command changes linearly, its first and last "
    f"values are limited and joined by a straight line. {NO_LIMIT_RPM:g} rpm are no limit.",
    kind="command",
    parameters=(WHEEL, AHEAD, TURN),
    act=_act,
    fitted=_fitted,
    of_ground=True,
)
