"""A robot file whose mass or attraction no robot has is doubted before anything is simulated from it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from evaluator.cli.experiment.diagnose import say_doubts
from evaluator.errors import InputError
from evaluator.workflow import diagnose
from evaluator.workflow.checks import check_experiment
from evaluator.workflow.runs.implausible import implausible_values, unloaded_wheels, vague_tolerances
from simulator.robot import load_robot, shipped_robot_text

BARREL = load_robot("barrel")
VOLUME_MM3 = 5.0 * 9.0 * 6.5
WEIGHT_MN = 0.5e-3 * 9.8e3


@pytest.mark.parametrize(
    ("density", "doubted"), [(9.9, True), (10.1, False), (1700.0, False), (21_400.0, False), (21_600.0, True)]
)
def test_a_robot_is_denser_than_foam_and_no_denser_than_platinum(density: float, *, doubted: bool) -> None:
    body = BARREL.body.model_copy(update={"mass_g": density * 1e-6 * VOLUME_MM3})
    (*found,) = implausible_values(BARREL.model_copy(update={"body": body}))
    assert any(f"{density:.2g} kg/m3" in item for item in found) is doubted


@pytest.mark.parametrize(
    ("share", "doubted"), [(0.0099, True), (0.0101, False), (0.0, False), (299.0, False), (301.0, True)]
)
def test_a_magnet_holds_a_robot_and_does_not_press_it_flat(share: float, *, doubted: bool) -> None:
    magnets = {"driving_wheel_mN": share * WEIGHT_MN, "driven_wheel_mN": 0.1 * share * WEIGHT_MN}
    attraction = BARREL.magnetic_attraction.model_copy(update=magnets)
    (*found,) = implausible_values(BARREL.model_copy(update={"magnetic_attraction": attraction}))
    assert ([f"{share:.2g} of its weight" in item for item in found] == [True]) is doubted


@pytest.mark.parametrize("name", ["barrel", "column", "tire", "two_driven_caster", "four_driven", "six_driven"])
def test_shipped_robots_are_plausible(name: str) -> None:
    robot = load_robot(name)
    assert [*implausible_values(robot), *unloaded_wheels(robot)] == []


@pytest.mark.parametrize(
    ("gravity_mm", "said"),
    [
        ((0.0, 0.0), []),
        ((1.6, 1.8), ["middle_right, rear_left, rear_right carry no load; are the centre of gravity and"]),
        ((2.1, 0.0), ["is outside the wheels"]),
    ],
)
def test_wheels_without_load_and_a_robot_that_tips_are_named(gravity_mm: tuple[float, float], said: list[str]) -> None:
    """Six wheels without magnets: around the one in front at (2, 2), the middle and rear ones of the right lift off."""
    robot = load_robot("six_driven")
    wheels = [wheel.model_copy(update={"attraction_mN": 0.0}) for wheel in robot.wheel]
    body = robot.body.model_copy(update={"center_of_gravity_mm": gravity_mm})
    found = list(unloaded_wheels(robot.model_copy(update={"body": body, "wheel": tuple(wheels)})))
    assert len(found) == len(said)
    assert all(words in item for words, item in zip(said, found, strict=True))


@pytest.mark.parametrize(
    ("share", "said"), [(0.05, []), (1.0, []), (5.0, ["slip.lateral_friction = 5, which is 500 %"])]
)
def test_a_tolerance_in_percent_is_told(share: float, said: list[str]) -> None:
    vague = BARREL.model_copy(update={"tolerance": {"slip.lateral_friction": share, "wheels.radius_mm": 0.01}})
    assert list(implausible_values(vague)) == []  # which would refuse it
    found = list(vague_tolerances(vague))
    assert len(found) == len(said)
    assert all(words in item for words, item in zip(said, found, strict=True))


def test_a_caster_needs_no_load() -> None:
    """The weight of a robot stands above its axle where its file does not say more: the caster behind carries none."""
    robot = load_robot("two_driven_caster")
    wheels = [wheel.model_copy(update={"attraction_mN": 0.0}) for wheel in robot.wheel]
    axle_mm = next(wheel.x_mm for wheel in wheels if wheel.grips)
    body = robot.body.model_copy(update={"center_of_gravity_mm": (axle_mm, 0.0)})
    above_axle = robot.model_copy(update={"body": body, "wheel": tuple(wheels)})
    assert list(unloaded_wheels(above_axle)) == []
    off = body.model_copy(update={"center_of_gravity_mm": (axle_mm, wheels[0].y_mm)})
    assert ["no load" in item for item in unloaded_wheels(above_axle.model_copy(update={"body": off}))] == [True]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"slip": {"lateral_friction": 26.0}}, "slip.lateral_friction = 26; wheels have 0.005 to 4: is a decimal"),
        ({"slip": {"longitudinal_friction": 0.004}}, "slip.longitudinal_friction = 0.004;"),
        ({"slip": {"lateral_friction": 3.9}}, ""),
        ({"wheels": {"track_mm": 60.0}}, "wheel centres 4 x 60 mm apart, of a body of 5 x 9 x 6.5 mm;"),
        ({"wheels": {"wheelbase_mm": 28.0}}, "wheel centres 28 x 4 mm apart"),
        ({"wheels": {"track_mm": 26.0}}, ""),
        (
            {"wheels": {"radius_mm": 2.1}},
            "front_left and rear_left are 4 mm apart, less than their radii of 2.1 and",
        ),
        ({"wheels": {"radius_mm": 1.9}}, ""),
    ],
)
def test_frictions_and_places_of_wheels_that_no_robot_has_are_doubted(
    changes: dict[str, dict[str, float]], said: str
) -> None:
    tables = {name: getattr(BARREL, name).model_copy(update=values) for name, values in changes.items()}
    found = list(implausible_values(BARREL.model_copy(update=tables)))
    assert len(found) == bool(said)
    assert all(item.startswith(said) for item in found)


def test_check_doubts_a_mass_in_kilograms_with_the_name_of_the_file_and_diagnose_refuses_it(
    tmp_path: Path,
) -> None:
    text = shipped_robot_text("barrel").replace("mass_g = 0.5", "mass_g = 0.0005")
    (tmp_path / "robot.toml").write_text(text, encoding="utf-8")
    (tmp_path / "m.csv").write_text("time_s,green_x_mm,green_y_mm,yellow_x_mm,yellow_y_mm\n0,0,1,0,-1\n1,0,1,0,-1\n")
    run = '[[run]]\nid = "r"\nmarks = "m.csv"\nleft_rpm = 1\nright_rpm = 1\n'
    path = tmp_path / "experiment.toml"
    path.write_text(f'format = 1\nname = "e"\nrobot = "robot.toml"\n{run}', encoding="utf-8")
    found = check_experiment(path)
    assert found.faults == ()
    assert "robot.toml: 0.0005 g in a box of 5 x 9 x 6.5 mm are 1.7 kg/m3" in found.mistakes[0]
    with pytest.raises(InputError, match=r"robot.toml: 0.0005 g in a box of 5 x 9 x 6.5 mm are 1.7 kg/m3"):
        diagnose(path, tmp_path / "out")
    assert not (tmp_path / "out" / "diagnosis.json").exists()


def test_diagnose_names_supports_without_load(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = shipped_robot_text("six_driven").replace("[body]", "[body]\ncenter_of_gravity_mm = [2.1, 0.0]")
    text = re.sub(r"attraction_mN = [\d.]+", "attraction_mN = 0.0", text)
    (tmp_path / "robot.toml").write_text(text, encoding="utf-8")
    path = tmp_path / "experiment.toml"
    run = '[[run]]\nid = "r"\nmarks = "m.csv"\nleft_rpm = 1\nright_rpm = 1\n'
    path.write_text(f'format = 1\nname = "e"\nrobot = "robot.toml"\n{run}', encoding="utf-8")
    say_doubts(path)
    assert capsys.readouterr().err.startswith(f"mistake? {tmp_path / 'robot.toml'}: ")
