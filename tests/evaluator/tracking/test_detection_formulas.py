"""Which blobs are marks, in closed form: planes and candidates that are made by hand, no recording."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from math import exp, log
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.recording import Frame
from evaluator.tracking.detection import color_map as color_map_module
from evaluator.tracking.detection.color_kernels import (
    AREA,
    CENTER_X,
    CENTER_Y,
    CLIPPED,
    STRENGTH,
    color_scan,
    color_window,
    is_color,
)
from evaluator.tracking.detection.explain import _hue_around, _is_part
from evaluator.tracking.detection.find import _fits, _widened, blobs_of, is_known
from evaluator.tracking.detection.selection import (
    Candidate,
    _log_odds,
    _own_score,
    _pair_scores,
    _same_place,
    alike,
    choose,
)
from evaluator.tracking.settings import MarkSettings, TrackingSettings

UNSAID = MarkSettings()
SAID = MarkSettings(diameter_px=10.0)
GREEN = Candidate("green", (50.0, 40.0), 5.0, 1.0, 80.0, (90.0, 90.0))
YELLOW = replace(GREEN, mark="yellow", center_px=(80.0, 40.0))


def of_own(**values: Any) -> float:
    """Score of a blob over that of a round, whole one of the strongest colour and the size that was said."""
    return _own_score(replace(GREEN, **values), SAID, 80.0) - _own_score(GREEN, SAID, 80.0)


def test_a_blob_loses_by_size_colour_shape_and_the_border_what_its_spreads_say() -> None:
    assert of_own(radius_px=5.0 * exp(0.15)) == pytest.approx(-0.5)  # one spread
    assert of_own(radius_px=5.0 * exp(-0.3)) == pytest.approx(-2.0)
    assert of_own(chroma=40.0) == pytest.approx(2 * log(0.5))
    assert of_own(whole=False) == pytest.approx(-4.0)
    round_one = log(1 + exp(-2.0))  # a disc, or a sticker of any shape
    assert of_own(elongation=exp(0.3)) == pytest.approx(log(exp(-0.5) + exp(-2.0)) - round_one)
    assert of_own(elongation=exp(0.45)) == pytest.approx(log(exp(-1.125) + exp(-2.0)) - round_one)
    assert of_own(elongation=exp(3.0)) == pytest.approx(-2.0 - round_one)


@pytest.mark.parametrize(("radius", "lost"), [(9.0, 0.0), (3.1, 0.0), (3.0, 0.0), (2.0, 0.5), (1.0, 2.0)])
def test_where_no_size_is_said_only_blobs_below_three_pixels_lose(radius: float, lost: float) -> None:
    whole = _own_score(replace(GREEN, radius_px=20.0), UNSAID, 80.0)
    assert _own_score(replace(GREEN, radius_px=radius), UNSAID, 80.0) == pytest.approx(whole - lost)


SAID_PAIR = TrackingSettings(distance_diameters=3.0)
OTHER_MARKS = TrackingSettings.model_validate({"mark": {"red": {}, "blue": {}}, "body": ["red", "blue"]})


def of_pair(settings: TrackingSettings, other: Candidate, names: tuple[str, str] = ("green", "yellow")) -> float:
    """Score of GREEN and another blob as the marks of these names, over their scores alone."""
    first, second = replace(GREEN, mark=names[0]), replace(other, mark=names[1])
    alone = [_own_score(one, settings.mark[one.mark], 80.0) for one in (first, second)]
    return float(_pair_scores([first], [second], settings, 80.0)[0, 0]) - sum(alone)


def test_a_pair_loses_by_unequal_sizes_and_by_a_distance_that_is_not_that_of_the_robot() -> None:
    assert of_pair(SAID_PAIR, YELLOW) == pytest.approx(0.0)
    assert of_pair(SAID_PAIR, replace(YELLOW, center_px=(68.0, 16.0))) == pytest.approx(0.0)  # in any direction
    far = replace(YELLOW, center_px=(50.0 + 30 * exp(1.0), 40.0))
    assert of_pair(SAID_PAIR, far) == pytest.approx(_log_odds(1.0))
    for off, lost in ((0.15, 0.5), (0.3, 2.0)):  # of their sizes, by one spread and by two
        smaller = replace(YELLOW, radius_px=5.0 * exp(-off), center_px=(50.0 + 15 * (1 + exp(-off)), 40.0))
        assert of_pair(SAID_PAIR, smaller) == pytest.approx(-lost)


def test_marks_of_a_robot_that_nobody_described_are_some_three_diameters_apart() -> None:
    names = ("red", "blue")
    assert of_pair(OTHER_MARKS, YELLOW, names) == pytest.approx(0.0)
    far = replace(YELLOW, center_px=(50.0 + 30 * exp(1.0), 40.0))
    assert of_pair(OTHER_MARKS, far, names) == pytest.approx(-0.5 - 2.0)  # and marks of others in a larger area
    halves = replace(YELLOW, center_px=(56.0, 40.0))  # of one square, 0.6 diameters apart
    assert of_pair(OTHER_MARKS, halves, names) == pytest.approx(-0.5 * log(0.6 / 3) ** 2 + 2 * log(3.0))
    nested = replace(YELLOW, center_px=(54.0, 40.0))
    assert of_pair(OTHER_MARKS, nested, names) == pytest.approx(-0.5 * log(0.4 / 3) ** 2 + 2 * log(3.0) - 20.0)


def test_of_many_robots_the_nearest_mark_belongs_to_one_robot() -> None:
    red, blue = (replace(GREEN, mark=name) for name in ("red", "blue"))
    others = [replace(blue, center_px=(50.0 + apart, 40.0), chroma=85.0) for apart in (45.0, 110.0)]
    near = replace(blue, center_px=(56.0, 40.0))
    assert choose([red, near, *others], OTHER_MARKS)[0] == {"red": red, "blue": near}


def test_a_distance_is_that_of_the_robot_that_was_said_or_bounded_that_of_another() -> None:
    assert _log_odds(0.0) == pytest.approx(0.0)
    assert _log_odds(0.1) == _log_odds(-0.1)
    said, other = exp(-2.0) / 0.05, exp(-0.125) / 0.2  # two spreads of the robot said, half a one of all robots
    assert _log_odds(0.1) == pytest.approx(log((said + other) / (1 / 0.05 + 1 / 0.2)))
    assert _log_odds(9.0) == _log_odds(99.0) == pytest.approx(-20.0 - log(1 + 0.2 / 0.05))


def test_of_two_pairs_the_likelier_is_chosen_and_one_about_as_likely_is_alike() -> None:
    settings = SAID_PAIR
    dimmer = [replace(one, center_px=(x, 140.0), chroma=70.0) for one, x in ((GREEN, 50.0), (YELLOW, 80.0))]
    chosen, score = choose([*dimmer, GREEN, YELLOW], settings)
    assert chosen == {"green": GREEN, "yellow": YELLOW}
    assert score == pytest.approx(2 * log(1 + exp(-2.0)))
    lost = 4 * log(70 / 80)  # 0.53
    assert [pair["green"] for pair in alike([*dimmer, GREEN, YELLOW], settings)] == [GREEN, dimmer[0]]
    assert -0.7 < lost < -0.35
    too_dim = [replace(one, chroma=66.0) for one in dimmer]  # 0.77
    assert [pair["green"] for pair in alike([*too_dim, GREEN, YELLOW], settings)] == [GREEN]


def test_pairs_that_share_a_blob_are_the_likelier_of_them_alone() -> None:
    above = replace(YELLOW, center_px=(50.0, 10.0), chroma=79.0)
    assert alike([GREEN, above, YELLOW], SAID_PAIR) == [{"green": GREEN, "yellow": YELLOW}]


@pytest.mark.parametrize(("apart", "same"), [(4.9, True), (5.1, False)])
def test_blobs_nearer_than_the_larger_radius_are_one(apart: float, *, same: bool) -> None:
    other = replace(GREEN, center_px=(50.0 + 0.6 * apart, 40.0 - 0.8 * apart), radius_px=3.0)
    assert _same_place(GREEN, other) == _same_place(other, GREEN) == same


# A chroma sample covers 2 × 2 luma samples; the first one's centre is at (0.5, 0.5).
CELL, COLOR = np.array([2.0, 2.0, 0.5, 0.5]), np.array([128.0, 128.0, 0.6, 0.8, 10.0, 0.5])


def uncompiled(kernel: Any) -> Any:
    """What a kernel is made of, where there is a compiler at all."""
    return getattr(kernel, "py_func", kernel)


def window(samples: dict[tuple[int, int], tuple[float, float]], x: float, y: float, half: float) -> np.ndarray:
    """What `color_window` finds in grey planes of 8 × 6 samples but for some; samples: (u, v) less grey by (i, j)."""
    u, v = np.full((6, 8), 128, np.uint8), np.full((6, 8), 128, np.uint8)
    for (i, j), (du, dv) in samples.items():
        u[j, i], v[j, i] = 128 + du, 128 + dv
    found = np.zeros(5)
    uncompiled(color_window)(u, v, CELL, x, y, half, COLOR, found)
    return found


def test_a_window_gives_area_weighted_centre_and_mean_chroma_of_its_colour() -> None:
    found = window({(2, 1): (12, 16), (3, 1): (24, 32), (3, 3): (12, 16)}, 6.5, 4.5, 4.0)  # chroma 20, 40, 20
    assert found[AREA] == 3 * 4.0
    assert found[CENTER_X] == pytest.approx(0.5 + 2 * (20 * 2 + 40 * 3 + 20 * 3) / 80)
    assert found[CENTER_Y] == pytest.approx(0.5 + 2 * (20 * 1 + 40 * 1 + 20 * 3) / 80)
    assert found[STRENGTH] == pytest.approx(80 / 3)
    assert found[CLIPPED] == 0.0


@pytest.mark.parametrize(
    ("du", "dv", "counts"),
    [
        (12, 16, True),
        (6, 8, False),  # chroma 10: not above the least
        (6, 9, True),
        (20, 11, True),  # across 0.45 of along
        (19, 9, False),  # across 0.53 of along
        (4, 20, True),  # as far to the other side
        (3, 20, False),
        (-12, -16, False),  # the opposite colour
    ],
)
def test_a_sample_is_of_a_colour_above_its_least_chroma_and_within_its_angle(du: int, dv: int, *, counts: bool) -> None:
    along, across = 0.6 * du + 0.8 * dv, abs(0.6 * dv - 0.8 * du)
    assert counts == (along > 10 and across < 0.5 * along)
    assert window({(3, 2): (du, dv)}, 6.5, 4.5, 2.0)[AREA] == (4.0 if counts else 0.0)
    assert uncompiled(is_color)(128.0 + du, 128.0 + dv, COLOR) == pytest.approx(along if counts else 0.0)


@pytest.mark.parametrize("toward", [(0.6, 0.8), (-0.6, -0.8), (0.8, -0.6)])
def test_all_allowed_samples_of_a_colour_are_marked_within_their_bounds(toward: tuple[float, float]) -> None:
    """Of chromas 20 at three places, one of them not allowed, 11 at another, 20 across the colour at a last one."""
    along, across = np.array(toward), np.array([-toward[1], toward[0]])
    planes, mask = np.full((2, 6, 8), 128.0), np.ones((6, 8), np.uint8)
    for (j, i), chroma in {(1, 2): 20 * along, (4, 6): 20 * along, (5, 7): 20 * along, (2, 3): 11 * along,
                           (0, 0): 20 * across}.items():  # fmt: skip
        planes[:, j, i] += chroma
    allowed = np.ones((6, 8), bool)
    allowed[5] = False
    color = np.array([128.0, 128.0, *toward, 99.0, 0.5])  # whose own least chroma does not count
    for least, bounds in ((15.0, (2, 1, 4, 2, 6)), (10.0, (3, 1, 4, 2, 6)), (25.0, (0, 6, -1, 8, -1))):
        assert uncompiled(color_scan)(*planes, allowed, color, least, mask) == bounds
        assert np.argwhere(mask).tolist() == [[1, 2], [2, 3], [4, 6]][:: 1 if least < 15 else 2][: bounds[0]]


def test_a_window_without_the_colour_has_no_centre() -> None:
    found = window({}, 6.5, 4.5, 2.0)
    np.testing.assert_equal(found[[AREA, CENTER_X, CENTER_Y, STRENGTH]], [0.0, np.nan, np.nan, 0.0])


OUTSIDE = [(6.5, 4.5, 0.0), (0.5, 4.5, 0.4), (14.5, 4.5, 0.4), (6.5, 0.5, 0.4), (0.5, 0.5, 0.64), (99.0, 4.5, 1.0)]


@pytest.mark.parametrize(("x", "y", "clipped"), OUTSIDE)
def test_share_of_a_window_outside_the_image_is_counted_in_samples(x: float, y: float, clipped: float) -> None:
    assert window({}, x, y, 4.0)[CLIPPED] == pytest.approx(clipped)  # two samples to each side


def test_hue_of_a_place_is_the_mean_direction_also_across_red() -> None:
    planes = np.full((5, 6), np.nan, np.float32)
    planes[2, 3:5] = 350.0, 30.0
    assert _hue_around(planes, 2, 4, 1.9) == pytest.approx(10.0, abs=1e-4)
    assert _hue_around(planes, 2, 5, 0.0) == pytest.approx(30.0, abs=1e-4)  # one cell around at least
    assert np.isnan(_hue_around(planes, 0, 0, 1.0))  # cells that are grey
    planes[0, 0] = 200.0
    assert _hue_around(planes, 0, 0, 1.0) == pytest.approx(200.0, abs=1e-4)


@pytest.mark.parametrize(("away", "part"), [(0.99, True), (1.01, False)])
def test_a_larger_blob_is_that_of_its_chosen_core_up_to_three_tenths_of_it(away: float, *, part: bool) -> None:
    core, large = replace(GREEN, radius_px=2.0), replace(GREEN, radius_px=20.0)
    assert _is_part(core, replace(large, center_px=(50.0, 40.0 + 6.0 * away))) == part
    assert _is_part(GREEN, replace(GREEN, center_px=(50.0 - 5.0 * away, 40.0))) == part


@pytest.mark.parametrize(
    ("radius", "elongation", "fits"),
    [(3.05, 1.0, True), (2.95, 1.0, False), (8.45, 1.0, True), (8.55, 1.0, False), (5.0, 5.9, True), (5.0, 6.1, False)],
)
def test_a_mark_has_about_the_diameter_that_was_said_and_is_no_stripe(
    radius: float, elongation: float, *, fits: bool
) -> None:
    assert _fits(replace(GREEN, radius_px=radius, elongation=elongation), SAID) == fits  # 10 px
    assert _fits(replace(GREEN, radius_px=99.0, elongation=elongation), UNSAID) == (elongation < 6)


NEAR = [(6.2, 2.4, True), (6.3, 2.4, False), (4.1, 2.0, True), (3.9, 0.0, False), (5.0, 2.6, False)]


@pytest.mark.parametrize(("radius", "away", "known"), NEAR)
def test_blobs_of_two_levels_are_one_of_about_the_same_size_and_place(
    radius: float, away: float, *, known: bool
) -> None:
    assert is_known(replace(GREEN, radius_px=radius, center_px=(50.0 + away, 40.0)), [GREEN]) == known


def test_a_range_of_hues_is_widened_where_no_other_begins() -> None:
    assert _widened(80.0, 160.0, 15.0, [(80.0, 160.0), (40.0, 80.0)]) == (80.0, 175.0)
    assert _widened(80.0, 160.0, 15.0, [(80.0, 160.0), (160.0, 200.0)]) == (65.0, 160.0)


@pytest.mark.parametrize(("cells", "counts"), [(3, True), (2, False)])  # of 2 px² each
def test_a_blob_has_an_area_of_six_square_pixels_at_least(cells: int, *, counts: bool) -> None:
    chroma = np.zeros((8, 16), np.float32)
    chroma[3, 2 : 2 + cells] = 50.0
    colors: Any = SimpleNamespace(chroma=chroma, u=chroma, v=chroma, cell_px=(2.0, 1.0), origin_px=(0.5, 0.0))
    assert bool(blobs_of("green", colors, np.flatnonzero(chroma))) == counts


def test_blobs_are_what_hangs_together_also_by_corners_with_place_size_and_whether_the_border_cuts_them() -> None:
    chroma = np.zeros((12, 16), np.float32)
    chroma[4:6, 4:6] = chroma[6:8, 6:8] = 50.0  # two squares that touch at a corner
    chroma[0:3, 12:15] = 60.0  # cut by the border
    chroma[10, 1] = 70.0  # too small
    colors: Any = SimpleNamespace(
        chroma=chroma, u=chroma + 1, v=chroma + 2, cell_px=(2.0, 2.0), origin_px=(0.5, 0.5),
    )  # fmt: skip
    found = sorted(blobs_of("green", colors, np.flatnonzero(chroma)), key=lambda blob: blob.chroma)
    pair, square = (blob for blob in found if blob.radius_px > 2.0)
    assert pair.center_px == pytest.approx((0.5 + 2 * 5.5, 0.5 + 2 * 5.5))
    assert pair.radius_px == pytest.approx((8 * 4 / np.pi) ** 0.5)
    assert pair.elongation > 2.0
    assert (pair.whole, square.whole) == (True, False)
    assert square.center_px == pytest.approx((0.5 + 2 * 13.0, 0.5 + 2 * 1.0))
    assert square.elongation == pytest.approx(1.0)
    assert (square.chroma, square.chroma_uv) == (60.0, (61.0, 62.0))


USUAL = np.array([8.0] * 6 + [10.0] * 2 + [12.0] * 6 + [60.0])  # median 10, median deviation 2


@pytest.mark.parametrize(
    ("chroma", "floor", "motley"),
    [
        (USUAL, 10 + 6 * 1.4826 * 2, False),  # six robust sigmas above the middle
        (4 * USUAL, 56.0, True),  # what is coloured all over leaves stickers
        (0 * USUAL, 14.0, False),
    ],
)
def test_the_least_chroma_is_above_what_noise_and_tints_of_a_frame_reach(
    chroma: np.ndarray, floor: float, *, motley: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fill(*given: Any) -> None:
        given[-1].flat[:] = chroma

    monkeypatch.setattr(color_map_module.color_kernels, "chroma_plane", fill)
    grey = np.full((3, 5), 128, np.uint8)
    frame = Frame(
        0, 0, Fraction(1, 60), np.full((6, 10), 99, np.uint8), grey, grey, 8, full_range=True, matrix="bt601",
        row_origin=1, row_step=2, kind="", repeated=False, owner=None,
    )  # fmt: skip
    found = color_map_module.color_map(frame, np.ones((3, 5), bool))
    assert (found.floor, found.motley) == (pytest.approx(floor), motley)
    assert found.colorful.tolist() == np.flatnonzero(chroma > floor).tolist()
    assert (found.cell_px, found.origin_px) == ((2.0, 4.0), (0.5, 2.0))  # of a field, whose rows are two apart
