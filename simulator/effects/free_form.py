"""Free-form effect: a single term (see simulator.dynamics.terms) as an [[effect]] of robot.toml.

    [[effect]]
    id = "free-form"
    channel = "force_forward"       # where it acts, see simulator.dynamics.terms.CHANNELS
    basis = "sign_u"                # what it depends on, see simulator.dynamics.terms.BASES
    coefficient = -0.4              # mN, µN·mm, deg (steer), mm (camera), rpm (drive) or relative, per basis
    pattern = "common"              # over the wheels, see simulator.dynamics.terms.PATTERNS
    point_mm = [0.0, 0.0]           # for the bases toward_x and toward_y

The entry may be repeated; terms add up.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from simulator.dynamics.terms import (
    ABS_LEFT_COMMAND,
    ABS_RIGHT_COMMAND,
    BASES,
    CAMERA_X,
    CHANNELS,
    COS_ANGLE,
    DRAG,
    FORCE_FORWARD,
    FORCE_LEFT,
    FORCE_PLATE_X,
    FORCE_PLATE_Y,
    LEFT_COMMAND,
    LEFT_DRIVE,
    PATTERNS,
    RIGHT_COMMAND,
    SIN_ANGLE,
    SLIDE_COS2,
    SLIDE_SIN2,
    SPEED,
    STEER,
    TIME,
    UN_PER_MN,
    X_CUBED,
    Y_CUBED,
    Term,
    X,
    Y,
)

ID = "free-form"
_CHOICES: dict[str, Collection[str]] = {"channel": CHANNELS, "basis": BASES, "pattern": PATTERNS}
_OF_WHEELS = (COS_ANGLE, SIN_ANGLE, SLIDE_COS2, SLIDE_SIN2)
_OF_LENSES = (X_CUBED, Y_CUBED)
_OF_CAMERAS = (X, Y, TIME, *_OF_LENSES)
_OF_DRIVES = (LEFT_COMMAND, RIGHT_COMMAND, ABS_LEFT_COMMAND, ABS_RIGHT_COMMAND)


def scale_of_channel(channel: int) -> float:
    """Factor from file units (mN, µN·mm, deg, 1) to kernel units (µN, µN·mm, rad, 1) for a channel's coefficient."""
    if channel in (FORCE_FORWARD, FORCE_LEFT, FORCE_PLATE_X, FORCE_PLATE_Y, DRAG):
        return UN_PER_MN
    return math.radians(1.0) if channel == STEER else 1.0


def term_of(given: Mapping[str, Any]) -> Term:
    """The term of a valid entry."""
    channel = CHANNELS[given["channel"]]
    x, y = given.get("point_mm", (0.0, 0.0))
    return Term(
        channel,
        BASES[given["basis"]],
        float(given["coefficient"]) * scale_of_channel(channel),
        str(given.get("pattern", "common")),
        (float(x), float(y)),
    )


def faults(given: Mapping[str, Any]) -> Iterator[str]:
    """Errors of an entry, one phrase each."""
    known = [*_CHOICES, "coefficient", "point_mm"]
    for name in given:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.4)
            yield f"effect {ID} has no parameter {name}" + (f"; did you mean {near[0]}?" if near else "")
    for name, choices in _CHOICES.items():
        value = given.get(name, "common" if name == "pattern" else None)
        if not isinstance(value, str) or value not in choices:
            near = difflib.get_close_matches(str(value), choices, n=1, cutoff=0.4)
            hint = f"did you mean {near[0]}?" if near else f"it is one of {', '.join(choices)}"
            yield f"effect {ID}: {name} = {value!r}; {hint}"
    if not _is_number(given.get("coefficient")):
        yield f"effect {ID}: coefficient = {given.get('coefficient')!r} is not a finite number"
    point = given.get("point_mm", (0.0, 0.0))
    if not (isinstance(point, list | tuple) and len(point) == 2 and all(_is_number(value) for value in point)):
        yield f"effect {ID}: point_mm = {point!r} must be two numbers"
    basis, channel = BASES.get(str(given.get("basis"))), CHANNELS.get(str(given.get("channel")))
    if basis is None or channel is None:
        return
    of_wheels = SPEED <= channel < CAMERA_X
    if basis in _OF_WHEELS and not of_wheels:
        yield f"effect {ID}: basis {given['basis']} belongs to wheels, channel {given['channel']} does not"
    takes = _OF_DRIVES if channel >= LEFT_DRIVE else _OF_CAMERAS if channel >= CAMERA_X else None
    fits = basis in takes if takes is not None else basis not in (*_OF_LENSES, *_OF_DRIVES)
    if not fits:
        bases = [name for name, number in BASES.items() if takes is None or number in takes]
        hint = f"; it takes {', '.join(bases)}" if takes is not None else ""
        yield f"effect {ID}: channel {given['channel']} does not take basis {given['basis']}{hint}"


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
