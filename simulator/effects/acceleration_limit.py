"""A drive that limits how fast the wheels change their speed."""

from __future__ import annotations

import math

from simulator.effects.coordinates import Candidate, Coordinate, Parameters, Scene
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter

NO_LIMIT_RPM_S = 1e6  # an acceleration that no drive reaches
AHEAD, TURN, WHEEL = (
    Parameter(name, "rpm/s", NO_LIMIT_RPM_S, 1.0, 0.0, NO_LIMIT_RPM_S, at_least=1e-3, shown=40.0)
    for name in ("ahead_rpm_s", "turn_rpm_s", "wheel_rpm_s")
)
STEP_S = 0.01  # time to reach full speed: a delay of this size is visible in the marks (command-lag)
# Times to reach the usual speed at the starts of a fit: typical of robots of a metre, and those of smaller ones. From a
# time far above the true one no fit of marks of micrometres converges, and a lag was named for a ramp of 0.25 s.
BEGUN_S, BEGUN_SMALL_S = (0.5,), (0.5, 0.15, 0.05)
LONGEST_S = 10.0  # time to the usual speed that no small motor needs: a limit that does not act shows no other bound


def _act(draft: Draft, values: Values) -> None:
    ramps = (0.0 if values[item.name] >= NO_LIMIT_RPM_S else 1 / values[item.name] for item in (AHEAD, TURN, WHEEL))
    draft.ramps_s_per_rpm = tuple(max(old, new) for old, new in zip(draft.ramps_s_per_rpm, ramps, strict=True))


def _fitted(scene: Scene) -> Candidate:
    """Inverses of the three limits, s/rpm, which are 0 without a limit; a ramp delays motion by half its duration.

    A drive limits its speeds ahead and in turns, or each of its motors: a fit begins with either.
    """
    step = STEP_S / scene.usual_rpm
    most = math.inf if scene.size.full else LONGEST_S / scene.usual_rpm
    parts = tuple(
        Coordinate(f"s_per_rpm_{item.name.removesuffix('_rpm_s')}", 0.0, step, 0.0, most, closed=True)
        for item in (AHEAD, TURN, WHEEL)
    )

    def physical(values: tuple[float, ...]) -> Parameters:
        names = (AHEAD.name, TURN.name, WHEEL.name)
        return {name: 1 / max(value, 1 / NO_LIMIT_RPM_S) for name, value in zip(names, values, strict=True)}

    begun = [time_s / scene.usual_rpm for time_s in (BEGUN_S if scene.size.full else BEGUN_SMALL_S)]
    starts = [start for each in begun for start in ((each, each, 0.0), (0.0, 0.0, each))]
    return Candidate("acceleration-limit", parts, physical, tuple(starts), alike=_other_limits)


def _other_limits(values: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
    """The slowest ramp as that of each wheel alone, and as that of the mean and the difference of both sides alone."""
    slowest = max(values)
    return (0.0, 0.0, slowest), (slowest, slowest, 0.0)


EFFECT = Effect(
    id="acceleration-limit",
    name="the drive limits how fast the wheels change speed",
    sentence="The mean speed of both sides changes by at most ahead_rpm_s, half of their difference by at most "
    "turn_rpm_s; then the speed of each wheel changes by at most wheel_rpm_s.",
    law="|d/dt (n_left + n_right)/2| ≤ ahead_rpm_s, |d/dt (n_right − n_left)/2| ≤ turn_rpm_s, |dn/dt| ≤ wheel_rpm_s",
    source="limits of linear and angular acceleration of drive controllers (ros2_controllers, diff_drive_controller) "
    "and ramps of motor controllers; measured on the wheels of a Clearpath Husky and a Warthog (tests/benchmarks)",
    limits="The limits are equal for speeding up and slowing down, forward and backward. They act after limits of the "
    f"speed and before dead time and lag of the motors. {NO_LIMIT_RPM_S:g} rpm/s are no limit.",
    kind="command",
    parameters=(AHEAD, TURN, WHEEL),
    act=_act,
    fitted=_fitted,
    of_ground=True,
)
