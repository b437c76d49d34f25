from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from evaluator.tracking.detection import appearance
from evaluator.tracking.detection.appearance import learn_shape
from evaluator.tracking.refinement import kernels, shading
from evaluator.tracking.refinement.disc import NO_SHADE, PER_PX, fit, make_disc
from evaluator.tracking.refinement.learn_shape import cut_patch, finished
from evaluator.tracking.refinement.shading import LightNotes, bent_shade, learn_shading

DISC = make_disc(8.0, 0.9, (0.0, 0.0), (120.0, 40.0), 1.0)


@pytest.mark.parametrize("covered", [0.0, 0.2])
def test_uneven_light_is_learnt_though_a_wire_passes_over_the_mark(covered: float) -> None:
    rng = np.random.default_rng(3)
    places = rng.uniform(100, 400, (200, 2))
    beta = np.array([4e-4, -2e-4]) + 2e-6 * (places - 250.0)
    measured = beta + rng.normal(0, 5e-4, beta.shape)
    measured[rng.random(200) < covered] += [0.03, -0.02]
    found = learn_shading(DISC, 16.0, places, measured * (160.0 - 16.0))
    assert found is not None
    shift, variance = found.shift(places)
    normal = (shift - found.gain * beta) / np.sqrt(variance)[:, None]
    assert np.sqrt(np.mean(normal**2)) < 2.0


@pytest.mark.parametrize("level", [(12000.0, 4000.0), (4000.0, 9000.0)])
def test_a_fitted_centre_is_off_by_the_gain_where_light_is_uneven(level: tuple[float, float]) -> None:
    """A disc is drawn in light that grows by 0.2 % a pixel, and fitted as if the light were even."""
    disc, black, beta = make_disc(8.0, 0.9, (0.0, 0.0), level, 100.0), 1600.0, np.array([2e-3, -1e-3])
    center, rows = np.array([30.3, 29.6]), np.indices((60, 61))
    away = rows[::-1] - center[:, None, None]
    profile = np.interp(np.hypot(*away), np.arange(len(disc.profile)) / PER_PX, disc.profile, right=0.0)
    light = (level[1] - black + level[0] * profile) * (1.0 + np.tensordot(beta, away, 1))
    result = np.zeros(kernels.RESULTS)
    start = np.array([*center, *level])
    luma = np.rint(black + light).astype(np.uint16)
    kernels.fit_disc(luma, 0, 1, start, False, disc.numbers(), disc.table, np.array([100.0, 1e3]), result)
    off = result[[kernels.X, kernels.Y]] - center
    assert np.hypot(*off) > 0.02
    np.testing.assert_allclose(off, shading._gain(disc, black) * beta, rtol=0.05)


def test_uneven_light_is_noted_in_the_interior_of_a_mark_frame_by_frame() -> None:
    """In 12 bits: light that grows by 8 levels a pixel to the right, on a mark of 2560 above a black of 256."""
    luma = np.tile(np.rint(2560 + 8 * np.arange(200.0)), (100, 1)).astype(np.uint16)
    frame: Any = SimpleNamespace(luma=luma, row_origin=0, row_step=1, black=256.0)
    disc, notes = make_disc(8.0, 0.9, (0.0, 0.0), (1920.0, 640.0), 1.0), LightNotes()
    notes.note(frame, (40.0, 50.0))  # of a mark that is too small nothing is noted
    assert notes.learnt(disc) is None
    notes.interior_px = 5.0
    for x in np.linspace(30, 170, 40):
        notes.note(frame, (float(x), 50.0))
    found = notes.learnt(disc)
    assert found is not None
    shift, _ = found.shift(np.array([[100.0, 50.0]]))
    assert shift[0] == pytest.approx([found.gain * 8 / (1920 + 640 - 256), 0.0], rel=0.02, abs=1e-5)


def _ball(center: tuple[float, float], contrast: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
    """A mark of 6 px radius on a black top, whose luma changes by contrast from its centre to its rim; (40, 40)."""
    fine = (np.arange(400) + 0.5) / 10 - 0.5
    u, v = (fine[None, :] - center[0]) / 6.0, (fine[:, None] - center[1]) / 6.0
    luma = 30.0 + 100.0 * (np.hypot(u, v) < 1.0) * (1.0 + contrast[0] * u + contrast[1] * v)
    blurred = cv2.GaussianBlur(luma, (0, 0), 8.0).reshape(40, 10, 40, 10).mean(axis=(1, 3))
    return np.rint(blurred + rng.normal(0, 1, blurred.shape)).astype(np.uint8)


@pytest.mark.parametrize("contrast", [(0.5, -0.25), (-0.2, 0.3)])
def test_a_mark_that_is_lit_from_one_side_is_found_at_its_centre_with_a_sigma_that_holds(
    contrast: tuple[float, float],
) -> None:
    rng = np.random.default_rng(5)
    centers = [(19.5 + x, 20.0 + y) for x, y in rng.uniform(-1, 1, (6, 2))]
    images = [_ball(center, contrast, rng) for center in centers]
    shape = learn_shape([cut_patch(one, (0, 1), (19.5, 20.0), 14.0) for one in images], 6.0)
    disc = finished(shape)
    assert disc is not None
    np.testing.assert_allclose(np.array(disc.shade) * 6.0, contrast, atol=0.05)
    off = np.array([fit(one, (0, 1), (19.5, 20.0), disc)[:2] for one in images]) - centers
    assert np.abs(off.mean(axis=0)).max() < 0.05
    x, y, both = bent_shade(disc)
    assert off.mean(axis=0) @ np.linalg.solve([[x + 1e-4, both], [both, y + 1e-4]], off.mean(axis=0)) < 9.0
    flat = fit(images[0], (0, 1), (19.5, 20.0), replace(disc, shade=NO_SHADE))[:2] - centers[0]
    assert np.hypot(*flat) > 0.2


def test_a_flat_mark_has_no_shade() -> None:
    rng = np.random.default_rng(6)
    images = [_ball((19.7, 20.2), (0.0, 0.0), rng) for _ in range(6)]
    disc = finished(learn_shape([cut_patch(one, (0, 1), (19.5, 20.0), 14.0) for one in images], 6.0))
    assert disc is not None
    assert disc.shade == NO_SHADE
    assert not bent_shade(disc).any()


@pytest.mark.parametrize(("flat_noise", "shaded"), [(6.1, True), (5.9, False)])
def test_a_shade_is_believed_if_no_flat_mark_leaves_about_as_little(
    flat_noise: float, shaded: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A wire across the rim, or light from beyond an edge, looks like a shade until it is taken out."""

    def learn(_patches: Any, _radius: float, _blur: float, *, shaded: bool) -> Any:
        yield
        return replace(DISC, shade=(0.05, 0.0), noise=4.0) if shaded else replace(DISC, noise=flat_noise)

    monkeypatch.setattr(appearance, "learn_disc", learn)
    patches = [cut_patch(np.zeros((40, 40), np.uint8), (0, 1), (20.0, 20.0), 14.0)]
    disc = finished(learn_shape(patches, 8.0))
    assert disc is not None
    assert (disc.shade != NO_SHADE) is shaded
