"""Robots exported to MuJoCo: their steady turns there, where MuJoCo is installed, and what is said of them."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from click.testing import CliRunner

from evaluator.cli.export_robot import export_robot
from simulator.errors import SimulationError
from simulator.exchange.mjcf import losses, mjcf
from simulator.robot import load_robot
from simulator.steady import steady_turn
from tests.simulator.effect_probe import affected


@pytest.mark.parametrize(
    ("name", "left_rpm", "right_rpm", "seconds"),
    [
        ("barrel", 33.3, 14.4, 0.5),
        ("column", -33.3, -14.4, 0.5),
        ("tire", 70.0, 100.0, 0.5),
        ("two_driven_caster", 33.3, 14.4, 0.5),
        ("four_driven", 60.0, 30.0, 10.0),
        ("six_driven", 33.3, 14.4, 0.3),
    ],
)
def test_the_radius_is_reproduced_in_mujoco(name: str, left_rpm: float, right_rpm: float, seconds: float) -> None:
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed (pip install turnscope[mujoco])")
    robot = load_robot(name)
    model = mujoco.MjModel.from_xml_string(mjcf(robot, left_rpm, right_rpm))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(int(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
    unit_mm = 1e3 if name == "four_driven" else 1.0
    turn = steady_turn(robot, left_rpm, right_rpm)
    assert data.qvel[5] == pytest.approx(turn.yaw_rate_rad_s, rel=0.01)
    assert unit_mm * np.hypot(*data.qvel[:2]) / abs(data.qvel[5]) == pytest.approx(abs(turn.radius_mm), rel=0.01)


def test_every_wheel_has_a_contact_and_every_driven_one_a_motor() -> None:
    root = ET.fromstring(mjcf(load_robot("two_driven_caster"), 33.3, 14.4))  # noqa: S314  # written a line above
    assert [pair.get("condim") for pair in root.iter("pair")] == ["3", "3", "1"]
    assert [motor.get("name") for motor in root.iter("velocity")] == ["left_motor", "right_motor"]
    assert [float(item.get("biasprm", "").split()[0]) for item in root.iter("general")] == [22050.0, 22050.0]  # µN
    controls = root.find("keyframe/key")
    assert controls is not None
    assert controls.get("ctrl", "").split()[0] == f"{33.3 * 2 * np.pi / 60:.9g}"


def test_what_cannot_be_exported_is_said() -> None:
    with pytest.raises(SimulationError, match="do not know plate-tilt"):
        mjcf(affected(load_robot("barrel"), "plate-tilt", angle_deg=2.0), 33.3, 14.4)
    assert any("attraction" in sentence for sentence in losses(load_robot("barrel"), 33.3, 14.4))
    assert not any("attraction" in sentence for sentence in losses(load_robot("tire"), 33.3, 14.4))
    assert any("balls" in sentence for sentence in losses(load_robot("two_driven_caster"), 33.3, 14.4))


def test_the_command_writes_the_file_and_says_what_was_lost(tmp_path: Path) -> None:
    output = tmp_path / "barrel.xml"
    done = CliRunner().invoke(export_robot, ["barrel", "-o", str(output)])
    assert done.exit_code == 0, done.output
    assert "What was lost:" in done.output
    assert output.read_text(encoding="utf-8").startswith("<mujoco")
