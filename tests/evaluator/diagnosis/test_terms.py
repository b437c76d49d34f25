"""Coordinates of the candidates and the parameters that are told: each way of writing an effect says the same."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evaluator.diagnosis.candidates.coordinates import attraction_of, named_terms, size_of
from evaluator.diagnosis.candidates.free_form import free_terms
from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.likelihood.variants import add_term
from evaluator.robot_geometry import reference_places
from simulator.effects.catalogue import BUILT_IN, EFFECTS
from simulator.effects.draft import Draft
from simulator.effects.parameter import Size
from simulator.observation import view_of
from simulator.robot import load_robot, shipped_robots

HUSKY = Path(__file__).parents[2] / "driven_robot" / "husky.toml"
TERMS = named_terms(30.0, (10.0, 30.0))


@pytest.mark.parametrize("effect", sorted(TERMS))
def test_every_effect_has_a_term_with_its_parameters(effect: str) -> None:
    told = TERMS[effect].physical(TERMS[effect].absent)
    assert sorted(told) == sorted(EFFECTS[effect].absent())


@pytest.mark.parametrize("effect", [effect for effect in sorted(TERMS) if "factor" in EFFECTS[effect].absent()])
def test_factors_are_one_where_nothing_is_changed(effect: str) -> None:
    assert TERMS[effect].physical(TERMS[effect].absent) == EFFECTS[effect].absent()


def test_magnets_of_known_balance_and_unknown_level_have_a_long_interval_upward() -> None:
    """The ratio of the loads, of attraction and weight, is the same at every level."""
    strength = named_terms(20.0, (30.0,), attraction=(18.0, 2.0))["magnet-strength"]
    for weakness in (5.0, 1.5, 0.3):
        found = strength.physical((4.25, -math.log(weakness)))
        assert found["driving_factor"] == pytest.approx(1 / weakness)
        loads = 1 + 18 * found["driving_factor"], 1 + 2 * found["driven_factor"]
        assert loads[1] / loads[0] == pytest.approx(4.25 * 3 / 19)
        assert strength.known is not None
        assert strength.known((4.25, -math.log(weakness))) == {"driven_over_driving_load": pytest.approx(4.25 * 3 / 19)}
    assert strength.physical(strength.absent) == pytest.approx({"driving_factor": 1.0, "driven_factor": 1.0})


def test_a_driven_wheel_carries_its_weight_at_least() -> None:
    """Below a level of all magnets, a lower load of the driven wheels cannot be: the balance stays, the level does not.

    With the level kept, no change of the balance changed anything, and a fit stayed there, 5 below its best evidence.
    """
    strength = named_terms(20.0, (30.0,), attraction=(18.0, 2.0))["magnet-strength"]
    found = strength.physical((1.0, -math.log(7.0)))
    assert found == pytest.approx({"driving_factor": (19 / 3 - 1) / 18, "driven_factor": 0.0}, abs=1e-12)
    assert strength.physical((1.1, -math.log(7.0)))["driving_factor"] < found["driving_factor"]
    assert strength.physical((1 / 3, 0.0)) == pytest.approx({"driving_factor": 1.0, "driven_factor": 0.0}, abs=1e-12)
    least = strength.physical((strength.coordinates[0].low, 0.0))
    assert least == pytest.approx({"driving_factor": 5.0, "driven_factor": 0.0}, abs=1e-12)


@pytest.mark.parametrize(
    ("robot", "attracted"), [("barrel", True), ("tire", False), ("two_driven_caster", False), ("four_driven", False)]
)
def test_magnets_of_driven_wheels_have_a_strength_where_there_are_any(robot: str, attracted: bool) -> None:
    """A factor of the magnets of casters was told as 3, between 0 and 55."""
    found = attraction_of(load_robot(robot))
    assert bool(found[1]) == attracted
    assert named_terms(20.0, (30.0,), attraction=found)["magnet-strength"].size == 1 + attracted


def test_magnets_of_driven_wheels_alone_have_a_balance() -> None:
    strength = named_terms(20.0, (30.0,), attraction=(0.0, 2.0))["magnet-strength"]
    for balance, level in ((1.0, 0.0), (0.5, -1.0)):
        found = strength.physical((balance, level))
        assert found == pytest.approx({"driving_factor": math.exp(level), "driven_factor": (3 * balance - 1) / 2})


def test_attraction_is_over_the_weight_on_a_wheel() -> None:
    assert attraction_of(load_robot("barrel")) == pytest.approx((22.05 / 1.225, 2.45 / 1.225), rel=2e-3)


@pytest.mark.parametrize("name", shipped_robots())
def test_every_candidate_acts_on_every_shipped_robot(name: str) -> None:
    robot = load_robot(name)
    terms = named_terms(20.0, (30.0,), size=size_of(robot), attraction=attraction_of(robot))
    for term in terms.values():
        place = term.starts[0] if term.starts else tuple(item.absent + item.step for item in term.coordinates)
        add_term(term, place, Draft(robot), view_of(robot, reference_places(robot)))


def run_from(place: tuple[float, float], *, from_poses: bool) -> RunData:
    marks = np.tile([*place, place[0], place[1] - 3.66], (3, 1)) + np.arange(3.0)[:, None]
    return RunData("r", 30.0, 20.0, 0.0, None, np.arange(3.0), marks, 0, from_poses=from_poses)


def test_runs_whose_poses_mostly_begin_in_one_place_have_no_common_frame_and_measured_marks_always_have() -> None:
    here, there, elsewhere = (0.0, 1.83), (0.0, 1.8301), (0.0, 1.8302)

    def share(*places: tuple[float, float], from_poses: bool = True) -> bool:
        return Session(tuple(run_from(place, from_poses=from_poses) for place in places), (), {}).one_frame

    assert not share(here, here, here)
    assert not share(there, here, here)  # of one the first poses lack
    assert share(here, here, there, elsewhere)
    assert share(here, here, from_poses=False)
    assert share(here)


@pytest.mark.parametrize(
    ("levels", "recur"), [("AABBCC", False), ("AABBCCA", False), ("AABBCCAB", True), ("ABAB", True), ("AAAA", False)]
)
def test_a_change_from_run_to_run_is_sought_on_open_ground_where_two_commands_recur(
    levels: str, *, recur: bool
) -> None:
    runs = tuple(replace(run_from((0.0, 1.83), from_poses=True), left_rpm=float(ord(level))) for level in levels)
    husky, barrel = load_robot(HUSKY), load_robot("barrel")
    assert Session(runs, (husky,) * len(runs), {}).commands_recur == recur
    assert Session(runs, (barrel,) * len(runs), {}).commands_recur  # the model explains each command to the noise
    assert set(TERMS) - set(named_terms(30.0, (10.0, 30.0), commands_recur=False)) == {"speed-drift"}


def test_effects_and_terms_of_the_plate_are_not_tried_where_runs_share_no_frame() -> None:
    left_out = set(TERMS) - set(named_terms(30.0, (10.0, 30.0), one_frame=False))
    assert left_out == {effect for effect in BUILT_IN if BUILT_IN[effect].of_plate}
    assert {"plate-tilt", "camera-tilt"} < left_out
    of_ground = {effect for effect in BUILT_IN if BUILT_IN[effect].of_ground}
    assert (
        set(named_terms(30.0, (10.0, 30.0), size=Size(100.0, 1e4))) - set(TERMS)
        == of_ground
        == {"speed-limit", "acceleration-limit", "sliding-friction", "friction-across"}
    )
    free = free_terms(one_frame=False)
    assert "free:moment.one" in free
    assert "free:moment.cos_heading+moment.sin_heading" in set(free_terms()) - set(free)
    assert not [term for term in free if "plate" in term]
