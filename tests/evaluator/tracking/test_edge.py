"""A mark beside the edge of its body, out of focus: drawn in linear light, blurred, written in a camera's gamma."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from evaluator.tracking.detection.appearance import learn_shape
from evaluator.tracking.refinement import kernels, slow_path
from evaluator.tracking.refinement.disc import Disc, fit
from evaluator.tracking.refinement.edge import View, find_edge
from evaluator.tracking.refinement.learn_shape import Patch, cut_patch, finished

Array = NDArray[np.float64]
SIDE, FINE, RADIUS = 60, 4, 7.0
CENTER = (30.3, 29.8)


def drawn(
    angle: float, gap_px: float, blur_px: float, *, beyond: float = 0.7, corner: float = 0.0, gamma: float = 2.2,
    seed: int = 0,
) -> NDArray[np.uint8]:  # fmt: skip
    """A mark on a black body whose edge lies gap_px beyond the mark's rim, at an angle; corner: and another one."""
    place = (np.arange(SIDE * FINE) + 0.5) / FINE - 0.5
    dx, dy = np.meshgrid(place - CENTER[0], place - CENTER[1])
    along, aside = np.cos(angle) * dx + np.sin(angle) * dy, np.cos(angle) * dy - np.sin(angle) * dx
    outside = (along > RADIUS + gap_px) | ((corner > 0.0) & (aside > RADIUS + gap_px + 1.0))
    scene = np.where(np.hypot(dx, dy) < RADIUS, 0.4, np.where(outside, beyond, 0.02)).astype(np.float32)
    light = cv2.resize(cv2.GaussianBlur(scene, (0, 0), blur_px * FINE), (SIDE, SIDE), interpolation=cv2.INTER_AREA)
    noise = np.random.default_rng(seed).normal(0.0, 2.0, (SIDE, SIDE))
    return np.clip(np.rint(255.0 * np.asarray(light, float) ** (1.0 / gamma) + noise), 0, 255).astype(np.uint8)


def patch(luma: NDArray[np.uint8], half: float = 25.0) -> Patch:
    return cut_patch(luma, (0, 1), CENTER, half)


def learnt(images: list[NDArray[np.uint8]]) -> Disc:
    disc = finished(learn_shape([patch(luma, 1.6 * RADIUS + 5.0) for luma in images], RADIUS))
    assert disc is not None
    return disc


def beside(luma: NDArray[np.uint8], disc: Disc) -> tuple[Array, Array | None]:
    """Centres less the true one, px: of the disc alone, and beside an edge, None where none is found."""
    plain, sloped, noise = fit(luma, (0, 1), CENTER, disc), np.zeros(kernels.RESULTS), np.array([disc.noise, 5.0])
    start = np.array([*CENTER, disc.amplitude, disc.base])
    kernels.fit_disc(luma, 0, 1, start, True, disc.numbers(), disc.table, noise, sloped)
    found = find_edge(View(patch(luma), disc, (0.0, 0.0), (disc.noise, 5.0)), plain, sloped, None)
    return plain[:2] - CENTER, None if found is None else found[0][:2] - CENTER


ANGLES = np.linspace(0.2, 5.9, 4)


def errors_beside(gap_px: float, blur_px: float, **scene: float) -> tuple[Disc, Array, Array]:
    """The disc that is learnt, and of all images the error beside the edge and the shift that the edge makes, px."""
    images = [drawn(angle, gap_px, blur_px, seed=k, **scene) for k, angle in enumerate(ANGLES)]
    disc = learnt(images)
    both = [beside(luma, disc) for luma in images]
    edged = np.array([alone if other is None else other for alone, other in both])
    return disc, edged, edged - [alone for alone, _ in both]


@pytest.mark.parametrize(("blur_px", "scene", "least"), [(3.0, {}, 0.8), (2.2, {"corner": 1.0}, 0.0)])
def test_light_from_beyond_the_edge_of_the_body_is_told_from_a_shift_of_the_mark(
    blur_px: float, scene: dict[str, float], least: float
) -> None:
    disc, error, shift = errors_beside(5.0, blur_px, **scene)
    assert disc.edge is not None
    left = float(np.sqrt(np.mean(error**2) / np.mean(shift**2)))
    assert least < left / slow_path.EDGED < 1.2  # what the uncertainty allows for


def test_in_linear_light_nothing_of_it_is_left() -> None:
    _, error, shift = errors_beside(5.0, 3.0, gamma=1.0)
    assert np.sqrt(np.mean(error**2)) < 0.03
    assert np.sqrt(np.mean(shift**2)) > 0.1


def test_a_mark_far_from_any_edge_has_none() -> None:
    disc, _, shift = errors_beside(40.0, 2.0)
    assert disc.edge is None
    assert np.abs(shift).max() < 0.01
