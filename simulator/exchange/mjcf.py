"""Export to MuJoCo (MJCF). Body frame: x forward, y to the left, z up, origin on the plate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree as ET

from simulator.exchange.creep import LIMIT, RAD_S_PER_RPM, SMALL_MM, Contact, contacts_in_turn, moments_g_mm2
from simulator.nominal_robot import GRAVITY_MM_S2, Wheel
from simulator.robot import Robot

SETTLES = 10.0  # time constant of a contact, in steps; MuJoCo's minimum of two makes contacts chatter
SINKS = 1e-3  # of the smallest wheel's radius: approximate depth to which the robot may sink into the plate
WHEEL_MASS = 1e-4  # of the robot's mass, each: in the slip model wheels have no mass
ARMATURE = 0.1  # of mass times radius squared: motor inertia, without which light wheels are numerically unstable
SHORTEST = 2.0  # shortest time constant, in steps
IMPEDANCE = 0.9  # of contacts, at any depth
CONTACTS = 2  # of a capsule with a plane
NARROW = 1e-2  # of the radius: half the width of a wheel. Capsules, because their contact is aligned with the axle
LAGS = 1e-4  # of the commanded rotation: loss of the motors under load
FASTEST = 1e9  # rad/s² at which a wheel starts to turn; MuJoCo calls a motion unstable from ten times as much


@dataclass(frozen=True)
class Units:
    """Units in which a model's numbers are neither tiny nor huge: mm and g, or m and kg; per_N: newton in them."""

    length_mm: float
    mass_g: float

    @property
    def per_N(self) -> float:
        """One newton in the unit of force."""
        return 1e6 / (self.length_mm * self.mass_g)

    @staticmethod
    def of(robot: Robot) -> Units:
        """Metres and kilograms for robots of 0.1 m or more."""
        return Units(1e3, 1e3) if max(robot.extent_mm) > SMALL_MM else Units(1.0, 1.0)


def mjcf(robot: Robot, left_rpm: float, right_rpm: float) -> str:
    """A model whose keyframe "turn" holds the commands of a turn, with the robot's steady turn at these commands.

    Raises SimulationError as contacts_in_turn does.
    """
    robot, contacts = contacts_in_turn(robot, left_rpm, right_rpm)
    units = Units.of(robot)
    step = _time_step_s(robot, contacts, units)
    creeps = [_creep(contact, robot, units) for contact in contacts]
    softness = _softness(creeps, step)
    root = ET.Element("mujoco", model=robot.name)
    ET.SubElement(root, "compiler", angle="radian", inertiafromgeom="false")
    gravity = f"0 0 {-GRAVITY_MM_S2 / units.length_mm:g}"
    ET.SubElement(
        root,
        "option",
        timestep=f"{step:.4g}",
        gravity=gravity,
        cone="elliptic",
        integrator="implicitfast",
        impratio=f"{softness:.6g}",
    )
    world = ET.SubElement(root, "worldbody")
    ET.SubElement(world, "geom", name="plate", type="plane", size="0 0 1", contype="0", conaffinity="0")
    _body(world, robot, contacts, units)
    pairs, actuators = ET.SubElement(root, "contact"), ET.SubElement(root, "actuator")
    controls = []
    for contact, creep in zip(contacts, creeps, strict=True):
        _pair(pairs, contact, creep, step, softness, robot)
        if contact.rpm is not None:
            controls.append(contact.rpm * RAD_S_PER_RPM)
            _motor(actuators, contact, units, robot)
    for contact in contacts:
        if contact.attraction_N:
            _attraction(actuators, contact, units)
            controls.append(0.0)
    ET.SubElement(ET.SubElement(root, "keyframe"), "key", name="turn", ctrl=_numbers(*controls))
    root.insert(0, ET.Comment(_remark(units, left_rpm, right_rpm)))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _remark(units: Units, left_rpm: float, right_rpm: float) -> str:
    names = "m, kg and N" if units.length_mm > 1 else "mm, g and µN"
    return (
        f" Written by turnscope. Units: {names}, s and rad. Controls of the motors are rotations in rad/s; the "
        f'keyframe "turn" has {left_rpm:g} / {right_rpm:g} rpm. '
    )


def _time_step_s(robot: Robot, contacts: tuple[Contact, ...], units: Units) -> float:
    """Time step so short that contacts, which settle in SETTLES steps, are stiff enough for the loads."""
    mass = robot.body.mass_g / units.mass_g
    pressed = sum((contact.load_N * units.per_N) for contact in contacts) / mass  # m/s²
    radius = min(contact.wheel.radius_mm for contact in contacts) / units.length_mm
    return float((SINKS * radius / pressed) ** 0.5 / 2)


def _body(world: ET.Element, robot: Robot, contacts: tuple[Contact, ...], units: Units) -> None:
    """The chassis with its weight at plate level, so that driving shifts no load between the wheels, and the wheels."""
    body, (x, y) = robot.body, robot.body.center_of_gravity_mm
    mass = robot.body.mass_g / units.mass_g
    length, width, height = (value / units.length_mm for value in (body.length_mm, body.width_mm, body.height_mm))
    yaw, tilting = _inertia(robot, units)
    chassis = ET.SubElement(world, "body", name="robot")
    ET.SubElement(chassis, "freejoint", name="pose")
    wheels = sum(1 for contact in contacts if contact.wheel.grips)
    ET.SubElement(
        chassis,
        "inertial",
        pos=_numbers(x / units.length_mm, y / units.length_mm, 0),
        mass=f"{mass * (1 - WHEEL_MASS * wheels):.9g}",
        diaginertia=_numbers(tilting, tilting, yaw),
    )
    ET.SubElement(
        chassis, "geom", name="chassis", type="box", size=_numbers(length / 2, width / 2, height / 4),
        pos=_numbers(0, 0, 3 * height / 4), contype="0", conaffinity="0",
    )  # fmt: skip
    for contact in contacts:
        _wheel(chassis, contact, mass, units)


def _wheel(chassis: ET.Element, contact: Contact, mass: float, units: Units) -> None:
    wheel = contact.wheel
    radius, place = wheel.radius_mm / units.length_mm, (wheel.x_mm / units.length_mm, wheel.y_mm / units.length_mm)
    ET.SubElement(chassis, "site", name=f"over_{wheel.name}", pos=_numbers(*place, 0))
    look: dict[str, Any] = {"name": wheel.name, "contype": "0", "conaffinity": "0"}
    if not wheel.grips:
        ET.SubElement(chassis, "geom", type="sphere", size=f"{radius:.9g}", pos=_numbers(*place, radius), **look)
        return
    body = ET.SubElement(chassis, "body", name=f"{wheel.name}_wheel", pos=_numbers(*place, radius))
    own = WHEEL_MASS * mass
    ET.SubElement(
        body,
        "joint",
        name=f"{wheel.name}_axle",
        type="hinge",
        axis="0 1 0",
        armature=f"{ARMATURE * mass * radius**2:.6g}",
    )
    inertia = _numbers(0.4 * own * radius**2, 0.4 * own * radius**2, 0.4 * own * radius**2)
    ET.SubElement(body, "inertial", pos="0 0 0", mass=f"{own:.9g}", diaginertia=inertia)
    half = NARROW * radius
    ET.SubElement(body, "geom", type="capsule", size=f"{radius:.9g}", fromto=_numbers(0, -half, 0, 0, half, 0), **look)


@dataclass(frozen=True)
class Creep:
    """Creep of a contact: slopes of friction along and across by its speed, and its effective inverse mass."""

    along: float
    across: float
    inverse_mass: float

    @property
    def ratio(self) -> float:
        """Square root of the slope along over the slope across; 1 if only one of them is known."""
        return (self.along / self.across) ** 0.5 if self.along and self.across else 1.0

    @property
    def time(self) -> float:
        """Time constant that gives this creep, s, if friction is as soft as the normal force; 0: none.

        A MuJoCo contact creeps by R/B times its force, with B = 2/(d·t) and R = (1 - d)/d times the inverse mass.
        """
        slope = (self.across or self.along) / CONTACTS
        return 2 / ((1 - IMPEDANCE) * slope * self.inverse_mass) if slope else 0.0


def _creep(contact: Contact, robot: Robot, units: Units) -> Creep:
    along, across = (
        abs(force) * units.per_N / abs(creep / units.length_mm) if creep and force else 0.0
        for force, creep in zip(contact.force_N, contact.creep_mm_s, strict=True)
    )
    return Creep(along, across, _inverse_mass(contact.wheel, robot, units))


def _softness(creeps: Sequence[Creep], step: float) -> float:
    """impratio: friction as soft as the time step allows, so that it follows creep instead of acceleration."""
    shortest = min((creep.time for creep in creeps if creep.time), default=0.0)
    return min(1.0, SETTLES * step / shortest) if shortest else 1.0


def _pair(pairs: ET.Element, contact: Contact, creep: Creep, step: float, softness: float, robot: Robot) -> None:
    """The contact of a wheel with the plate; the first direction of a capsule's contact is that of its axle."""
    solimp = f"{IMPEDANCE} {IMPEDANCE} 1"
    hard: dict[str, Any] = {
        "geom1": "plate",
        "geom2": contact.wheel.name,
        "solref": _numbers(SETTLES * step, 1),
        "solimp": solimp,
    }
    if not contact.wheel.grips or not contact.load_N > 0:
        ET.SubElement(pairs, "pair", condim="1", **hard)
        return
    limit, ratio = LIMIT * contact.friction(robot), creep.ratio
    # Softness in the second direction is that in the first over the square of the ratio of the limits.
    friction = _numbers(limit / max(ratio, 1), limit * min(ratio, 1), 0, 0, 0)
    soft = _numbers(max(softness * creep.time, SHORTEST * step), 1)
    ET.SubElement(pairs, "pair", condim="3", friction=friction, solreffriction=soft, **hard)


def _inverse_mass(wheel: Wheel, robot: Robot, units: Units) -> float:
    """Acceleration of a wheel's centre per unit force on it, averaged over all directions."""
    mass, (yaw, tilting) = robot.body.mass_g / units.mass_g, _inertia(robot, units)
    x, y = ((place - middle) / units.length_mm for place, middle in zip(
        (wheel.x_mm, wheel.y_mm), robot.body.center_of_gravity_mm, strict=True
    ))  # fmt: skip
    z = wheel.radius_mm / units.length_mm
    turned = (y * y + z * z) / tilting + (x * x + z * z) / tilting + (x * x + y * y) / yaw
    return 1 / mass + turned / 3


def _inertia(robot: Robot, units: Units) -> tuple[float, float]:
    yaw, tilting = (moment / units.mass_g / units.length_mm**2 for moment in moments_g_mm2(robot))
    return yaw, tilting


def _motor(actuators: ET.Element, contact: Contact, units: Units, robot: Robot) -> None:
    """A motor that holds its speed under the friction of its wheel; its control is the speed in rad/s."""
    wheel = contact.wheel
    radius = wheel.radius_mm / units.length_mm
    torque = contact.friction(robot) * contact.load_N * units.per_N * radius
    turning = max(abs(contact.rpm or 0.0), 1.0) * RAD_S_PER_RPM
    inertia = ARMATURE * robot.body.mass_g / units.mass_g * radius**2
    gain = min(torque / LAGS, FASTEST * inertia) / turning
    ET.SubElement(actuators, "velocity", name=f"{wheel.name}_motor", joint=f"{wheel.name}_axle", kv=f"{gain:.6g}")


def _attraction(actuators: ET.Element, contact: Contact, units: Units) -> None:
    """A constant force toward the plate, which needs no control."""
    name = contact.wheel.name
    ET.SubElement(
        actuators, "general", name=f"{name}_attraction", site=f"over_{name}", gear="0 0 -1 0 0 0",
        biastype="affine", gainprm="0", biasprm=_numbers(contact.attraction_N * units.per_N, 0, 0),
    )  # fmt: skip


def _numbers(*values: float) -> str:
    return " ".join(f"{value:.9g}" for value in values)
