"""Limits between a robot that rests and one that moves, or is moved by hand."""

from __future__ import annotations

ONSET_SIGMAS, ONSET_LEAST_MM = 6.0, 0.02  # distance from the rest position, in its scatter and in mm, that shows motion
MOVING_FRAMES = 4  # consecutive frames: one or two may be noise, or wrong marks in succession
RESTS_S = 0.1  # shortest rest between hand and motors: nobody releases the robot and switches on faster
