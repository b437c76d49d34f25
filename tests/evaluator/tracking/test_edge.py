"""A mark beside the edge of its body, out of focus: drawn in linear light, blurred, written in a camera's gamma."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from evaluator.tracking.detection.appearance import learn_shape
from evaluator.tracking.refinement import kernels, slow_path
from evaluator.tracking.refinement.disc import Disc, Edge, fit, make_disc
from evaluator.tracking.refinement.edge import View, find_edge, matters
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


def fitted(x: float, sigma: float = 0.02, residual: float = 1.0) -> Array:
    numbers = np.zeros(kernels.RESULTS)
    numbers[[kernels.X, kernels.VAR_X, kernels.VAR_Y]] = x, sigma**2 / 2, sigma**2 / 2
    numbers[[kernels.AMPLITUDE, kernels.RESIDUAL, kernels.PIXELS]] = 100.0, residual, 200.0
    return numbers


def test_an_edge_is_looked_for_where_a_slope_shifts_a_mark_by_three_sigmas() -> None:
    assert not matters(fitted(30.0), fitted(30.058))
    assert matters(fitted(30.0), fitted(30.062))


@pytest.mark.parametrize(
    ("shift_px", "residual", "sloped", "kept"),
    [
        (0.009, 1.0, 4.0, False),
        (0.011, 1.0, 4.0, True),
        (0.2, 1.6, 4.0, True),
        (0.2, 2.1, 4.0, False),
        (0.2, 1.42, 1.2, True),  # a slope leaves as much, but for two standard deviations of 200 squares
        (0.2, 1.46, 1.2, False),
    ],
)
def test_an_edge_counts_where_it_shifts_the_mark_by_half_a_sigma_and_explains_what_disturbs_it(
    shift_px: float, residual: float, sloped: float, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    disc = make_disc(6.0, 0.9, (0.0, 0.0), (100.0, 30.0), 4.0)
    plain, edge = fitted(30.0, residual=4.5), fitted(30.0 + shift_px, residual=residual)
    path = slow_path.SlowPath(disc.numbers(), disc.table, np.array([4.0, 5.0]), plain, 4.0, disc)
    monkeypatch.setattr(
        path, "_fit", lambda *_, result, **__: result.__setitem__(slice(None), fitted(30.3, residual=sloped))
    )
    monkeypatch.setattr(path, "_fit_unoccluded", lambda *_: (0.0, 0.0))
    monkeypatch.setattr(path, "_glares", lambda _: False)
    monkeypatch.setattr(slow_path, "cut_patch", lambda *_: None)
    monkeypatch.setattr(slow_path, "find_edge", lambda *_: (edge, Edge(0.0, 9.0, 40.0, 90.0)))
    frame: Any = SimpleNamespace(luma=None, row_origin=0, row_step=1, index=1)
    path.refit(frame, suspicious=False)
    assert (plain[kernels.X] == edge[kernels.X]) == kept
    assert (path.shift[0] == pytest.approx(slow_path.EDGED * shift_px)) == kept
