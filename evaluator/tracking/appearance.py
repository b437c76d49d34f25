"""What is learnt of a mark from the pictures it was first found in: its colour against the plate, its disc."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.tracking.disc import Disc, Patch, cut_patch, learn_disc
from evaluator.tracking.find import Candidate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Appearance:
    """Colour and shape of one mark.

    neutral: (u, v) of what is grey in this recording. direction: unit vector from it to the mark's colour. wanted:
    least chroma along the direction, and the tangent of the half angle about it, for a pixel to count. area_px2: how
    many pixels count on the whole mark. disc: its shape in the luma.
    """

    neutral: Array
    direction: Array
    wanted: Array
    area_px2: float
    disc: Disc


def learn(
    sightings: Sequence[tuple[Frame, Candidate]], others_uv: Sequence[Array], neutral: Array
) -> Appearance | None:
    """Learn a mark from the pictures where it was found; None where its luma shows no disc.

    others_uv: mean colours of the other marks; the half angle ends midway to the nearest of them.
    """
    colors = np.array([candidate.chroma_uv for _, candidate in sightings])
    color = np.median(colors, axis=0) - neutral
    length = float(np.hypot(*color))
    if length < 2.0:  # two levels: below that, rounding alone turns the direction by tens of degrees
        return None
    direction = color / length
    half_angle = np.radians(40.0)
    for other in others_uv:
        away = other - neutral
        cosine = float(away @ direction / max(np.hypot(*away), 1e-9))
        half_angle = min(half_angle, 0.5 * float(np.arccos(np.clip(cosine, -1, 1))))
    disc = _disc(sightings)
    if disc is None:
        return None
    area = float(np.median([np.pi * candidate.radius_px**2 for _, candidate in sightings]))
    return Appearance(
        neutral=neutral,
        direction=direction,
        wanted=np.array([0.45 * length, np.tan(max(half_angle, np.radians(8.0)))]),
        area_px2=area,
        disc=disc,
    )


def _disc(sightings: Sequence[tuple[Frame, Candidate]]) -> Disc | None:
    patches: list[Patch] = []
    radius = float(np.median([candidate.radius_px for _, candidate in sightings]))
    for frame, candidate in sightings:
        patch = cut_patch(frame.luma, (frame.row_origin, frame.row_step), candidate.center_px, 1.3 * radius + 4.0)
        if len(patch.value) > 30:
            patches.append(patch)
    if not patches:
        return None
    try:
        disc, spread = learn_disc(patches, radius)
    except np.linalg.LinAlgError:
        return None
    plausible = 0.4 < disc.radius_px / radius < 2.0
    return disc if plausible and abs(disc.amplitude) > spread else None
