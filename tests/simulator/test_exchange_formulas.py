"""Numbers of an exported robot in closed form, from contacts that are known; no turn is simulated."""

from __future__ import annotations

from math import pi, sqrt
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree as ET

import pytest

from simulator.exchange import mjcf, sdf
from simulator.exchange.creep import Contact, moments_g_mm2
from simulator.exchange.mjcf import Creep, Units
from simulator.nominal_robot import Wheel

# 8 g of 6 mm by 4 mm by 3 mm, weight 0.5 mm ahead and 0.25 mm to the right of its centre
BODY = SimpleNamespace(mass_g=8.0, length_mm=6.0, width_mm=4.0, height_mm=3.0, center_of_gravity_mm=(0.5, -0.25))
ROBOT: Any = SimpleNamespace(
    body=BODY, yaw_inertia_g_mm2=30.0, extent_mm=(3.0, 2.0), name="r",
    slip=SimpleNamespace(longitudinal_friction=0.2, lateral_friction=0.3),
)  # fmt: skip
SMALL, LARGE = Units(1.0, 1.0), Units(1e3, 1e3)
DRIVEN = Wheel(name="left", x_mm=1.5, y_mm=2.0, radius_mm=0.8, driven_by="left")
BALL = Wheel(name="ball", x_mm=-2.0, y_mm=0.0, radius_mm=0.5, support="ball")


def contact(wheel: Wheel = DRIVEN, **more: Any) -> Contact:
    """Pressed by 1 mN, held by 0.04 mN along and 0.03 mN across, at 2 mm/s and 0.5 mm/s."""
    usual: dict[str, Any] = {"load_N": 1e-3, "attraction_N": 5e-4, "force_N": (-4e-5, 3e-5)}
    return Contact(wheel, **{**usual, "creep_mm_s": (2.0, -0.5), "rpm": 30.0 if wheel is DRIVEN else None, **more})


def numbers(text: str | None) -> list[float]:
    return [float(value) for value in (text or "").split()]


def near(*values: float) -> Any:
    return pytest.approx(list(values), rel=1e-6)


def test_units_are_millimetres_and_grams_up_to_a_tenth_of_a_metre() -> None:
    for extent, units, per_N in ((100.0, SMALL, 1e6), (100.1, LARGE, 1.0)):
        found = Units.of(SimpleNamespace(extent_mm=(20.0, extent)))  # type: ignore[arg-type]
        assert (found, found.per_N) == (units, per_N)
    assert "m, kg and N" in mjcf._remark(LARGE, 3.0, 4.0)
    assert "mm, g and µN" in mjcf._remark(SMALL, 3.0, 4.0)


def test_moments_are_that_of_the_robot_and_that_of_a_box() -> None:
    assert moments_g_mm2(ROBOT) == near(30.0, 8 * (36 + 9) / 12)
    assert moments_g_mm2(SimpleNamespace(body=BODY, yaw_inertia_g_mm2=90.0)) == near(90.0, 45.9)  # type: ignore[arg-type]
    wide: Any = SimpleNamespace(body=SimpleNamespace(**{**vars(BODY), "width_mm": 7.0}), yaw_inertia_g_mm2=30.0)
    assert moments_g_mm2(wide)[1] == pytest.approx(8 * (49 + 9) / 12)
    assert mjcf._inertia(ROBOT, LARGE) == near(30e-9, 30e-9)


def test_steps_are_so_short_that_a_wheel_sinks_in_by_a_thousandth_of_its_radius() -> None:
    """Of 1 mN and 2 mN on 8 g; SINKS · the smaller radius over the acceleration is the square of twice the step."""
    contacts = (contact(), contact(BALL, load_N=2e-3))
    for units in (SMALL, LARGE):
        assert mjcf._time_step_s(ROBOT, contacts, units) == pytest.approx(sqrt(1e-3 * 0.5e-3 / (3e-3 / 8e-3)) / 2)


def test_creep_is_the_slope_of_friction_and_the_time_that_gives_it() -> None:
    creep = mjcf._creep(contact(), ROBOT, SMALL)
    assert (creep.along, creep.across) == near(40 / 2, 30 / 0.5)  # µN per mm/s
    assert creep.ratio == pytest.approx(sqrt(20 / 60))
    assert creep.time == pytest.approx(2 / (0.1 * 30 * creep.inverse_mass))  # two contacts share a slope
    assert Creep(20.0, 0.0, 0.5).time == pytest.approx(2 / (0.1 * 10 * 0.5))
    assert (Creep(20.0, 0.0, 0.5).ratio, Creep(0.0, 20.0, 0.5).ratio, Creep(0.0, 0.0, 0.5).time) == (1.0, 1.0, 0.0)
    large = mjcf._creep(contact(), ROBOT, LARGE)
    assert (large.along, large.across) == near(4e-5 / 2e-3, 3e-5 / 5e-4)
    assert mjcf._creep(contact(creep_mm_s=(0.0, 1.0), force_N=(1e-5, 0.0)), ROBOT, SMALL).time == 0.0
    dx, dy, z = 1.0, 2.25, 0.8  # of the wheel from the weight
    turned = (dy**2 + z**2) / 30 + (dx**2 + z**2) / 30 + (dx**2 + dy**2) / 30
    assert creep.inverse_mass == pytest.approx(1 / 8 + turned / 3)
    assert large.inverse_mass == pytest.approx(1e3 * creep.inverse_mass)


def test_friction_is_as_soft_as_ten_steps_of_the_fastest_contact_allow() -> None:
    creeps = [Creep(0.0, 20.0, 1.0), Creep(0.0, 40.0, 1.0), Creep(0.0, 0.0, 1.0)]  # times 2 s, 1 s and none
    assert mjcf._softness(creeps, 0.02) == pytest.approx(0.2)
    assert mjcf._softness(creeps, 0.2) == 1.0
    assert mjcf._softness(creeps[2:], 0.02) == 1.0


@pytest.mark.parametrize(("along", "across", "limits"), [(90.0, 10.0, (0.3, 0.9)), (10.0, 90.0, (0.9, 0.3))])
def test_a_contact_has_its_limits_and_times(along: float, across: float, limits: tuple[float, float]) -> None:
    pairs, creep = ET.Element("contact"), Creep(along, across, 0.5)
    mjcf._pair(pairs, contact(), creep, 0.01, 0.25, ROBOT)
    pair = pairs[0].attrib
    assert (pair["geom2"], pair["condim"], pair["solimp"]) == ("left", "3", "0.9 0.9 1")
    assert numbers(pair["solref"]) == near(0.1, 1)
    assert numbers(pair["friction"]) == near(*limits, 0, 0, 0)  # three times the friction of 0.3, a third of it aside
    assert numbers(pair["solreffriction"]) == near(0.25 * creep.time, 1)
    mjcf._pair(pairs, contact(), Creep(1e9, 1e9, 0.5), 0.01, 0.25, ROBOT)
    assert numbers(pairs[1].get("solreffriction")) == near(0.02, 1)
    for ball in (contact(BALL), contact(load_N=0.0)):
        mjcf._pair(pairs, ball, creep, 0.01, 0.25, ROBOT)
        assert (pairs[-1].get("condim"), pairs[-1].get("friction")) == ("1", None)


def test_friction_of_a_contact_is_that_of_its_law_or_what_it_needs() -> None:
    assert contact().friction(ROBOT) == 0.3
    assert contact(force_N=(3e-4, 4e-4)).friction(ROBOT) == pytest.approx(0.5)
    assert contact(load_N=0.0, force_N=(3e-4, 4e-4)).friction(ROBOT) == 0.3


def test_a_motor_lags_by_a_ten_thousandth_of_its_rotation_and_starts_no_faster_than_can_be_simulated() -> None:
    """Torque 0.3 · 1000 µN · 0.8 mm at 30 rpm; inertia 0.1 · 8 g · 0.8² mm²."""
    actuators = ET.Element("actuator")
    mjcf._motor(actuators, contact(), SMALL, ROBOT)
    mjcf._motor(actuators, contact(rpm=0.5), SMALL, ROBOT)  # as slow as one of 1 rpm
    mjcf._motor(actuators, contact(load_N=1e3), SMALL, ROBOT)
    gains = [float(item.get("kv", "")) for item in actuators]
    assert gains == pytest.approx([240 / 1e-4 / pi, 240 / 1e-4 / (pi / 30), 1e9 * 0.512 / pi], rel=1e-4)
    mjcf._motor(actuators, contact(), LARGE, ROBOT)  # N m s instead of µN mm s
    assert float(actuators[-1].get("kv", "")) == pytest.approx(gains[0] * 1e-9, rel=1e-4)
    mjcf._attraction(actuators, contact(), SMALL)
    assert numbers(actuators[-1].get("biasprm")) == near(500, 0, 0)
    assert (actuators[-1].get("site"), actuators[-1].get("gear")) == ("over_left", "0 0 -1 0 0 0")


@pytest.mark.parametrize("units", [SMALL, LARGE])
def test_body_and_wheels_of_a_model_for_mujoco_have_their_sizes_masses_and_places(units: Units) -> None:
    world, mm, g = ET.Element("worldbody"), units.length_mm, units.mass_g
    mjcf._body(world, ROBOT, (contact(), contact(BALL)), units)
    chassis = world[0]
    own, box, left, ball = (
        chassis.find(path) for path in ("inertial", "geom[@name='chassis']", "body", "geom[@name='ball']")
    )
    assert own is not None and box is not None and left is not None and ball is not None  # noqa: PT018
    assert numbers(own.get("pos")) == near(0.5 / mm, -0.25 / mm, 0)
    assert numbers(own.get("mass")) == near(8 * (1 - 1e-4) / g)
    assert numbers(own.get("diaginertia")) == near(*(30 / g / mm**2,) * 3)
    assert numbers(box.get("size")) == near(3 / mm, 2 / mm, 0.75 / mm)
    assert numbers(box.get("pos")) == near(0, 0, 2.25 / mm)
    assert numbers(ball.get("pos")) == near(-2 / mm, 0, 0.5 / mm)
    assert numbers(ball.get("size")) == near(0.5 / mm)
    assert numbers(left.get("pos")) == near(1.5 / mm, 2 / mm, 0.8 / mm)
    joint, inertial, geom = left
    assert numbers(joint.get("armature")) == near(0.1 * 8 * 0.64 / g / mm**2)
    assert numbers(inertial.get("mass")) == near(8e-4 / g)
    assert numbers(inertial.get("diaginertia")) == near(*(0.4 * 8e-4 * 0.64 / g / mm**2,) * 3)
    assert numbers(geom.get("size")) == near(0.8 / mm)
    assert numbers(geom.get("fromto")) == near(0, -0.008 / mm, 0, 0, 0.008 / mm, 0)
    assert [numbers(site.get("pos")) for site in chassis.iter("site")] == [
        near(1.5 / mm, 2 / mm, 0),
        near(-2 / mm, 0, 0),
    ]


def test_body_and_wheels_of_a_model_for_gazebo_are_in_metres_kilograms_and_newton() -> None:
    model = ET.Element("model")
    sdf._chassis(model, ROBOT, (contact(), contact(BALL)))
    link = model[0]

    def text(path: str) -> list[float]:
        return numbers(link.findtext(path))

    assert text("inertial/pose") == near(5e-4, -2.5e-4, 0, 0, 0, 0)
    assert text("inertial/mass") == near(8e-3 * 0.99)
    assert [text(f"inertial/inertia/{name}") for name in ("ixx", "iyy", "izz")] == [near(30e-9)] * 3
    assert text("visual/pose") == near(0, 0, 2.25e-3, 0, 0, 0)
    assert text("visual/geometry/box/size") == near(6e-3, 4e-3, 1.5e-3)
    assert text("collision/pose") == near(-2e-3, 0, 5e-4, 0, 0, 0)
    assert text("collision/geometry/sphere/radius") == near(5e-4)
    assert [float(item.text or "") for item in link.iter() if item.tag in ("mu", "mu2")] == [0.0, 0.0]  # a ball rolls
    sdf._wheel(model, ROBOT, contact())
    wheel = model[1]
    assert numbers(wheel.findtext("pose"))[:3] == near(1.5e-3, 2e-3, 8e-4)
    assert numbers(wheel.findtext("inertial/mass")) == near(8e-5)
    mu = [float(item.text or "") for item in wheel.iter() if item.tag in ("mu", "mu2")]
    assert mu == near(0.9, 0.9)
    slips = {item.tag: float(item.text or "") for item in wheel.iter() if item.tag in ("slip1", "slip2")}
    assert slips == pytest.approx({"slip1": 5e-4 / 3e-5, "slip2": 2e-3 / 4e-5}, rel=1e-5)  # along the axle, across it
    sdf._motor(model, contact())
    assert numbers(model[-1].findtext("initial_velocity")) == near(pi)
    sdf._attraction(model, (contact(), contact(BALL), contact(attraction_N=0.0)))
    names = [item.text for item in model[-1].iter("entity_name")]
    assert names == ["robot::left", "robot::chassis"]
    assert [numbers(item.text) for item in model[-1].iter("force")] == [near(0, 0, -5e-4)] * 2
