"""A robot of a metre is diagnosed as a microrobot is: steps, bounds and tolerances follow its size; ground is noise."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from evaluator.diagnosis.assessment.verdict import material_gain
from evaluator.diagnosis.candidates.coordinates import USUAL_LOAD_MN, is_full_size, named_terms, on_open_ground, size_of
from evaluator.diagnosis.candidates.free_form import free_terms
from evaluator.diagnosis.design.candidate_runs import commands_at
from evaluator.diagnosis.likelihood.known_to import quantities, start_per_run_s
from evaluator.diagnosis.likelihood.preparation import build_problem, with_noise_of
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.diagnosis.likelihood.run_data import RunData, Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.diagnosis.likelihood.variants import varied_robot
from evaluator.diagnosis.output.effect_tables import effect_tables
from evaluator.diagnosis.output.robot_file import with_values_of_each
from evaluator.interchange.commands import constant
from evaluator.report.diagnosis.values import parameter
from evaluator.report.diagnosis.words import in_words
from evaluator.robot_geometry import reference_places
from evaluator.settings import KnownTo
from simulator.dynamics.scale import USUAL_DISTANCE_MM
from simulator.effects.parameter import PAPER_SIZE, UNITS, Size
from simulator.robot import Robot, load_robot, shipped_robots

LARGE = Path(__file__).parents[2] / "driven_robot" / "husky.toml"


def runs_of(robot: Robot, seed: int, scatter: float) -> list[RunData]:
    """Windows of a moving robot by its own model, each wheel side off by chance: as ground makes it."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 2.0, 0.1)
    places = np.array(reference_places(robot))
    runs = []
    for number, (left, right) in enumerate([(40.0, 20.0), (20.0, 40.0), (-30.0, -50.0), (50.0, 45.0)] * 2):
        blank = np.tile(places.ravel(), (len(time), 1))
        told = constant(left, right, 0.0, None, starts_at_rest=False)
        run = RunData(f"r{number}", left, right, 0.0, None, time, blank, number, log=told, from_poses=True)
        off = tuple(scatter * rng.normal(size=2))
        own = (0.0, 0.0, 0.3 * number, 0.0, *off, 0.0)
        marks = Simulated([robot], [run], {}).marks([Task(0, own)])[0]
        runs.append(
            RunData(*(getattr(run, n) for n in FIELDS), marks_mm=marks, order=number, log=told, from_poses=True)
        )
    return runs


FIELDS = ("id", "left_rpm", "right_rpm", "start_s", "stop_s", "time_s")


@pytest.mark.parametrize("name", [name for name in shipped_robots() if name != "four_driven"])  # that is of 50 kg
def test_shipped_robots_keep_the_steps_that_were_chosen_for_them(name: str) -> None:
    assert size_of(load_robot(name)) == PAPER_SIZE


@pytest.mark.parametrize(("times", "on_ground"), [(10.0, False), (15.0, False), (17.0, True)])
def test_robot_of_some_centimetres_drives_on_a_plate_where_wheel_speeds_differ_between_runs(
    times: float, on_ground: bool
) -> None:
    robot = load_robot("barrel")
    assert robot.wheels is not None
    wheels = robot.wheels.model_copy(update={"wheelbase_mm": 4.0 * times, "track_mm": 4.0 * times})
    large = robot.model_copy(update={"wheels": wheels})
    poses, marks = (cast("RunData", SimpleNamespace(from_poses=of_poses)) for of_poses in (True, False))
    problem = Problem((poses,), cast("Simulated", None), (), (), (), 1.0, size_of(large).length)
    assert is_full_size(large) == on_open_ground([large], [poses]) == problem.open_ground == on_ground
    assert (4 in problem.varied) != on_ground  # wheel speeds
    filmed = replace(problem, data=(marks,))
    assert not on_open_ground([large], [marks])
    assert not filmed.open_ground
    assert 4 in filmed.varied
    assert not size_of(large, filmed=True).on_ground


def test_size_of_a_large_robot_is_the_distance_of_its_wheels_from_their_middle_and_its_load_beside_the_papers() -> None:
    """Wheels at (±256, ±277.5) mm against (±2, ±2); 50 kg against 53.9 mN of weight and attraction."""
    size = size_of(load_robot(LARGE))
    assert size.length == pytest.approx(np.hypot(256.0, 277.5) / np.sqrt(8))
    assert size.force == pytest.approx(50e3 * 9.8 / 53.9)
    moved = load_robot(LARGE)
    wheels = tuple(wheel.model_copy(update={"x_mm": wheel.x_mm + 900.0}) for wheel in moved.wheel)
    assert size_of(moved.model_copy(update={"wheel": wheels})).length == pytest.approx(size.length)
    corners = 1000.0 * np.array([[3.0, 4.0], [3.0, -4.0], [-3.0, 4.0], [-3.0, -4.0]])
    pulled = SimpleNamespace(
        wheel_positions_mm=lambda: corners, weight_uN=5e6, all_wheels=[SimpleNamespace(attraction_mN=2e3)] * 3
    )  # fmt: skip
    assert size_of(cast("Robot", pulled)).length == pytest.approx(5000.0 / USUAL_DISTANCE_MM)
    assert size_of(cast("Robot", pulled)).force == pytest.approx((5e3 + 6e3) / USUAL_LOAD_MN)


def powers(unit: str) -> tuple[int, int]:
    """Powers of length and of force in a unit, read from how it is written."""
    above, _, below = unit.replace("(", "").replace(")", "").partition("/")

    def count(part: str, *symbols: str) -> int:
        return sum(factor in symbols for factor in part.split("·"))

    return count(above, "mm") - count(below, "mm"), count(above, "mN", "µN") - count(below, "mN", "µN")


@pytest.mark.parametrize("unit", UNITS)
def test_a_quantity_grows_with_length_and_force_as_its_unit_says(unit: str) -> None:
    """Times are alike on robots of any size, so that a mm/s grows as a length does."""
    length, force = powers(unit)
    assert Size(length=7.0, force=11.0).of(unit) == pytest.approx(7.0**length * 11.0**force)


def test_steps_and_bounds_have_the_dimension_of_their_unit() -> None:
    size = Size(length=100.0, force=1e4)
    usual, large = (named_terms(20.0, (30.0,), size=item) for item in (PAPER_SIZE, size))
    ratios = {
        "tether-pull": 1e4,
        "mass-offset": 100.0,
        "viscous-drag": 100.0,
        "camera-tilt": 0.01,
        "wheel-toe": 1,
    }
    for effect, ratio in ratios.items():
        before, after = usual[effect].coordinates[0], large[effect].coordinates[0]
        assert after.step == pytest.approx(ratio * before.step)
        assert (after.low, after.high) == pytest.approx((ratio * before.low, ratio * before.high))
    free = [items["free:moment.u"].coordinates[0].step for items in (free_terms(), free_terms(size))]
    assert free[1] == pytest.approx(free[0] * 100.0 * 1e4 / 100.0)  # a moment, per speed


def test_motors_of_a_large_robot_are_looked_at_as_later_than_those_of_a_small_one() -> None:
    usual, large = (named_terms(20.0, (30.0,), size=item)["command-lag"] for item in (PAPER_SIZE, Size(100.0, 1e4)))
    assert [start[0] for start in usual.starts] == [0.02]
    assert [start[0] for start in large.starts] == [0.05, 0.3]
    assert all(large.clipped(start) == start for start in large.starts)


def test_metres_of_a_large_robot_are_off_by_a_tenth_at_most_and_seconds_by_a_hundredth() -> None:
    usual, large = (named_terms(20.0, (30.0,), size=item) for item in (PAPER_SIZE, Size(100.0, 1e4)))
    for effect, bounds in (("plane-scale", (0.9, 1.1)), ("time-base", (0.99, 1.01))):
        assert [(item[effect].coordinates[0].low, item[effect].coordinates[0].high) for item in (usual, large)] == [
            (0.5, 2.0),
            bounds,
        ]


def test_the_centre_of_gravity_of_a_large_robot_may_move_within_its_wheels_and_no_farther() -> None:
    robot = load_robot(LARGE)
    terms = named_terms(3000.0, (30.0,), size=size_of(robot))
    reach = terms["mass-offset"].coordinates[0].high
    assert 0.8 * 256 < reach < 256  # half the wheelbase


def test_tolerances_that_no_file_states_are_those_of_a_tape_on_a_robot_of_a_metre() -> None:
    robot = load_robot(LARGE)
    data = runs_of(robot, 1, 0.0)
    sigma = {item.key: item.sigma for item in quantities(KnownTo(), robot, data)}
    assert 5 < sigma["center_of_gravity_x_mm"] < 30
    stated = robot.model_copy(update={"known_to": type(robot.known_to)(center_of_gravity_mm=2.0)})
    assert {item.key: item.sigma for item in quantities(KnownTo(), stated, data)}["center_of_gravity_x_mm"] == 2.0


def test_marks_that_no_file_places_show_the_heading_of_a_robot_of_any_size() -> None:
    (x0, y0), (x1, y1) = reference_places(load_robot(LARGE))
    assert np.hypot(x0 - x1, y0 - y1) == pytest.approx(3.66 * 990 / 5)


def test_runs_that_the_ground_disturbs_leave_noise_of_the_size_of_the_disturbance() -> None:
    robot = load_robot(LARGE)
    sizes = []
    for scatter in (0.0, 0.1):
        data = runs_of(robot, 5, scatter)
        forward = Simulated([robot] * len(data), data, {})
        problem, start = build_problem(data, forward)
        found = with_noise_of(problem, start).noise
        sizes.append(np.median([parts[0].sigma_mm for parts in found]))
    assert sizes[0] < 1.0
    assert 10 < sizes[1] < 100  # a tenth of about half a metre in each run, the start pose at its best


def test_lengths_of_a_wheel_list_are_known_to_a_tolerance_and_move_in_one_ratio() -> None:
    robot = load_robot(LARGE)
    found = {item.key: item for item in quantities(KnownTo(), robot, runs_of(robot, 1, 0.0))}
    assert found["wheel.radius_mm"].per_unit == pytest.approx(165.0)
    assert found["wheel.x_mm"].per_unit == pytest.approx(512.0)
    assert found["wheel.y_mm"].per_unit == pytest.approx(555.0)
    moved = varied_robot(robot, {"wheel.y_mm": 0.01})
    assert moved.wheel_positions_mm()[:, 1] == pytest.approx(1.01 * robot.wheel_positions_mm()[:, 1])
    assert moved.wheel_positions_mm()[:, 0] == pytest.approx(robot.wheel_positions_mm()[:, 0])


def test_a_length_of_a_wheel_list_that_moved_is_written_in_the_unit_of_the_file() -> None:
    text = LARGE.read_text(encoding="utf-8")
    written = with_values_of_each(text, "wheel", "radius_mm", 1.01, "before")
    radii = [wheel["radius_m"] for wheel in tomllib.loads(written)["wheel"]]
    assert radii == pytest.approx([0.16665] * 4)
    assert written.count("# 0.165 before") == 4
    inline = text[: text.index("[[wheel]]")] + 'wheel = [{name = "a", radius_m = 0.1}]\n'
    assert with_values_of_each(inline, "wheel", "radius_mm", 1.01, "before") == inline


def test_a_gain_that_is_alike_on_both_sides_acts_on_both_and_is_said_and_kept_as_one_number() -> None:
    both = "free:left_drive.left_command=right_drive.right_command+left_drive.right_command=right_drive.left_command"
    term = free_terms()[both]
    assert term.size == 2
    acting = [(item.channel, item.basis, value) for item, value in term.acting((-0.2, 0.5))]
    assert acting == [
        ("left_drive", "left_command", -0.2),
        ("right_drive", "right_command", -0.2),
        ("left_drive", "right_command", 0.5),
        ("right_drive", "left_command", 0.5),
    ]
    assert len(term.kernel_terms((-0.2, 0.5))) == 4
    assert "proportional to their own command and proportional to the command of the other side" in term.describe()
    assert parameter(list(term.physical((-0.2, 0.5)))[1]) == ("proportional to the command of the other side", "")
    tables = tomllib.loads("\n".join(effect_tables({both: term}, {both: (-0.2, 0.5)})))["effect"]
    assert [table["coefficient"] for table in tables] == [-0.2, -0.2, 0.5, 0.5]
    assert in_words(f"without {both} the runs").count("proportional") == 2


def test_on_ground_a_term_without_a_name_is_an_answer_only_where_it_lessens_what_is_left() -> None:
    assert material_gain(24) == pytest.approx(16.1, abs=0.1)  # a fifth less, in three modes of every run
    assert material_gain(48) == pytest.approx(2 * material_gain(24))


def test_of_a_log_in_which_no_command_returns_few_levels_are_proposed_again() -> None:
    levels = sorted({max(abs(left), abs(right)) for left, right in commands_at(list(np.linspace(5.0, 80.0, 40)))})
    assert len(levels) == 8
    assert (levels[0], levels[-1]) == (5.0, 80.0)


def test_logs_of_computers_know_the_start_better_than_a_sensor_that_seldom_measures() -> None:
    robot = load_robot(LARGE)
    logged = runs_of(robot, 1, 0.0)
    by_frame = [replace(run, log=None) for run in logged]
    starts = [{item.key: item.sigma for item in quantities(KnownTo(), robot, data)} for data in (logged, by_frame)]
    assert [item["start_common_s"] for item in starts] == pytest.approx([0.02, 0.1])
    assert [start_per_run_s(KnownTo(), data) for data in (logged, by_frame)] == pytest.approx([0.01, 0.05])
    assert start_per_run_s(KnownTo(start_per_run_s=0.3), logged) == 0.3
