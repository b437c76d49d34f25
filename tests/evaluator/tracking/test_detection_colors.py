"""Colours of a frame, in closed form: what a camera stores of a colour is that colour again."""

from __future__ import annotations

import colorsys
from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.recording import Frame
from evaluator.tracking.detection.appearance import Appearance, learn_color, with_disc
from evaluator.tracking.detection.color_kernels import chroma_plane, color_scan, is_color
from evaluator.tracking.detection.color_map import _hue, allowed_cells, color_map, neutral_of
from evaluator.tracking.detection.search import mean_light
from evaluator.tracking.detection.selection import Candidate
from evaluator.tracking.settings import MarkSettings, TrackingSettings

KINDS = [("bt601", False, 8), ("bt709", True, 8), ("bt601", True, 10), ("bt709", False, 12)]


def stored(rgb: np.ndarray, matrix: str = "bt601", full_range: bool = True, depth: int = 8) -> Frame:
    """A frame of colours (rows, columns, 3), levels of 8 bits, as BT.601 or BT.709 says that they are stored.

    Luma is the weighted mean of R, G and B, and the colour planes are B and R less luma over their largest values.
    """
    of_red, of_blue = {"bt601": (0.299, 0.114), "bt709": (0.2126, 0.0722)}[matrix]
    red, green, blue = np.moveaxis(rgb / 255, -1, 0)
    luma = of_red * red + (1 - of_red - of_blue) * green + of_blue * blue
    u, v = (blue - luma) / (2 * (1 - of_blue)), (red - luma) / (2 * (1 - of_red))
    black, swing, of_color = (0, 255, 255) if full_range else (16, 219, 224)
    unit = 2 ** (depth - 8)
    planes = [unit * (black + swing * luma), *(unit * (128 + of_color * part) for part in (u, v))]
    kind = np.uint8 if depth == 8 else np.uint16
    luma, u, v = (np.rint(plane).astype(kind) for plane in planes)
    return Frame(
        0, 0, Fraction(1, 60), luma, u, v, depth, full_range=full_range, matrix=matrix,
        row_origin=0, row_step=1, kind="", repeated=False, owner=None,
    )  # fmt: skip


@pytest.mark.parametrize(("matrix", "full_range", "depth"), KINDS)
def test_a_colour_is_what_its_planes_were_made_of(matrix: str, full_range: bool, depth: int) -> None:
    rgb = np.random.default_rng(1).uniform(0, 255, (6, 8, 3)).round()
    frame = stored(rgb, matrix, full_range, depth)
    rounding = 1.6 / 2 ** (depth - 8)  # half a level of luma and of the planes, the latter times two
    np.testing.assert_allclose(frame.to_rgb(), rgb, atol=rounding + 0.5)
    to_rgb = frame.rgb_from_planes.astype(np.float32)
    planes = np.stack([frame.luma, frame.u, frame.v, np.ones_like(frame.luma)]).reshape(4, -1)
    np.testing.assert_allclose((to_rgb @ planes).T, rgb.reshape(-1, 3), atol=rounding)
    chroma = np.zeros((6, 8), np.float32)
    chroma_plane(frame.luma, frame.u, frame.v, to_rgb, chroma)
    np.testing.assert_allclose(chroma, np.ptp(rgb, axis=2), atol=2 * rounding)
    grey = replace(frame, u=None, v=None)
    shades = stored(np.full((2, 2, 3), 100.0), matrix, full_range, depth)
    np.testing.assert_allclose(replace(grey, luma=shades.luma).to_rgb(), np.full((2, 2, 3), 100), atol=1)
    dark = stored(np.zeros((2, 2, 3)), matrix, full_range, depth)
    assert mean_light(dark) == pytest.approx(1e-9)
    white = mean_light(stored(np.full((2, 2, 3), 255.0), matrix, full_range, depth))
    assert white == pytest.approx(2 ** (depth - 8) * (255 if full_range else 219))


def test_hue_is_that_of_the_hsv_circle() -> None:
    rgb = np.random.default_rng(2).uniform(0, 255, (200, 3))
    expected = [360 * colorsys.rgb_to_hsv(*color / 255)[0] for color in rgb]
    np.testing.assert_allclose(_hue(rgb.T.astype(np.float32)), expected, atol=1e-3)


@pytest.mark.parametrize(
    ("plate", "gains"),
    [
        ((150.0, 120.0, 90.0), (0.8, 1.0, 4 / 3)),  # made grey
        ((30.0, 160.0, 200.0), (1.7, 0.8125, 0.65)),  # no lamp differs by more than a factor of 1.7 ...
        ((230.0, 90.0, 40.0), (0.6, 4 / 3, 1.7)),  # ... or 0.6
    ],
)
@pytest.mark.parametrize("balance", [1.0, 0.0, 0.5])
def test_what_most_of_a_frame_shows_is_made_grey_as_far_as_a_lamp_may_tint_it(
    plate: tuple[float, ...], gains: tuple[float, ...], balance: float
) -> None:
    rgb = np.tile(plate, (12, 16, 1))
    rgb[4:6, 4:8] = mark = 60.0, 140.0, 70.0
    allowed = np.ones((12, 16), bool)
    found = color_map(stored(rgb), allowed, balance)
    gain = np.array(gains) ** balance
    assert found.chroma[0, 0] == pytest.approx(np.ptp(gain * plate), abs=3.0)
    assert found.chroma[4, 4] == pytest.approx(np.ptp(gain * mark), abs=4.0)
    where = found.colorful.tolist().index(4 * 16 + 4) if 4 * 16 + 4 in found.colorful else None
    assert (where is not None) == bool(found.chroma[4, 4] > found.floor)
    if where is not None:
        expected = 360 * colorsys.rgb_to_hsv(*(gain * mark / 255))[0]
        assert abs((found.hue_deg[where] - expected + 180) % 360 - 180) < 3.0


def test_cells_are_as_many_samples_as_a_colour_plane_is_smaller_and_regions_are_in_pixels() -> None:
    """Two samples of luma across, one down, of a field whose rows are two pixels apart."""
    field = stored(np.full((10, 24, 3), 90.0))
    assert field.u is not None
    assert field.v is not None
    u, v = (np.ascontiguousarray(plane[:, ::2]) for plane in (field.u, field.v))
    field = replace(field, u=u, v=v, row_origin=1, row_step=2)
    found = color_map(field, np.ones((10, 12), bool))
    assert (found.cell_px, found.origin_px) == ((2.0, 2.0), (0.5, 1.0))
    settings = TrackingSettings(region_px=(5, 3, 17, 15), mask_px=((8, 6, 11, 8),))
    mark = MarkSettings(region_px=(0, 0, 24, 11))
    expected = np.zeros((10, 12), bool)
    expected[1:8, 2:9] = True  # every cell that the region touches
    expected[3:4, 4:6] = False
    np.testing.assert_array_equal(allowed_cells(field, settings), expected)
    expected[6:] = False
    np.testing.assert_array_equal(allowed_cells(field, settings, mark), expected)


def test_grey_is_the_middle_of_the_planes_as_far_as_the_lamp_has_tinted_it() -> None:
    tinted = stored(np.full((4, 4, 3), (120.0, 100.0, 80.0)), "bt601", True, 10)
    assert tinted.u is not None
    assert tinted.v is not None
    u, v = float(tinted.u[0, 0]), float(tinted.v[0, 0])
    for balance in (0.0, 0.5, 1.0):
        expected = 512 + balance * (u - 512), 512 + balance * (v - 512)
        assert neutral_of(tinted, np.ones((4, 4), bool), balance) == pytest.approx(expected)


@pytest.mark.parametrize(("apart_deg", "half_deg"), [(None, 40.0), (100.0, 40.0), (60.0, 30.0), (10.0, 8.0)])
def test_a_colour_ends_midway_to_the_nearest_other_and_at_less_than_half_its_chroma(
    apart_deg: float | None, half_deg: float
) -> None:
    mark = Candidate("green", (0.0, 0.0), 5.0, 1.0, 80.0, (128 + 30.0, 126 - 40.0))
    others = []
    if apart_deg is not None:
        turn = 3.0 * (30 - 40j) * np.exp(1j * np.radians(apart_deg))
        others = [(128 + turn.real, 126 + turn.imag), (128 - 30.0, 126 + 40.0)]
    color = learn_color(mark, others, (128.0, 126.0))
    assert color == pytest.approx([128, 126, 0.6, -0.8, 0.45 * 50, np.tan(np.radians(half_deg))])


def test_all_allowed_samples_of_a_colour_are_marked_and_bounded() -> None:
    rng = np.random.default_rng(4)
    u, v = (rng.integers(60, 200, (9, 14)).astype(np.uint8) for _ in range(2))
    allowed = rng.random((9, 14)) < 0.7
    allowed[:, :3] = allowed[0] = False
    color, least = np.array([128.0, 126.0, 0.6, -0.8, 90.0, 0.7]), 20.0
    wanted = color.copy()
    wanted[4] = least
    expected = np.array(
        [[is_color(float(u[j, i]), float(v[j, i]), wanted) > 0 and allowed[j, i] for i in range(14)] for j in range(9)]
    )
    mask = np.full((9, 14), 9, np.uint8)
    count, *bounds = color_scan(u, v, allowed, color, least, mask)
    rows, columns = np.nonzero(expected)
    assert 5 < count == len(rows)
    assert bounds == [rows.min(), rows.max(), columns.min(), columns.max()]
    np.testing.assert_array_equal(mask, expected)
    assert color[4] == 90.0
    assert color_scan(u, v, allowed, color, 300.0, mask)[0] == 0
    assert not mask.any()


def test_a_mark_is_no_smaller_than_four_fifths_of_the_disc_it_turns_out_to_be() -> None:
    disc: Any = SimpleNamespace(radius_px=10.0)
    for area, expected in ((100.0, 80 * np.pi), (300.0, 300.0)):
        assert with_disc(Appearance(np.zeros(6), area, disc), disc).area_px2 == pytest.approx(expected)
