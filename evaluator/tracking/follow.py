"""Follow one mark from picture to picture: predict, look for its colour there, fit its disc, judge what came out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.tracking import kernels
from evaluator.tracking.appearance import Appearance, patch_of
from evaluator.tracking.disc import PER_PX, Patch
from evaluator.tracking.shading import LightNotes, interior_px
from evaluator.tracking.sighting import ABSENT, OK, Sighting

Array = NDArray[np.float64]
Point = tuple[float, float]
# Residual (mean square over noise) above which something is in the way for certain: 4 sigma for the 130 pixels of a
# mark of 5 px radius. The background's slope is then fitted too, and the light is suspected.
DISTURBED = 1.5
# Sigmas of the residual's usual scatter (as it was learnt: codecs make it larger than chance) from which a sloping
# background is tried, and from which the uncertainty allows for what is in the way.
SUSPECT, ODD = 2.0, 3.0
SLOPING = 12.0  # fall of the squares, in variances, that two slopes bring by chance once in 400 pictures
# A slope that was there from the start, or came slowly, looks just like a shift: it is looked for in every eighth
# picture, and in the eight after one that has it. Lenses and lamps change by about 0.1 % a pixel (`shading`),
# reflections by more.
LOOKOUT, GLARING = 8, 1.5e-3
SMALLEST_PX = 2.0  # radius of a mark's even inside that a slope can be seen in
PER_MEDIAN = 1.4826  # sigma over median deviation
# A disturbance that looked just like a shift would move the centre by √pixels times its own share of the noise; real
# ones (wires, glare, shadows) reach a third of that.
LIKENESS = 0.11
HOPELESS = 8.0  # residual at which a disc is no longer what is seen

# Sigmas beyond which a pixel is taken for something else than mark or background. Noise loses nothing (weights fall as
# 1/(1 + (r/5)⁴): 0.4 % of the information), a wire or a glint loses its pull.
SOFTNESS = 5.0

LATELY = 4.0  # intervals since a mark was seen from which its place then tells no longer how fast it is

SHUTTERS = (0.1, 0.3, 0.5, 0.7, 0.9)  # shares of an interval that are tried: smear adds variance, 1/12 of its square
SMEARED_PX = 2.0  # motion in an interval from which the share matters

BRIGHTER = 1.2  # amplitude over what it was, from which the light has changed rather than flickered
NOISE_STEP = 1.03
CALMER = 0.7  # of the noise: residuals of 100 pixels stay above by chance in 98 %
NOISE_RANGE = 30.0  # least and most noise of a recording, compressed or not, in variance

VIEW_EVERY = 10
RELEARN_AT = (60, 240)  # pictures in which a mark was seen: a second and four seconds of most recordings


@dataclass
class Follower:
    """Where one mark was last and how it moves.

    look: what it looks like. exposure: share of the interval that the shutter is open, None to learn it. position,
    velocity: px and px/s at time_s, None while never seen. missed: pictures since it was measured.
    """

    look: Appearance
    exposure: float | None
    position: Point | None = None
    velocity: Point = (0.0, 0.0)
    time_s: float = 0.0
    missed: int = 0

    def __post_init__(self) -> None:
        """Make the arrays the kernels read and fill."""
        self._shutter = 0.5 if self.exposure is None else self.exposure
        self._found, self._result = np.zeros(5), np.zeros(kernels.RESULTS)
        self._fitted, self._strength = self._result.tolist(), 0.0
        self._start, self._sloped = np.zeros(4), np.zeros(6)
        self.seen, self.views = 0, list[Patch]()
        self.light = LightNotes()
        self._slope = np.zeros(2)
        self._watch = 0
        self._scatter = (DISTURBED - 1.0) / ODD  # of residuals about 1, one sigma; the largest that is believed
        self.take_look(self.look)

    def take_look(self, look: Appearance) -> None:
        """Change what the mark looks like."""
        disc = look.disc
        self.look = look
        self._disc, self._profile, self._profile_slope = disc.numbers(), disc.profile, disc.slope
        self._noise = np.array([*disc.noise, SOFTNESS])
        self._least_noise = 0.5 * disc.noise[0]
        self._amplitude, self._base = disc.amplitude, disc.base
        self.radius_px = disc.radius_px
        self.light.interior_px = interior_px(disc)
        self.color = look.color.copy()

    def predicted(self, time_s: float) -> Point | None:
        """Where the mark should be at a time, at constant velocity."""
        if self.position is None:
            return None
        lapse = time_s - self.time_s
        return self.position[0] + self.velocity[0] * lapse, self.position[1] + self.velocity[1] * lapse

    def step_px(self, interval_s: float) -> float:
        """How far the mark moves in an interval, along both axes together."""
        return (abs(self.velocity[0]) + abs(self.velocity[1])) * interval_s

    def look_again(
        self, frame: Frame, cell: Array, place: Point, interval_s: float, guide: Point, light: float
    ) -> Sighting:
        """Measure a mark that was lost where the whole picture was searched for it.

        It may be faster than it was. guide: velocity, px/s, of the body it is on. light: of what there was when it was
        last seen.
        """
        color, velocity = self.color[4], self.velocity
        self.color[4] = min(light, 1.0) * color
        lapse, velocities = frame.time_s - self.time_s, [(0.0, 0.0)]
        if guide != (0.0, 0.0):
            velocities.insert(0, guide)
        if self.position is not None and 0 < lapse < LATELY * interval_s:
            velocities.insert(0, ((place[0] - self.position[0]) / lapse, (place[1] - self.position[1]) / lapse))
        one = ABSENT["not seen"]
        for self.velocity in velocities:
            one = self.look_at(frame, cell, place, 3.0, interval_s)
            if one.status == OK:
                break
        self.color[4], self.velocity = color, velocity
        return one

    def look_at(self, frame: Frame, cell: Array, place: Point, reach_px: float, interval_s: float) -> Sighting:
        """Measure the mark near a place of the picture; reach_px: how far from it the mark may be.

        cell: of the chroma samples, as `kernels.color_window` takes it.
        """
        radius = self.radius_px
        kernels.color_window(frame.u, frame.v, cell, place[0], place[1], radius + reach_px, self.color, self._found)
        colored, seen_x, seen_y, self._strength, clipped = self._found.tolist()
        area = self.look.area_px2
        if colored < 0.35 * area:
            return ABSENT["outside the picture" if clipped > 0.2 else "not seen"]
        seen = (seen_x, seen_y)
        crowded = colored > 1.5 * area
        start = self._start
        # The colour's centre is good to a chroma sample, the prediction usually to a tenth: take it unless they differ.
        near = abs(seen[0] - place[0]) + abs(seen[1] - place[1]) < 0.4 * radius + 1.0
        start[0], start[1] = place if near or crowded else seen
        start[2], start[3] = self._amplitude, self._base
        self._smear(self.velocity, self._shutter * interval_s)
        self._fit(frame, start)
        result = self._result
        residual = float(result[kernels.RESIDUAL])
        if residual > DISTURBED and self.exposure is None and interval_s > 0:
            residual = self._learn_exposure(frame, start, interval_s)
        if residual > DISTURBED and BRIGHTER < (brighter := result[kernels.AMPLITUDE] / self._amplitude) < 4.0:
            # The lights went on: photon noise grows with the light, gain noise with its square.
            self._noise[0] = min(self._noise[0] * brighter**2, NOISE_RANGE * self._least_noise)
            start[2], start[3] = result[kernels.AMPLITUDE], result[kernels.BASE]
            self._fit(frame, start)
            residual = float(result[kernels.RESIDUAL])
        suspicious = residual > 1.0 + SUSPECT * self._scatter
        if suspicious or self._watch > 0 or frame.index % LOOKOUT == 0:
            self._try_slope(frame, suspicious=suspicious)
        return self._judged(frame, cell, seen, place, reach_px, crowded=crowded)

    def _smear(self, velocity: Point, exposure_s: float) -> None:
        """Smear the disc as its motion does. Beyond a diameter it is a wrong velocity sooner than a fast mark."""
        x, y = velocity[0] * exposure_s, velocity[1] * exposure_s
        keep = min(1.0, 2.0 * self.radius_px / (abs(x) + abs(y) + 1e-9))
        self._disc[5], self._disc[6] = x * keep, y * keep

    def _learn_exposure(self, frame: Frame, start: Array, interval_s: float) -> float:
        """See from a mark that moves fast which share of the interval the shutter is open; returns the residual."""
        velocity, lapse = self.velocity, frame.time_s - self.time_s
        if self.position is not None and self.missed == 0 and lapse > 0 and np.isfinite(self._result[0]):
            velocity = self._result[0] - self.position[0], self._result[1] - self.position[1]
            velocity = velocity[0] / lapse, velocity[1] / lapse
        if (abs(velocity[0]) + abs(velocity[1])) * interval_s < SMEARED_PX:
            return float(self._result[kernels.RESIDUAL])
        tried: list[tuple[float, float]] = []
        for share in (*SHUTTERS, None):
            best = min(tried)[1] if share is None else share
            self._smear(velocity, best * interval_s)
            self._fit(frame, start)
            tried.append((float(self._result[kernels.RESIDUAL]), best))
        self._shutter = tried[-1][1]
        return tried[-1][0]

    def _try_slope(self, frame: Frame, *, suspicious: bool) -> None:
        """Fit a sloping background too, and keep that where the slope is there: the onset of glare or shadow."""
        plain, result = self._result.copy(), self._result
        self._sloped[:4], self._sloped[4:] = plain[: kernels.BASE + 1], 0.0
        self._fit(frame, self._sloped)
        fall = (plain[kernels.RESIDUAL] - result[kernels.RESIDUAL]) * plain[kernels.PIXELS]
        glaring = bool(fall > SLOPING) and self._glares(frame)
        self._watch = LOOKOUT if glaring else self._watch - 1
        if glaring or (suspicious and (plain[kernels.RESIDUAL] >= DISTURBED or fall > SLOPING)):
            return
        result[:] = plain

    def _glares(self, frame: Frame) -> bool:
        """Whether the fitted slope is a reflection: strong enough, and inside the mark too, unlike a body's edge."""
        x, y, slope = self._result[0], self._result[1], self._result[kernels.SLOPE_X : kernels.SLOPE_Y + 1]
        inner = self.radius_px - 2.5 * self.look.disc.blur_px
        if inner < SMALLEST_PX or np.hypot(*slope) < GLARING * abs(self._result[kernels.AMPLITUDE]):
            return False
        kernels.interior_slope(frame.luma, frame.row_origin, frame.row_step, x, y, inner, self._slope)
        # The slope of a plane through n samples of a disc of radius r is known to 2·noise/(r·√n).
        sigma = 2.0 * np.sqrt(self._noise[0] / np.pi) / inner**2
        steepness = np.hypot(*slope)
        return bool(3.0 * sigma < steepness and np.hypot(*(self._slope - slope)) < 0.5 * steepness + 3.0 * sigma)

    def _fit(self, frame: Frame, start: Array) -> None:
        kernels.fit_disc(
            frame.luma, frame.row_origin, frame.row_step, start, self._disc, self._profile, self._profile_slope,
            PER_PX, self._noise, self._result,
        )  # fmt: skip

    def _judged(
        self, frame: Frame, cell: Array, seen: Point, place: Point, reach_px: float, *, crowded: bool
    ) -> Sighting:
        self._fitted = self._result.tolist()
        x, y, amplitude, _, var_x, var_y, cov_xy, residual, used, inside, pixels, slope, _ = self._fitted
        reach, slack = reach_px + 0.5 * self.radius_px + 1.0, 0.5 * self.radius_px + 1.0
        reason = ""
        if x != x:  # noqa: PLR0124 - NaN: no fit
            reason = "no disc"
        elif inside < 0.9:
            reason = "outside the picture"
        elif abs(x - place[0]) > reach or abs(y - place[1]) > reach or not 0.25 < amplitude / self._amplitude < 4.0:
            reason = "no disc"
        elif used < 0.75:
            reason = "partly hidden"
        elif residual > HOPELESS:
            reason = "disturbed"
        elif crowded or abs(x - seen[0]) + abs(y - seen[1]) > slack:
            reason = self._crowd(frame, cell, (x, y), slack)
        if reason:
            return ABSENT[reason]
        # Residuals above the learnt noise (codec, wire, texture) widen the uncertainty by more than chance makes them
        # scatter; a chance calm keeps it.
        chance = (2.0 / max(pixels, 1.0)) ** 0.5
        scale = max(1.0, residual - chance) + LIKENESS * pixels * max(residual - 1.0 - ODD * self._scatter, 0.0)
        self.light.note_fit(frame.time_s, sloped=slope != 0.0)
        return Sighting(x, y, scale * var_x, scale * var_y, scale * cov_xy, OK)

    def keep_view(self, frame: Frame) -> None:
        """Keep some clear views of the mark, for learning its shape anew once it was seen in other places."""
        self.seen += 1
        if self.seen % VIEW_EVERY == 0 and self.seen < RELEARN_AT[-1] and self._result[kernels.RESIDUAL] < DISTURBED:
            self.views.append(patch_of(frame, self.position or (0.0, 0.0), self.radius_px))

    def looks_changed(self) -> bool:
        """Whether residuals are no longer what they were while the shape was learnt: then it is worth learning anew."""
        ratio = self._noise[0] / self.look.disc.noise[0]
        return bool(not 0.6 < ratio < 1.6)

    def note_light(self, frame: Frame) -> None:
        """Note how unevenly the mark is lit where it was just seen."""
        if not self.missed and self.position is not None and self._fitted[kernels.SLOPE_X] == 0.0:
            self.light.note(frame, self.position)

    def _crowd(self, frame: Frame, cell: Array, place: Point, slack: float) -> str:
        """Why the colour right around a fitted centre speaks against it, or nothing."""
        found, area = self._found, self.look.area_px2
        kernels.color_window(frame.u, frame.v, cell, place[0], place[1], self.radius_px, self.color, found)
        self._strength = float(found[kernels.STRENGTH])
        if found[0] < 0.5 * area:
            return "partly hidden"
        beside = abs(found[1] - place[0]) + abs(found[2] - place[1]) > slack
        return "ambiguous" if beside else ""

    def accept(self, sighting: Sighting, time_s: float) -> None:
        """Take over a measurement, or count a miss."""
        if sighting.status != OK:
            self.missed += 1
            return
        lapse = time_s - self.time_s
        if self.position is not None and self.missed == 0 and lapse > 0:
            self.velocity = (sighting.x - self.position[0]) / lapse, (sighting.y - self.position[1]) / lapse
        elif self.missed > 3:
            self.velocity = (0.0, 0.0)
        self.position, self.time_s, self.missed = (sighting.x, sighting.y), time_s, 0
        # Lights change slowly, or at once.
        amplitude, residual = self._fitted[kernels.AMPLITUDE], self._fitted[kernels.RESIDUAL]
        rate = 0.1 if 1 / BRIGHTER < amplitude / self._amplitude < BRIGHTER else 1.0
        self._amplitude += rate * (amplitude - self._amplitude)
        self._base += rate * (self._fitted[kernels.BASE] - self._base)
        # Noise is what residuals usually are: a codec leaves more of it on a moving mark than on one at rest. Steps of
        # equal size toward either side follow the median, which a passing disturbance does not move.
        # After a disturbance that lasted they are clearly lower, and must not hide the next one.
        step = NOISE_STEP if residual > 1.0 else 1.0 / NOISE_STEP if residual > CALMER else CALMER
        self._noise[0] = min(max(float(self._noise[0]) * step, self._least_noise), NOISE_RANGE * self._least_noise)
        off = PER_MEDIAN * abs(residual - 1.0)
        scatter = self._scatter * (NOISE_STEP if off > self._scatter else 1.0 / NOISE_STEP)
        chance = (2.0 / max(self._fitted[kernels.PIXELS], 1.0)) ** 0.5
        self._scatter = min(max(scatter, chance), max((DISTURBED - 1.0) / ODD, chance))
        strength = 0.5 * self._strength
        rate = 0.1 if 1 / BRIGHTER < strength / self.color[4] < BRIGHTER else 1.0
        self.color[4] += rate * (strength - float(self.color[4]))
