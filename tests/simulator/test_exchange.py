"""Robots exported to MuJoCo and Gazebo: turns where MuJoCo is installed, files, and what is said of them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from click.testing import CliRunner

from evaluator.cli.simulation.export_robot import export_robot
from simulator.effects.entry import EffectEntry
from simulator.errors import SimulationError
from simulator.exchange.creep import contacts_in_turn
from simulator.exchange.losses import losses
from simulator.exchange.mjcf import mjcf
from simulator.exchange.sdf import sdf
from simulator.robot import load_robot
from simulator.steady import steady_turn
from tests.simulator.effect_probe import affected

LIMITED = {"id": "speed-limit", "wheel_rpm": 25.0, "ahead_rpm": 1e3, "turn_rpm": 5.0}


@pytest.mark.parametrize(
    ("name", "effects", "left_rpm", "right_rpm", "seconds"),
    [
        ("barrel", [], 33.3, 14.4, 0.5),
        ("column", [], -33.3, -14.4, 0.5),
        ("tire", [], 70.0, 100.0, 0.5),
        ("two_driven_caster", [], 33.3, 14.4, 0.5),
        ("four_driven", [], 60.0, 30.0, 10.0),
        ("six_driven", [], 33.3, 14.4, 0.3),
        # effects as in the robot file of a diagnosis
        ("barrel", [{"id": "magnet-imbalance", "left_over_right": 1.3}], 33.3, 14.4, 0.5),
        ("barrel", [{"id": "mass-offset", "x_mm": -1.0, "y_mm": 0.5}, LIMITED], 33.3, 14.4, 0.5),
        ("four_driven", [{"id": "sliding-friction", "share": 1.0}], 60.0, 30.0, 10.0),
    ],
)
def test_the_radius_is_reproduced_in_mujoco(
    name: str, effects: list[dict[str, Any]], left_rpm: float, right_rpm: float, seconds: float
) -> None:
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed (pip install turnscope[mujoco])")
    robot = load_robot(name).model_copy(update={"effect": tuple(map(EffectEntry.model_validate, effects))})
    model = mujoco.MjModel.from_xml_string(mjcf(robot, left_rpm, right_rpm))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(int(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
    unit_mm = 1e3 if name == "four_driven" else 1.0
    turn = steady_turn(robot, left_rpm, right_rpm)
    assert data.qvel[5] == pytest.approx(turn.yaw_rate_rad_s, rel=0.01)
    assert unit_mm * np.hypot(*data.qvel[:2]) / abs(data.qvel[5]) == pytest.approx(abs(turn.radius_mm), rel=0.01)


@pytest.mark.parametrize(("name", "left_rpm", "right_rpm"), [("barrel", 33.3, 14.4), ("four_driven", -60.0, -30.0)])
def test_contacts_creep_by_the_slip_of_their_wheels_against_their_friction(
    name: str, left_rpm: float, right_rpm: float
) -> None:
    """Slip ratio and angle are those of the simulated turn: Eq. (3) of the paper, and its slip angle."""
    robot = load_robot(name)
    turn, (_, contacts) = steady_turn(robot, left_rpm, right_rpm), contacts_in_turn(robot, left_rpm, right_rpm)
    slips = zip(contacts, turn.wheels.slip_ratio.tolist(), turn.wheels.slip_angle_rad.tolist(), strict=True)
    for contact, ratio, angle in slips:
        along, across = contact.creep_mm_s
        if contact.rpm is None:
            assert along == 0.0
            continue
        surface = contact.rpm * 2 * np.pi / 60 * contact.wheel.radius_mm
        forward = surface + along
        assert along / max(abs(forward), abs(surface)) == pytest.approx(ratio, rel=1e-6)
        assert across / abs(forward) == pytest.approx(np.tan(angle), rel=1e-6)
        assert np.sign(contact.force_N).tolist() == (-np.sign(contact.creep_mm_s)).tolist()
    assert sum(contact.load_N for contact in contacts) == pytest.approx(
        9.8e-3 * robot.body.mass_g + sum(contact.attraction_N for contact in contacts)
    )


def test_every_wheel_has_a_contact_and_every_driven_one_a_motor() -> None:
    root = ET.fromstring(mjcf(load_robot("two_driven_caster"), 33.3, 14.4))  # noqa: S314  # written a line above
    assert [pair.get("condim") for pair in root.iter("pair")] == ["3", "3", "1"]
    assert [motor.get("name") for motor in root.iter("velocity")] == ["left_motor", "right_motor"]
    assert [float(item.get("biasprm", "").split()[0]) for item in root.iter("general")] == [22050.0, 22050.0]  # µN
    controls = root.find("keyframe/key")
    assert controls is not None
    assert controls.get("ctrl", "").split()[0] == f"{33.3 * 2 * np.pi / 60:.9g}"


def test_what_cannot_be_exported_is_said() -> None:
    with pytest.raises(SimulationError, match="other simulators lack plate-tilt"):
        mjcf(affected(load_robot("barrel"), "plate-tilt", angle_deg=2.0), 33.3, 14.4)
    assert any("attraction" in sentence for sentence in losses(load_robot("barrel"), 33.3, 14.4))
    assert not any("attraction" in sentence for sentence in losses(load_robot("tire"), 33.3, 14.4))
    delayed = affected(load_robot("tire"), "command-lag", dead_time_s=0.1, time_constant_s=0.1)
    assert any("left out: command-lag" in sentence for sentence in losses(delayed, 33.3, 14.4))
    scaled = affected(load_robot("tire"), "friction-level", factor=0.5)
    assert any("(friction-level) act as at this turn" in sentence for sentence in losses(scaled, 33.3, 14.4))
    assert any("balls" in sentence for sentence in losses(load_robot("two_driven_caster"), 33.3, 14.4))


def test_the_command_writes_the_file_and_says_what_was_lost(tmp_path: Path) -> None:
    output = tmp_path / "barrel.xml"
    done = CliRunner().invoke(export_robot, ["barrel", "-o", str(output)])
    assert done.exit_code == 0, done.output
    assert "What was lost:" in done.output
    assert output.read_text(encoding="utf-8").startswith("<mujoco")


def test_gazebo_gets_the_creep_of_the_turn_and_all_of_the_mass() -> None:
    robot = load_robot("four_driven")
    turn = steady_turn(robot, 60.0, 30.0)
    root = ET.fromstring(sdf(robot, 60.0, 30.0))  # noqa: S314  # written here
    assert sum(float(item.text or "") for item in root.iter("mass")) == pytest.approx(50.0)
    across = turn.v_mm_s + turn.yaw_rate_rad_s * robot.wheel[0].x_mm
    creep = abs(across / turn.wheels.lateral_force_mN[0])  # mm/s per mN is m/s per N
    assert float(next(root.iter("slip1")).text or "") == pytest.approx(creep, rel=1e-5)
    speeds = [float(item.text or "") for item in root.iter("initial_velocity")]
    assert speeds == pytest.approx([2 * np.pi, np.pi] * 2)
    assert any("Gazebo" in sentence for sentence in losses(robot, 60.0, 30.0, "sdf"))


def test_gazebo_pulls_down_and_has_the_inertia_of_the_robot_in_si_units() -> None:
    robot = load_robot("barrel")
    root = ET.fromstring(sdf(robot, 33.3, 14.4))  # noqa: S314  # written here
    assert [float(v) for v in (root.findtext("world/gravity") or "").split()] == pytest.approx([0, 0, -9.8], abs=0.01)
    pulls = [[float(v) for v in (item.text or "").split()] for item in root.iter("force")]
    assert pulls == [[0, 0, pytest.approx(-wheel.attraction_mN / 1e3)] for wheel in robot.all_wheels]
    inertia = root.find("world/model[@name='robot']/link[@name='chassis']/inertial/inertia")
    assert inertia is not None
    tilting, yaw = (float(inertia.findtext(name) or "") for name in ("ixx", "izz"))
    assert yaw == pytest.approx(robot.yaw_inertia_g_mm2 * 1e-9)  # g·mm² in kg·m²
    body = robot.body
    box = body.mass_g * (max(body.length_mm, body.width_mm) ** 2 + body.height_mm**2) / 12 * 1e-9
    assert tilting == pytest.approx(box)


def test_mujoco_has_the_inertia_about_the_vertical_last() -> None:
    robot = load_robot("barrel")
    root = ET.fromstring(mjcf(robot, 33.3, 14.4))  # noqa: S314  # written here
    inertia = next(root.iter("inertial")).get("diaginertia", "")
    assert float(inertia.split()[2]) == pytest.approx(robot.yaw_inertia_g_mm2)  # in g and mm
    assert inertia.split()[0] == inertia.split()[1] != inertia.split()[2]


@pytest.mark.parametrize(("length", "small"), [(99.0, True), (101.0, False)])
def test_a_robot_below_ten_centimetres_is_said_to_be_small_for_gazebo(length: float, *, small: bool) -> None:
    robot: Any = SimpleNamespace(all_wheels=(), effect=(), extent_mm=(length, 20.0))
    assert any("for a robot this small" in sentence for sentence in losses(robot, 33.3, 14.4, "sdf")) == small
