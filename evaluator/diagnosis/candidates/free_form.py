"""Free-form terms: physics and measurement errors that are not in the catalogue.

The terms of simulator.dynamics.terms, {channel} × {basis} × {pattern over the wheels}, in families of one to four terms
that belong together (a moment over heading: cosine and sine). Families equivalent to an effect of the catalogue are
omitted, so that a family describes something that no named effect can.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.candidates.free_form_words import BASIS_WORDS, CHANNEL_WORDS, TWIN_WORDS
from simulator.dynamics.scale import DIMENSIONS
from simulator.dynamics.terms import BASES, CHANNELS, X_CUBED, Y_CUBED, is_of_plate
from simulator.dynamics.terms import Term as KernelTerm
from simulator.effects.coordinates import Candidate, Coordinate, Parameters
from simulator.effects.free_form import scale_of_channel
from simulator.effects.parameter import PAPER_SIZE, Size

Floats = NDArray[np.float64]

PREFIX = "free:"
# Steps in file units with a visible, linear response, for a basis of size one and a robot of the paper's size.
CHANNEL_STEP = {
    "force_forward": 0.02,
    "force_left": 0.02,
    "moment": 20.0,
    "force_plate_x": 0.02,
    "force_plate_y": 0.02,
    "speed": 0.002,
    "steer": 0.1,
    "load": 0.01,
    "stiffness": 0.01,
    "drag": 0.02,
    "friction": 0.01,
    "friction_across": 0.01,
    "camera_x": 0.02,
    "camera_y": 0.02,
    "left_drive": 0.002,
    "right_drive": 0.002,
}
# Bounds of relative changes: the sign is preserved, and values are plausible for a wheel. A slip law of another shape
# may have several times the initial stiffness.
RELATIVE = {
    "load": (-0.9, 2.0),
    "stiffness": (-0.9, 6.0),
    "friction": (-0.9, 2.0),
    "friction_across": (-0.9, 2.0),
}
# Bounds of changes that are as likely in either direction. A side may turn by the command of the other one alone.
EITHER_WAY = {"speed": 0.6, "left_drive": 1.5, "right_drive": 1.5}
MOST_STEPS = 200  # bound of forces, moments, angles and lengths: one step is just visible, so that no fit is near it
OWN_COMMAND = ("left_drive", "left_command"), ("right_drive", "right_command")
OTHER_COMMAND = ("left_drive", "right_command"), ("right_drive", "left_command")
# Sizes of the bases on a plate for the paper's robot and at its speeds, by which steps are divided.
BASIS_SIZE = {
    "u": 3.0,
    "abs_u": 3.0,
    "u_abs_u": 10.0,
    "v": 0.5,
    "v_abs_v": 0.25,
    "x": 10.0,
    "y": 10.0,
    "time": 5.0,
    "x_r_squared": 1e3,
    "y_r_squared": 1e3,
    "yaw_rate": 0.3,
    "abs_yaw_rate": 0.3,
    "yaw_rate_abs": 0.1,
}


@dataclass(frozen=True)
class Item:
    """One coefficient of a family; twin: another place where the same coefficient acts."""

    channel: str
    basis: str
    pattern: str = "common"
    twin: Item | None = None

    @property
    def name(self) -> str:
        """Notation of the item: channel.basis, the pattern unless it is common, = and its twin."""
        own = f"{self.channel}.{self.basis}" + ("" if self.pattern == "common" else f".{self.pattern}")
        return own if self.twin is None else f"{own}={self.twin.name}"

    @property
    def parts(self) -> tuple[Item, ...]:
        """The item and its twin, if there is one: on both acts one coefficient."""
        return (self,) if self.twin is None else (self, self.twin)

    @property
    def of_plate(self) -> bool:
        """Whether it depends on the robot's position or direction on the plate."""
        return is_of_plate(CHANNELS[self.channel], BASES[self.basis])


@dataclass(frozen=True)
class FreeTerm(Candidate):
    """A family of free-form terms that acts in the simulator."""

    items: tuple[Item, ...] = ()

    def kernel_terms(self, values: Sequence[float]) -> list[KernelTerm]:
        """Terms of the kernel for these coefficients, given in file units."""
        result = []
        for item, value in self.acting(values):
            channel = CHANNELS[item.channel]
            size = float(value) * scale_of_channel(channel)
            result.append(KernelTerm(channel, BASES[item.basis], size, item.pattern))
        return result

    def acting(self, values: Sequence[float]) -> list[tuple[Item, float]]:
        """Every item on which a coefficient acts, with its value."""
        return [(part, float(value)) for item, value in zip(self.items, values, strict=True) for part in item.parts]

    def describe(self) -> str:
        """The family in plain words."""
        if all(item.twin for item in self.items):
            words = " and ".join(TWIN_WORDS[item.name] for item in self.items)
            return f"a rotation of the wheels in addition to their command, alike on both sides, {words}"
        channels = {item.channel for item in self.items}
        if {(item.channel, item.basis) for item in self.items} == {*OWN_COMMAND, *OTHER_COMMAND}:
            return "a rotation of the wheels in addition to their command, on each side proportional to both commands"
        if len(channels) == 1:
            words = " and ".join(dict.fromkeys(BASIS_WORDS[item.basis][0] for item in self.items))
            return f"{CHANNEL_WORDS[self.items[0].channel][0]} {words}{self._wheels()}"
        return (
            " and ".join(f"{CHANNEL_WORDS[i.channel][0]} {BASIS_WORDS[i.basis][0]}" for i in self.items)
            + self._wheels()
        )

    def _wheels(self) -> str:
        patterns = {item.pattern for item in self.items} - {"common"}
        return f" ({', '.join(sorted(patterns))} wheels)" if patterns else ""


def grows_with_time(effect: str) -> bool:
    """Whether a free-form term has a part in proportion to the time since the start of a run."""
    parts = effect.removeprefix(PREFIX).split("+")
    return effect.startswith(PREFIX) and any("time" in part.split(".")[1:2] for part in parts)


def free_terms(size: Size = PAPER_SIZE, *, one_frame: bool = True) -> dict[str, FreeTerm]:
    """All families by id, with steps and bounds for the size of a robot.

    one_frame: whether the runs share a frame; otherwise without families that depend on the plate.
    """
    every = (_family(items, size) for items in _families())
    return {term.id: term for term in every if one_frame or not any(item.of_plate for item in term.items)}


def own_commands(*, alike: bool) -> FreeTerm:
    """Rotation of each side in proportion to its command; alike: one coefficient for both sides instead of two."""
    left, right = (Item(*place) for place in OWN_COMMAND)
    return _family((replace(left, twin=right),) if alike else (left, right), PAPER_SIZE)


def _family(items: tuple[Item, ...], size: Size) -> FreeTerm:
    names = [item.name for item in items]
    coordinates = tuple(coefficient(name, item, size) for name, item in zip(names, items, strict=True))

    def physical(values: tuple[float, ...]) -> Parameters:
        return dict(zip(names, map(float, values), strict=True))

    return FreeTerm(PREFIX + "+".join(names), coordinates, physical, items=items)


def coefficient(name: str, item: Item, size: Size = PAPER_SIZE) -> Coordinate:
    """A coefficient with its visible step, bounded so that friction, load and speed keep their sign."""
    basis = BASIS_SIZE.get(item.basis, 1.0) * size.length ** _length_power(item.basis)
    step = CHANNEL_STEP[item.channel] * _times_as_large(item.channel, size)
    most = EITHER_WAY.get(item.channel, MOST_STEPS * step)
    low, high = RELATIVE.get(item.channel, (-most, most))
    if item.basis != "one":  # may have either sign
        low, high = max(low, -high), min(high, -low)
    return Coordinate(name, 0.0, step / basis, low / basis, high / basis)


def _length_power(basis: str) -> int:
    number = BASES[basis]
    if number in (X_CUBED, Y_CUBED):
        return 3
    return DIMENSIONS[number][0] if number in DIMENSIONS else 0


def _times_as_large(channel: str, size: Size) -> float:
    unit = CHANNEL_WORDS[channel][1]
    return size.force * size.length if unit == "µN·mm" else {"mN": size.force, "mm": size.length}.get(unit, 1.0)


def _families() -> Iterator[tuple[Item, ...]]:
    def each(channel: str, *groups: str, pattern: str = "common") -> Iterator[tuple[Item, ...]]:
        for group in groups:
            yield tuple(Item(channel, basis, pattern) for basis in group.split())

    heading, twice = "cos_heading sin_heading", "cos_2_heading sin_2_heading"
    yield from each(
        "force_forward", "u_abs_u", "sign_u", "sign_u u u_abs_u", "abs_u", "abs_yaw_rate", "time", twice, "x y"
    )
    yield from each(
        "force_left", "sign_u", "abs_u", "u", "yaw_rate", "sign_yaw_rate", "v", "v_abs_v", "time", twice, "x y"
    )
    yield from each(
        "moment", "one", "sign_u", "u", "abs_u", "abs_yaw_rate", "yaw_rate_abs", "time", heading, twice, "x y"
    )
    yield from each("moment", "sign_yaw_rate yaw_rate yaw_rate_abs", f"{heading} {twice}", "u_abs_u")
    for basis in ("time", "abs_u", "abs_yaw_rate"):
        yield Item("force_plate_x", basis), Item("force_plate_y", basis)
    yield tuple(Item(f"force_plate_{a}", b) for a in "xy" for b in "xy")
    for pattern in ("driving", "driving-left-right"):
        yield from each("speed", "sign_u", "abs_u", "time", heading, twice, "x y", "abs_yaw_rate", pattern=pattern)
        yield from each("steer", "sign_u", "abs_u", "time", pattern=pattern)
        yield from each("drag", "sign_u", "u", pattern=pattern)
    for pattern in ("front-left", "front-right"):
        yield from each("speed", "sign_u", "abs_u", "time", pattern=pattern)
    yield from each("friction", "abs_u", "time", "sign_u", "abs_yaw_rate", heading, twice)
    yield from each("stiffness", "one", "abs_u", "time", "sign_u")
    for pattern in ("driving", "driven", "driving-left-right", "driven-left-right"):
        yield from each("friction", "one", "time", "abs_u", pattern=pattern)
        yield from each("stiffness", "one", pattern=pattern)
    for pattern in ("front-left", "front-right", "rear-left", "rear-right"):
        yield Item("friction", "one", pattern), Item("stiffness", "one", pattern)
        yield Item("friction", "one", pattern), Item("friction", "abs_u", pattern), Item("stiffness", "one", pattern)
        yield tuple(Item(channel, "one", pattern) for channel in ("friction", "friction_across", "stiffness"))
    yield from each("steer", "one", pattern="driven")
    yield from each("steer", "one", pattern="driven-left-right")
    # a load shifted from one diagonal to the other differs from magnet-imbalance by a fifth of a sigma only: omitted
    for pattern in ("front-rear", "driven-left-right"):
        yield from each("load", "one", pattern=pattern)
    # a constant change of the load of all wheels has no effect if the slip law is normalized by the load
    yield from each("load", "time", "abs_u", "sign_u", pattern="driving")
    yield from each("load", "sign_u", "abs_yaw_rate", pattern="front-rear")
    yield from each("load", "sign_yaw_rate", pattern="driving-left-right")
    yield from each("drag", "sign_u", "u", pattern="left-right")
    # a drive that mixes its sides: gears that share a shaft, a mixer in the controller
    yield Item("left_drive", "right_command"), Item("right_drive", "left_command")
    yield tuple(Item(f"{a}_drive", f"{b}_command") for a in ("left", "right") for b in ("left", "right"))
    # the same gains on both sides: of the common part of the commands 1 + own + other, of their difference 1 + own −
    # other
    own, other = (Item(*first, twin=Item(*second)) for first, second in (OWN_COMMAND, OTHER_COMMAND))
    yield (other,)
    yield own, other
    yield Item("camera_x", "time"), Item("camera_y", "time")  # a drift of the image
    yield Item("camera_x", "x"), Item("camera_x", "y")  # unequal scales and a shear; the rest is a scale and a turn
    yield Item("camera_x", "x_r_squared"), Item("camera_y", "y_r_squared")  # residual distortion of the lens


@dataclass(frozen=True)
class WheelFriction(FreeTerm):
    """Relative change of the friction under single wheels. Not a candidate: see noise/friction_wander.py."""

    weights: tuple[float, ...] = ()  # of the wheels

    def kernel_terms(self, values: Sequence[float]) -> list[KernelTerm]:
        """The term of the kernel for this change."""
        channel = CHANNELS["friction"]
        return [KernelTerm(channel, BASES["one"], float(values[0]) * scale_of_channel(channel), self.weights)]


@cache
def wheel_friction(wheels: int) -> tuple[WheelFriction, ...]:
    """A term for each wheel of a robot with this number of wheels."""
    change = coefficient("change", Item("friction", "one"))
    return tuple(
        WheelFriction(
            f"friction-under-wheel-{wheel + 1}-of-{wheels}",
            (change,),
            lambda values: {"change": float(values[0])},
            weights=tuple(float(other == wheel) for other in range(wheels)),
        )
        for wheel in range(wheels)
    )
