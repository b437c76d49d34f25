"""Coordinates in which effects are fitted, and what an effect says of two that are one cause, worked out on paper."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from simulator.dynamics.model import NUMBERS, compile_robot
from simulator.effects.catalogue import EFFECTS
from simulator.effects.coordinates import Candidate, Scene, polar
from simulator.effects.draft import Draft
from simulator.effects.parameter import UNITS, Parameter, Size
from simulator.observation import view_of
from simulator.robot import load_robot
from tests.simulator.effect_probe import affected

SCENE = Scene(20.0, (30.0, 10.0, 0.0, 10.0 + 1e-9, 10.0))  # levels are rounded before they are compared
OWN = {
    "speed-limit",
    "acceleration-limit",
    "command-lag",
    "magnet-strength",
    "tether-spring",
    "plate-tilt",
    "speed-ripple",
    "friction-grain",
}


def candidate(effect_id: str) -> Candidate:
    return EFFECTS[effect_id].candidate(SCENE)


@pytest.mark.parametrize("effect_id", sorted(set(EFFECTS) - OWN))
def test_other_effects_are_fitted_in_their_parameters(effect_id: str) -> None:
    found = candidate(effect_id)
    declared = EFFECTS[effect_id].parameters
    assert [item.name for item in found.coordinates] == [item.name for item in declared]
    values = tuple(2.0 * item.step + item.absent for item in declared)
    assert tuple(found.physical(values).values()) == values
    for item, given in zip(found.coordinates, declared, strict=True):
        assert (item.absent, item.step) == (given.absent, given.step)


@pytest.mark.parametrize("effect_id", sorted(set(EFFECTS) - {"friction-level", "plane-scale", "time-base"}))
def test_coordinates_of_a_larger_robot_give_parameters_that_are_larger_by_their_units(effect_id: str) -> None:
    """Steps from nothing on a robot seven times as long, whose wheels carry eleven times as much."""
    size, steps = Size(7.0, 11.0), (2.0, 3.0, -1.0, 1.0)
    paper, large = (
        EFFECTS[effect_id].candidate(scene) for scene in (SCENE, Scene(140.0, SCENE.command_levels_rpm, size))
    )
    told = [
        found.physical(tuple(c.absent + n * c.step for c, n in zip(found.coordinates, steps, strict=False)))
        for found in (paper, large)
    ]
    for item in EFFECTS[effect_id].parameters:
        assert told[1][item.name] - item.absent == pytest.approx(
            size.of(item.unit) * (told[0][item.name] - item.absent)
        )
    for small, big in zip(paper.coordinates, large.coordinates, strict=True):
        factor = big.step / small.step
        ends = [(bound - small.absent) * factor + small.absent for bound in (small.low, small.high)]
        assert (big.low, big.high) == pytest.approx(ends)


@pytest.mark.parametrize("effect_id", sorted(EFFECTS))
def test_a_number_that_an_entry_leaves_out_is_that_of_no_effect(effect_id: str) -> None:
    """A factor of one, a speed that no wheel reaches, a point at the origin, an attraction with the square."""
    for item in EFFECTS[effect_id].parameters:
        factor = item.name.endswith(("factor", "left_over_right"))
        usual = 1e6 if effect_id.endswith("-limit") else 2.0 if item.name == "exponent" else float(factor)
        assert item.absent == usual


def test_an_entry_may_not_say_less_than_nothing() -> None:
    """A factor of a hundredth at least, a magnet that is gone, a limit of a thousandth of a rpm a second."""
    least = {f"{effect.id}.{item.name}": item.at_least for effect in EFFECTS.values() for item in effect.parameters}
    factors = {name: value for name, value in least.items() if name.endswith(("factor", "left_over_right"))}
    assert factors == {name: 0.0 if name.startswith("magnet-strength") else 0.01 for name in factors}
    limits = {name: value for name, value in least.items() if "-limit." in name}
    assert limits == {name: 0.001 if name.endswith("rpm_s") else 0.0 for name in limits}
    assert set(least.values()) == {-np.inf, 0.0, 0.001, 0.01}


# An effect that a fit brings to a bound is no answer: it imitates something else.
BOUNDS = {
    "axle-compliance": [(-20, 20)],
    "camera-tilt": [(-0.02, 0.02)] * 2 + [(0, 1)],  # of a camera 50 mm away; from a linear change to a homography
    "rolling-shutter": [(-10, 10)] * 2,
    "drive-speed-mismatch": [(0.5, 2)],  # beyond half and twice, a length, a time or a gear is another one
    "drive-speed-scale": [(0.5, 2)],
    "plane-scale": [(0.5, 2)],
    "time-base": [(0.5, 2)],
    "friction-across": [(0.3, 3)],
    "friction-gradient": [(-0.05, 0.05)] * 2,  # nothing is left 20 mm away
    "friction-grain": [(-0.9, 0.9)] * 2,  # no direction without friction
    "friction-level": [(0.2, 5)],
    "magnet-imbalance": [(0.2, 5)],
    "mark-offset": [(-3, 3)] * 2 + [(-45, 45)],
    "mass-offset": [(-1.9, 1.9)] * 2,  # within the wheels, at 2 mm
    "motor-droop": [(0, 0.1)],
    "plate-tilt": [(-45, 45)] * 2,
    "rolling-drag": [(0, 0.5)],
    "scrub-torque": [(0, 2)],
    "sliding-friction": [(0, 1)],
    "speed-drift": [(-0.05, 0.05)],
    "speed-ripple": [(-0.5, 0.5)] * 2,
    "tether-pull": [(-20, 20)] * 2,  # less than friction holds, of 54 mN
    "viscous-drag": [(0, 10), (0, 1e6)],
    "wheel-toe": [(-30, 30)] * 2,
}


@pytest.mark.parametrize("effect_id", sorted(BOUNDS))
def test_a_fit_ends_where_an_effect_would_be_something_else(effect_id: str) -> None:
    found = [(item.low, item.high) for item in candidate(effect_id).coordinates]
    assert found == pytest.approx(np.array(BOUNDS[effect_id]))


@pytest.mark.parametrize("effect_id", sorted(EFFECTS))
def test_a_fit_may_begin_where_the_effect_is_absent_and_at_its_starts(effect_id: str) -> None:
    found, declared = candidate(effect_id), EFFECTS[effect_id]
    for values in (found.absent, *found.starts):
        assert found.clipped(values) == values
        for name, value in found.physical(values).items():
            parameter = declared.parameter(name)
            assert parameter is not None
            assert parameter.at_least <= value
    assert all(item.step > 0 for item in found.coordinates)
    assert all(parameter.unit in UNITS for parameter in declared.parameters)


@pytest.mark.parametrize(
    ("effect_id", "size", "angle", "degrees"),
    [
        ("plate-tilt", "angle_deg", "azimuth_deg", 210.0),
        ("speed-ripple", "amplitude", "phase_deg", 210.0),
        ("friction-grain", "amplitude", "direction_deg", 105.0),  # half of it: a grain is the same after half a turn
    ],
)
def test_components_are_size_times_cosine_and_sine(effect_id: str, size: str, angle: str, degrees: float) -> None:
    """(-4 cos 30°, -4 sin 30°) of the bound: the direction of 210 degrees."""
    found = candidate(effect_id)
    unit = found.coordinates[0].step
    told = found.physical((-4 * unit * math.cos(math.pi / 6), -4 * unit * 0.5))
    assert told == pytest.approx({size: 4 * unit, angle: degrees})
    assert all(item.low == -item.high for item in found.coordinates)


@pytest.mark.parametrize("effect_id", sorted(EFFECTS))
def test_where_a_fit_begins_nothing_is_changed(effect_id: str) -> None:
    barrel = load_robot("barrel")
    robot = affected(barrel, effect_id, **candidate(effect_id).physical(candidate(effect_id).absent))
    found, nominal = compile_robot(robot, 3)[0], compile_robot(barrel, 3)[0]
    assert all(np.array_equal(found[name], nominal[name]) for name in NUMBERS)
    assert np.abs(found["coefficient"]).max() < 1e-5  # a spring has no anchor without a trace of stiffness
    assert view_of(robot) == view_of(barrel)


def test_a_direction_has_a_period() -> None:
    with pytest.raises(ValueError, match="no period"):
        polar("some-effect", Parameter("size", "", 0.0, 0.1), Parameter("angle_deg", "deg", 0.0, 5.0))


def test_delay_is_the_sum_of_dead_time_and_time_constant() -> None:
    """A share of a quarter: half of the delay is the time constant."""
    assert candidate("command-lag").physical((0.3, 0.25)) == pytest.approx(
        {"dead_time_s": 0.15, "time_constant_s": 0.15}
    )
    bounds = [(item.absent, item.low, item.high) for item in candidate("command-lag").coordinates]
    assert bounds == [(0.0, 0.0, 2.0), (0.0, 0.0, 1.0)]  # a share is a share
    told = candidate("command-lag").physical((0.3, 0.04))
    assert told == pytest.approx({"dead_time_s": 0.24, "time_constant_s": 0.06})


def test_limits_are_fitted_in_their_inverses_from_the_median_of_the_commanded_speeds() -> None:
    found = candidate("speed-limit")
    assert found.physical((0.05, 0.1, 0.2)) == pytest.approx({"wheel_rpm": 20.0, "ahead_rpm": 10.0, "turn_rpm": 5.0})
    assert found.physical((0.05, 0.0, 0.0)) == pytest.approx({"wheel_rpm": 20.0, "ahead_rpm": 1e6, "turn_rpm": 1e6})
    assert set(found.physical(found.absent).values()) == {1e6}
    # of 10, 10, 10 and 30 rpm, and between the fastest two
    assert found.starts == (*(pytest.approx((0.1,) * 3),) * 2, pytest.approx((0.05,) * 3))
    levels = Scene(20.0, (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0, 120.0))
    fastest = [start[0] for start in EFFECTS["speed-limit"].candidate(levels).starts[2:]]
    assert [1 / begin for begin in fastest] == pytest.approx([70.0, 90.0, 110.0])
    ground = EFFECTS["speed-limit"].candidate(replace(levels, size=Size(100.0, 1e6)))
    assert len(ground.starts) == 2
    assert Scene(20.0, (0.0, 40.0, 10.0, 20.0, 30.0, 50.0)).fast_rpm == 40.0
    assert EFFECTS["speed-limit"].candidate(Scene(20.0, ())).starts[0] == pytest.approx((1 / 60,) * 3)


def test_accelerations_are_fitted_in_their_inverses_from_times_to_the_median_of_the_commanded_speeds() -> None:
    found = candidate("acceleration-limit")
    assert found.physical((0.05, 0.0, 0.0)) == pytest.approx(
        {"wheel_rpm_s": 1e6, "ahead_rpm_s": 20.0, "turn_rpm_s": 1e6}
    )
    assert set(found.physical(found.absent).values()) == {1e6}
    begun = (0.05, 0.015, 0.005)  # of 10, 10, 10 and 30; a small robot may be thirty times as quick as a large one
    each = [start for value in begun for start in ((value, value, 0.0), (0.0, 0.0, value))]
    assert np.array(found.starts) == pytest.approx(np.array(each))
    assert [(item.low, item.high) for item in found.coordinates] == [(0.0, pytest.approx(1.0))] * 3  # ten seconds
    assert found.alike is not None
    assert found.alike((0.002, 0.01, 0.0)) == ((0.0, 0.0, 0.01), (0.01, 0.01, 0.0))  # other limits act nearly alike
    ground = EFFECTS["acceleration-limit"].candidate(replace(SCENE, size=Size(100.0, 1.0)))
    assert np.array(ground.starts) == pytest.approx(np.array(each[:2]))
    assert {item.high for item in ground.coordinates} == {math.inf}


def test_magnets_are_fitted_in_the_balance_of_the_loads_and_the_logarithm_of_their_level() -> None:
    found = candidate("magnet-strength")
    load = 2 * (3 / 19) * (1 + 18 / 4)  # of a driven wheel, over its weight
    assert found.physical((2.0, -np.log(4.0))) == pytest.approx(
        {"driving_factor": 0.25, "driven_factor": (load - 1) / 2}
    )
    assert [item.low for item in found.coordinates] == pytest.approx([19 / 3 / 91, np.log(0.05)])
    assert [item.high for item in found.coordinates] == pytest.approx([201 / 91 * 19 / 3, np.log(5.0)])
    assert [item.prior_sigma for item in found.coordinates] == [np.inf, 1.0]  # most runs show the balance alone
    alone = EFFECTS["magnet-strength"].candidate(Scene(20.0, (30.0,), attraction=(18.0, 0.0)))
    assert [(item.name, item.prior_sigma) for item in alone.coordinates] == [("weakness", np.inf)]
    assert alone.physical((4.0,)) == {"driving_factor": 0.25}
    draft = Draft(load_robot("barrel"))
    EFFECTS["magnet-strength"].act(draft, alone.physical((4.0,)))  # type: ignore[misc]
    assert draft.attraction_factor.tolist() == [0.25, 0.25, 1.0, 1.0]


@pytest.mark.parametrize(("reach_mm", "most"), [(400.0, 0.0025), (1e4, 0.05 / 50)])
def test_a_gradient_of_friction_may_double_it_within_reach(reach_mm: float, most: float) -> None:
    """By the size of a robot 50 times as large alone, it ended at a bound of 0.001, and a true pair was lost."""
    found = EFFECTS["friction-gradient"].candidate(Scene(reach_mm, (30.0,), Size(50.0)))
    assert [(item.low, item.high) for item in found.coordinates] == [(pytest.approx(-most), pytest.approx(most))] * 2
    assert found.coordinates[0].step == pytest.approx(1e-3 / 50)
    paper = EFFECTS["friction-gradient"].candidate(Scene(40.0, (30.0,)))
    assert paper.coordinates[1].high == 0.05


def test_a_spring_is_fitted_in_its_stiffness_and_its_pull_at_the_origin() -> None:
    told = candidate("tether-spring").physical((0.02, 0.3, -0.1))
    assert told == pytest.approx({"stiffness_mN_mm": 0.02, "anchor_x_mm": 15.0, "anchor_y_mm": -5.0})
    slack = candidate("tether-spring").physical((0.0, 0.3, 0.0))
    assert slack["stiffness_mN_mm"] * slack["anchor_x_mm"] == pytest.approx(0.3)
    assert slack["stiffness_mN_mm"] < 1e-6


def test_a_dead_band_lies_between_commands_or_above_the_largest() -> None:
    found = candidate("dead-band")
    assert found.stepwise
    assert found.between == ((10.0, 30.0), (30.0, 60.0))
    assert found.starts == ((20.0,), (45.0,))
    assert EFFECTS["dead-band"].candidate(Scene(20.0, (0.0,))).starts == ()


def test_friction_of_ground_is_fitted_in_its_logarithm_from_grip_to_ice() -> None:
    found = EFFECTS["friction-level"].candidate(replace(SCENE, size=Size(250.0, 1e6)))
    assert found.physical(found.absent) == {"factor": 1.0}
    assert [found.physical(start)["factor"] for start in found.starts] == pytest.approx([1.0, 0.5, 0.25, 0.125])
    assert [found.acts_at(start) for start in found.starts] == [False, True, True, True]
    (only,) = found.coordinates
    assert (math.exp(only.low), math.exp(only.high)) == pytest.approx((0.07 / 0.9, 0.9 / 0.07))


def test_no_dead_band_lies_above_the_largest_command_of_a_robot_that_moved_over_ground() -> None:
    ground = replace(SCENE, size=Size(250.0, 1e6))
    assert EFFECTS["dead-band"].candidate(ground).starts == ((20.0,),)
    more = replace(ground, command_levels_rpm=(10.0, 30.0, 60.0, 80.0))
    assert EFFECTS["dead-band"].candidate(more).starts == ((20.0,), (45.0,), (70.0,))


@pytest.mark.parametrize(("effect", "bounds"), [("plane-scale", (0.9, 1.1)), ("time-base", (0.99, 1.01))])
def test_metres_over_ground_are_right_to_a_tenth_and_seconds_to_a_hundredth(
    effect: str, bounds: tuple[float, float]
) -> None:
    """A factor beyond is a wrong unit or a recording that was replayed at another rate, and no effect."""
    for size, wanted in ((Size(250.0, 1e6), bounds), (SCENE.size, (0.5, 2.0))):
        (factor,) = EFFECTS[effect].candidate(replace(SCENE, size=size)).coordinates
        assert (factor.low, factor.high) == wanted


def test_a_magnet_is_looked_for_in_and_around_the_reach_of_the_runs() -> None:
    found = candidate("stray-magnet")
    force, x, y, exponent = np.array(found.starts).T
    assert len(found.starts) == 16
    assert not force.any()
    assert (exponent == 2.0).all()
    assert sorted(set(np.hypot(x, y).round(6))) == [10.0, 24.0]
    assert sorted(set(np.degrees(np.arctan2(y, x)).round(6) % 360)) == [45.0 * number for number in range(8)]
    assert [(item.low, item.high) for item in found.coordinates] == [(0, 20), (-80, 80), (-80, 80), (0, 6)]


@pytest.mark.parametrize(
    ("left", "right", "words"),
    [
        (1.05, 1.0, "the left wheel alone is off"),
        (1.0, 0.95, "the right wheel alone is off"),
        (1.05, 0.95, ""),
        (1.001, 0.999, ""),
        (1.009, 0.95, "the right wheel alone is off"),  # 1.8 standard deviations: within the 95 %
        (0.989, 0.95, ""),  # 2.2: beyond
    ],
)
def test_a_mismatch_and_a_scale_are_one_wheel_where_the_other_may_be_right(
    left: float, right: float, words: str
) -> None:
    """Speeds of the wheels relative to their commands, each known to 0.005."""
    rng = np.random.default_rng(1)
    speeds = np.array([left, right])[:, None] + 0.005 * rng.normal(size=(2, 4000))
    cause = EFFECTS["drive-speed-mismatch"].single_cause
    assert cause is not None
    assert cause.other == "drive-speed-scale"
    assert cause.words({"left_over_right": speeds[0] / speeds[1], "factor": speeds.mean(axis=0)}) == words


def test_wheels_that_hardly_grip_are_believed_beside_late_motors_alone() -> None:
    found = EFFECTS["friction-level"].candidate(replace(SCENE, size=Size(250.0, 1e6)))
    believed = {factor: found.believed(math.log(factor), {"speed-limit"}) for factor in (0.1, 0.3, 4.0, 6.0)}
    assert believed == {0.1: False, 0.3: True, 4.0: True, 6.0: False}
    assert found.believed(math.log(0.1), {"command-lag", "speed-limit"})
    assert candidate("friction-level").believed(-0.9, set())
