"""A disc beside an edge in closed form: its luma, its slopes by all that is unknown, and a fit that finds them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.special import ndtr

from evaluator.tracking.refinement import edge as module
from evaluator.tracking.refinement import kernels
from evaluator.tracking.refinement.disc import make_disc
from evaluator.tracking.refinement.edge import View, _anywhere, _beyond, _left, _Model, find_edge, without_edge
from evaluator.tracking.refinement.learn_shape import Patch

NOISE = (4.0, 5.0)
STATE = np.array([30.4, 29.7, 110.0, 25.0, 0.7, 9.5, 10.5, 80.0])
DISC = make_disc(6.0, 1.6, (0.06, -0.03), (110.0, 25.0), NOISE[0])
ROUND = make_disc(6.0, 1.6, (0.0, 0.0), (110.0, 25.0), NOISE[0])


def patch(half: int = 16) -> Patch:
    y, x = np.mgrid[30 - half : 31 + half, 30 - half : 31 + half].astype(float)
    return Patch(x.ravel(), y.ravel(), np.zeros(x.size), (30.0, 30.0))


def model(path: tuple[float, float] = (0.0, 0.0), disc: Any = DISC) -> _Model:
    return _Model(View(patch(), disc, path, NOISE))


def test_luma_is_that_of_the_disc_and_of_what_lies_beyond_either_edge() -> None:
    """Half of the height on an edge, three quarters where both meet; nothing within."""
    luma, _ = model()(STATE)
    far, _ = model()(np.array([*STATE[:7], 0.0]))
    x, y = patch().x - STATE[0], patch().y - STATE[1]
    along, aside = np.cos(0.7) * x + np.sin(0.7) * y, np.cos(0.7) * y - np.sin(0.7) * x
    outside = 1 - (1 - ndtr((along - 9.5) / 1.6)) * (1 - ndtr((aside - 10.5) / 1.6))
    np.testing.assert_allclose(luma - far, 80.0 * outside, atol=1e-3)
    middle = np.hypot(x, y).argmin()
    assert far[middle] == pytest.approx(135.0, abs=0.5)
    assert far[np.hypot(x, y).argmax()] == pytest.approx(25.0)


@pytest.mark.parametrize("path", [(0.0, 0.0), (5.0, -3.0)])
def test_slopes_are_those_of_the_luma_by_each_unknown(path: tuple[float, float]) -> None:
    of, steps = model(path), np.array([0.02, 0.02, 1.0, 1.0, 2e-3, 0.02, 0.02, 1.0])
    _, slopes = of(STATE)
    for k, step in enumerate(steps):
        change = step * np.eye(8)[k]
        difference = (of(STATE + change)[0] - of(STATE - change)[0]) / (2 * step)
        np.testing.assert_allclose(slopes[:, k], difference, atol=0.03 * np.abs(difference).max())


def test_a_smeared_edge_is_blurred_by_the_smear_along_its_normal_too() -> None:
    """A path of 6 px along the first edge's normal: a variance of 3 px² more there, none aside."""
    of = model((6.0 * np.cos(0.7), 6.0 * np.sin(0.7)), ROUND)
    luma = of(STATE)[0] - of(np.array([*STATE[:7], 0.0]))[0]
    x, y = patch().x - STATE[0], patch().y - STATE[1]
    along, aside = np.cos(0.7) * x + np.sin(0.7) * y, np.cos(0.7) * y - np.sin(0.7) * x
    blur = np.sqrt(1.6**2 + 3.0)
    outside = 1 - (1 - ndtr((along - 9.5) / blur)) * (1 - ndtr((aside - 10.5) / 1.6))
    np.testing.assert_allclose(luma, 80.0 * outside, atol=0.05 * 80)


def fitted(x: float, y: float, slope: tuple[float, float] = (0.0, 0.0), residual: float = 1.0) -> np.ndarray:
    numbers = np.zeros(kernels.RESULTS)
    numbers[[kernels.X, kernels.Y, kernels.AMPLITUDE, kernels.BASE]] = x, y, 110.0, 25.0
    numbers[[kernels.SLOPE_X, kernels.SLOPE_Y]] = slope
    numbers[[kernels.RESIDUAL, kernels.USED, kernels.PIXELS]] = residual, 0.9, 400.0
    return numbers


@pytest.mark.parametrize("corner", [False, True])
@pytest.mark.parametrize("angle", [0.7, 3.9])
def test_an_edge_or_a_corner_beside_a_mark_is_found_where_it_is(angle: float, corner: bool) -> None:
    rng = np.random.default_rng(3)
    state = STATE.copy()
    state[4], state[6] = angle, 10.5 if corner else 60.0
    value = model(disc=ROUND)(state)[0] + rng.normal(0.0, 2.0, len(patch().x))
    seen = Patch(patch().x, patch().y, value, (30.0, 30.0))
    light = 8.0 * np.array([np.cos(angle), np.sin(angle)])
    plain, sloped = fitted(30.4 + 0.05 * light[0], 29.7 + 0.05 * light[1]), fitted(30.5, 29.8, (light[0], light[1]))
    found = find_edge(View(seen, ROUND, (0.0, 0.0), NOISE), plain, sloped)
    assert found is not None
    numbers, edge = found
    assert numbers[:2] == pytest.approx(state[:2], abs=4 * np.sqrt(numbers[kernels.VAR_X]))
    assert numbers[[kernels.AMPLITUDE, kernels.BASE]] == pytest.approx(state[2:4], abs=1.5)
    assert 0.01 < np.sqrt(numbers[kernels.VAR_X]) < 0.05
    assert numbers[kernels.RESIDUAL] == pytest.approx(1.0, abs=0.2)
    assert edge.height == pytest.approx(80.0, abs=6.0)
    if not corner:
        assert (edge.angle % (2 * np.pi), edge.distance_px) == pytest.approx((angle, 9.5), abs=0.1)
        assert edge.aside_px > 14.0
    even = without_edge(seen, ROUND, numbers, edge)
    alone = model(disc=ROUND)(np.array([*state[:7], 0.0]))[0]
    near = np.hypot(seen.x - 30.4, seen.y - 29.7) < ROUND.outer_px + 1.6  # what was fitted
    assert np.std((even.value - alone)[near]) == pytest.approx(2.0, abs=0.3)
    assert find_edge(View(seen, ROUND, (0.0, 0.0), NOISE), plain, sloped, edge) is not None


def test_before_an_even_or_sloping_background_there_is_no_edge() -> None:
    rng = np.random.default_rng(4)
    alone = model(disc=ROUND)(np.array([*STATE[:7], 0.0]))[0]
    for slope in (0.0, 1.5):
        value = alone + slope * (patch().x - 30.4) + rng.normal(0.0, 2.0, len(patch().x))
        seen = View(Patch(patch().x, patch().y, value, (30.0, 30.0)), ROUND, (0.0, 0.0), NOISE)
        assert find_edge(seen, fitted(30.4, 29.7), fitted(30.4, 29.7, (slope, 0.0))) is None
    few = Patch(patch().x[:31], patch().y[:31], alone[:31], (30.0, 30.0))
    assert find_edge(View(few, ROUND, (0.0, 0.0), NOISE), fitted(30.4, 29.7), fitted(30.4, 29.7)) is None


@pytest.mark.parametrize(("fall", "counts"), [(21.0, True), (19.0, False)])
def test_an_edge_counts_that_leaves_twenty_variances_less_than_a_slope(
    fall: float, counts: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    edge = module.Edge(0.7, 9.5, 60.0, 80.0)
    monkeypatch.setattr(_Model, "fit", lambda *_: (fitted(30.0, 30.0), edge))
    monkeypatch.setattr(_Model, "cost_of_slope", lambda *_: 0.9 * 400 - 8 + fall)  # squares of 352 are left of it
    assert _left(fitted(30.0, 30.0)) == pytest.approx(352.0)
    seen = View(patch(), ROUND, (0.0, 0.0), NOISE)
    assert (find_edge(seen, fitted(30.0, 30.0), fitted(30.0, 30.0, (1.0, 0.0))) is not None) == counts


def test_edges_and_corners_are_looked_for_on_either_side_of_the_slope() -> None:
    """Half a blur to two and a half from the rim, on the light side and on the dark one."""
    starts = _anywhere(ROUND, fitted(30.0, 30.0, (0.0, 2.0)))
    edges, corners = starts[::2], starts[1::2]
    assert [round(start[0], 6) for start in edges] == [round(np.pi / 2, 6)] * 3 + [round(3 * np.pi / 2, 6)] * 3
    assert [start[1] for start in edges[:3]] == pytest.approx([6.8, 8.4, 10.0])
    assert {start[2] for start in edges} == {ROUND.outer_px + 6 * 1.6}
    assert [start[0] for start in corners] == pytest.approx([start[0] - np.pi / 4 for start in edges])
    assert all(start[1] == start[2] for start in corners)


def test_what_lies_beyond_turns_about_the_mark() -> None:
    x, y = patch().x - STATE[0], patch().y - STATE[1]
    _, slopes = _beyond(x, y, (1.6, 1.6), STATE)
    for k, slope in zip((4, 5, 6), slopes, strict=True):
        change = 1e-5 * np.eye(8)[k]
        both = [_beyond(x, y, (1.6, 1.6), STATE + sign * change)[0] for sign in (1, -1)]
        np.testing.assert_allclose(slope, (both[0] - both[1]) / 2e-5, atol=1e-6)
