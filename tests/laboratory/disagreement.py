"""Which runs truly disagree with the robot file, in which phase and quantity: two motions without noise, side by side.

The one is the session as it was. The other has the robot, camera and clock that are written in the files, driven by the
commands, frictions, gains and starts of the very runs: what a run has of its own is no disagreement of the model. Speed
along and across the robot and yaw rate are slopes over pieces of about a second, as seen on the marks.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from tests.laboratory.effects import View
from tests.laboratory.reference import Array, World
from tests.laboratory.session import FRAME_S, Session, noise_of, true_marks

PIECE_S = 1.0
SIGMAS = 3.5  # of the noise of a phase's mean: beyond, a run disagrees
DRAWS = 200  # of noise on a piece at rest
QUANTITIES = ("along", "sideways", "yaw_rate")
Item = tuple[str, str, str]  # run, phase (start, steady), quantity


def disagreements(session: Session, rng: np.random.Generator) -> list[Item]:
    """Phases of runs whose two motions differ by more than SIGMAS of what the noise of the session makes of them."""
    world = World(session.said, friction_of_run=session.world.friction_of_run)
    plain = replace(session, world=world, view=View())
    sigma = piece_sigmas(session, rng)
    found: list[Item] = []
    for run, ((times, seen), (_, said)) in enumerate(zip(true_marks(session), true_marks(plain), strict=True)):
        begin, end = max(session.start_s[run], times[0]), times[-1]
        if np.isfinite(session.stop_s[run]):
            end = min(end, session.stop_s[run])
        edges = np.linspace(begin, end, max(int((end - begin) / PIECE_S), 1) + 1)
        apart: dict[str, list[Array]] = {"start": [], "steady": []}
        for low, high in pairwise(edges):
            inside = (times >= low) & (times <= high)
            if inside.sum() >= 5:
                difference = _velocity(times[inside], seen[:, inside]) - _velocity(times[inside], said[:, inside])
                apart["start" if (low + high) / 2 - begin < PIECE_S else "steady"].append(difference)
        for phase, values in apart.items():
            if values:
                large = np.abs(np.mean(values, axis=0)) * np.sqrt(len(values)) > SIGMAS * sigma
                found += [
                    (f"r{run + 1:02d}", phase, name) for name, is_so in zip(QUANTITIES, large, strict=True) if is_so
                ]
    return found


def piece_sigmas(session: Session, rng: np.random.Generator) -> Array:
    """Standard deviations (3,) of the velocities of a piece, mm/s and rad/s, of marks at rest with their noise."""
    times = np.arange(0, PIECE_S, FRAME_S)
    robot = session.said
    rest = np.array([*robot.green_mm, *robot.yellow_mm])[:, None]
    draws = [_velocity(times, rest + noise_of(session.noise, (4, len(times)), rng)) for _ in range(DRAWS)]
    return np.asarray(1.4826 * np.median(np.abs(draws), axis=0))


def _velocity(times: Array, marks: Array) -> Array:
    """Along and across the robot, mm/s, and yaw rate, rad/s, of marks (4, n): slopes in the frame of the marks."""
    since = times - times.mean()
    middle = (marks[:2] + marks[2:]) / 2
    line = marks[:2] - marks[2:]
    angle = np.unwrap(np.arctan2(line[1], line[0]))
    vx, vy = middle @ since / (since @ since)
    heading = angle[len(angle) // 2] - np.pi / 2
    c, s = np.cos(heading), np.sin(heading)
    return np.array([c * vx + s * vy, -s * vx + c * vy, angle @ since / (since @ since)])
