"""A shape in its patches: where it is fitted, and from how many patches an edge beside it is believed."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.tracking.detection import appearance
from evaluator.tracking.refinement import kernels
from evaluator.tracking.refinement.learn_shape import Patch, _levels, finished
from tests.evaluator.tracking.test_fit_kernels import DISC, STATE, drawn


@pytest.mark.parametrize("step", [1, 2])
def test_a_disc_is_fitted_in_a_patch_at_its_place_in_the_frame_and_its_column_in_the_patch(step: int) -> None:
    luma = np.rint(drawn(np.array([*STATE[:4], 0.0, 0.0]), 0.0, float(step), (41 // step, 40)))
    rows, columns = np.indices(luma.shape)
    place = 100.0 + columns.ravel(), 50.0 + step * rows.ravel()
    patch = Patch(*place, luma.ravel(), (100.0 + STATE[0] + 0.8, 50.0 + STATE[1] - 0.8))
    seen, where, fitted = appearance._fitted(patch, DISC, sloping=False)
    assert (where, seen.dtype) == ((50, step), np.uint8)
    np.testing.assert_array_equal(seen, luma)
    assert fitted[[kernels.X, kernels.Y]] == pytest.approx([STATE[0], 50.0 + STATE[1]], abs=0.01)


def test_a_patch_reaches_over_half_a_radius_and_five_pixels_beyond_the_rim() -> None:
    """Of a radius of 10 px: 21 px in each direction, which is enough for the light around it and for its blur."""
    frame: Any = SimpleNamespace(luma=np.zeros((200, 200), np.uint8), row_origin=0, row_step=1)
    seen = appearance.patch_of(frame, (100.0, 90.0), 10.0)
    assert (seen.x.min(), seen.x.max(), seen.y.min(), seen.y.max()) == (79.0, 121.0, 69.0, 111.0)


def test_a_lesson_begins_with_the_luma_within_the_mark_and_around_it() -> None:
    """Within six tenths of the radius and beyond twelve; what lies between is left out, though it is most."""
    y, x = np.mgrid[:41, :41].astype(float)
    away = np.hypot(x - 20.5, y - 18.5)
    luma = np.where(away < 0.6 * 8, 90.0, np.where(away > 1.2 * 8, 30.0, 200.0))
    seen = Patch(x.ravel(), y.ravel(), luma.ravel(), (20.5, 18.5))
    assert _levels(seen, 8.0) == (60.0, 30.0)
    assert _levels(seen, 1.0) == (200.0 - 30.0, 30.0)  # no sample is within: the lightest of all
    assert _levels(seen, 40.0) == (30.0 - 30.0, 30.0)  # none is around


@pytest.mark.parametrize("step", [1, 2])
@pytest.mark.parametrize("wire", [False, True])
def test_samples_under_a_wire_are_left_out_of_a_patch_that_is_else_whole(step: int, *, wire: bool) -> None:
    """A wire of 2 px as dark as the plate, down across the mark, a third of its radius to the right of its centre."""
    luma = drawn(np.array([*STATE[:4], 0.0, 0.0]), 0.0, float(step), (41 // step, 40))
    hidden = slice(column := round(STATE[0] + DISC.radius_px / 3), column + 2)
    luma[:, hidden] = DISC.base if wire else luma[:, hidden]
    rows, columns = np.indices(luma.shape)
    place = 100.0 + columns.ravel(), 50.0 + step * rows.ravel()
    patch = Patch(*place, np.rint(luma).ravel(), (100.0 + STATE[0], 50.0 + STATE[1]))
    shown, share = appearance._uncovered(patch, DISC)
    inside = np.hypot(columns - STATE[0], step * rows - STATE[1]) < DISC.radius_px - 2
    across = np.zeros(luma.shape, bool)
    across[:, hidden] = wire
    assert not shown.reshape(luma.shape)[inside & across].any()
    far = np.abs(columns - column) > 6 * wire  # but for what the blur mixes with the wire
    assert shown.reshape(luma.shape)[far].all()
    assert (0.1 < share < 0.5) if wire else share == 0.0


@pytest.mark.parametrize(
    ("patches", "edges", "learnt"),
    [(6, 3, True), (7, 3, False), (7, 4, True), (3, 2, False), (3, 3, True)],
)
def test_an_edge_is_believed_that_half_of_the_patches_show_and_three_at_least(
    patches: int, edges: int, learnt: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    first: Any = SimpleNamespace(noise=4.0, amplitude=100.0, edge=None, radius_px=8.0, blur_px=1.0)
    given = [Patch(np.full(9, 5.0), np.zeros(9), np.full(9, float(k)), (0.0, 0.0)) for k in range(patches)]
    residuals = iter([1.0, 0.5, 0.7, 0.1])  # of a lesson: the second explains more, the third less

    def find_edge(view: Any, plain: np.ndarray, sloped: np.ndarray, _last: Any) -> Any:
        assert (plain[kernels.X], sloped[kernels.X]) == (25.0, 25.0)  # in the frame
        assert view.path_px == (0.0, 0.0)
        assert view.noise == (100.0, 5.0)  # a tenth of the amplitude, squared
        if view.patch.value[0] == 0:
            fitted[kernels.RESIDUAL] = next(residuals)
        return (fitted.copy(), "edge") if view.patch.value[0] < edges else None

    fitted = np.zeros(kernels.RESULTS)
    lessons: list[int] = []

    def learn(cleared: list[Patch], _radius: float, _blur: float, *, shaded: bool) -> Iterator[None]:
        assert shaded
        lessons.append(len(cleared))
        yield
        return SimpleNamespace(**vars(first))  # type: ignore[return-value]

    start = np.zeros(kernels.RESULTS)
    start[kernels.X] = 20.0
    monkeypatch.setattr(appearance, "_fitted", lambda *_, **__: (None, None, start.copy()))
    monkeypatch.setattr(appearance, "matters", lambda *_: True)
    monkeypatch.setattr(appearance, "find_edge", find_edge)
    monkeypatch.setattr(appearance, "without_edge", lambda patch, *_: patch)
    monkeypatch.setattr(appearance, "learn_disc", learn)
    monkeypatch.setattr(appearance, "replace", lambda disc, **new: SimpleNamespace(**{**vars(disc), **new}))
    disc = finished(appearance._learn_beside_edge(given, first, shaded=True))
    assert disc.edge == ("edge" if learnt else None)
    assert lessons == ([edges] * 2 if learnt else [])


def test_a_patch_that_no_disc_fits_counts_as_a_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """What covers a mark is told beside its disc: without one there is nothing to tell it from."""
    luma, nowhere = np.zeros((4, 5), np.uint8), np.full(kernels.RESULTS, np.nan)
    monkeypatch.setattr(appearance, "_fitted", lambda *_, **__: (luma, (0, 1), nowhere))
    shown, share = appearance._uncovered(Patch(*np.zeros((3, 20)), (2.0, 2.0)), DISC)
    assert (shown.tolist(), share) == ([True] * 20, 0.0)
