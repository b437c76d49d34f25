"""A mark beside the edge of its body, where blur mixes light from beyond the edge into the mark's rim.

A fit with uniform or linear background would be shifted by this light, by a pixel and more if the blur is a fifth of
the mark. Therefore the edge, or two edges that meet at a right angle, are fitted together with the disc, with the same
blur: their direction, their distances, and the difference of light beyond them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from evaluator.tracking.refinement import kernels
from evaluator.tracking.refinement.disc import PER_PX, Disc, Edge
from evaluator.tracking.refinement.learn_shape import Patch
from evaluator.tracking.refinement.motion_blur import path_of

Array = NDArray[np.float64]

AROUND = 1.0  # blurs beyond the pixels of a fit of the disc alone, so that more than one flank of the edge is visible
PLACES = (0.5, 1.5, 2.5)  # initial distances of the edge from the rim of the disc, in blurs
FAR = 6.0  # blurs beyond the disc, from which an edge does not affect the mark
ANGLE, DISTANCE, ASIDE, HEIGHT = range(4, 8)  # indices of the edge's unknowns, after those of the disc
UNKNOWNS = HEIGHT + 1
CLEARLY = 20.0  # decrease of squared residuals, in variances, that four unknowns cause by chance once in 2000 frames
SHIFTED = 3.0  # shift of a mark by a slope, in sigmas, where an edge shifts it by one sigma; in clips, a third or less
STEPS, ENOUGH_PX = 20, 0.01  # most steps of a fit; a smaller step ends it
LARGEST = 0.4  # radii: largest step of the centre or the edge
TURNED = 0.3  # rad: largest step of the edge's direction


@dataclass(frozen=True)
class View:
    """Data of the fit: pixels around a mark, its disc and motion blur; noise: variance, softness."""

    patch: Patch
    disc: Disc
    path_px: tuple[float, float]
    noise: tuple[float, float]


def find_edge(view: View, plain: Array, sloped: Array, last: Edge | None = None) -> tuple[Array, Edge] | None:
    """Fit a disc and an edge beside it, if they explain the pixels better than a linear background does.

    plain, sloped: results of `kernels.fit_disc` without and with slopes. last: the edge in an earlier frame. Returns
    results as of `kernels.fit_disc`, and the edge; None if there is no edge beside the mark.
    """
    disc, patch = view.disc, view.patch
    reach = disc.outer_px + AROUND * disc.blur_px
    near = np.hypot(patch.x - plain[kernels.X], patch.y - plain[kernels.Y]) < reach
    if np.count_nonzero(near) < 4 * UNKNOWNS:
        return None
    patch = replace(patch, x=patch.x[near], y=patch.y[near], value=patch.value[near])
    model, rough = _Model(replace(view, patch=patch)), _Model(replace(view, patch=_thinned(patch)))
    centers = [one[: kernels.Y + 1].tolist() for one in (plain, sloped)]
    again = [] if last is None else [(last.angle, last.distance_px, last.aside_px)]
    for starts in filter(None, (again, _anywhere(disc, sloped))):
        tried = [rough.levelled(np.array([*at, 0.0, 0.0, *edge, 1.0])) for edge in starts for at in centers]
        found = model.fit(min(tried, key=lambda one: one[0])[1])
        if found is not None and model.cost_of_slope(sloped) - _left(found[0]) > CLEARLY:
            return found
    return None


def matters(plain: Array, sloped: Array) -> bool:
    """Whether the slope of the background is so large that an edge may shift the mark; arguments of `find_edge`."""
    shift = sloped[: kernels.Y + 1] - plain[: kernels.Y + 1]
    return bool(shift @ shift > SHIFTED**2 * plain[[kernels.VAR_X, kernels.VAR_Y]].sum())


def _thinned(patch: Patch) -> Patch:
    """Some samples, spread evenly, sufficient for initial values."""
    every = slice(None, None, 1 + len(patch.value) // (20 * UNKNOWNS))
    return replace(patch, x=patch.x[every], y=patch.y[every], value=patch.value[every])


def _left(fitted: Array) -> float:
    """Residual squares over the noise of a fit with an edge."""
    return float(fitted[kernels.RESIDUAL] * (fitted[kernels.USED] * fitted[kernels.PIXELS] - UNKNOWNS))


def without_edge(patch: Patch, disc: Disc, fitted: Array, edge: Edge) -> Patch:
    """The patch corrected to a uniform background beyond the edge."""
    state = np.array([*fitted[: kernels.BASE + 1], *edge])
    beyond = _beyond(patch.x - state[0], patch.y - state[1], (disc.blur_px, disc.blur_px), state)[0]
    return replace(patch, value=patch.value - edge.height * beyond)


def _anywhere(disc: Disc, sloped: Array) -> list[tuple[float, float, float]]:
    """Initial angles and distances: an edge or a corner on the light or the dark side of the slope."""
    across = float(np.arctan2(sloped.item(kernels.SLOPE_Y), sloped.item(kernels.SLOPE_X)))
    far = disc.outer_px + FAR * disc.blur_px
    starts = []
    for turn in (0.0, np.pi):
        for place in PLACES:
            distance = disc.radius_px + place * disc.blur_px
            starts += [(across + turn, distance, far), (across + turn - np.pi / 4, distance, distance)]
    return starts


class _Model:
    """Luma of a disc beside an edge; unknowns: x, y, amplitude, base, angle, distance, aside, height."""

    def __init__(self, view: View) -> None:
        self._view = view
        self._x, self._y, self._value = view.patch.x, view.patch.y, view.patch.value
        path = path_of(view.disc.numbers(view.path_px))
        self._offsets = np.zeros((1, 2)) if path is None else path[:, :2].astype(float)
        self._radii = np.arange(len(view.disc.profile)) / PER_PX

    def __call__(self, state: Array) -> tuple[Array, Array]:
        """Luma, (n,), and its derivatives by the unknowns, (n, UNKNOWNS)."""
        disc, offsets = self._view.disc, self._offsets
        aside_x, aside_y = disc.blur_px**2 * disc.shade[0], disc.blur_px**2 * disc.shade[1]
        dx, dy = self._x - state[0] + aside_x, self._y - state[1] + aside_y
        profile, steep_x, steep_y = np.zeros_like(dx), np.zeros_like(dx), np.zeros_like(dx)
        for off_x, off_y in offsets:
            ax, ay = dx - off_x, dy - off_y
            out_x, out_y = (1.0 + disc.e1) * ax + disc.e2 * ay, disc.e2 * ax + (1.0 - disc.e1) * ay
            r = np.sqrt(np.maximum(ax * out_x + ay * out_y, 1e-12))
            profile += np.interp(r, self._radii, disc.profile, right=0.0) / len(offsets)
            steep = np.interp(r, self._radii, disc.slope, right=0.0) / r / len(offsets)
            steep_x, steep_y = steep_x + steep * out_x, steep_y + steep * out_y
        light = 1.0 + disc.shade[0] * dx + disc.shade[1] * dy
        steep_x, steep_y = light * steep_x + disc.shade[0] * profile, light * steep_y + disc.shade[1] * profile
        profile *= light
        beyond, (by_angle, by_distance, by_aside) = _beyond(dx, dy, self._blurs(state[ANGLE]), state)
        amplitude, height = state[2], state[HEIGHT]
        cos, sin = np.cos(state[ANGLE]), np.sin(state[ANGLE])
        # The edge moves with the mark, so that its distance stays constant while the centre moves.
        by_x = -amplitude * steep_x + height * (by_distance * cos - by_aside * sin)
        by_y = -amplitude * steep_y + height * (by_distance * sin + by_aside * cos)
        edge = height * by_angle, height * by_distance, height * by_aside, beyond
        slopes = np.stack([by_x, by_y, profile, np.ones_like(dx), *edge], axis=1)
        return amplitude * profile + state[3] + height * beyond, slopes

    def _blurs(self, angle: float) -> tuple[float, float]:
        """Blur of the edge and of the one aside: that of the lens, and of the motion across them."""
        (x, y), cos, sin = self._view.path_px, np.cos(angle), np.sin(angle)
        across = (x * cos + y * sin) ** 2, (y * cos - x * sin) ** 2
        return tuple(float(np.sqrt(self._view.disc.blur_px**2 + path / 12.0)) for path in across)  # type: ignore[return-value]

    def levelled(self, state: Array) -> tuple[float, Array]:
        """Residual squares, and the state with the best amplitude, base and height."""
        levels, state = [2, 3, HEIGHT], state.copy()
        shown = self(state)[1][:, levels]
        state[levels] = np.linalg.lstsq(shown, self._value, rcond=None)[0]
        return float(np.sum((self._value - shown @ state[levels]) ** 2)), state

    def _cost(self, residual: Array) -> float:
        """Robust cost with bounded growth: the integral of 2r/(1 + (r/s)⁴)."""
        far = self._view.noise[0] * self._view.noise[1] ** 2
        return float(np.sum(far * np.arctan(residual**2 / far)))

    def cost_of_slope(self, sloped: Array) -> float:
        """Residual squares over the noise of a disc on a linear background; sloped: result of `kernels.fit_disc`."""
        even = np.array([*sloped[: kernels.BASE + 1], 0.0, np.inf, np.inf, 0.0])
        tilt = sloped[kernels.SLOPE_X] * (self._x - even[0]) + sloped[kernels.SLOPE_Y] * (self._y - even[1])
        return self._cost(self._value - self(even)[0] - tilt) / self._view.noise[0]

    def fit(self, state: Array) -> tuple[Array, Edge] | None:
        """Fit all unknowns by Levenberg-Marquardt; returns as `find_edge`."""
        (noise, softness), disc = self._view.noise, self._view.disc
        damping, best, cost = 1e-3, state, np.inf
        largest = LARGEST * disc.radius_px
        for _ in range(STEPS):
            shown, slopes = self(state)
            residual = self._value - shown
            now = self._cost(residual)
            if now < cost:
                moved = float(np.abs((state - best)[[0, 1, DISTANCE]]).max())
                done = np.isfinite(cost) and cost - now < 1e-3 * now and moved < ENOUGH_PX
                # At first the edge itself has large residuals, not an occlusion: its pixels keep their weight until it
                # fits.
                scale = max(noise, float(np.mean(residual**2)))
                weight = 1.0 / (1.0 + (residual**2 / (scale * softness**2)) ** 2)
                best, cost, damping = state, now, damping / 5.0
                normal, right = (slopes.T * weight) @ slopes, (slopes.T * weight) @ residual
                if done:
                    break
            elif damping > 1e4:
                break
            else:
                damping *= 8.0
            move = np.linalg.solve(normal + np.diag(damping * np.diag(normal) + 1e-9 * np.trace(normal)), right)
            move[[0, 1, DISTANCE, ASIDE]] = np.clip(move[[0, 1, DISTANCE, ASIDE]], -largest, largest)
            move[ANGLE] = np.clip(move[ANGLE], -TURNED, TURNED)
            state = best + move
        if not min(best[DISTANCE], best[ASIDE]) > disc.radius_px:
            return None
        covariance = np.linalg.inv(normal + 1e-9 * np.trace(normal) * np.eye(UNKNOWNS)) * noise
        result = np.zeros(kernels.RESULTS)
        result[[kernels.X, kernels.Y, kernels.AMPLITUDE, kernels.BASE]] = best[:4]
        result[[kernels.VAR_X, kernels.VAR_Y, kernels.COV_XY]] = covariance[0, 0], covariance[1, 1], covariance[0, 1]
        result[kernels.RESIDUAL] = cost / noise / max(float(weight.sum()) - UNKNOWNS, 1.0)
        result[kernels.USED], result[kernels.INSIDE], result[kernels.PIXELS] = weight.mean(), 1.0, len(residual)
        return result, Edge(*best[ANGLE:].tolist())


def _beyond(dx: Array, dy: Array, blurs: tuple[float, float], state: Array) -> tuple[Array, tuple[Array, Array, Array]]:
    """Share of each pixel that lies beyond an edge, (n,), and its slopes by angle, distance and distance aside."""
    cos, sin = np.cos(state[ANGLE]), np.sin(state[ANGLE])
    along, aside = cos * dx + sin * dy, cos * dy - sin * dx
    (one, rise), (other, rise_aside) = (
        (ndtr(depth / blur), np.exp(-0.5 * (depth / blur) ** 2) / (blur * np.sqrt(2.0 * np.pi)))
        for depth, blur in zip((along - state[DISTANCE], aside - state[ASIDE]), blurs, strict=True)
    )
    by_distance, by_aside = -rise * (1.0 - other), -rise_aside * (1.0 - one)
    # A rotation of the corner moves each edge in proportion to the depth along the other one.
    return one + other - one * other, (-by_distance * aside + by_aside * along, by_distance, by_aside)
