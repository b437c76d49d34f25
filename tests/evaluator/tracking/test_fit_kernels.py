"""The fit of a disc part by part, as plain Python: normal equations, windows, weights, slopes, what covers a mark."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.tracking.refinement import kernels, occluded_pixels, occlusion, slow_path
from evaluator.tracking.refinement.disc import PER_PX, make_disc
from evaluator.tracking.refinement.motion_blur import path_of
from evaluator.tracking.refinement.occluded_pixels import ALONG_X, ALONG_Y, LEFT, PROFILE
from evaluator.tracking.refinement.slow_path import SlowPath

DISC = make_disc(6.0, 0.9, (0.06, -0.04), (100.0, 30.0), 4.0)
STATE = np.array([20.3, 19.6, 100.0, 30.0, 0.4, -0.3])  # x, y, amplitude, base, slopes
WINDOW, SHAPE = (6, 34, 6, 35), (41, 40)


def drawn(state: np.ndarray, row_origin: float = 0.0, row_step: float = 1.0, shape: tuple[int, int] = SHAPE) -> Any:
    """Luma of the disc at a state on a sloping ground."""
    j, i = np.indices(shape)
    dx, dy = i - state[0], row_origin + row_step * j - state[1]
    r = np.sqrt((1 + DISC.e1) * dx * dx + 2 * DISC.e2 * dx * dy + (1 - DISC.e1) * dy * dy)
    profile = np.interp(r, np.arange(len(DISC.profile)) / PER_PX, DISC.profile)
    return state[3] + state[2] * profile + state[4] * dx + state[5] * dy


def summed(luma: np.ndarray, state: np.ndarray, *, sloping: bool, softness: float = 1e3, window: Any = WINDOW) -> Any:
    """Normal equations and right hand side (symmetric), squares, weight and count, of noise of 4."""
    normal, right = np.zeros((6, 6)), np.zeros(6)
    sums = kernels.accumulate.py_func(
        luma, 0.0, 1.0, state, state if sloping else None, window, DISC.numbers(), DISC.table, None,
        np.array([4.0, softness]), normal, right,
    )  # fmt: skip
    size = 6 if sloping else 4
    return (normal + np.triu(normal, 1).T)[:size, :size], right[:size], *sums


@pytest.mark.parametrize("sloping", [False, True])
def test_a_step_by_the_normal_equations_takes_back_a_small_change_of_each_unknown(sloping: bool) -> None:
    true = STATE if sloping else np.array([*STATE[:4], 0.0, 0.0])
    for place, step in enumerate([0.02, -0.02, 0.5, -0.5, 0.02, -0.02][: 6 if sloping else 4]):
        change = step * np.eye(6)[place]
        normal, right, *_ = summed(drawn(true), true + change, sloping=sloping)
        move = np.linalg.solve(normal, right)
        scale = np.array([0.02, 0.02, 0.5, 0.5, 0.02, 0.02])[: len(move)]
        np.testing.assert_allclose(move / scale, -change[: len(move)] / scale, atol=0.15)


def test_normal_equations_of_a_mark_that_is_cut_are_the_change_of_their_right_side_by_each_unknown() -> None:
    """Cut by half: no product of two slopes cancels over the pixels."""
    luma, cut = drawn(STATE), (6, 22, 6, 22)
    normal = summed(luma, STATE, sloping=True, window=cut)[0]
    size = np.sqrt(np.diag(normal))
    assert np.abs(normal / np.outer(size, size)).min() > 0.02
    for place, step in enumerate([0.05, 0.05, 0.5, 0.5, 0.02, 0.02]):
        change = step * np.eye(6)[place]
        right = [summed(luma, STATE + sign * change, sloping=True, window=cut)[1] for sign in (1, -1)]
        np.testing.assert_allclose(
            (right[0] - right[1]) / (-2 * step) / size, normal[place] / size, atol=0.035 * size[place]
        )


def test_normal_equations_are_of_the_noise_and_weights_halve_at_the_softness() -> None:
    luma = drawn(STATE)
    normal, _, squares, weight, count = summed(luma + 3.0, STATE, sloping=True)
    assert squares == pytest.approx(9.0 / 4.0 * count, rel=2e-3)
    assert weight == pytest.approx(count)
    assert normal[3, 3] == pytest.approx(count / 4.0)  # of the base
    # On the flat inside and outside every fourth pixel counts.
    dx, dy = np.meshgrid(np.arange(40) - STATE[0], np.arange(41) - STATE[1])
    square = 1.06 * dx * dx - 0.08 * dx * dy + 0.94 * dy * dy
    flat = (square < (6 - 3.15) ** 2) | (square > (6 + 3.15) ** 2)
    fourth = np.zeros(SHAPE, bool)
    fourth[::2, ::2] = True
    assert count == np.count_nonzero((square <= DISC.outer_px**2) & (~flat | fourth))
    luma[20, 26] += 10.0  # five sigmas, on the rim
    *_, weight, count = summed(luma, STATE, sloping=True, softness=5.0)
    assert weight == pytest.approx(count - 0.5, abs=0.01)


@pytest.mark.parametrize("size", [4, 6])
def test_cholesky_solves_and_inverts_and_refuses_what_is_singular(size: int) -> None:
    root = np.random.default_rng(size).normal(size=(size, size))
    matrix, right = root @ root.T + np.eye(size), np.arange(1.0, size + 1)
    work, move, result, column = np.triu(matrix), np.zeros(size), np.zeros(kernels.RESULTS), np.zeros(size)
    assert kernels.solve.py_func(work, right, move, size)
    assert move == pytest.approx(np.linalg.solve(matrix, right))
    kernels.invert_leading.py_func(work, size, column, result)
    inverse = np.linalg.inv(matrix)
    assert result[[kernels.VAR_X, kernels.VAR_Y, kernels.COV_XY]] == pytest.approx(
        [*np.diag(inverse)[:2], inverse[0, 1]]
    )
    matrix[-1] = matrix[:, -1] = 0.0
    assert not kernels.solve.py_func(np.triu(matrix), right, move, size)


@pytest.mark.parametrize(
    ("columns", "origin", "step", "window"),
    [(60, 0.0, 1.0, (10, 21, 15, 31)), (30, 0.0, 1.0, (10, 21, 15, 26)), (60, 1.0, 2.0, (5, 10, 15, 31)),
     (18, 0.0, 1.0, (10, 21, 15, 18))],
)  # fmt: skip
def test_window_holds_the_pixels_within_reach_in_whole_lanes(
    columns: int, origin: float, step: float, window: tuple[int, ...]
) -> None:
    around = kernels.window_around.py_func
    assert around(np.zeros((40, columns)), origin, step, np.array([20.0, 15.0]), 5.5) == window
    assert around(np.zeros((18, 60)), 0.0, 1.0, np.array([3.0, 15.0]), 5.5) == (10, 18, 0, 16)


def test_slope_inside_a_mark_is_that_of_the_plane_there_from_twelve_pixels_on() -> None:
    y, x = np.mgrid[:20, :30]
    luma = 50.0 + 0.7 * x - 1.2 * (1 + 2 * y)
    luma[np.hypot(x - 14.5, 1 + 2 * y - 20.0) > 5.0] = 999.0
    slope, inside = np.zeros(2), kernels._interior_slope.py_func
    inside(luma, 1.0, 2.0, 14.5, 20.0, 5.0, slope, np.zeros((5, 3)))
    assert slope == pytest.approx([0.7, -1.2])
    inside(luma, 1.0, 2.0, 14.5, 20.0, 1.9, slope, np.zeros((5, 3)))
    assert np.isnan(slope).all()  # six pixels


def planes_at(state: np.ndarray, luma: np.ndarray, smear: tuple[float, float] = (0.0, 0.0)) -> Any:
    planes, used = np.zeros((6, *SHAPE)), np.zeros(SHAPE, bool)
    numbers = DISC.numbers(smear)
    occluded_pixels.model.py_func(luma, 0.0, 1.0, 0, state, numbers, DISC.table, path_of(numbers), planes, used)
    return planes, used


def test_nothing_is_left_of_a_mark_at_its_state_and_its_slopes_are_those_of_its_luma() -> None:
    planes, used = planes_at(STATE, drawn(STATE))
    assert np.abs(planes[LEFT][used]).max() < 1.0  # steps of the table, of 100 levels
    for plane, place in ((ALONG_X, 0), (ALONG_Y, 1)):
        change = 0.05 * np.eye(6)[place]
        flat = [np.array([*(STATE + way * change)[:4], 0.0, 0.0]) for way in (1, -1)]
        slope = (drawn(flat[0]) - drawn(flat[1])) / 0.1
        assert np.abs(planes[plane] - slope)[used].max() < 0.05 * np.abs(slope).max()
    smeared, used = planes_at(STATE, drawn(STATE), (4.0, 0.0))
    assert smeared[PROFILE][used].sum() == pytest.approx(planes[PROFILE][used].sum(), rel=0.01)
    assert np.abs(smeared[ALONG_X]).max() < 0.7 * np.abs(planes[ALONG_X]).max()


def parts(pulls: np.ndarray, product: np.ndarray | None = None) -> occlusion.Parts:
    count = len(pulls)
    products, padded = np.zeros((occlusion.PARTS, 6, 6)), np.zeros((occlusion.PARTS, 6))
    products[:count], padded[:count] = np.eye(6) if product is None else product, pulls
    return occlusion.Parts(products, padded, np.zeros((6, 6)), np.zeros(6))


def test_jackknife_is_the_sum_of_the_squared_steps_without_each_part() -> None:
    pulls = np.random.default_rng(0).normal(size=(5, 6))
    told = parts(pulls)
    assert told.step(6)
    assert told.move == pytest.approx(pulls.sum(axis=0) / 5)
    without = (pulls.sum(axis=0) - pulls) / 4
    assert told.jackknife(6) == pytest.approx(np.sum(without[:, :2] ** 2))
    alone = np.zeros((6, 6))
    alone[0, 0] = 1.0
    assert parts(pulls[:2], alone).jackknife(4) == np.inf


@pytest.mark.parametrize(("fall", "slopes"), [(11.9, False), (12.1, True)])
def test_light_slopes_where_two_more_unknowns_bring_the_squares_down_by_twelve(fall: float, slopes: bool) -> None:
    pulls = np.zeros((1, 6))
    pulls[0] = [5.0, 1.0, 2.0, 3.0, 0.6 * np.sqrt(fall), -0.8 * np.sqrt(fall)]
    assert parts(pulls).sloping() == slopes


def test_pulls_of_all_parts_of_a_rim_are_those_of_the_whole_and_leave_out_what_is_covered() -> None:
    planes, used = planes_at(STATE + np.array([0.1, -0.05, 0, 0, 0, 0]), drawn(STATE))
    covered, at = np.zeros(SHAPE, bool), STATE[:2]
    covered[:, :21] = True
    found = []
    for split in (False, True):
        products, pulls = np.ones((occlusion.PARTS, 6, 6)), np.ones((occlusion.PARTS, 6))
        sums = occlusion._pull.py_func(
            planes, used, covered, at, np.array([4.0, 5.0]), 0.0, 1.0, 0, split, products, pulls, np.ones(6)
        )
        found.append((products.sum(axis=0), pulls.sum(axis=0), *sums))
        filled = np.flatnonzero(products[:, 0, 0])
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other)
    assert filled.tolist() == [0, 1, 2, 9, 10, 11]  # 90 degrees to either side of x
    products, pulls, weight, squares, count = found[0]
    assert count < np.count_nonzero(used & ~covered)
    assert weight == pytest.approx(count, rel=0.02)
    move = np.linalg.solve((products + np.triu(products, 1).T), pulls)
    assert move[:2] == pytest.approx([-0.1, 0.05], abs=0.02)
    assert squares == pytest.approx(np.sum(planes[LEFT][used & ~covered] ** 2) / 4.0, rel=0.05)


@pytest.mark.parametrize(("weight", "left"), [(11.9, False), (12.1, True)])
def test_nothing_is_told_where_fewer_than_twelve_pixels_are_left_to_fit(
    weight: float, left: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    luma, fitted, result = drawn(STATE), np.zeros(kernels.RESULTS), np.zeros(kernels.RESULTS)
    luma[:, 17:19] = 30.0  # a dark wire
    fitted[: kernels.BASE + 1], fitted[kernels.SLOPE_X :] = STATE[:4], STATE[4:]
    pull = occlusion._pull
    monkeypatch.setattr(occlusion, "_pull", lambda *said: (weight, *pull(*said)[1:]))
    seeming, share = occlusion.fit_uncovered(
        np.rint(luma).astype(np.uint8), 0.0, 1.0, fitted, DISC.numbers(), DISC.table, np.array([4.0, 5.0]), result,
        None, occluded_pixels.CORE, 0.03,
    )  # fmt: skip
    assert seeming > 0.03
    assert (share < 1.0) == left
    assert result.any() == left


def path(**said: float) -> SlowPath:
    """A slow path whose plain and sloped fits are as said."""
    result, sloped = np.zeros(kernels.RESULTS), np.zeros(kernels.RESULTS)
    result[[kernels.AMPLITUDE, kernels.PIXELS, kernels.RESIDUAL]] = 100.0, 200.0, said.get("residual", 1.2)
    sloped[[kernels.AMPLITUDE, kernels.RESIDUAL]] = 100.0, said.get("sloped", 1.2)
    sloped[[kernels.X, kernels.Y]] = 0.3, -0.1
    sloped[[kernels.SLOPE_X, kernels.SLOPE_Y]] = said.get("slope", 0.0) * np.array([0.6, 0.8])
    one = SlowPath(DISC.numbers(), DISC.table, np.array([4.0, 5.0]), result, said.get("inner", 4.0), DISC)
    one.sloped[:] = sloped
    return one


@pytest.mark.parametrize(
    ("residual", "sloped", "suspicious", "taken", "share"),
    [
        (1.2, 1.145, True, False, 0.0),  # of 200 pixels the squares fall by 11
        (1.2, 1.135, True, True, 0.2),  # by 13: light slopes, and a fifth of the shift may be left
        (1.2, 1.135, False, False, 1.0),  # not taken out: all of it
        (1.49, 1.48, True, False, 0.0),
        (1.51, 1.50, True, True, 0.0),  # disturbed, whatever it is
        (1.51, 1.50, False, False, 0.0),
    ],
)
def test_a_slope_is_kept_where_it_is_there_and_something_is_wrong(
    residual: float, sloped: float, suspicious: bool, taken: bool, share: float
) -> None:
    one = path(residual=residual, sloped=sloped)
    one.watch = 5
    frame: Any = SimpleNamespace(index=1)
    assert one._keep_slope(frame, suspicious=suspicious) == taken
    assert one.shift == pytest.approx((0.3 * share, -0.1 * share))
    assert one.watch == (8 if share else 4)
    assert (one.result[kernels.X] == 0.3) == taken


@pytest.mark.parametrize(
    ("slope", "inner", "off", "glares"),
    [
        (0.9, 4.0, 0.0, True),
        (0.9, 1.9, 0.0, False),  # too small an inside
        (0.14, 9.0, 0.0, False),  # less than 1.5e-3 of 100 levels a pixel
        (0.16, 9.0, 0.0, True),
        (0.40, 4.0, 0.0, False),  # within three sigmas of 2·2/√π/16 = 0.141
        (0.45, 4.0, 0.0, True),
        (0.9, 4.0, 0.86, True),  # inside it may differ by half of it and three sigmas
        (0.9, 4.0, 0.89, False),
    ],
)
def test_a_slope_is_a_reflection_where_the_inside_of_the_mark_has_it_too(
    slope: float, inner: float, off: float, glares: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = path(slope=slope, inner=inner)
    inside = slope * np.array([0.6, 0.8]) + off * np.array([-0.8, 0.6])
    monkeypatch.setattr(slow_path.kernels, "interior_slope", lambda *said: said[-1].__setitem__(slice(None), inside))
    frame: Any = SimpleNamespace(luma=None, row_origin=0, row_step=1)
    assert one._glares(frame) == glares


@pytest.mark.parametrize(
    ("share", "variance", "residual", "sound"),
    [(0.64, 0.05, 1.4, True), (0.66, 0.05, 1.4, False), (0.0, 0.05, 1.4, False), (0.3, 0.0505, 1.4, True),
     (0.3, 0.0508, 1.4, False), (0.3, 0.05, 1.6, False)],
)  # fmt: skip
def test_what_shows_of_a_mark_tells_where_it_is_while_a_third_is_left_and_its_parts_agree(
    share: float, variance: float, residual: float, sound: bool
) -> None:
    """To a quarter of a blur of 0.9 px: a variance of 0.0506 along either axis."""
    one = path()
    one.unoccluded[[kernels.VAR_X, kernels.VAR_Y]] = variance + 0.01, variance - 0.01
    one.unoccluded[kernels.RESIDUAL] = residual
    assert one._sound(share) == sound


def test_the_slow_path_is_taken_in_every_fourth_frame_and_while_it_is_watched() -> None:
    one, frames = path(), [SimpleNamespace(index=index) for index in range(8)]
    assert [one.begin(frame) for frame in frames] == [index in (0, 4) for index in range(8)]  # type: ignore[arg-type]
    one.watch = 1
    assert one.begin(frames[1])  # type: ignore[arg-type]


@pytest.mark.parametrize(("explained", "occluded"), [(0.0269, False), (0.0271, True)])
def test_what_covers_a_mark_is_believed_unless_a_slope_explains_a_tenth_of_it(
    explained: float, occluded: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = path(residual=1.3, sloped=1.3)

    monkeypatch.setattr(one, "_fit", lambda *_, **__: None)
    monkeypatch.setattr(one, "_fit_unoccluded", lambda *said: (0.03, 0.2) if said[2] < 1 else (explained, 0.0))
    one.unoccluded[kernels.X] = 7.0
    frame: Any = SimpleNamespace(index=1)
    assert one.refit(frame, suspicious=True) == occluded
    assert one.occluded == occluded
    assert (one.watch, one.occluded_lately) == ((8, 8) if occluded else (-1, -1))
    assert one.result[kernels.X] == (7.0 if occluded else 0.0)
