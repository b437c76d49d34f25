"""Observation of one mark in one frame."""

from __future__ import annotations

from typing import NamedTuple

OK = "ok"
REPEATED = "repeated frame"  # the recording shows the previous frame again
AMBIGUOUS = "ambiguous"
# Reasons that are found after the whole recording has been tracked:
BACKGROUND = "at rest while the robot moves"  # an object of the mark's colour that is not on the robot
ALONE = "at rest, without its partner"  # no evidence that it is a mark of a robot
UNLIKE = "at rest, and unlike the marks of a robot"  # no pair looked like the marks of a robot, and nothing moved
MISTAKEN = "something else, not the mark found later"  # a more probable pair appeared, or was lit, later
STRANGER = "not on the other mark's body"  # their distance changes as much as they move
OFF_COURSE = "off its course"  # a position that it cannot have reached, such as codec residue
WRONG_DISTANCE = "wrong distance"  # its distance from its partner is not that of one body


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
        "not seen",  # its colour is nowhere within its reach
        "outside the image",  # partly or wholly beyond the border
        "partly hidden",  # too small a part is visible
        "disturbed",  # its luma is not that of a disc: glare, a wire, a shadow
        "faded",  # its colour is there but much paler: codec residue, or a shadow
        "no disc",  # its colour is there but no disc of its size and brightness
        AMBIGUOUS,  # another object of its colour is beside it or in its place
        REPEATED,
    )
}
