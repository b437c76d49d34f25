from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.tracking.refinement import kernels, shading
from evaluator.tracking.refinement.disc import PER_PX, make_disc
from evaluator.tracking.refinement.shading import LightNotes, learn_shading

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
