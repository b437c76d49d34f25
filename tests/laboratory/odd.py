"""One odd run in a session: what goes wrong about once in twenty recordings. The keys of KINDS name it.

Each function changes one run of a session. ACCEPTED holds the kinds of the file contract that name it rightly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.laboratory.session import AfterTracking, Push, Session

Odd = Callable[[Session, int, np.random.Generator], Session]


def _driven(session: Session, run: int, rpm: tuple[float, float]) -> Session:
    changed = session.rpm.copy()
    changed[:, run] = rpm
    return replace(session, rpm=changed)


def _after(session: Session, run: int, change: AfterTracking) -> Session:
    return replace(session, after={**session.after, run: change})


def reversed_(session: Session, run: int, rng: np.random.Generator) -> Session:
    """The run drove backward where forward is written, or the other way round."""
    del rng
    left, right = session.rpm[:, run]
    return _driven(session, run, (-left, -right))


def sides_swapped(session: Session, run: int, rng: np.random.Generator) -> Session:
    """Left and right motor are swapped."""
    del rng
    left, right = session.rpm[:, run]
    return _driven(session, run, (right, left))


def wrong_command(session: Session, run: int, rng: np.random.Generator) -> Session:
    """The commands of two recordings are exchanged in the file: both runs are odd."""
    del rng
    other = other_run(session, run)
    first = tuple(session.rpm[:, run])
    return _driven(_driven(session, run, tuple(session.rpm[:, other])), other, first)


def other_run(session: Session, run: int) -> int:
    """The run whose command differs most from this one's in how it turns and how fast."""
    return int(np.argmax(np.abs(session.said_rpm - session.said_rpm[:, [run]]).sum(axis=0)))


def marks_swapped(session: Session, run: int, rng: np.random.Generator) -> Session:
    """The columns of the two marks are exchanged."""
    del rng
    return _after(session, run, lambda times, marks: (times, marks[[2, 3, 0, 1]]))


def mirrored(session: Session, run: int, rng: np.random.Generator) -> Session:
    """The image is mirrored."""
    del rng
    return _after(session, run, lambda times, marks: (times, marks * np.array([[-1], [1], [-1], [1]])))


def wrong_rate(session: Session, run: int, rng: np.random.Generator) -> Session:
    """Times are doubled: 30 frames a second were written instead of 60. start_s stays as it is."""
    del rng
    return _after(session, run, lambda times, marks: (times[0] + 2 * (times - times[0]), marks))


def wrong_unit(session: Session, run: int, rng: np.random.Generator) -> Session:
    """Lengths are in m, cm or inch instead of mm."""
    unit = float(rng.choice([1e-3, 0.1, 1 / 25.4]))
    return _after(session, run, lambda times, marks: (times, marks * unit))


def wrong_robot(session: Session, run: int, rng: np.random.Generator) -> Session:
    """Another robot, with its marks 10 to 30 % nearer or farther apart."""
    robot = session.world.robot
    apart = 1 + rng.choice([-1, 1]) * rng.uniform(0.1, 0.3)
    marks = {name: (getattr(robot, name)[0], getattr(robot, name)[1] * apart) for name in ("green_mm", "yellow_mm")}
    return replace(session, robots={**session.robots, run: replace(robot, **marks)})


def late_start(session: Session, run: int, rng: np.random.Generator) -> Session:
    """The motors start 0.15 to 1 s after the written time."""
    late = session.late_s.copy()
    late[run] += rng.uniform(0.15, 1.0)
    return replace(session, late_s=late)


def stuck(session: Session, run: int, rng: np.random.Generator) -> Session:
    """The robot stands for the whole run."""
    del rng
    return _driven(session, run, (0.0, 0.0))


def quits_half_way(session: Session, run: int, rng: np.random.Generator) -> Session:
    """The robot snags and stops after 30 to 70 % of the run."""
    lasts = session.end_s[run] - session.start_s[run]
    return replace(session, quits_s={**session.quits_s, run: float(lasts * rng.uniform(0.3, 0.7))})


def pushed(session: Session, run: int, rng: np.random.Generator) -> Session:
    """Somebody touches the robot: 0.5 to 3 mm and 2 to 15 degrees within 0.1 to 0.3 s."""
    lasts = session.end_s[run] - session.start_s[run]
    way, far = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 3)
    turn = np.deg2rad(rng.choice([-1, 1]) * rng.uniform(2, 15))
    push = Push(lasts * rng.uniform(0.3, 0.7), rng.uniform(0.1, 0.3), far * np.cos(way), far * np.sin(way), float(turn))
    return replace(session, pushes={**session.pushes, run: push})


def camera_moved(session: Session, run: int, rng: np.random.Generator) -> Session:
    """The camera is knocked within a run: 0.3 to 3 mm and 0.3 to 3 degrees from one frame to the next, later runs too.

    A knock between two runs is not drawn: with a start pose of its own a run cannot tell it.
    """
    way, far = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 3)
    turn = np.deg2rad(rng.choice([-1, 1]) * rng.uniform(0.3, 3))
    share = rng.uniform(0.3, 0.7)
    moment = session.start_s[run] + share * (session.end_s[run] - session.start_s[run])

    def knocked(from_s: float) -> AfterTracking:
        def change(times: np.ndarray, marks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            z = np.stack([marks[0] + 1j * marks[1], marks[2] + 1j * marks[3]])
            moved = np.where(times >= from_s, z * np.exp(1j * turn) + far * np.exp(1j * way), z)
            return times, np.stack([moved[0].real, moved[0].imag, moved[1].real, moved[1].imag])

        return change

    later = {other: knocked(-np.inf) for other in range(run + 1, session.runs)}
    return replace(session, after={**session.after, **later, run: knocked(moment)})


KINDS: dict[str, Odd] = {
    odd.__name__.strip("_").replace("_", "-"): odd
    for odd in (
        reversed_,
        sides_swapped,
        wrong_command,
        marks_swapped,
        mirrored,
        wrong_rate,
        wrong_unit,
        wrong_robot,
        late_start,
        stuck,
        quits_half_way,
        pushed,
        camera_moved,
    )
}
ACCEPTED = {name: {name} for name in KINDS}
ACCEPTED["quits-half-way"] = {"stuck", "pushed"}  # both words fit a robot that snags
