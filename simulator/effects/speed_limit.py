"""A drive that limits how fast the wheels turn."""

from __future__ import annotations

from simulator.effects.coordinates import Candidate, Coordinate, Parameters, Scene
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import NO_LIMIT_RPM, Draft
from simulator.effects.parameter import Parameter

WHEEL, AHEAD, TURN = (
    Parameter(name, "rpm", NO_LIMIT_RPM, 1.0, 0.0, NO_LIMIT_RPM, at_least=0.0, shown=20.0)
    for name in ("wheel_rpm", "ahead_rpm", "turn_rpm")
)
USUAL_RPM = 60.0  # of a session that commands nothing: some command for scale
# Share of the largest command at which a fit begins to limit: a limit that nothing exceeds has no slope.
BEGIN = 0.6
# Of the largest command, what a step of a fit moves a limit of that size by, and the least that a limit may be.
STEP, LEAST = 0.02, 0.02
MOST_RATIO = 10.0  # of the limit of a wheel over that of speed ahead or of turning: beyond, the robot hardly does it


def _act(draft: Draft, values: Values) -> None:
    limits = (values[item.name] for item in (WHEEL, AHEAD, TURN))
    draft.limits_rpm = tuple(min(old, new) for old, new in zip(draft.limits_rpm, limits, strict=True))


def _fitted(scene: Scene) -> Candidate:
    """The inverse of the wheels' limit, nought where there is none, and how many times lower the other two are."""
    largest = max(scene.command_levels_rpm, default=0.0) or USUAL_RPM
    slowness = Coordinate("min_per_rev", 0.0, STEP / largest, 0.0, 1 / (LEAST * largest), closed=True)
    ratios = (Coordinate(f"wheel_over_{part}", 0.0, STEP, 0.0, MOST_RATIO, closed=True) for part in ("ahead", "turn"))

    def physical(values: tuple[float, ...]) -> Parameters:
        slow, ahead, turn = values
        inverse = (slow, slow * ahead, slow * turn)
        names = (WHEEL.name, AHEAD.name, TURN.name)
        return {name: 1 / max(item, 1 / NO_LIMIT_RPM) for name, item in zip(names, inverse, strict=True)}

    starts = tuple((1 / (BEGIN * largest), ratio, ratio) for ratio in (0.0, 1.0))
    return Candidate("speed-limit", (slowness, *ratios), physical, starts)


EFFECT = Effect(
    id="speed-limit",
    name="the drive limits the speed of the wheels",
    sentence="No wheel turns faster than wheel_rpm; what both sides have in common is limited to ahead_rpm before, and "
    "what each turns faster or slower than that to turn_rpm.",
    law="common = clip((n_left + n_right)/2, ±ahead_rpm), half = clip((n_right − n_left)/2, ±turn_rpm), "
    "n = clip(common ∓ half, ±wheel_rpm)",
    source="limits of linear and angular velocity of drive controllers (ros2_controllers, diff_drive_controller) and "
    "of motor controllers; measured on the wheels of a Clearpath Husky and a Warthog (tests/benchmarks)",
    limits="The same forward and backward, and sharp. Of a command that ramps the ends are limited, and the ramp lies "
    f"straight between them. {NO_LIMIT_RPM:g} rpm are no limit.",
    kind="command",
    parameters=(WHEEL, AHEAD, TURN),
    act=_act,
    fitted=_fitted,
    of_ground=True,
)
