"""Follow one mark from frame to frame: predict its position, find its colour there, fit its disc, check the result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.tracking.detection import color_kernels
from evaluator.tracking.detection.appearance import SOFTNESS, Appearance, learn_shape, patch_of
from evaluator.tracking.following.motion import Motion, Point, beyond
from evaluator.tracking.observation import ABSENT, AMBIGUOUS, OK, Sighting
from evaluator.tracking.refinement import fast_path, kernels
from evaluator.tracking.refinement.blob import has_another_hue
from evaluator.tracking.refinement.disc import Disc
from evaluator.tracking.refinement.learn_shape import Patch, Steps
from evaluator.tracking.refinement.shading import LightNotes, interior_px
from evaluator.tracking.refinement.shutter import SHARE_SIGMA, UNKNOWN, best_share
from evaluator.tracking.refinement.slow_path import SlowPath
from evaluator.tracking.uncertainty.color_offset import ColorOffsets
from evaluator.tracking.uncertainty.rim import Rim, rim_power

Array = NDArray[np.float64]
# A disturbance of the same form as the change by a shift would move the centre by √pixels times its share of the noise.
# Real disturbances (wires, glare, shadows) reach a third of that.
LIKENESS = 0.11
HOPELESS = 8.0  # residual above which the mark is not a disc

LATELY = 4.0  # intervals since a mark was last seen up to which that position is used for its velocity
GONE = 8  # frames without a mark after which what is found must have its hue: by then it may have left the image
SMEARED_PX = 2.0  # motion in an interval from which the exposure matters
STEADY = 2.0  # ratio of successive speeds beyond which a mark starts, stops or is pushed, instead of turning

VAGUE = 0.2  # of the radius: uncertainty of a centre above which the mark hardly resembles the disc
VIEW_EVERY = 10  # frames between the stored views of a mark, so that they show it at different positions
RELEARN_AT = (60, 240)  # number of frames with the mark: one and four seconds of most recordings


@dataclass
class Follower(Motion):
    """Tracker of one disc: last position and velocity, appearance, fits.

    look: its appearance. exposure: share of the frame interval for which the shutter is open, None to learn it.
    turn_rad_s: rotation rate of the velocity, for motion blur.
    """

    look: Appearance
    exposure: float | None
    position: Point | None = None
    velocity: Point = (0.0, 0.0)
    time_s: float = 0.0
    missed: int = 0
    turn_rad_s: float = 0.0

    def __post_init__(self) -> None:
        """Allocate the arrays of the kernels."""
        # Share of the interval for which the shutter is open, and its standard uncertainty.
        self.shutter = UNKNOWN if self.exposure is None else (self.exposure, 0.0)
        self._found, self._result = np.zeros(5), np.zeros(kernels.RESULTS)
        self._fitted, self._start = self._result.tolist(), np.zeros(4)
        self.seen, self.unlike, self.hidden, self.views = 0, 0, False, list[Patch]()
        self.light, self.rim, self.offsets = LightNotes(), Rim(), ColorOffsets()
        # Place and time at which it was last seen, but not measured.
        self.last_sighting: tuple[Point | None, float] = (None, 0.0)
        self._usual = np.zeros(5)
        self._usual[fast_path.U_SCATTER] = (fast_path.DISTURBED - 1.0) / fast_path.ODD  # the largest plausible scatter
        self.take_look(self.look)

    def take_look(self, look: Appearance) -> None:
        """Replace the appearance of the mark."""
        disc = look.disc
        self.look = look
        self._disc, self._table = disc.numbers(), disc.table
        self._noise = np.array([disc.noise, SOFTNESS])
        inner_px = disc.radius_px - 2.5 * disc.blur_px
        self._slow_path = SlowPath(self._disc, self._table, self._noise, self._result, inner_px, disc)
        self._usual[[fast_path.U_AMPLITUDE, fast_path.U_BASE, fast_path.U_LEAST_NOISE, fast_path.U_AREA]] = (
            disc.amplitude, disc.base, 0.5 * disc.noise, look.area_px2
        )  # fmt: skip
        self.radius_px, self._brightest_px = disc.radius_px, disc.brightest_px
        self.light.interior_px, self.rim = interior_px(disc), Rim()
        self.color = look.color.copy()

    def take_shape(self, look: Appearance) -> None:
        """Replace the shape of a followed mark; its light and noise are those measured last."""
        level, noise = self._usual[[fast_path.U_AMPLITUDE, fast_path.U_BASE]].copy(), self._noise[0]
        self.take_look(look)
        self._usual[[fast_path.U_AMPLITUDE, fast_path.U_BASE]] = level
        self._noise[0] = max(noise, self._usual[fast_path.U_LEAST_NOISE])

    def _turned(self, velocity: Point, lapse_s: float) -> Point:
        """Velocity after a lapse, extrapolated at its last rotation rate: motion blur then fits on curved paths."""
        if self.turn_rad_s == 0.0:
            return velocity
        (x, y), cos, sin = velocity, math.cos(self.turn_rad_s * lapse_s), math.sin(self.turn_rad_s * lapse_s)
        return cos * x - sin * y, sin * x + cos * y

    def look_again(
        self, frame: Frame, cell: Array, place: Point, interval_s: float, guide: Point, light: float
    ) -> Sighting:
        """Measure a lost mark at a position found by a search of the whole frame.

        Its velocity may have changed. guide: velocity of its body, px/s. light: mean light of the frame, relative to
        that of the frame in which the mark was last seen.
        """
        color, velocity, usual = self.color[4], self.velocity, self._usual.copy()
        turn_rad_s, self.turn_rad_s = self.turn_rad_s, 0.0
        self.color[4] = min(light, 1.0) * color
        if not 1.0 / fast_path.BRIGHTER < light < fast_path.BRIGHTER:
            # Lights were switched: the mark changed by the same factor as the whole image.
            self._usual[[fast_path.U_AMPLITUDE, fast_path.U_BASE, fast_path.U_LEAST_NOISE]] *= (
                light,
                light,
                max(light, 1.0),
            )
        velocities = [(0.0, 0.0)] if guide == (0.0, 0.0) else [guide, (0.0, 0.0)]
        # The mark was seen just before: after a sudden change of speed, its motion blur differs from the predicted one.
        for where, when in ((self.position, self.time_s), self.last_sighting):
            lapse = frame.time_s - when
            if where is not None and 0 < lapse < LATELY * interval_s:
                velocities.insert(0, ((place[0] - where[0]) / lapse, (place[1] - where[1]) / lapse))
        one = ABSENT["not seen"]
        for self.velocity in velocities:
            one = self.look_at(frame, cell, place, 3.0, interval_s)
            if one.status == OK:
                break
        if self.missed > GONE and has_another_hue(frame, cell, self.color, place, self.radius_px):
            one = ABSENT[AMBIGUOUS]  # something else where nothing better is in view
        self.color[4], self.velocity, self.turn_rad_s = color, velocity, turn_rad_s
        if one.status != OK:
            self._usual[:] = usual
        return one

    def look_at(self, frame: Frame, cell: Array, place: Point, reach_px: float, interval_s: float) -> Sighting:
        """Measure the mark near a position of the frame; reach_px: largest distance of the mark from it.

        cell: of the chroma samples, see `color_kernels.color_window`.
        """
        x_px_s, y_px_s = self._turned(self.velocity, frame.time_s - self.time_s + 0.5 * interval_s)
        result, exposure_s = self._result, self.shutter[0] * interval_s
        verdict = fast_path.fit_mark(
            frame.luma, frame.u, frame.v, frame.row_origin, frame.row_step, cell, *place, reach_px,
            exposure_s * x_px_s, exposure_s * y_px_s, self.color, self._usual, self._disc, self._table,
            self._noise, self._start, self._found, result,
        )  # fmt: skip
        if verdict == fast_path.TOO_LITTLE:
            return ABSENT["outside the image" if beyond(frame, place, self.radius_px) else "not seen"]
        lookout = self._slow_path.begin(frame)
        if verdict == fast_path.WELL and not lookout:
            return self._measured(frame, cell)
        if verdict == fast_path.UNUSUAL:
            self._explain_disturbance(frame, interval_s)
        suspicious = bool(result[kernels.RESIDUAL] > 1.0 + fast_path.SUSPECT * self._usual[fast_path.U_SCATTER])
        if suspicious or lookout:
            taken = self._slow_path.refit(frame, suspicious=suspicious)
            if verdict == fast_path.WELL and not taken:
                return self._measured(
                    frame, cell, with_rim=self._slow_path.regular(frame)
                )  # the fast path's fit stands
        return self._judged(frame, cell, place, reach_px)

    def _explain_disturbance(self, frame: Frame, interval_s: float) -> None:
        """Fit again if a long exposure or a change of light explains the disturbance."""
        result, start, usual = self._result, self._start, self._usual
        residual = result[kernels.RESIDUAL]
        if residual > fast_path.DISTURBED and self.exposure is None and interval_s > 0:
            residual = self._learn_exposure(frame, start, interval_s)
        brighter = result[kernels.AMPLITUDE] / usual[fast_path.U_AMPLITUDE]
        if residual > fast_path.DISTURBED and fast_path.BRIGHTER < brighter < fast_path.PLAUSIBLE:
            # Photon noise grows with the light, gain noise with its square.
            least = usual[fast_path.U_LEAST_NOISE]
            self._noise[0] = min(self._noise[0] * brighter**2, fast_path.NOISE_RANGE * least)
            start[2], start[3] = result[kernels.AMPLITUDE], result[kernels.BASE]
            self._slow_path.fit(frame, start)

    def _learn_exposure(self, frame: Frame, start: Array, interval_s: float) -> float:
        """Estimate the exposure, as a share of the interval, from a fast mark; returns the residual."""
        lapse = frame.time_s - self.time_s
        velocity = self._turned(self.velocity, lapse + 0.5 * interval_s)
        if self.position is not None and self.missed == 0 and lapse > 0 and np.isfinite(self._result[0]):
            velocity = self._result[0] - self.position[0], self._result[1] - self.position[1]
            velocity = self._turned((velocity[0] / lapse, velocity[1] / lapse), 0.5 * lapse)
        if (abs(velocity[0]) + abs(velocity[1])) * interval_s < SMEARED_PX:
            return float(self._result[kernels.RESIDUAL])

        def left(share: float) -> float:
            fast_path.smear(self._disc, velocity[0] * share * interval_s, velocity[1] * share * interval_s)
            self._slow_path.fit(frame, start)
            return float(self._result[kernels.RESIDUAL])

        self.shutter = best_share(left), SHARE_SIGMA
        return left(self.shutter[0])

    def _judged(self, frame: Frame, cell: Array, place: Point, reach_px: float) -> Sighting:
        """The fitted mark, or the reason why the fit is not the mark."""
        x, y, amplitude, _, _, _, _, residual, used, inside, _, _, _ = self._result.tolist()
        colored, seen_x, seen_y, _, _ = self._found.tolist()
        slack = 0.5 * self.radius_px + 1.0
        brightness, far = amplitude / self._usual[fast_path.U_AMPLITUDE], max(abs(x - place[0]), abs(y - place[1]))
        reason = ""
        if x != x:  # noqa: PLR0124 - NaN: no fit
            reason = "no disc"
        elif inside < fast_path.LEAST_INSIDE:
            reason = "outside the image"
        elif far > reach_px + slack or not 1.0 / fast_path.PLAUSIBLE < brightness < fast_path.PLAUSIBLE:
            reason = "no disc"
        elif used < fast_path.LEAST_USED:
            reason = "partly hidden"
        elif residual > HOPELESS:
            reason = "disturbed"
        elif colored > fast_path.MANY * self.look.area_px2 or abs(x - seen_x) + abs(y - seen_y) > slack:
            reason = self._crowd(frame, cell, (x, y), slack)
        return ABSENT[reason] if reason else self._measured(frame, cell, with_rim=True)

    def _measured(self, frame: Frame, cell: Array, *, with_rim: bool = False) -> Sighting:
        """The fitted mark with its uncertainty; with_rim: evaluate the rim, too."""
        self._fitted = self._result.tolist()
        x, y, _, _, var_x, var_y, cov_xy, residual, _, _, pixels, slope, _ = self._fitted
        self.light.note_fit(frame.time_s, sloped=slope != 0.0)
        if self.occluded:
            # From one end of a smeared mark its middle is known only as accurately as the length of the smear.
            share, unsure = self.shutter
            half_x, half_y = ((0.5 * unsure / share if share else 0.0) * path for path in self._disc[5:7].tolist())
            return Sighting(x, y, var_x + half_x**2, var_y + half_y**2, cov_xy + half_x * half_y, OK)
        aside_x, aside_y = self._brightest_px
        self.offsets.note(frame.time_s, (x + aside_x, y + aside_y), self._found, self.look.area_px2, cell.item(0))
        # Residuals above the learnt noise (codec, wire, texture) increase the uncertainty if they exceed it by more
        # than chance; residuals below it do not reduce the uncertainty.
        scale, (dx, dy) = 1.0, self._slow_path.shift
        if residual > 1.0:
            odd = residual - 1.0 - fast_path.ODD * float(self._usual[fast_path.U_SCATTER])
            scale = max(1.0, residual - (2.0 / max(pixels, 1.0)) ** 0.5) + LIKENESS * pixels * max(odd, 0.0)
        if with_rim:
            where = frame.luma, frame.row_origin, frame.row_step, self._result
            self.rim.note(rim_power(*where, self._disc, self._table, self._noise), 0.5 * scale * (var_x + var_y))
        rim = self.rim.extra_px2
        var_x, var_y, cov_xy = scale * var_x + dx * dx + rim, scale * var_y + dy * dy + rim, scale * cov_xy + dx * dy
        return Sighting(x, y, var_x, var_y, cov_xy, OK)

    def keep_view(self, frame: Frame) -> None:
        """Store some undisturbed views of the mark, to learn its shape again from several positions."""
        self.seen += 1
        if (
            self.seen % VIEW_EVERY == 0
            and self.seen < RELEARN_AT[-1]
            and self._result[kernels.RESIDUAL] < fast_path.DISTURBED
        ):
            self.views.append(patch_of(frame, self.position or (0.0, 0.0), self.radius_px))

    def learn_anew(self, patches: Sequence[Patch], interval_s: float) -> Steps[Disc | None]:
        """Learn the shape from patches of the moving mark."""
        return learn_shape(
            patches, self.radius_px, self.look.disc.blur_px, smeared=self.step_px(interval_s) > SMEARED_PX
        )

    @property
    def occluded(self) -> bool:
        """Whether the last measurement is that of the visible part of a disc."""
        return self._slow_path.occluded

    def looks_changed(self) -> bool:
        """Whether residuals have changed since the shape was learnt, so that it should be learnt again."""
        ratio = self._noise[0] / self.look.disc.noise
        return bool(not 0.6 < ratio < 1.6)

    def note_light(self, frame: Frame) -> None:
        """Record the gradient of light at the mark, unless a wire causes it."""
        if self.occluded:
            return
        if not self.missed and self.position is not None and self._fitted[kernels.SLOPE_X] == 0.0:
            amplitude, (x, y) = self._fitted[kernels.AMPLITUDE], self.look.disc.shade
            self.light.note(frame, self.position, (amplitude * x, amplitude * y))

    def _crowd(self, frame: Frame, cell: Array, place: Point, slack: float) -> str:
        """Reason why the colour around a fitted centre contradicts the fit, or ""."""
        found, area = self._found, self.look.area_px2
        color_kernels.color_window(frame.u, frame.v, cell, place[0], place[1], self.radius_px, self.color, found)
        if found[0] < 0.5 * area:
            return "partly hidden"
        beside = abs(found[1] - place[0]) + abs(found[2] - place[1]) > slack
        return "ambiguous" if beside else ""

    def accept(self, sighting: Sighting, time_s: float) -> None:
        """Update the state with a measurement, or count a miss."""
        before, lapse = self.velocity, time_s - self.time_s
        vague = sighting.status == OK and sighting.var_x + sighting.var_y > 2.0 * (VAGUE * self.radius_px) ** 2
        unlike = vague or sighting.status in {"no disc", "partly hidden", "not seen"}
        self.unlike = self.unlike + 1 if unlike and not self.occluded else 0
        # A mark that was out of sight reappears in parts; it is then not a smaller mark.
        self.hidden = unlike and (self.hidden or (sighting.status == "not seen" and self.last_sighting[1] < time_s))
        if self.move(sighting, time_s):
            self.turn_rad_s = self._turn(before, lapse)
        if sighting.status == OK:
            fast_path.settle(self._usual, self._noise, self.color, self._found, self._result)

    def _turn(self, before: Point, lapse_s: float) -> float:
        """Rotation rate of the velocity since the previous one, rad/s; 0 if the mark is slow, starts or stops."""
        if self.step_px(lapse_s) < SMEARED_PX:
            return 0.0
        (x, y), (old_x, old_y) = self.velocity, before
        steady = 1.0 / STEADY < math.hypot(x, y) / max(math.hypot(old_x, old_y), 1e-9) < STEADY
        return math.atan2(old_x * y - old_y * x, old_x * x + old_y * y) / lapse_s if steady else 0.0
