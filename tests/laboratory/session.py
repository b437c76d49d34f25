"""A session in the laboratory: robot, commands, starts, camera, and what is written about them; and its recordings.

Everything that is true stands beside everything that is said. Times: a recording has its own clock, in which start_s is
written; the motors really start late_s after that. Units: mm, s, rpm, rad.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.signal import lfilter

from tests.laboratory.effects import View
from tests.laboratory.motion import SHORTEST_LAG_S, Motion, simulate
from tests.laboratory.reference import Array, Robot, World

FRAME_S = 1 / 60
AfterTracking = Callable[[Array, Array], tuple[Array, Array]]  # times (k,) and marks (4, k) of one run, changed


@dataclass(frozen=True)
class Noise:
    """What the tracking adds to every coordinate."""

    white_mm: float = 0.003
    heavy_tailed: bool = False  # Student's t with 3 degrees of freedom, scaled to white_mm
    slow_mm: float = 0.0  # Ornstein-Uhlenbeck, standard deviation
    slow_s: float = 3.0  # and its correlation time
    lost_share: float = 0.0  # of frames in which one mark is missing
    dropped_share: float = 0.0  # of frames that are not there at all
    gap_s: float = 0.0  # one gap a run, of this length
    outlier_share: float = 0.0  # of frames in which one mark is somewhere else
    round_s: float = 1e-6  # of the times in the file
    shake_mm: float = 0.0  # amplitude in which camera or plate shake, both marks alike
    shake_hz: float = 10.0
    drift_mm: float = 0.0  # Ornstein-Uhlenbeck, standard deviation: camera against plate, both marks alike
    drift_s: float = 10.0  # and its correlation time

    @property
    def floor_mm(self) -> float:
        """RMS of what is drawn anew in every frame or wanders slowly; no outliers."""
        return float(np.sqrt(self.white_mm**2 + self.slow_mm**2 + self.drift_mm**2))


@dataclass(frozen=True)
class Push:
    """A robot moved by hand some time after its start: how far in the plate frame, and how much turned."""

    at_s: float
    over_s: float
    x_mm: float
    y_mm: float
    turn_rad: float


@dataclass(frozen=True)
class Session:
    """All runs of one experiment. Arrays have a last axis of runs; rows of rpm: left, right; of pose: x, y, heading."""

    world: World
    view: View
    said: Robot
    said_rpm: Array
    start_s: Array
    end_s: Array
    stop_s: Array  # NaN: motors run to the end of the recording
    pose: Array
    rpm: Array
    gain: Array
    late_s: Array
    begin_s: Array
    phase_s: Array  # of the first frame
    noise: Noise = field(default_factory=Noise)
    quits_s: Mapping[int, float] = field(default_factory=dict)  # run that stops by itself, s after its start
    pushes: Mapping[int, Push] = field(default_factory=dict)
    robots: Mapping[int, Robot] = field(default_factory=dict)  # run made with another robot: its marks
    after: Mapping[int, AfterTracking] = field(default_factory=dict)

    @property
    def runs(self) -> int:
        """How many runs."""
        return len(self.start_s)

    def with_robot(self, **values: object) -> Session:
        """The session with other true values of the robot."""
        return replace(self, world=replace(self.world, robot=replace(self.world.robot, **values)))


def frame_times_s(session: Session, run: int) -> Array:
    """Times of the frames in the recording's own clock."""
    first = session.begin_s[run] + session.phase_s[run]
    return np.arange(first, session.end_s[run], FRAME_S)


def motion(session: Session) -> Motion:
    """All runs, driven."""
    ends = np.where(np.isnan(session.stop_s), session.end_s + 0.5, session.stop_s)
    lasts = (ends - session.start_s) / session.view.time_factor
    for run, quits in session.quits_s.items():
        lasts[run] = quits
    return simulate(session.world, session.rpm * session.gain, session.pose, lasts)


def true_marks(session: Session) -> list[tuple[Array, Array]]:
    """Times and marks of every run as a camera without noise would give them, before anything is mixed up."""
    driven, result = motion(session), []
    ideal = 0.0 if session.world.lags_s else SHORTEST_LAG_S  # the solver's own lag: motors without any follow at once
    for run in range(session.runs):
        times = frame_times_s(session, run)
        since = (times - session.start_s[run]) / session.view.time_factor - session.late_s[run] + ideal

        def pose_at(since: Array, run: int = run) -> Array:
            pose = driven.pose_at(run, since)
            return _pushed(pose, since, session.pushes[run]) if run in session.pushes else pose

        robot = session.robots.get(run, session.world.robot)
        result.append((times, session.view.filmed_mm(robot, pose_at, since)))
    return result


def recorded(session: Session, rng: np.random.Generator) -> list[tuple[Array, Array]]:
    """Times and marks of every run as they stand in the files; a missing mark is NaN."""
    result = []
    for run, (exact, marks) in enumerate(true_marks(session)):
        seen = marks + noise_of(session.noise, marks.shape, rng)
        kept = _losses(session.noise, exact, seen, rng)
        rounded = np.round(exact / session.noise.round_s) * session.noise.round_s
        change = session.after.get(run, _unchanged)
        result.append(change(rounded[kept], seen[:, kept]))
    return result


def _unchanged(times: Array, marks: Array) -> tuple[Array, Array]:
    return times, marks


def _pushed(pose: Array, since: Array, push: Push) -> Array:
    """The rest of the path turned about where the robot is, and moved: right where no force depends on the place."""
    share = np.clip((since - push.at_s) / push.over_s, 0, 1)
    share = share * share * (3 - 2 * share)
    x0, y0 = (np.interp(push.at_s, since, row) for row in pose[:2])
    c, s = np.cos(push.turn_rad * share), np.sin(push.turn_rad * share)
    dx, dy = pose[0] - x0, pose[1] - y0
    x, y = x0 + c * dx - s * dy + push.x_mm * share, y0 + s * dx + c * dy + push.y_mm * share
    return np.stack([x, y, pose[2] + push.turn_rad * share])


def noise_of(noise: Noise, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """What the tracking adds to coordinates (rows, frames), without outliers."""
    if noise.heavy_tailed:
        white = rng.standard_t(3, shape) * noise.white_mm / np.sqrt(3)  # variance of t with 3 dof: 3
    else:
        white = rng.normal(0, noise.white_mm, shape)
    slow = _wandering(noise.slow_s, shape, rng)
    way, begin = rng.uniform(0, 2 * np.pi, 2)
    wave = np.sin(begin + 2 * np.pi * noise.shake_hz * FRAME_S * np.arange(shape[1]))
    shake = np.outer(np.resize([np.cos(way), np.sin(way)], shape[0]), wave)
    drift = np.resize(_wandering(noise.drift_s, (2, shape[1]), rng), shape)
    return white + noise.slow_mm * slow + noise.shake_mm * shake + noise.drift_mm * drift


def _wandering(lasting_s: float, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Ornstein-Uhlenbeck noise of unit variance (rows, frames), each row by itself."""
    keeps = np.exp(-FRAME_S / lasting_s)
    drive = rng.normal(0, 1, shape) * np.sqrt(1 - keeps**2)
    drive[:, 0] = rng.normal(0, 1, shape[0])
    return np.asarray(lfilter([1.0], [1.0, -keeps], drive, axis=1))


def _losses(noise: Noise, times: Array, seen: Array, rng: np.random.Generator) -> Array:
    """Put outliers and missing marks in place; which frames are there."""
    count = len(times)
    for frame in np.flatnonzero(rng.random(count) < noise.outlier_share):
        mark, way = 2 * rng.integers(2), rng.uniform(0, 2 * np.pi)
        off = np.exp(rng.uniform(np.log(0.1), np.log(3.0)))
        seen[mark : mark + 2, frame] += off * np.array([np.cos(way), np.sin(way)])
    for frame in np.flatnonzero(rng.random(count) < noise.lost_share):
        mark = 2 * rng.integers(2)
        seen[mark : mark + 2, frame] = np.nan
    if noise.gap_s:
        from_s = rng.uniform(times[0] + 1.0, max(times[-1] - noise.gap_s - 0.5, times[0] + 1.1))
        seen[:, (times > from_s) & (times < from_s + noise.gap_s)] = np.nan
    kept = rng.random(count) >= noise.dropped_share
    kept[0] = True
    return kept


def rms_change_mm(first: list[tuple[Array, Array]], second: list[tuple[Array, Array]]) -> float:
    """RMS distance of marks of two sessions on equal frames, every run laid on its counterpart as a rigid path."""
    squares, count = 0.0, 0
    for (_, a), (_, b) in zip(first, second, strict=True):
        p = np.concatenate([a[0] + 1j * a[1], a[2] + 1j * a[3]])
        q = np.concatenate([b[0] + 1j * b[1], b[2] + 1j * b[3]])
        p, q = p - p.mean(), q - q.mean()
        turn = np.vdot(p, q)
        left = q - p * turn / max(abs(turn), 1e-12)
        squares, count = squares + float((np.abs(left) ** 2).sum()), count + len(left)
    return float(np.sqrt(squares / count))
