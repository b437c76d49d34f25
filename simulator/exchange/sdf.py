"""Export to Gazebo (SDF 1.9). Units: SI; body frame: x forward, y to the left, z up."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from simulator.exchange.creep import LIMIT, RAD_S_PER_RPM, Contact, contacts_in_turn, moments_g_mm2
from simulator.nominal_robot import GRAVITY_MM_S2
from simulator.robot import Robot

MM_PER_M, G_PER_KG = 1e3, 1e3
WHEEL_MASS = 1e-2  # of the robot's mass, each: Gazebo's solvers need parts of similar mass
STEP_S = 1e-3  # Gazebo's usual step


def sdf(robot: Robot, left_rpm: float, right_rpm: float) -> str:
    """A world with the robot on a plate, its motors at the commands of a turn.

    Raises SimulationError as contacts_in_turn does.
    """
    robot, contacts = contacts_in_turn(robot, left_rpm, right_rpm)
    root = ET.Element("sdf", version="1.9")
    world = ET.SubElement(root, "world", name="plate")
    physics = ET.SubElement(world, "physics", name="steps", type="ignored")
    _text(physics, "max_step_size", f"{STEP_S:g}")
    _text(world, "gravity", f"0 0 {-GRAVITY_MM_S2 / MM_PER_M:g}")
    ET.SubElement(world, "plugin", filename="gz-sim-physics-system", name="gz::sim::systems::Physics")
    _plate(world)
    model = ET.SubElement(world, "model", name="robot")
    _chassis(model, robot, contacts)
    for contact in contacts:
        _wheel(model, robot, contact)
        if contact.rpm is not None:
            _motor(model, contact)
    if any(contact.attraction_N for contact in contacts):
        _attraction(world, contacts)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _text(parent: ET.Element, tag: str, value: str) -> None:
    ET.SubElement(parent, tag).text = value


def _plate(world: ET.Element) -> None:
    model = ET.SubElement(world, "model", name="plate")
    _text(model, "static", "true")
    collision = ET.SubElement(ET.SubElement(model, "link", name="plate"), "collision", name="plate")
    _text(ET.SubElement(ET.SubElement(collision, "geometry"), "plane"), "normal", "0 0 1")


def _chassis(model: ET.Element, robot: Robot, contacts: tuple[Contact, ...]) -> None:
    """The body with its weight at plate level, so that driving shifts no load between the wheels."""
    body, mass = robot.body, robot.body.mass_g / G_PER_KG
    (x, y), wheels = robot.body.center_of_gravity_mm, sum(contact.wheel.grips for contact in contacts)
    link = ET.SubElement(model, "link", name="chassis")
    yaw, tilting = (moment / G_PER_KG / MM_PER_M**2 for moment in moments_g_mm2(robot))
    own = mass * (1 - WHEEL_MASS * wheels)
    _inertial(link, (x / MM_PER_M, y / MM_PER_M, 0.0), own, (tilting, tilting, yaw))
    sizes = (body.length_mm, body.width_mm, body.height_mm / 2)
    visual = ET.SubElement(link, "visual", name="body")
    _text(visual, "pose", f"0 0 {0.75 * body.height_mm / MM_PER_M:.9g} 0 0 0")
    _text(ET.SubElement(ET.SubElement(visual, "geometry"), "box"), "size", _numbers(*(v / MM_PER_M for v in sizes)))
    for contact in contacts:
        if not contact.wheel.grips:
            _ball(link, contact)


def _inertial(link: ET.Element, place: tuple[float, ...], mass: float, moments: tuple[float, ...]) -> None:
    inertial = ET.SubElement(link, "inertial")
    _text(inertial, "pose", f"{_numbers(*place)} 0 0 0")
    _text(inertial, "mass", f"{mass:.9g}")
    inertia = ET.SubElement(inertial, "inertia")
    for name, moment in zip(("ixx", "iyy", "izz"), moments, strict=True):
        _text(inertia, name, f"{moment:.9g}")


def _ball(link: ET.Element, contact: Contact) -> None:
    wheel = contact.wheel
    collision = ET.SubElement(link, "collision", name=wheel.name)
    _text(collision, "pose", f"{_numbers(*(v / MM_PER_M for v in (wheel.x_mm, wheel.y_mm, wheel.radius_mm)))} 0 0 0")
    _text(ET.SubElement(ET.SubElement(collision, "geometry"), "sphere"), "radius", f"{wheel.radius_mm / MM_PER_M:.9g}")
    _friction(collision, {"mu": "0", "mu2": "0"})


def _wheel(model: ET.Element, robot: Robot, contact: Contact) -> None:
    """A sphere on an axle, which touches the plate in one point."""
    wheel = contact.wheel
    if not wheel.grips:
        return
    radius, mass = wheel.radius_mm / MM_PER_M, WHEEL_MASS * robot.body.mass_g / G_PER_KG
    link = ET.SubElement(model, "link", name=wheel.name)
    _text(link, "pose", f"{_numbers(wheel.x_mm / MM_PER_M, wheel.y_mm / MM_PER_M, radius)} 0 0 0")
    _inertial(link, (0.0, 0.0, 0.0), mass, (0.4 * mass * radius**2,) * 3)
    collision = ET.SubElement(link, "collision", name="contact")
    _text(ET.SubElement(ET.SubElement(collision, "geometry"), "sphere"), "radius", f"{radius:.9g}")
    along, across = (
        abs(creep / MM_PER_M / force) if force else 0.0
        for force, creep in zip(contact.force_N, contact.creep_mm_s, strict=True)
    )
    # The first direction is that of the axle, which a wheel keeps as it turns.
    limit = f"{LIMIT * contact.friction(robot):.6g}"
    slips = {"slip1": f"{across:.6g}", "slip2": f"{along or across:.6g}"}
    _friction(collision, {"mu": limit, "mu2": limit, "fdir1": "0 1 0", **slips})
    joint = ET.SubElement(model, "joint", name=f"{wheel.name}_axle", type="revolute")
    _text(joint, "parent", "chassis")
    _text(joint, "child", wheel.name)
    _text(ET.SubElement(joint, "axis"), "xyz", "0 1 0")


def _friction(collision: ET.Element, values: dict[str, str]) -> None:
    ode = ET.SubElement(ET.SubElement(ET.SubElement(collision, "surface"), "friction"), "ode")
    for name, value in values.items():
        _text(ode, name, value)


def _motor(model: ET.Element, contact: Contact) -> None:
    plugin = ET.SubElement(
        model, "plugin", filename="gz-sim-joint-controller-system", name="gz::sim::systems::JointController"
    )
    _text(plugin, "joint_name", f"{contact.wheel.name}_axle")
    _text(plugin, "initial_velocity", f"{(contact.rpm or 0.0) * RAD_S_PER_RPM:.9g}")


def _attraction(world: ET.Element, contacts: tuple[Contact, ...]) -> None:
    plugin = ET.SubElement(
        world, "plugin", filename="gz-sim-apply-link-wrench-system", name="gz::sim::systems::ApplyLinkWrench"
    )
    for contact in contacts:
        if contact.attraction_N:
            lasting = ET.SubElement(plugin, "persistent")
            _text(lasting, "entity_name", f"robot::{contact.wheel.name if contact.wheel.grips else 'chassis'}")
            _text(lasting, "entity_type", "link")
            _text(lasting, "force", f"0 0 {-contact.attraction_N:.9g}")


def _numbers(*values: float) -> str:
    return " ".join(f"{value:.9g}" for value in values)
