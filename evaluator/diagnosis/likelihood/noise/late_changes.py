"""Changes of a command that come later or earlier than its log says.

A program that commands the motors sends each change when the operating system lets it: some milliseconds late, never
twice the same. The start of a run has a parameter of its own; each later change, and the stop, shifts and turns the
rest of the path at random. An effect that bends the path, as a stray magnet does, would otherwise explain it: changes
up to 24 ms late were taken for one with a probability of 1.000.

A change that comes late by δ lets the robot continue as before for δ, so that the rest of its path is moved as a whole.
The next change comes in time and cuts δ off the motion between both. Forces that depend on position, and the lag of
motors, alter this at second order only.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from simulator.command import Command

Floats = NDArray[np.float64]

MOST_CHANGES = 24  # of a run, those with the largest shifts; a log of a controller may have hundreds of small ones


def jumps_of(command: Command) -> list[float]:
    """Times in s at which a command jumps after its motors were first switched on, the final stop included."""
    on = (command.left_rpm != 0.0) | (command.right_rpm != 0.0)
    jump = np.flatnonzero((np.diff(command.time_s) == 0) & np.logical_or.accumulate(on)[:-1])
    return sorted(set(command.time_s[jump].tolist()))


def late_changes(time_s: Floats, channels: Floats, changes_s: Sequence[float], half_distance_mm: float) -> Floats:
    """Response (k, n, 4) in mm/s of the channels of a run to the lateness of each change, largest ones first.

    time_s: (n,). channels: (n, 4), predicted, finite, of which midpoint and direction are used: see
    features.channels_of. changes_s: in order; those outside of the frames are omitted.
    """
    place, angle = channels[:, 0] + 1j * channels[:, 1], np.unwrap(channels[:, 2])
    velocity, turning = np.gradient(place, time_s), np.gradient(angle, time_s)
    # frames before a change: the last two whose differences do not contain it
    last = [int(np.searchsorted(time_s, at, side="left")) - 2 for at in changes_s]
    inside = [(at, frame) for at, frame in zip(changes_s, last, strict=True) if 0 <= frame < len(time_s) - 2]
    found = []
    for number, (at, before) in enumerate(inside):
        following, end = inside[number + 1] if number + 1 < len(inside) else (np.inf, -1)
        after = time_s > at
        later = time_s > following

        def moved(frame: int) -> tuple[NDArray[np.complex128], float]:
            """Velocity of every place if the robot continued as in a frame, and its yaw rate."""
            return velocity[frame] + 1j * turning[frame] * (place - place[frame]), float(turning[frame])

        on, turned_on = moved(before)
        cut, turned_cut = moved(end) if end >= 0 else (velocity, 0.0)
        shift = after * (on - np.where(later, cut, velocity))
        turn = after * (turned_on - np.where(later, turned_cut, turning))
        found.append(np.stack([shift.real, shift.imag, turn * half_distance_mm, np.zeros(len(time_s))], axis=-1))
    found.sort(key=lambda part: -float(np.sum(part**2)))
    return np.array(found[:MOST_CHANGES]).reshape(-1, len(time_s), 4)
