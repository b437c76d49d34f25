"""Headings of poses in another convention, told by the direction of motion: a skid-steered robot moves along itself.

Wheels that slide let a robot drift aside by some degrees, not by 90, and not by the opposite of its heading; a load at
one end, by 30 in tight turns, so that gentle ones judge where there are some. A compass
counts clockwise from north, other programs clockwise from x: their robots seem to turn the other way or to move
sideways, and no exchange of sides in the commands corrects that.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread.command_unit import STRAIGHT_SHARE
from evaluator.diagnosis.mistakes.misread.turn_sense import FEWEST, FEWEST_FRAMES
from evaluator.diagnosis.mistakes.motion import midpoint_and_heading
from evaluator.diagnosis.mistakes.recognised import Found, by_recording
from evaluator.interchange.log_offset import averaging_times
from simulator.robot import Robot

Complexes = NDArray[np.complex128]

# Mean cosine of twice the angle between motion and heading. A reading is refuted below that of 30 degrees: robots with
# magnetic wheels drift aside by up to 18 degrees in a turn, and of 280 parts of right logs of six robots the least is
# 0.76. Another one has to agree to 23 degrees in the mean: headings of a Husky do so to 0.95 as they are and to 0.92 if
# their sign is the fault, simulated ones to 0.99.
REFUTED, AGREES = 0.5, 0.7
# Mean speed of both sides over that of the faster, from which a turn is gentle: with a centre of gravity a fifth of the
# wheelbase off, the middle of four wheels moves 13 degrees off its heading there, and 27 degrees at 0.6.
GENTLE_SHARE = 0.75
STRAIGHTEST_SHARE = 0.9  # a side force in turns, beyond any in the catalogue, left 0.47 at 0.75, and 0.96 here
COMPASS = "clockwise from the y axis, as a compass does from north (or its x and y are exchanged)"
CLOCKWISE = "clockwise (or its x or y axis points the other way)"
SIDEWAYS = "from another axis, 90 degrees off"
REMEDY = "give headings from the x axis of the plate toward its y axis (90 degrees minus a compass bearing)"


def in_another_convention(data: Sequence[RunData], robots: Sequence[Robot] = ()) -> list[Found]:
    """Runs with poses whose headings contradict their direction of motion: all, or all parts of a recording."""
    del robots  # neither size nor wheels of a robot change the direction in which it moves
    runs = {run.id: run for run in data if run.from_poses}
    for groups in ([list(runs)], by_recording(runs)):
        read = [(group, _reading([runs[name] for name in group])) for group in groups]
        found = [Found(name, "wrong-unit", seen, REMEDY) for group, seen in read if seen for name in group]
        if found:  # what moves robots aside in turns, but not in straight parts, is no convention
            return [] if len(groups) == 1 and _agree_where_straight(list(runs.values())) else found
    return []


def _reading(runs: Sequence[RunData]) -> str:
    """How headings of runs disagree with their direction of motion; "" if they do not clearly.

    The way of a single run may be a push or a slide: several have to agree. Tight turns tell another convention only.
    """
    for share in (GENTLE_SHARE, STRAIGHT_SHARE):
        ways = [_ways(run, share) for run in runs]
        if sum(map(np.any, ways)) >= FEWEST:
            break
    else:
        return ""
    way, *turned = np.sum(ways, axis=0)
    direct, opposite = np.array(turned) / way
    if direct.real > REFUTED:
        return ""
    agrees = {COMPASS: -opposite.real, CLOCKWISE: opposite.real, SIDEWAYS: -direct.real}
    found = [words for words, agreement in agrees.items() if agreement > AGREES]
    if found:
        return f"does not move the way it heads: its headings seem to count {', or '.join(found)}"
    if share < GENTLE_SHARE:
        return ""
    if abs(direct) > AGREES:
        off_deg = abs(float(np.degrees(np.angle(direct)))) / 2
        return f"does not move the way it heads: its headings are off by {off_deg:.0f} degrees"
    return "does not move the way it heads, and its headings follow no usual convention or are in another unit"


def _agree_where_straight(runs: Sequence[RunData]) -> bool:
    """Whether the headings of several runs agree with their motion in straight parts in several directions.

    In one direction alone, as along the x axis, headings of either sense agree.
    """
    ways = [_ways(run, STRAIGHTEST_SHARE) for run in runs]
    way, direct, opposite = np.sum(ways, axis=0)
    some = sum(map(np.any, ways)) >= FEWEST
    return bool(some and direct.real > AGREES * way.real and abs(opposite) < REFUTED * way.real)


def _ways(run: RunData, share: float) -> Complexes:
    """Sums (3,) of squared ways, and of them times the angle between motion and heading, or the sum of both, doubled.

    Doubled angles are the same for both directions of motion. share: least mean speed of both sides over that of the
    faster one: turns on the spot drift anywhere. Zeros for too few frames.
    """
    time_s, middle_mm, heading_rad = midpoint_and_heading(run)
    if len(time_s) < FEWEST_FRAMES:
        return np.zeros(3, dtype=np.complex128)
    times, half = averaging_times(time_s)
    sides = np.array(run.run_command.command.at(times))
    times = times[abs(sides.sum(axis=0)) / 2 > share * abs(sides).max(axis=0)]
    after, before = (np.array([np.interp(times + way * half, time_s, part) for part in middle_mm.T]) for way in (1, -1))
    way = ((after - before)[0] + 1j * (after - before)[1]) ** 2
    turn = np.exp(2j * np.interp(times, time_s, heading_rad))
    return np.array([np.abs(way).sum(), (way / turn).sum(), (way * turn).sum()])
