"""Observation of one mark in one frame."""

from __future__ import annotations

from typing import NamedTuple

OK = "ok"
REPEATED = "repeated frame"  # the recording shows the frame before once more
BACKGROUND = "at rest while the robot moves"  # something of its colour that is not on the robot: found afterwards
ALONE = "at rest, without its partner"  # nothing shows that it is a mark of a robot: found afterwards
UNLIKE = "at rest, and unlike the marks of a robot"  # no pair ever looked like one, and nothing moved: found afterwards
MISTAKEN = "something else, not the mark found later"  # a likelier pair came into view or into light: found afterwards
AMBIGUOUS = "ambiguous"
STRANGER = "not on the other mark's body"  # their distance changes as much as they move: found afterwards
OFF_COURSE = "off its course"  # where it cannot have come to, as codec residue is: found afterwards
WRONG_DISTANCE = "wrong distance"  # it and its partner lie farther apart or nearer than on one body: found afterwards


class Sighting(NamedTuple):
    """One mark in one frame: centre and its variances in px and px², status "ok" or why it is absent (then NaN)."""

    x: float
    y: float
    var_x: float
    var_y: float
    cov_xy: float
    status: str


NAN = float("nan")
ABSENT = {
    reason: Sighting(NAN, NAN, NAN, NAN, NAN, reason)
    for reason in (
        "not seen",  # its colour is nowhere that it could be
        "outside the image",  # partly or wholly beyond the border
        "partly hidden",  # too little of it shows
        "disturbed",  # its luma is not that of a disc: glare, a wire, a shadow
        "faded",  # its colour is there but much paler than it was: what a codec left behind, or a shadow
        "no disc",  # its colour is there but no disc of its size and brightness
        AMBIGUOUS,  # something else of its colour is beside it or in its place
        REPEATED,
    )
}
