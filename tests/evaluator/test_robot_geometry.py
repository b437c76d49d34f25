from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from evaluator.errors import InputError
from evaluator.files import read_with
from evaluator.mark_geometry import MarkGeometry
from evaluator.robot_geometry import RobotGeometry, read_geometry, reference_line, robot_shape, sought
from evaluator.settings import MeasuredRobot, load_any_robot, load_measured
from evaluator.tracking import settings
from simulator import mark_layout
from simulator.mark_layout import Mark
from simulator.robot import Robot, load_robot
from simulator.units import in_standard_units


def test_a_tracker_finds_every_kind_of_mark_that_a_robot_may_have() -> None:
    """Two lists, because measurement does not import the simulator."""
    assert get_args(settings.Kind) == get_args(mark_layout.Kind)


@pytest.mark.parametrize("name", ["barrel", "two_driven_caster", "four_driven", "six_driven"])
def test_measurement_reads_the_shape_that_the_simulator_has(name: str) -> None:
    shape = read_geometry(Path(name)).shape
    assert shape is not None
    assert shape == robot_shape(load_robot(name)) == robot_shape(load_measured(Path(name)))


def test_a_robot_that_is_only_measured_may_have_any_table_of_a_robot_but_no_misspelt_one(tmp_path: Path) -> None:
    """With [slipp], a robot passed `check` as one without a slip law, and the diagnosis refused it."""
    assert set(MeasuredRobot.model_fields) >= set(Robot.model_fields)
    file = tmp_path / "robot.toml"
    file.write_text('name = "mine"\n[marks]\ngreen_mm = [1, 0]\n[known_to]\nmark_position_mm = 0.02\n')
    assert read_with(load_any_robot, file).known_to.mark_position_mm == 0.02
    file.write_text(file.read_text() + "[slipp]\nlateral_friction = 0.3\n")
    with pytest.raises(InputError, match=r"robot.toml: unknown key slipp; did you mean slip\?$"):
        read_with(load_any_robot, file)


@pytest.mark.parametrize(
    ("said", "wanted", "value"),
    [
        ({"yaw_inertia_kg_m2": 2e-9}, "yaw_inertia_g_mm2", 2.0),  # 1e3 g and 1e6 mm²
        ({"left_rad_s": np.pi}, "left_rpm", 30.0),
        ({"length_m": 0.25}, "length_mm", 250.0),
        ({"pull_N": 0.5}, "pull_mN", 500.0),
        ({"mass_kg": 0.004}, "mass_g", 4.0),
        ({"place_m": [0.001, -0.002]}, "place_mm", [1.0, -2.0]),
        ({"length_mm": 5}, "length_mm", 5),
    ],
)
def test_units_are_brought_to_the_one_used_inside(said: dict[str, object], wanted: str, value: object) -> None:
    assert in_standard_units(said, [wanted]) == {wanted: pytest.approx(value)}


def test_a_value_in_two_units_is_refused() -> None:
    with pytest.raises(ValueError, match="length_mm and length_m are both given"):
        in_standard_units({"length_mm": 5.0, "length_m": 0.005}, ["length_mm"])


def test_a_tracker_looks_for_marks_as_far_apart_in_diameters_as_the_robot_says() -> None:
    shared = {"x_mm": 0.0, "height_mm": 6.5}
    marks = tuple(
        Mark.model_validate({"name": name, "y_mm": y, "diameter_mm": diameter, **shared})
        for name, y, diameter in (("green", 3.0, 1.5), ("yellow", -3.0, 2.5))
    )
    wanted = sought(RobotGeometry(marks), None)
    assert wanted.distance_diameters == pytest.approx(6.0 / 2.0)
    assert wanted.body == ("green", "yellow")


def test_a_tracker_without_marks_of_its_own_looks_for_those_of_the_robot_and_keeps_those_it_has() -> None:
    shared = {"height_mm": 6.5, "y_mm": 0.0}
    marks = [{"name": "red_top", "x_mm": 3.0}, {"name": "lamp", "x_mm": -3.0, "kind": "light"}]
    robot = RobotGeometry(tuple(Mark.model_validate(shared | mark) for mark in marks))
    wanted = sought(robot, None)
    assert {name: mark.kind for name, mark in wanted.mark.items()} == {"red_top": "color", "lamp": "light"}
    assert wanted.body == ("red_top", "lamp")
    said = settings.TrackingSettings(mark={"blue": settings.MarkSettings()})
    assert sought(robot, said).mark == said.mark
    assert sought(robot, said).body is None


def test_marks_at_two_heights_are_refused_and_one_height_is_that_of_the_poses(tmp_path: Path) -> None:
    marks = [f'[[mark]]\nname = "{name}"\nx_mm = {x}\ny_mm = 0.0\nheight_mm = ' for name, x in (("a", 1.0), ("b", 2.0))]
    path = tmp_path / "robot.toml"
    path.write_text(f"{marks[0]}6.5\n{marks[1]}6.5\n", encoding="utf-8")
    assert read_geometry(path).marks().height_mm == 6.5
    path.write_text(f"{marks[0]}6.5\n{marks[1]}7.5\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"robot\.toml: marks of different heights \[6\.5, 7\.5\]"):
        read_geometry(path)


def test_axes_of_the_papers_robot_are_drawn_beyond_its_front_and_to_its_wheels() -> None:
    robot = load_robot("barrel")
    ahead_mm, left_mm = MarkGeometry.of_robot(robot).axes_mm
    axle_mm, side_mm = robot.wheel_positions_mm().max(axis=0)
    assert axle_mm + robot.driving_radius_mm < ahead_mm < robot.body.length_mm
    assert left_mm == pytest.approx(side_mm, rel=0.05)


def test_the_reference_line_runs_from_the_second_mark_to_the_first() -> None:
    np.testing.assert_allclose(reference_line(load_robot("barrel")), [0.0, 3.66])  # from yellow to green


def test_the_wheel_of_a_robot_is_the_mean_of_those_that_drive(tmp_path: Path) -> None:
    wheels = [("left", 0.0, 20.0, 10.0), ("right", 0.0, -20.0, 12.0), ("none", -30.0, 0.0, 4.0)]
    lines = ["format = 1", 'name = "cart"', "[body]", "length_mm = 80.0", "width_mm = 50.0"]
    for side, x, y, radius in wheels:
        lines += ["[[wheel]]", f'name = "{side}"', f"x_mm = {x}", f"y_mm = {y}", f"radius_mm = {radius}"]
        lines.append(f'driven_by = "{side}"')
    lines += ["[marks]", "green_mm = [1.0, 2.0]", "yellow_mm = [1.0, -2.0]", "diameter_mm = 1.0", "height_mm = 30.0"]
    path = tmp_path / "robot.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    shape = read_geometry(path).shape
    assert shape is not None
    assert shape.wheel_radius_mm == 11.0


def test_distance_of_several_marks_is_that_of_the_two_that_are_farthest_apart() -> None:
    """Their scale is checked by it, and found by it where marks are in px: the farther apart, the smaller the error."""
    marks = MarkGeometry({"nose": (2.0, 0.0), "side": (1.0, 1.0), "tail": (-1.0, -4.0), "rear": (-1.5, 0.0)})
    assert marks.farthest_pair() == ("side", "tail")
    assert marks.spacing_mm == pytest.approx(np.hypot(2, 5))
