"""The slow path of a fitted mark: sloping background, occlusion, edge of the body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.tracking.refinement import fast_path, kernels
from evaluator.tracking.refinement.disc import Disc, Edge
from evaluator.tracking.refinement.edge import AROUND, View, find_edge, matters
from evaluator.tracking.refinement.learn_shape import cut_patch
from evaluator.tracking.refinement.occluded_pixels import CORE, CORE_EXPECTED
from evaluator.tracking.refinement.occlusion import BENT, NOTABLE, SLOPING, fit_uncovered

Array = NDArray[np.float64]

# A slope or a wire that is present from the start, or appears slowly, looks like a shift. It is therefore looked for in
# every fourth frame, and in the eight frames after one that has it. Light of lenses and lamps changes by about 0.1 %
# per pixel (`shading`), reflections by more.
LOOKOUT_MASK, WATCHED, GLARING = 3, 8, 1.5e-3
UNTAKEN = 1.0  # share of the shift by a slope that counts as an error if the slope is not corrected
SMALLEST_PX = 2.0  # least radius of a mark's even interior in which a slope can be measured
LEFT = 0.35  # least visible share of a mark's information with which an occluded mark is still measured
# A slope explains an occlusion unless more than this share of it remains, or the mark stays disturbed. Thin wires leave
# 0.95 or more, glare up to 0.85.
EXPLAINED = 0.9
# Largest uncertainty, in blurs of the edge, at which the parts of a rim agree; beyond it steps are no longer linear.
AGREED = 0.25
NEGLIGIBLE = 0.5  # of a centre's sigma: an edge that shifts it by less increases its error by an eighth at most
# Share of the shift by an edge that may remain after correction: lenses scatter light, and with a camera's gamma the
# flank of a bright edge extends farther than that of a mark. A gamma of 2.2 leaves 0.5 to 0.65 of the shift.
EDGED = 0.6
CHANCE = 2.0  # standard deviations
HALF = 0.5  # of the residual with a slope: the edge of a body explains so much, even beside other disturbances
NEVER = 2.0  # a share that is never reached, so that no fit is done


@dataclass
class SlowPath:
    """Fits of one mark and their findings; the arrays are those of `kernels.fit_disc`, shared with the follower.

    inner_px: radius of the mark's even interior. watch: remaining frames in which a slope is looked for;
    occluded_lately: remaining frames in which an occlusion is looked for. shift: shift of the centre by a slope that
    was not corrected in the last slow path, px, as an uncertainty. occluded: whether the result is that of the visible
    part of an occluded mark; its variances are then complete. shape: of the mark. edge: last edge found beside the
    mark; edge_lately: remaining frames in which an edge is fitted even without a slope, or, if negative, in which none
    is fitted because none was found.
    """

    disc: Array
    table: NDArray[np.float32]
    noise: Array
    result: Array
    inner_px: float
    shape: Disc
    watch: int = 0
    occluded_lately: int = 0
    shift: tuple[float, float] = (0.0, 0.0)
    occluded: bool = False

    def __post_init__(self) -> None:
        """Allocate the arrays of the kernels."""
        self.edge: Edge | None = None
        self.edge_lately = 0 if self.shape.edge is None else WATCHED
        self.sloped, self.unoccluded = np.zeros(kernels.RESULTS), np.zeros(kernels.RESULTS)

    def begin(self, frame: Frame) -> bool:
        """Reset for a new frame; returns whether it takes the slow path even if the mark looks normal."""
        self.occluded = False
        return self.watch > 0 or self.edge_lately > 0 or self.regular(frame)

    @staticmethod
    def regular(frame: Frame) -> bool:
        """Whether a frame takes the slow path because of its number, without any anomaly."""
        return not frame.index & LOOKOUT_MASK

    def fit(self, frame: Frame, start: Array) -> None:
        """Fit the disc on a uniform background."""
        self._fit(frame, start, sloping=False, result=self.result)

    def _fit(self, frame: Frame, start: Array, *, sloping: bool, result: Array) -> None:
        where = frame.luma, frame.row_origin, frame.row_step
        kernels.fit_disc(*where, start, sloping, self.disc, self.table, self.noise, result)

    def refit(self, frame: Frame, *, suspicious: bool) -> bool:
        """Also fit a sloping background, an edge, or the visible part of the mark, and accept the one that is present.

        Returns whether one was accepted.
        """
        result, sloped = self.result, self.sloped
        if not result[kernels.X] < np.inf:
            return False
        # An occlusion leaves more residual than usual.
        due = suspicious or self.occluded_lately > 0 or (self.regular(frame) and result[kernels.RESIDUAL] > 1.0)
        seeming, share = self._fit_unoccluded(frame, result, NOTABLE) if due else (0.0, 0.0)
        self._fit(frame, result[: kernels.BASE + 1], sloping=True, result=sloped)
        self.edge_lately -= int(np.sign(self.edge_lately))
        edge = self._fit_beside_edge(frame)
        if edge is not None and edge[kernels.RESIDUAL] < max(fast_path.DISTURBED, HALF * sloped[kernels.RESIDUAL]):
            return self._keep_edge(edge)
        self.occluded = (
            share > 0.0
            and self._sound(share)
            and (
                sloped[kernels.RESIDUAL] > fast_path.DISTURBED
                or self._fit_unoccluded(frame, sloped, NEVER)[0] > EXPLAINED * seeming
            )
        )
        self.occluded_lately = WATCHED if self.occluded else self.occluded_lately - 1
        if not self.occluded:
            return self._keep_slope(frame, suspicious=suspicious)
        self.watch, self.shift = WATCHED, (0.0, 0.0)
        result[:] = self.unoccluded
        return True

    def _keep_slope(self, frame: Frame, *, suspicious: bool) -> bool:
        """Accept the fit with a slope if the slope is significant (glare or shadow); else the plain one."""
        residual = self.result.item(kernels.RESIDUAL)
        sloping = self._sloping()
        taken = (sloping and (suspicious or self._glares(frame))) or (suspicious and residual >= fast_path.DISTURBED)
        self.watch = WATCHED if sloping else self.watch - 1
        self.shift = self._share(BENT if taken else UNTAKEN, self.sloped) if sloping else (0.0, 0.0)
        if taken:
            self.result[:] = self.sloped
        return taken

    def _sloping(self) -> bool:
        """Whether the slope of the light across the mark is significant."""
        result, sloped = self.result, self.sloped
        fall = result.item(kernels.RESIDUAL) - sloped.item(kernels.RESIDUAL)
        return bool(fall * result.item(kernels.PIXELS) > SLOPING)

    def _share(self, share: float, other: Array) -> tuple[float, float]:
        """A share of the vector from the plain fit's centre to another's, px."""
        x, y = share * (other[: kernels.Y + 1] - self.result[: kernels.Y + 1])
        return float(x), float(y)

    def _fit_beside_edge(self, frame: Frame) -> Array | None:
        """Fit the edge of the body beside the mark; None without a slope, or if a slope explains the pixels as well."""
        sloping = self._sloping() and matters(self.result, self.sloped)
        if self.edge_lately < 0 or not (self.edge_lately or sloping):
            return None
        smear, noise = (self.disc.item(5), self.disc.item(6)), (self.noise.item(0), self.noise.item(1))
        rows, place = (frame.row_origin, frame.row_step), (self.result.item(kernels.X), self.result.item(kernels.Y))
        patch = cut_patch(frame.luma, rows, place, self.shape.outer_px + 2.0 * AROUND * self.shape.blur_px)
        found = find_edge(View(patch, self.shape, smear, noise), self.result, self.sloped, self.edge)
        if found is None:
            self.edge_lately = -WATCHED if self.edge is None is self.shape.edge else self.edge_lately
            return None
        fitted, self.edge = found
        shift = fitted[: kernels.Y + 1] - self.result[: kernels.Y + 1]
        # A rough floor resembles an edge, but leaves a larger residual than a slope does, by more than chance:
        # residuals are means of squares.
        chance = CHANCE * np.sqrt(2.0 / self.sloped.item(kernels.PIXELS))
        if (
            fitted[kernels.RESIDUAL] > (1.0 + chance) * self.sloped.item(kernels.RESIDUAL)
            or shift @ shift < NEGLIGIBLE**2 * fitted[[kernels.VAR_X, kernels.VAR_Y]].sum()
        ):
            self.edge_lately = -WATCHED
            return None
        return fitted

    def _keep_edge(self, edge: Array) -> bool:
        """Accept the fit beside an edge."""
        self.occluded, self.occluded_lately, self.watch = False, self.occluded_lately - 1, WATCHED
        self.edge_lately = WATCHED
        self.shift = self._share(EDGED, edge)
        self.result[:] = edge
        return True

    def _fit_unoccluded(self, frame: Frame, fitted: Array, least: float) -> tuple[float, float]:
        """Fit the visible part of an occluded mark; least and results: see `fit_uncovered`."""
        where = frame.luma, frame.row_origin, frame.row_step
        core = CORE_EXPECTED if self.occluded_lately > 0 else CORE
        return fit_uncovered(*where, fitted, self.disc, self.table, self.noise, self.unoccluded, None, core, least)

    def _sound(self, share: float) -> bool:
        """Whether the fit of a mark that is occluded by this share is reliable."""
        unoccluded = self.unoccluded
        sure = unoccluded[kernels.VAR_X] + unoccluded[kernels.VAR_Y] < 2.0 * (AGREED * self.shape.blur_px) ** 2
        return bool(0.0 < share < 1.0 - LEFT and sure and unoccluded[kernels.RESIDUAL] < fast_path.DISTURBED)

    def _glares(self, frame: Frame) -> bool:
        """Whether the fitted slope is a reflection: large enough, and also inside the mark, unlike a body's edge."""
        x, y, slope = self.sloped[0], self.sloped[1], self.sloped[kernels.SLOPE_X : kernels.SLOPE_Y + 1]
        inner, inside = self.inner_px, np.zeros(2)
        if inner < SMALLEST_PX or np.hypot(*slope) < GLARING * abs(self.sloped[kernels.AMPLITUDE]):
            return False
        kernels.interior_slope(frame.luma, frame.row_origin, frame.row_step, x, y, inner, inside)
        # The slope of a plane through n samples of a disc of radius r is known to 2·noise/(r·√n).
        sigma = 2.0 * np.sqrt(self.noise[0] / np.pi) / inner**2
        steepness = np.hypot(*slope)
        return bool(3.0 * sigma < steepness and np.hypot(*(inside - slope)) < 0.5 * steepness + 3.0 * sigma)
