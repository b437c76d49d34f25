"""Blobs of any shape: the share of a pixel, moments of the shares and what they are unsure by, in closed form."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from evaluator.tracking.following.follow_blob import EXTENT, BlobFollower
from evaluator.tracking.refinement import blob as blobs
from evaluator.tracking.refinement.blob import (
    SHORTEST,
    Blob,
    _between,
    _in_light,
    _light,
    _lumpy_variance,
    _members,
    _moments,
    _share,
    _span,
    blobs_around,
    elongation,
    extends_beyond,
    has_another_hue,
)
from tests.evaluator.tracking.synthetic import coverage, frames_in_memory
from tests.evaluator.tracking.test_detection_colors import stored

NOWHERE = np.zeros((), bool)  # no part of a mark is known to be covered whole


def test_elongation_is_the_ratio_of_the_axes_without_the_smear() -> None:
    """A box of 12 by 4 px: variances 12 and 4/3; smeared along the shorter side by 6 px it looks more like a square."""
    box = np.diag([12.0, 4 / 3])
    assert elongation(box) == pytest.approx(3.0)
    assert elongation(box + np.diag([0.0, 36 / 12]), (0.0, 6.0)) == pytest.approx(3.0)
    assert elongation(np.diag([1.0, 0.0])) == pytest.approx(np.sqrt(1 / SHORTEST))
    assert elongation(np.zeros((2, 2))) == 1.0


def test_share_of_a_pixel_is_how_much_of_the_core_is_mixed_into_what_is_around() -> None:
    rng = np.random.default_rng(4)
    mixed = np.clip(np.linspace(-1, 2, 30), 0, 1)[None, :].repeat(20, axis=0)
    colors = np.array([180.0, 60.0, 90.0])[:, None, None], np.array([60.0, 128.0, 128.0])[:, None, None]
    planes = colors[0] * mixed + colors[1] * (1 - mixed)
    planes[0] += 20 * rng.normal(size=(20, 30))  # luma of a rough floor: chroma tells
    share = _share(planes.astype(np.float32), mixed == 1, mixed == 0)
    assert np.abs(share - mixed).max() < 0.1
    assert share[mixed == 1].mean() == pytest.approx(1.0, abs=1e-3)
    assert share[mixed == 0].mean() == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("row_step", [1, 2])
def test_blob_has_the_centre_area_and_moments_of_its_box(row_step: int) -> None:
    share = np.zeros((40, 50))
    share[10:22, 20:38] = 1.0
    core, region = share > 0, np.ones_like(share, bool)
    blob = _moments(share, (region, core, ~core, NOWHERE), (100, 7, row_step), 33.0, whole=True)
    assert blob is not None
    assert blob.center_px == pytest.approx((100 + 28.5, 7 + row_step * 15.5))
    assert blob.area_px2 == pytest.approx(12 * 18 * row_step)
    assert np.diag(blob.spread_px2) == pytest.approx([(18**2 - 1) / 12, row_step**2 * (12**2 - 1) / 12])
    assert blob.covariance_px2 == pytest.approx(np.zeros((2, 2)))  # even inside and around
    small = np.zeros((40, 50))
    for size, found in ((5, False), (6, True)):
        small[10, 20 : 20 + size] = 1.0
        assert (
            _moments(small, (region, small > 0, small == 0, NOWHERE), (0, 0, 1), 1.0, whole=True) is not None
        ) == found
    over = np.where(core, 3.0, -1.0)  # clipped to 1.2 and -0.2: noise explains so much
    clipped = _moments(over, (core, core, ~core, NOWHERE), (0, 0, 1), 1.0, whole=True)
    assert clipped is not None
    assert clipped.area_px2 == pytest.approx(1.2 * 12 * 18)


def test_centroid_is_as_unsure_as_noise_of_the_shares_makes_it() -> None:
    rng = np.random.default_rng(5)
    core = np.zeros((30, 30), bool)
    core[10:20, 8:22] = True
    region = np.zeros_like(core)
    region[7:23, 5:25] = True
    blobs = [
        _moments(
            core + 0.05 * rng.normal(size=core.shape), (region, core, ~region, NOWHERE), (0, 0, 1), 1.0, whole=True
        )
        for _ in range(120)
    ]
    centers = np.array([blob.center_px for blob in blobs if blob is not None])
    stated = np.mean([np.diag(blob.covariance_px2) for blob in blobs if blob is not None], axis=0)
    # Noise that looks like light which rises over the blob is taken out: the centre is surer than that.
    ratio = centers.var(axis=0) / stated
    assert np.all((ratio > 0.5) & (ratio < 1.35))


def test_noise_that_neighbours_share_counts_by_how_many_share_it() -> None:
    rng = np.random.default_rng(6)
    everywhere = np.ones((210, 210), bool)
    white = rng.normal(size=(210, 210))
    assert _lumpy_variance(white, everywhere) == pytest.approx(1.0, rel=0.15)
    blocks = np.kron(rng.normal(size=(30, 30)), np.ones((7, 7)))
    # A mean over a square that lies anywhere holds (2/3)² of the variance of a block: of the sum over 49 pixels 21.8.
    assert _lumpy_variance(blocks, everywhere) == pytest.approx(49 * 4 / 9 * blocks.var(), rel=0.15)
    flat = np.kron(rng.normal(size=(3, 3)), np.ones((70, 70)))
    assert _lumpy_variance(flat, everywhere) == pytest.approx(49 * flat.var(), rel=0.15)


@pytest.mark.parametrize(("inside_px", "most_px"), [(0.0, 0.06), (17.0, 0.02)])
def test_light_that_rises_over_a_sticker_hardly_moves_its_centre(inside_px: float, most_px: float) -> None:
    """A disc of radius r in light that rises by g a pixel has its centroid g r²/4 off: 0.4 px here."""
    y, x = np.mgrid[:61, :61] - 30.0
    away = np.hypot(x - 0.3, y)
    rng = np.random.default_rng(5)
    share = np.clip(20.5 - away, 0, 1) * (1 + 0.004 * x) + 0.02 * rng.normal(size=away.shape)
    parts = away < 23, away < 19, (away > 24) & (away < 29), away < inside_px
    blob = _moments(share, parts, (0, 0, 1), 1.0, whole=True)
    assert blob is not None
    assert blob.center_px[0] == pytest.approx(30.3, abs=most_px)
    level = np.ones_like(share) + 0.1 * rng.normal(size=share.shape)
    assert _light(level, away < 3) == pytest.approx(1.0, abs=0.1)  # what noise explains is no light


def test_a_sample_is_of_a_colour_that_is_strong_along_it_and_little_across() -> None:
    color = np.array([128.0, 128.0, 0.6, 0.8, 10.0, 0.5])
    along = np.array([9.0, 11.0, 20.0, 20.0])
    across = np.array([0.0, 0.0, 9.0, 11.0])
    u, v = 128 + 0.6 * along - 0.8 * across, 128 + 0.8 * along + 0.6 * across
    found, member = _members(u.astype(np.float32), v.astype(np.float32), color)
    assert found == pytest.approx(along, rel=1e-5)
    assert member.tolist() == [0, 1, 1, 0]
    assert _span(10.0, 3.0, 0.5, 2.0, 100) == (3, 8)
    assert _span(1.0, 3.0, 0.5, 2.0, 2) == (0, 2)


def test_highlight_on_a_sticker_does_not_move_its_centre() -> None:
    """A lamp's reflection takes the colour of a third of a disc."""
    size, center, radius = (90, 80), (44.3, 40.6), 20.0
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    share = coverage(size, center, radius, 0.8)[..., None]
    glare = np.exp(-((x - 38.0) ** 2 + (y - 30.0) ** 2) / 8.0**2)[..., None]
    sticker = np.array([190.0, 185.0, 30.0])
    image = np.array([25.0, 25.0, 27.0]) * (1 - share) + share * (sticker + glare * (255.0 - sticker))
    (frame,) = frames_in_memory([image])
    assert frame.u is not None
    assert frame.v is not None
    toward = np.array([frame.u[40, 55], frame.v[40, 55]], float) - 128.0
    strength = float(np.hypot(*toward))
    color = np.array([128.0, 128.0, *(toward / strength), 0.45 * strength, 0.5])
    (blob,) = blobs_around(frame, np.array([1.0, 1.0, 0.0, 0.0]), color, center, 40.0, 100.0)
    assert np.hypot(*np.subtract(blob.center_px, center)) < 0.3  # by its colour alone 2.6 px
    assert blob.area_px2 == pytest.approx(np.pi * radius**2, rel=0.02)


@pytest.mark.parametrize(("origin", "step"), [(0, 1), (1, 2)])
def test_a_sticker_is_found_at_its_place_in_the_frame_by_subsampled_colours(origin: int, step: int) -> None:
    """24 by 12 px of a field or a frame whose colours are stored for two by two pixels; another beside it."""
    rgb = np.full((40, 80, 3), 90.0)
    rgb[12:24, 20:44] = 60.0, 150.0, 70.0
    rgb[30:36, 60:70] = 60.0, 150.0, 70.0
    whole = stored(rgb)
    assert whole.u is not None
    assert whole.v is not None
    u, v = (np.ascontiguousarray(plane[::2, ::2]) for plane in (whole.u, whole.v))
    seen = replace(whole, u=u, v=v, row_origin=origin, row_step=step)
    cell = np.array([2.0, 2.0 * step, 0.5, origin + 0.5 * step])
    toward = np.array([float(u[8, 15]) - 128, float(v[8, 15]) - 128])
    color = np.array([128.0, 128.0, *(toward / np.hypot(*toward)), 0.45 * np.hypot(*toward), 0.8])
    place = 31.5, origin + step * 17.5
    blobs = sorted(blobs_around(seen, cell, color, place, 60.0, 20.0), key=lambda one: one.area_px2)
    assert len(blobs) == 2
    assert blobs[1].center_px == pytest.approx(place, abs=0.02)
    assert blobs[1].area_px2 == pytest.approx(24 * 12 * step, rel=0.02)
    assert blobs[0].center_px == pytest.approx((64.5, origin + step * 32.5), abs=0.02)
    assert blobs[1].strength == pytest.approx(np.hypot(*toward), rel=0.01)
    assert [one.whole for one in blobs] == [True, True]
    near = blobs_around(seen, cell, color, place, 14.0, 20.0)
    assert [one.center_px for one in near] == [pytest.approx(blobs[1].center_px)]


def test_sticker_that_overhangs_a_dark_body_on_white_paper_is_where_it_is_within_the_doubt_of_the_tone_curve() -> None:
    """A lens mixes light, a camera writes it with a gamma: edges on paper and on the body shift differently."""
    x = np.arange(-24.0, 25.0)
    inside = np.clip(6.0 - np.abs(x), -0.5, 0.5) + 0.5
    colors = {"green": (0.02, 0.4, 0.04), "paper": (0.75, 0.75, 0.75), "body": (0.02, 0.02, 0.02)}
    light = np.where((x < 0)[:, None], colors["body"], colors["paper"])[None, :, :].repeat(49, axis=0)
    share = (inside[None, :] * inside[:, None])[..., None]
    light = cv2.GaussianBlur(light * (1 - share) + share * np.array(colors["green"]), (0, 0), 1.2)
    written = np.round(255.0 * light ** (1 / 2.2)).astype(np.uint8)
    y, v, u = np.moveaxis(cv2.cvtColor(written, cv2.COLOR_RGB2YCrCb).astype(float), -1, 0)
    planes = np.stack([y, u, v]).astype(np.float32)
    core, around = share[..., 0] > 0.99, share[..., 0] == 0.0
    region = np.ones_like(core)
    rgb_from_planes = np.array([[1.0, 0.0, 1.402, -179.5], [1.0, -0.344, -0.714, 135.4], [1.0, 1.772, 0.0, -226.8]])
    plain, in_light = (
        _moments(_share(each, core, around), (region, core, around, NOWHERE), (-24, -24, 1), 1.0, whole=True)
        for each in (planes, _in_light(planes, rgb_from_planes))
    )
    assert plain is not None
    assert in_light is not None
    found = _between(plain, in_light)
    assert abs(plain.center_px[0]) > 0.3
    assert abs(found.center_px[0]) < 0.5 * abs(plain.center_px[0])
    assert abs(found.center_px[0]) < 2.0 * np.sqrt(found.covariance_px2[0, 0])


def test_a_centre_lies_midway_between_two_tone_curves_and_anywhere_between_them() -> None:
    """4 by 2 px apart: a twelfth of that, squared, is the variance of an even distribution."""
    one = Blob((10.0, 20.0), np.diag([1.0, 3.0]), 50.0, np.eye(2), 30.0, whole=True)
    found = _between(one, replace(one, center_px=(14.0, 18.0), covariance_px2=np.diag([3.0, 1.0]), area_px2=90.0))
    assert (found.center_px, found.area_px2) == ((12.0, 19.0), 50.0)
    assert found.covariance_px2 == pytest.approx(np.array([[2 + 16 / 12, -8 / 12], [-8 / 12, 2 + 4 / 12]]))


@pytest.mark.parametrize(
    ("place", "half", "most", "beyond"),
    [
        ((25.0, 21.0), 20.0, 97.0, False),  # 12 by 8 px, whole within the window
        ((25.0, 21.0), 9.0, 97.0, False),  # and within one that begins in the middle of the image
        ((25.0, 21.0), 20.0, 95.0, True),
        ((19.6, 17.6), 20.0, 97.0, False),  # its corner is a part of it
        ((18.4, 21.0), 20.0, 97.0, True),  # beside it there is nothing
        ((25.0, 16.4), 20.0, 97.0, True),
        *(((x, y), 9.0, 97.0, True) for x, y in ((21.0, 21.0), (29.0, 21.0))),  # cut by the window on either side
        *(((x, y), 6.0, 97.0, True) for x, y in ((25.0, 19.0), (25.0, 23.0))),
        ((90.0, 21.0), 20.0, 97.0, True),  # outside the image
        ((25.0, -9.0), 20.0, 97.0, True),
    ],
)
def test_a_region_extends_beyond_an_area_or_a_window_or_is_not_there(
    place: tuple[float, float], half: float, most: float, *, beyond: bool
) -> None:
    frame: Any = SimpleNamespace(u=np.full((40, 60), 128, np.uint8), v=np.full((40, 60), 128, np.uint8))
    frame.u[17:25, 19:31] = 188
    color, cell = np.array([128.0, 128.0, 1.0, 0.0, 20.0, 0.5]), np.array([1.0, 1.0, 0.0, 0.0])
    assert extends_beyond(frame, cell, color, place, half, most) == beyond


@pytest.mark.parametrize(
    ("degrees", "other"), [(0.0, False), (19.0, False), (-19.0, False), (21.0, True), (-21.0, True)]
)
def test_a_hue_is_another_one_beyond_a_third_of_a_radian(degrees: float, *, other: bool) -> None:
    """0.35 rad are 20 degrees; where nothing has the colour there is no other hue."""
    turned = np.radians(degrees)
    u, v = np.full((40, 60), 1000, np.uint16), np.full((40, 60), 1000, np.uint16)
    u[15:25, 20:30], v[15:25, 20:30] = 1000 + 600 * np.cos(turned), 1000 + 600 * np.sin(turned)
    frame: Any = SimpleNamespace(u=u, v=v)
    color, cell = np.array([1000.0, 1000.0, 1.0, 0.0, 100.0, 0.8]), np.array([1.0, 1.0, 0.0, 0.0])
    assert has_another_hue(frame, cell, color, (24.5, 19.5), 8.0) == other
    assert not has_another_hue(frame, cell, color, (50.0, 35.0), 4.0)


def test_chroma_from_which_a_pixel_is_the_marks_lies_above_that_of_the_floor() -> None:
    """A mark on a floor of a third of its chroma: a threshold of its own chroma alone would take the floor for it."""
    rgb = np.full((60, 60, 3), 90.0) + np.array([0.0, 20.0, 0.0])
    rgb[24:36, 24:36] = 60.0, 150.0, 70.0
    frame = stored(rgb)
    assert frame.u is not None
    assert frame.v is not None
    mark, floor = (np.array([frame.u[at, at], frame.v[at, at]], float) - 128.0 for at in (30, 5))
    strength, beside = float(np.hypot(*mark)), float(floor @ mark / np.hypot(*mark))
    color = np.array([128.0, 128.0, *(mark / strength), 0.5 * strength, 0.8])  # rises at once, falls slowly
    follower = BlobFollower(color, 144.0, 0.0)
    sighting = follower.look_at(frame, np.array([1.0, 1.0, 0.0, 0.0]), (29.5, 29.5), 4.0, 0.1)
    follower.accept(sighting, 0.1)
    assert sighting.status == "ok"
    assert follower.color[4] == pytest.approx(beside + EXTENT * (strength - beside), rel=0.02)
    assert follower.color[4] > beside


def test_paler_part_of_a_mark_does_not_raise_its_threshold() -> None:
    """A ball of 36 px with half the colour where it is in shade, of which only the bright part was learnt."""
    y, x = np.mgrid[:80, :80] - 39.5
    share = 0.5 * (np.hypot(x, y) < 18.0) + 0.5 * (np.hypot(x - 4.0, y) < 14.0)
    frame = stored(90.0 + share[..., None] * np.array([-30.0, 60.0, -20.0]))
    assert frame.u is not None
    assert frame.v is not None
    strong = np.array([frame.u[40, 40], frame.v[40, 40]], float) - 128.0
    length = float(np.hypot(*strong))
    follower = BlobFollower(np.array([128.0, 128.0, *(strong / length), 0.6 * length, 0.8]), 616.0, 0.0)
    for k in range(20):
        sighting = follower.look_at(frame, np.array([1.0, 1.0, 0.0, 0.0]), (41.5, 39.5), 4.0, 0.1)
        follower.accept(sighting, 0.1 * k)
    assert sighting.status == "ok"
    assert follower.area_px2 > 800.0


@pytest.mark.parametrize(
    ("left", "top", "whole"),
    [(30, 20, True), (5, 20, True), (30, 5, True), (0, 20, False), (30, 0, False), (50, 20, False), (30, 30, False)],
)
def test_a_blob_is_whole_that_touches_no_border_of_the_image(
    left: int, top: int, *, whole: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ten by ten of 60 by 40 px: also one that lies in the second half of the image, as far as it is large."""
    said: list[bool] = []
    monkeypatch.setattr(blobs, "_measured", lambda *_, whole: said.append(whole))
    plane = np.full((40, 60), 128, np.uint8)
    plane[top : top + 10, left : left + 10] = 178
    frame: Any = SimpleNamespace(u=plane, v=np.full((40, 60), 128, np.uint8))
    color = np.array([128.0, 128.0, 1.0, 0.0, 22.5, 0.5])
    assert blobs_around(frame, np.array([1.0, 1.0, 0.0, 0.0]), color, (left + 5.0, top + 5.0), 9.0, 50.0) == []
    assert said == [whole]
