"""Appearance of a mark, learnt from its frames: colour relative to the plate, disc."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.tracking.detection.selection import Candidate
from evaluator.tracking.refinement import kernels
from evaluator.tracking.refinement.disc import NO_SHADE, Disc
from evaluator.tracking.refinement.edge import View, find_edge, matters, without_edge
from evaluator.tracking.refinement.fast_path import DISTURBED
from evaluator.tracking.refinement.learn_shape import Patch, Steps, cut_patch, learn_disc
from evaluator.tracking.refinement.occluded_pixels import CORE_EXPECTED
from evaluator.tracking.refinement.occlusion import NOTABLE, fit_uncovered

Array = NDArray[np.float64]
# Scale of the outlier weights 1/(1 + (r/SOFT)⁴), in sigmas: Gaussian noise loses 0.4 % of its information, a wire or a
# glint its influence.
SOFTNESS = 5.0
# Number of times that a shape is learnt again without occluded pixels, since the first shape adapts to the occlusion.
CLEARINGS = 3
SEVERAL = 3  # patches: fewer do not distinguish an occlusion from the mark's shape
SELDOM = 0.5  # share of the patches that must show a feature for it to change the shape
NO_DISC = 0.5  # lost share of the information on its centre from which a mark counts as no disc
ROUGH = 0.1  # of the amplitude: error of a shape that was learnt without the edge
RIM = 1.6  # radii
ENOUGH = 1009  # samples of a patch used to learn a shape: all of a mark of 8 px radius


@dataclass(frozen=True)
class Appearance:
    """Colour and shape of one mark.

    color: argument of `color_kernels.is_color`. area_px2: area of the pixels of this colour when the whole mark is
    visible. disc: its shape in the luma.
    """

    color: Array
    area_px2: float
    disc: Disc


def learn_color(candidate: Candidate, others_uv: Sequence[tuple[float, float]], neutral: tuple[float, float]) -> Array:
    """Direction and extent of a mark's colour in (u, v), the argument of `color_kernels.is_color`.

    others_uv: mean colours of the other marks; the half angle ends midway to the nearest of them.
    """
    color = np.subtract(candidate.chroma_uv, neutral)
    length = max(float(np.hypot(*color)), 1e-9)
    direction = color / length
    half_angle = np.radians(40.0)
    for other in others_uv:
        away = np.subtract(other, neutral)
        cosine = float(away @ direction / max(np.hypot(*away), 1e-9))
        half_angle = min(half_angle, 0.5 * float(np.arccos(np.clip(cosine, -1, 1))))
    tangent = np.tan(max(half_angle, np.radians(8.0)))
    return np.array([*neutral, *direction, 0.45 * length, tangent])


def patch_of(frame: Frame, center_px: tuple[float, float], radius_px: float) -> Patch:
    """Luma around a mark, with the surroundings that learning needs."""
    return cut_patch(frame.luma, (frame.row_origin, frame.row_step), center_px, RIM * radius_px + 5.0)


def learn_shape(
    patches: Sequence[Patch], radius_px: float, blur_px: float = 1.0, *, smeared: bool = False
) -> Steps[Disc | None]:
    """Learn the disc from patches around the mark; returns None if there is none of about that radius.

    smeared: the mark moves so fast that the motion blur of an edge beside it differs between patches, so that the edge
    cannot be removed.
    """
    whole = [patch for patch in patches if len(patch.value) > 30]
    if not whole:
        return None
    try:
        disc = yield from _learn_whole(whole, radius_px, blur_px, smeared=smeared, shaded=True)
        if disc.shade != NO_SHADE:
            # A wire over a part of the rim, or light from beyond an edge, resembles a shade, but is explained better.
            flat = yield from _learn_whole(whole, radius_px, blur_px, smeared=smeared, shaded=False)
            disc = disc if flat.noise > DISTURBED * disc.noise else flat
    except np.linalg.LinAlgError:
        return None
    plausible = 0.4 < disc.radius_px / radius_px < 2.0
    return disc if plausible and abs(disc.amplitude) > 2 * disc.noise**0.5 else None


def _learn_whole(patches: list[Patch], radius_px: float, blur_px: float, *, smeared: bool, shaded: bool) -> Steps[Disc]:
    """Learn a disc, again without what covers it or shines into it; shaded: whether it may be lit from one side."""
    disc = yield from learn_disc([_thinned(patch) for patch in patches], radius_px, blur_px, shaded=shaded)
    if len(patches) >= SEVERAL:
        disc = yield from _learn_clear(patches, disc, shaded=shaded)
        disc = disc if smeared else (yield from _learn_beside_edge(patches, disc, shaded=shaded))
    return disc


def _learn_clear(patches: list[Patch], first: Disc, *, shaded: bool) -> Steps[Disc]:
    """Learn a disc again without occluded pixels; returns the first one if nothing, or too much, is occluded."""
    disc = first
    for _ in range(CLEARINGS):
        clear, occluded = [], []
        for patch in patches:
            shown, share = _uncovered(patch, disc)
            yield
            clear.append(_thinned(_part(patch, shown)))
            occluded.append(share)
        if np.mean(occluded) > NO_DISC:
            return first
        if not any(occluded):
            break
        disc = yield from learn_disc(clear, first.radius_px, first.blur_px, shaded=shaded)
        disc = replace(disc, occluded=float(np.mean(occluded)))
    return disc


def _learn_beside_edge(patches: list[Patch], first: Disc, *, shaded: bool) -> Steps[Disc]:
    """Learn a disc again without light from beyond the edge of its body; returns the first one if there is none."""
    disc, other, least, edge = first, first, np.inf, first.edge
    for _ in range(CLEARINGS):
        cleared, left, rough = list[Patch](), list[float](), max(other.noise, (ROUGH * other.amplitude) ** 2)
        for patch in patches:
            plain, sloped = (_fitted(patch, other, sloping=sloping)[-1] for sloping in (False, True))
            if not matters(plain, sloped):
                continue
            plain[kernels.X], sloped[kernels.X] = plain[kernels.X] + patch.x[0], sloped[kernels.X] + patch.x[0]
            found = find_edge(View(patch, other, (0.0, 0.0), (rough, SOFTNESS)), plain, sloped, edge)
            yield
            if found is not None:
                edge = found[1]
                cleared.append(_thinned(without_edge(patch, other, *found)))
                left.append(found[0][kernels.RESIDUAL] * rough)
        if len(cleared) < max(SEVERAL, SELDOM * len(patches)) or not np.mean(left) < least:
            break
        disc, least = replace(other, edge=edge), float(np.mean(left))
        other = yield from learn_disc(cleared, first.radius_px, disc.blur_px, shaded=shaded)
    return disc


def _fitted(patch: Patch, disc: Disc, *, sloping: bool) -> tuple[NDArray[np.unsignedinteger], tuple[int, int], Array]:
    """Fit a disc in a patch (a whole rectangle); returns its luma, origin and step of the rows, results of `fit_disc`.

    Columns count from the patch's own first one.
    """
    columns = int(np.count_nonzero(patch.y == patch.y[0]))
    kind = np.uint8 if patch.value.max() < 256 else np.uint16
    luma: NDArray[np.unsignedinteger] = patch.value.reshape(-1, columns).astype(kind)
    # Whole rows of the frame, as whole numbers: kernels are compiled for those.
    rows = round(patch.y[0]), round(patch.y[columns] - patch.y[0]) if len(patch.y) > columns else 1
    start = np.array([patch.center_px[0] - patch.x[0], patch.center_px[1], disc.amplitude, disc.base])
    fitted, noise = np.zeros(kernels.RESULTS), np.array([disc.noise, SOFTNESS])
    kernels.fit_disc(luma, *rows, start, sloping, disc.numbers(), disc.table, noise, fitted)
    return luma, rows, fitted


def _uncovered(patch: Patch, disc: Disc) -> tuple[NDArray[np.bool_], float]:
    """Which samples of a patch are not occluded, (n,), and the lost share of the information."""
    luma, rows, fitted = _fitted(patch, disc, sloping=True)
    shown, noise = np.ones(luma.shape, bool), np.array([disc.noise, SOFTNESS])
    shape, share, table = disc.numbers(), 0.0, disc.table
    if np.isfinite(fitted[kernels.X]):
        where, result = (luma, *rows), fitted.copy()
        _, share = fit_uncovered(*where, fitted, shape, table, noise, result, shown, CORE_EXPECTED, NOTABLE)
    return shown.ravel(), share


def _part(patch: Patch, kept: NDArray[np.bool_] | NDArray[np.intp]) -> Patch:
    return Patch(patch.x[kept], patch.y[kept], patch.value[kept], patch.center_px)


def _thinned(patch: Patch) -> Patch:
    """At most ENOUGH samples, spread evenly, which suffice because shape errors do not move a large mark's centre."""
    if len(patch.value) <= ENOUGH:
        return patch
    return _part(patch, np.linspace(0, len(patch.value) - 1, ENOUGH).astype(int))


def with_disc(look: Appearance, disc: Disc) -> Appearance:
    """The appearance of a mark with another disc; its colour area is at least 0.8 of the disc's area."""
    return replace(look, disc=disc, area_px2=max(look.area_px2, 0.8 * np.pi * disc.radius_px**2))
