"""Words and units of free-form terms, by channel and basis, for reports and user-defined effects."""

from __future__ import annotations

# Channel → what acts, and its unit.
CHANNEL_WORDS = {
    "force_forward": ("a force along the robot", "mN"),
    "force_left": ("a force across the robot", "mN"),
    "moment": ("a moment about the vertical", "µN·mm"),
    "force_plate_x": ("a force along x of the plate", "mN"),
    "force_plate_y": ("a force along y of the plate", "mN"),
    "speed": ("a relative error of the surface speed", "1"),
    "steer": ("a turn of the wheels about the vertical", "deg"),
    "load": ("a relative change of the wheel load", "1"),
    "stiffness": ("a relative change of the slip stiffness", "1"),
    "drag": ("a force along the wheels", "mN"),
    "friction": ("a relative change of the friction", "1"),
    "friction_across": ("a relative change of the friction across the wheels", "1"),
    "camera_x": ("an error of the measured x", "mm"),
    "camera_y": ("an error of the measured y", "mm"),
    "left_drive": ("a rotation of the left wheels in addition to their command", "rpm"),
    "right_drive": ("a rotation of the right wheels in addition to their command", "rpm"),
}
# Basis → how the term depends on it, and the unit by which the unit of the channel is divided.
BASIS_WORDS = {
    "one": ("that is constant", ""),
    "u": ("proportional to forward speed", "/(mm/s)"),
    "v": ("proportional to sideways speed", "/(mm/s)"),
    "yaw_rate": ("proportional to yaw rate", "/(rad/s)"),
    "u_abs_u": ("growing with the square of forward speed", "/(mm/s)²"),
    "v_abs_v": ("growing with the square of sideways speed", "/(mm/s)²"),
    "yaw_rate_abs": ("growing with the square of the yaw rate", "/(rad/s)²"),
    "abs_u": ("growing with speed, the same forward and backward", "/(mm/s)"),
    "abs_yaw_rate": ("growing with yaw rate, the same to the left and right", "/(rad/s)"),
    "sign_u": ("that changes sign between forward and backward", ""),
    "sign_v": ("that changes sign with sideways motion", ""),
    "sign_yaw_rate": ("that changes sign between left and right turns", ""),
    "cos_heading": ("varying with the cosine of heading", ""),
    "sin_heading": ("varying with the sine of heading", ""),
    "cos_2_heading": ("varying with the cosine of twice the heading", ""),
    "sin_2_heading": ("varying with the sine of twice the heading", ""),
    "x": ("proportional to plate x", "/mm"),
    "y": ("proportional to plate y", "/mm"),
    "time": ("growing with time in the run", "/s"),
    "x_r_squared": ("growing with x times the square of the distance from the origin", "/mm³"),
    "y_r_squared": ("growing with y times the square of the distance from the origin", "/mm³"),
    "left_command": ("proportional to the left command", "/rpm"),
    "right_command": ("proportional to the right command", "/rpm"),
}
# Two places where one coefficient acts.
TWIN_WORDS = {
    "left_drive.left_command=right_drive.right_command": "proportional to their own command",
    "left_drive.right_command=right_drive.left_command": "proportional to the command of the other side",
}


def unit_of_coefficient(channel: str, basis: str) -> str:
    """Unit of a coefficient for display; empty for 1."""
    unit, per = CHANNEL_WORDS[channel][1], BASIS_WORDS[basis][1]
    if unit == "rpm" and per == "/rpm":
        return ""
    shown = f"{unit}{per}"
    return shown if per else shown.removesuffix("1")
