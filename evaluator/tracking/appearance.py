"""What is learnt of a mark from the pictures it was found in: its colour against the plate, its disc."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.tracking.choose import Candidate
from evaluator.tracking.disc import Disc, Patch, cut_patch, learn_disc

Array = NDArray[np.float64]
ENOUGH = 1009  # samples of a patch that a shape is learnt from: all of a mark of 8 px radius


@dataclass(frozen=True)
class Appearance:
    """Colour and shape of one mark.

    color: as `color_kernels.is_color` takes it. area_px2: area of the pixels that have the colour when the whole mark
    shows. disc: its shape in the luma.
    """

    color: Array
    area_px2: float
    disc: Disc


def learn_color(candidate: Candidate, others_uv: Sequence[tuple[float, float]], neutral: tuple[float, float]) -> Array:
    """Direction and extent of a mark's colour in (u, v), as `color_kernels.is_color` takes it.

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
    """Luma around a mark, with the rim that learning needs."""
    return cut_patch(frame.luma, (frame.row_origin, frame.row_step), center_px, 1.3 * radius_px + 4.0)


def learn_shape(patches: Sequence[Patch], radius_px: float, blur_px: float = 1.0) -> Disc | None:
    """Learn the disc from patches around the mark; None where there is none of about that radius."""
    whole = [_thinned(patch) for patch in patches if len(patch.value) > 30]
    if not whole:
        return None
    try:
        disc, spread = learn_disc(whole, radius_px, blur_px)
    except np.linalg.LinAlgError:
        return None
    plausible = 0.4 < disc.radius_px / radius_px < 2.0
    return disc if plausible and abs(disc.amplitude) > 2 * spread else None


def _thinned(patch: Patch) -> Patch:
    """At most ENOUGH samples, spread evenly: an error of the shape does not move the centre of a large mark."""
    if len(patch.value) <= ENOUGH:
        return patch
    kept = np.linspace(0, len(patch.value) - 1, ENOUGH).astype(int)
    return Patch(patch.x[kept], patch.y[kept], patch.value[kept], patch.center_px)


def with_disc(look: Appearance, disc: Disc) -> Appearance:
    """The same mark with a better known shape."""
    return replace(look, disc=disc, area_px2=max(look.area_px2, 0.8 * np.pi * disc.radius_px**2))
