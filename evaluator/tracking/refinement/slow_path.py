"""The slow path of a mark that was just fitted: whether light slopes across it, what covers it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.tracking.refinement import fast_path, kernels
from evaluator.tracking.refinement.occluded_pixels import CORE, CORE_EXPECTED
from evaluator.tracking.refinement.occlusion import BENT, NOTABLE, SLOPING, fit_uncovered

Array = NDArray[np.float64]

# A slope or a wire that was there from the start, or came slowly, looks just like a shift: it is looked for in every
# fourth frame, and in the eight after one that has it. Lenses and lamps change by about 0.1 % a pixel (`shading`),
# reflections by more.
LOOKOUT_MASK, WATCHED, GLARING = 3, 8, 1.5e-3
UNTAKEN = 1.0  # of the shift that a slope makes, what may be left where it is not taken out
SMALLEST_PX = 2.0  # radius of a mark's even inside that a slope can be seen in
LEFT = 0.35  # share of a mark's information that is left where it is still measured beside what covers it
# Of what seems occluded: a slope that leaves more of it is none. Wires leave 0.95 or more of it, glare up to 0.85.
EXPLAINED = 0.9
# Standard uncertainty, in blurs of the edge, up to which the parts of a rim agree: beyond, steps are no longer linear.
AGREED = 0.25
NEVER = 2.0  # share that nothing reaches


@dataclass
class SlowPath:
    """Fits of one mark and what they show; the arrays are those of `kernels.fit_disc`, shared with who follows it.

    inner_px: radius of the mark's even inside. watch: frames left in which a slope is looked for; occluded_lately: and
    what covers the mark, too. shift: of the centre by a slope that was not taken out when the slow path was last taken,
    as far as it may be wrong, px. occluded: whether the result is that of what shows beside something that covers the
    mark: its variances are then whole.
    """

    disc: Array
    table: NDArray[np.float32]
    noise: Array
    result: Array
    inner_px: float
    blur_px: float
    watch: int = 0
    occluded_lately: int = 0
    shift: tuple[float, float] = (0.0, 0.0)
    occluded: bool = False

    def __post_init__(self) -> None:
        """Make the arrays that the kernels read and fill."""
        self.sloped, self.unoccluded = np.zeros(kernels.RESULTS), np.zeros(kernels.RESULTS)

    def begin(self, frame: Frame) -> bool:
        """Forget the frame before; whether this one takes the slow path even if the mark looks well."""
        self.occluded = False
        return self.watch > 0 or self.regular(frame)

    @staticmethod
    def regular(frame: Frame) -> bool:
        """Whether a frame takes the slow path by its number, though nothing is odd."""
        return not frame.index & LOOKOUT_MASK

    def fit(self, frame: Frame, start: Array) -> None:
        """Fit the disc before a level background."""
        self._fit(frame, start, sloping=False, result=self.result)

    def _fit(self, frame: Frame, start: Array, *, sloping: bool, result: Array) -> None:
        where = frame.luma, frame.row_origin, frame.row_step
        kernels.fit_disc(*where, start, sloping, self.disc, self.table, self.noise, result)

    def refit(self, frame: Frame, *, suspicious: bool) -> bool:
        """Fit a sloping background too, or what shows beside something in the way; keep the one that is there.

        Returns whether one was kept.
        """
        result, sloped = self.result, self.sloped
        if not result[kernels.X] < np.inf:
            return False
        # What covers a mark leaves more residual than usual.
        due = suspicious or self.occluded_lately > 0 or (self.regular(frame) and result[kernels.RESIDUAL] > 1.0)
        seeming, share = self._fit_unoccluded(frame, result, NOTABLE) if due else (0.0, 0.0)
        self._fit(frame, result[: kernels.BASE + 1], sloping=True, result=sloped)
        self.occluded = (
            share > 0.0 and self._sound(share) and self._fit_unoccluded(frame, sloped, NEVER)[0] > EXPLAINED * seeming
        )
        self.occluded_lately = WATCHED if self.occluded else self.occluded_lately - 1
        if not self.occluded:
            return self._keep_slope(frame, suspicious=suspicious)
        self.watch, self.shift = WATCHED, (0.0, 0.0)
        result[:] = self.unoccluded
        return True

    def _keep_slope(self, frame: Frame, *, suspicious: bool) -> bool:
        """Keep the fit with a slope where the slope is there: the onset of glare or shadow; else the plain one."""
        result, sloped = self.result, self.sloped
        residual = result.item(kernels.RESIDUAL)
        sloping = (residual - sloped.item(kernels.RESIDUAL)) * result.item(kernels.PIXELS) > SLOPING
        taken = (sloping and (suspicious or self._glares(frame))) or (suspicious and residual >= fast_path.DISTURBED)
        self.watch = WATCHED if sloping else self.watch - 1
        self.shift = (0.0, 0.0)
        if sloping:
            share = BENT if taken else UNTAKEN
            self.shift = (
                share * (sloped.item(kernels.X) - result.item(kernels.X)),
                share * (sloped.item(kernels.Y) - result.item(kernels.Y)),
            )
        if taken:
            result[:] = sloped
        return taken

    def _fit_unoccluded(self, frame: Frame, fitted: Array, least: float) -> tuple[float, float]:
        """Fit what shows beside something that covers the mark; least, and what is returned: of `fit_uncovered`."""
        where = frame.luma, frame.row_origin, frame.row_step
        core = CORE_EXPECTED if self.occluded_lately > 0 else CORE
        return fit_uncovered(*where, fitted, self.disc, self.table, self.noise, self.unoccluded, None, core, least)

    def _sound(self, share: float) -> bool:
        """Whether a fit beside something that covers a share of the mark tells where the mark is."""
        unoccluded = self.unoccluded
        sure = unoccluded[kernels.VAR_X] + unoccluded[kernels.VAR_Y] < 2.0 * (AGREED * self.blur_px) ** 2
        return bool(0.0 < share < 1.0 - LEFT and sure and unoccluded[kernels.RESIDUAL] < fast_path.DISTURBED)

    def _glares(self, frame: Frame) -> bool:
        """Whether the fitted slope is a reflection: strong enough, and inside the mark too, unlike a body's edge."""
        x, y, slope = self.sloped[0], self.sloped[1], self.sloped[kernels.SLOPE_X : kernels.SLOPE_Y + 1]
        inner, inside = self.inner_px, np.zeros(2)
        if inner < SMALLEST_PX or np.hypot(*slope) < GLARING * abs(self.sloped[kernels.AMPLITUDE]):
            return False
        kernels.interior_slope(frame.luma, frame.row_origin, frame.row_step, x, y, inner, inside)
        # The slope of a plane through n samples of a disc of radius r is known to 2·noise/(r·√n).
        sigma = 2.0 * np.sqrt(self.noise[0] / np.pi) / inner**2
        steepness = np.hypot(*slope)
        return bool(3.0 * sigma < steepness and np.hypot(*(inside - slope)) < 0.5 * steepness + 3.0 * sigma)
