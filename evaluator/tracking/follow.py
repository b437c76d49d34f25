"""Follow one mark from picture to picture: predict, look for its colour there, fit its disc, judge what came out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.tracking import kernels
from evaluator.tracking.appearance import Appearance
from evaluator.tracking.disc import PER_PX
from evaluator.tracking.find import Candidate, cell_of

Array = NDArray[np.float64]
OK = "ok"


class Sighting(NamedTuple):
    """One mark in one picture: centre and its variances in px and px², status "ok" or why it is absent (then NaN)."""

    x: float
    y: float
    var_x: float
    var_y: float
    cov_xy: float
    status: str


def absent(reason: str) -> Sighting:
    """A mark that could not be measured."""
    nan = float("nan")
    return Sighting(nan, nan, nan, nan, nan, reason)


@dataclass
class Follower:
    """Where one mark was last and how it moves. position: None while lost. missed: pictures since it was measured."""

    look: Appearance
    exposure: float
    position: tuple[float, float] | None = None
    velocity: tuple[float, float] = (0.0, 0.0)
    time_s: float = 0.0
    missed: int = 0

    def __post_init__(self) -> None:
        """Make the arrays the kernels fill."""
        disc = self.look.disc
        self._found, self._result = np.zeros(5), np.zeros(kernels.RESULTS)
        self._start, self._disc = np.zeros(4), disc.numbers()
        self._noise = np.array([*disc.noise, 4.0])
        self._levels = [disc.amplitude, disc.base]

    def predicted(self, time_s: float) -> tuple[float, float] | None:
        """Where the mark should be at a time, at constant velocity."""
        if self.position is None:
            return None
        lapse = time_s - self.time_s
        return self.position[0] + self.velocity[0] * lapse, self.position[1] + self.velocity[1] * lapse

    def look_at(self, frame: Frame, place: tuple[float, float], reach_px: float, interval_s: float) -> Sighting:
        """Measure the mark near a place of the picture; reach_px: how far from it the mark may be."""
        look, found = self.look, self._found
        radius = look.disc.radius_px
        across, down = cell_of(frame)
        origin, step = frame.row_origin, frame.row_step
        half = radius + reach_px
        kernels.color_window(
            frame.u, frame.v, across, down, origin, step, place[0], place[1], half,
            look.neutral, look.direction, look.wanted, found,
        )  # fmt: skip
        share = found[kernels.COUNT] / look.area_px2
        if share < 0.35:
            return absent("outside the picture" if found[kernels.CLIPPED] > 0.3 else "not seen")
        x, y = found[kernels.CENTER_X], found[kernels.CENTER_Y]
        start, result = self._start, self._result
        start[0], start[1], start[2], start[3] = x, y, *self._levels
        lapse = self.exposure * interval_s
        self._disc[5], self._disc[6] = self.velocity[0] * lapse, self.velocity[1] * lapse
        kernels.fit_disc(
            frame.luma, origin, step, start, self._disc, look.disc.profile, look.disc.slope, PER_PX, self._noise, result
        )
        return self._judge((x, y))

    def _judge(self, seen: tuple[float, float]) -> Sighting:
        result, disc = self._result, self.look.disc
        x, y = float(result[kernels.X]), float(result[kernels.Y])
        if not np.isfinite(x):
            return absent("no fit")
        # Colour tells the centre to about a colour pixel; a disc found farther off is something else.
        if np.hypot(x - seen[0], y - seen[1]) > 0.5 * disc.radius_px + 2.0:
            return absent("color and disc disagree")
        if result[kernels.INSIDE] < 0.9:
            return absent("outside the picture")
        if not 0.3 < result[kernels.AMPLITUDE] / disc.amplitude < 3.0:
            return absent("brightness")
        if result[kernels.USED] < 0.7:
            return absent("partly hidden")
        scale = max(float(result[kernels.RESIDUAL]), 0.5)
        return Sighting(
            x,
            y,
            scale * float(result[kernels.VAR_X]),
            scale * float(result[kernels.VAR_Y]),
            scale * float(result[kernels.COV_XY]),
            OK,
        )

    def accept(self, sighting: Sighting, time_s: float) -> None:
        """Take over a measurement, or count a miss."""
        if sighting.status != OK:
            self.missed += 1
            return
        here = (sighting.x, sighting.y)
        lapse = time_s - self.time_s
        if self.position is not None and lapse > 0 and self.missed < 10:
            self.velocity = ((here[0] - self.position[0]) / lapse, (here[1] - self.position[1]) / lapse)
        else:
            self.velocity = (0.0, 0.0)
        self.position, self.time_s, self.missed = here, time_s, 0
        self._levels = [float(self._result[kernels.AMPLITUDE]), float(self._result[kernels.BASE])]

    def resembles(self, candidate: Candidate) -> bool:
        """Whether a blob found in the whole picture has about this mark's size and colour."""
        size = np.pi * candidate.radius_px**2 / self.look.area_px2
        away = np.array(candidate.chroma_uv) - self.look.neutral
        along = float(away @ self.look.direction)
        aside = abs(float(away[1] * self.look.direction[0] - away[0] * self.look.direction[1]))
        return bool(0.4 < size < 2.0 and along > self.look.wanted[0] and aside < self.look.wanted[1] * along)
