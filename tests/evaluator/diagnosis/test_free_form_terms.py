"""Families of terms without a name: units of the kernel, bounds that keep signs, sizes of robots, and words."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest

from evaluator.diagnosis.candidates.free_form import (
    BASIS_SIZE,
    CHANNEL_STEP,
    RELATIVE,
    FreeTerm,
    Item,
    coefficient,
    free_terms,
    wheel_friction,
)
from evaluator.diagnosis.candidates.free_form_words import BASIS_WORDS, CHANNEL_WORDS, unit_of_coefficient
from simulator.dynamics.terms import BASES, CHANNELS
from simulator.effects.parameter import Size

LARGE = Size(length=100.0, force=1e4)


def only(term: str) -> FreeTerm:
    return free_terms()[f"free:{term}"]


def test_every_place_where_a_cause_can_act_has_its_families() -> None:
    """A family that is left out is physics that nobody finds."""
    families = Counter(term.items[0].channel for term in free_terms().values())
    assert families == {
        "force_forward": 8,
        "force_left": 10,
        "force_plate_x": 4,
        "moment": 13,
        "speed": 20,
        "steer": 8,
        "drag": 6,
        "load": 8,
        "friction": 30,
        "stiffness": 8,
        "left_drive": 4,
        "camera_x": 3,
    }


def test_families_of_one_side_have_their_like_on_the_other() -> None:
    def mirrored(name: str) -> str:
        if "left-right" in name or name == "force_left":  # their coefficients may have either sign
            return name
        return name.replace("left", "*").replace("right", "left").replace("*", "right")

    places = [[part for part, _ in term.acting([0.0] * len(term.items))] for term in free_terms().values()]
    assert {frozenset((item.channel, item.basis, item.pattern) for item in one) for one in places} == {
        frozenset((mirrored(item.channel), mirrored(item.basis), mirrored(item.pattern)) for item in one)
        for one in places
    }


def test_steps_of_one_unit_are_alike_and_bases_have_the_size_of_what_they_are_powers_of() -> None:
    unlike = {
        unit: {CHANNEL_STEP[channel] for channel, (_, its) in CHANNEL_WORDS.items() if its == unit}
        for unit in ("mN", "mm", "rpm")
    }
    assert unlike == {"mN": {0.02}, "mm": {0.02}, "rpm": {0.002}}
    assert CHANNEL_STEP["moment"] == pytest.approx(1e3 * CHANNEL_STEP["force_left"])  # at 1 mm from the middle
    assert (
        CHANNEL_STEP["speed"]
        == CHANNEL_STEP["left_drive"]
        == pytest.approx(math.radians(CHANNEL_STEP["steer"]), rel=0.2)
    )
    assert {CHANNEL_STEP[name] for name in ("load", "stiffness", "friction", "friction_across")} == {0.01}
    sizes = {"u": 3.0, "v": 0.5, "yaw_rate": 0.3, "x": 10.0, "time": 5.0}  # of turns at a few mm/s, on a few cm
    assert {name: BASIS_SIZE[name] for name in sizes} == sizes
    for channel, basis in (("force_left", "v"), ("steer", "one"), ("friction", "time"), ("left_drive", "sign_u")):
        step = coefficient("some", Item(channel, basis)).step
        assert step == pytest.approx(CHANNEL_STEP[channel] / BASIS_SIZE.get(basis, 1.0))
    powers = {"abs_u": ("u", 1), "u_abs_u": ("u", 2), "v_abs_v": ("v", 2), "y": ("x", 1), "x_r_squared": ("x", 3)}
    powers |= {"y_r_squared": ("y", 3), "abs_yaw_rate": ("yaw_rate", 1), "yaw_rate_abs": ("yaw_rate", 2)}
    for basis, (base, power) in powers.items():
        assert BASIS_SIZE[basis] == pytest.approx(BASIS_SIZE[base] ** power, rel=0.15)


@pytest.mark.parametrize(
    ("term", "kernel"),
    [
        ("force_forward.sign_u", 1000.0),  # µN of a mN
        ("moment.one", 1.0),
        ("steer.sign_u.driving", math.radians(1.0)),
        ("drag.sign_u.left-right", 1000.0),
        ("friction.abs_u", 1.0),
        ("camera_x.time+camera_y.time", 1.0),
    ],
)
def test_coefficients_of_files_are_those_of_the_kernel_in_its_units(term: str, kernel: float) -> None:
    values = [2.0] * len(only(term).items)
    found = only(term).kernel_terms(values)
    assert [part.coefficient for part in found] == pytest.approx([2.0 * kernel] * len(values))
    for part, item in zip(found, only(term).items, strict=True):
        assert (part.channel, part.basis, part.pattern) == (CHANNELS[item.channel], BASES[item.basis], item.pattern)
    assert only(term).physical(tuple(values)) == dict.fromkeys([item.name for item in only(term).items], 2.0)


@pytest.mark.parametrize(
    ("term", "times"),
    [
        ("force_forward.sign_u", 1e4),  # as the load
        ("force_forward.u_abs_u", 1.0),  # mN/(mm/s)²: speeds grow as lengths do
        ("force_forward.x+force_forward.y", 1e2),
        ("moment.one", 1e6),
        ("moment.u", 1e4),
        ("moment.time", 1e6),  # times are alike
        ("friction.one.driving", 1.0),
        ("friction.abs_u", 1e-2),
        ("speed.cos_heading.driving+speed.sin_heading.driving", 1.0),
        ("camera_x.time+camera_y.time", 1e2),
        ("camera_x.x_r_squared+camera_y.y_r_squared", 1e-4),  # an error that grows as lengths, over their cube
        ("left_drive.right_command+right_drive.left_command", 1.0),
    ],
)
def test_steps_and_bounds_are_as_many_times_as_large_as_what_they_measure(term: str, times: float) -> None:
    paper, large = only(term).coordinates[0], free_terms(LARGE)[f"free:{term}"].coordinates[0]
    assert large.step == pytest.approx(times * paper.step)
    assert (large.low, large.high) == pytest.approx((times * paper.low, times * paper.high))


def test_a_relative_change_keeps_friction_load_and_speed_above_nought() -> None:
    assert all(low > -1 for low, _ in RELATIVE.values())
    alone = {name: (found.low, found.high) for name in CHANNELS if (found := coefficient("any", Item(name, "one")))}
    grips = {"load": 2.0, "stiffness": 6.0, "friction": 2.0, "friction_across": 2.0}
    sides = {name: 200 * CHANNEL_STEP[name] for name in CHANNELS} | {
        "speed": 0.6,
        "left_drive": 1.5,
        "right_drive": 1.5,
    }
    assert alone == {name: (-0.9, grips[name]) if name in grips else (-sides[name], sides[name]) for name in CHANNELS}
    bounds = {
        "friction.one.driving": (-0.9, 2.0),  # at least a tenth, three times at most
        "load.one.front-rear": (-0.9, 2.0),
        "stiffness.one.driving": (-0.9, 6.0),  # a law of another shape may be several times as steep
        "speed.sign_u.driving": (-0.6, 0.6),
        "left_drive.right_command+right_drive.left_command": (
            -1.5,
            1.5,
        ),  # a side may turn by the other's command alone
    }
    for term, ends in bounds.items():
        assert (only(term).coordinates[0].low, only(term).coordinates[0].high) == ends
    wave = only("friction.cos_heading+friction.sin_heading").coordinates[0]
    assert (wave.low, wave.high) == (-0.9, 0.9)  # takes as much as it gives
    fast = only("friction.abs_u").coordinates[0]
    assert (fast.low, fast.high) == pytest.approx((-0.3, 0.3))  # at 3 mm/s
    across = only("speed.x.driving+speed.y.driving").coordinates[0]
    assert (across.low, across.high) == pytest.approx((-0.06, 0.06))  # at 10 mm
    force = only("force_forward.sign_u").coordinates[0]
    assert (force.low, force.high) == pytest.approx((-200 * force.step, 200 * force.step))
    assert all(item.low < 0 == item.absent < item.high for term in free_terms().values() for item in term.coordinates)


def test_terms_are_said_in_words_with_their_units() -> None:
    assert only("moment.cos_heading+moment.sin_heading").describe() == (
        "a moment about the vertical varying with the cosine of heading and varying with the sine of heading"
    )
    assert (
        only("drag.u.left-right").describe()
        == "a force along the wheels proportional to forward speed (left-right wheels)"
    )
    assert only("force_plate_x.time+force_plate_y.time").describe() == (
        "a force along x of the plate growing with time in the run and a force along y of the plate growing with time "
        "in the run"
    )
    units = {
        ("force_forward", "u_abs_u"): "mN/(mm/s)²",
        ("friction", "one"): "",
        ("friction", "x"): "1/mm",
        ("left_drive", "right_command"): "",
        ("left_drive", "time"): "rpm/s",
        ("moment", "one"): "µN·mm",
    }
    assert {key: unit_of_coefficient(*key) for key in units} == units
    items = [item for term in free_terms().values() for item in term.items]
    assert {item.channel for item in items} <= set(CHANNEL_WORDS)
    assert {item.basis for item in items} <= set(BASIS_WORDS)
    for key, term in free_terms().items():
        assert key == "free:" + "+".join(item.name for item in term.items)


def test_the_friction_under_each_wheel_is_a_change_of_its_own() -> None:
    third = wheel_friction(4)[2]
    (found,) = third.kernel_terms((0.3,))
    assert (found.channel, found.basis, found.coefficient) == (CHANNELS["friction"], BASES["one"], 0.3)
    assert [term.weights for term in wheel_friction(4)] == [tuple(map(float, row)) for row in np.eye(4)]
    assert found.pattern == (0.0, 0.0, 1.0, 0.0)
    assert third.physical((0.3,)) == {"change": 0.3}
    assert (third.id, len({term.id for term in wheel_friction(6)})) == ("friction-under-wheel-3-of-4", 6)
