"""Lights in closed form: which blob is one, what it weighs, and how it is followed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.tracking import TrackingSettings
from evaluator.tracking.luma_marks import explain, lights
from evaluator.tracking.luma_marks.lights import _Blob, bright_blobs, shape_fault
from evaluator.tracking.settings import MarkSettings
from tests.evaluator.tracking.synthetic import frame_of

FIELD = frame_of(np.zeros((50, 100), np.uint8), origin=1, step=2)  # of odd rows
WHOLE = frame_of(np.zeros((50, 100), np.uint8))


@pytest.mark.parametrize(
    ("wide", "high", "area", "said"),
    [
        (2, 1, 2, "too small: 2 px, at least 3 are needed"),
        (2, 2, 3, ""),
        (15, 15, 200, ""),
        (15, 15, 201, "too large: 2 % of the frame"),
        (12, 3, 30, ""),
        (13, 3, 30, "a stripe: 13 by 3 px"),
        (3, 13, 30, "a stripe: 3 by 13 px"),
    ],
)
def test_a_light_is_a_compact_blob_of_three_pixels_to_a_fiftieth_of_the_frame(
    wide: int, high: int, area: int, said: str
) -> None:
    assert shape_fault((7, 9, wide, high, area), 10_000) == said


def scene(ground: np.ndarray, *squares: tuple[int, int], value: int = 200) -> np.ndarray:
    """Squares of 4 x 4 px with their top left corners."""
    luma = ground.astype(np.uint8)
    for x, y in squares:
        luma[y : y + 4, x : x + 4] = value
    return luma


def spread(at: tuple[float, float], reach: float, without: Any = ()) -> tuple[float, float]:
    """Sums of the squared distances in x and y of the pixels within reach."""
    y, x = np.mgrid[0:70, 0:100]
    inside = np.hypot(x - at[0], y - at[1]) <= reach
    for left, top in without:
        inside[top : top + 4, left : left + 4] = False
    return float(((x - at[0]) ** 2)[inside].sum()), float(((y - at[1]) ** 2)[inside].sum())


def test_a_light_is_weighed_above_the_wings_of_its_halo_and_without_its_neighbour() -> None:
    """Base 40, noise at least 1: bright above 40 + 0.4 · 160, weights above 40 + 0.15 · 160 = 64, reach 2.5 · 2 + 1."""
    found = bright_blobs(frame_of(scene(np.full((70, 100), 40), (50, 30), (55, 30))))
    assert found.level == pytest.approx(104.0)
    assert int(found.mask.sum()) == 32
    first, second = found.blobs
    assert first.place == pytest.approx((51.5, 31.5))
    assert second.place == pytest.approx((56.5, 31.5))
    assert (first.radius, first.light, first.cut) == (2.0, pytest.approx(16 * 136.0), False)
    squares = spread((51.5, 31.5), 6.0, [(55, 30)])
    assert first.variance == pytest.approx([(1 + 1 / 12) * square / 2176**2 + 0.03**2 for square in squares], rel=1e-6)
    halo = scene(np.full((70, 100), 40), (50, 30))
    halo[31, 56] = 80  # 4.5 px from the centre, as much above the wings as 2/17 of a pixel of the core
    (one,) = bright_blobs(frame_of(halo)).blobs
    assert one.place == pytest.approx(((2176 * 51.5 + 16 * 56) / 2192, (2176 * 31.5 + 16 * 31) / 2192))
    halo[31, 56], halo[31, 58] = 40, 80  # 6.5 px: beyond reach
    assert bright_blobs(frame_of(halo)).blobs[0].place == pytest.approx((51.5, 31.5))


def test_a_light_rises_above_eight_standard_deviations_of_its_ground_and_its_wings_above_two() -> None:
    """Columns of 30 and 50 in turn: a median of 40, a deviation of 10 · 1.4826."""
    ground = np.where(np.arange(100) % 2, 50, 30) * np.ones((70, 1))
    noise = 14.826
    found = bright_blobs(frame_of(scene(ground, (50, 30))))
    assert found.level == pytest.approx(40 + 8 * noise)
    assert found.blobs[0].light == pytest.approx(16 * (160 - 2 * noise))
    assert bright_blobs(frame_of(scene(ground, (50, 30), value=158))).blobs == []  # 158 is below 158.6, 159 above
    assert len(bright_blobs(frame_of(scene(ground, (50, 30), value=159))).blobs) == 1
    assert [
        box[:2] for box in bright_blobs(frame_of(scene(ground, *((40 + 4 * k, 30) for k in range(5))))).refused
    ] == [(40, 30)]


def test_noise_beside_a_light_is_that_of_the_ring_around_it() -> None:
    """Of 24 pixels beyond 0.8 · 6 px from the centre every second one is 20 above the wings."""
    luma = scene(np.full((70, 100), 40), (50, 30))
    y, x = np.mgrid[0:70, 0:100]
    distance = np.hypot(x - 51.5, y - 31.5)
    ring = (distance > 4.8) & (distance <= 6.0)
    luma[ring & ((x + y) % 2 == 0)] = 84
    (blob,) = bright_blobs(frame_of(luma)).blobs
    weight = np.where(distance <= 6.0, np.maximum(luma.astype(float) - 64, 0), 0)
    noise = float(np.std(weight[ring]))
    assert 9.9 < noise <= 10.0
    total = weight.sum()
    expected = [(noise**2 + 1 / 12) * square / total**2 + 0.03**2 for square in spread(blob.place, 6.0)]
    assert blob.variance == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(
    ("x", "y", "cut"), [(0, 30, True), (96, 30, True), (50, 0, True), (50, 66, True), (1, 1, False), (95, 65, False)]
)
def test_a_light_at_the_border_of_the_frame_is_cut(x: int, y: int, *, cut: bool) -> None:
    (blob,) = bright_blobs(frame_of(scene(np.full((70, 100), 40), (x, y)))).blobs
    assert blob.cut is cut


def blob(x: float, y: float = 0.0, **more: Any) -> _Blob:
    return _Blob(**{"place": (x, y), "radius": 2.0, "light": 100.0, "variance": (0.01, 0.02), "cut": False, **more})


@pytest.mark.parametrize(
    ("missed", "distance", "radius", "known"),
    [
        (0, 10.9, 2.0, True), (0, 11.1, 2.0, False), (1, 21.9, 2.0, True), (1, 22.1, 2.0, False),
        (0, 0.0, 0.81, True), (0, 0.0, 0.79, False), (0, 0.0, 4.9, True), (0, 0.0, 5.1, False),
    ],
)  # fmt: skip
def test_a_light_is_found_again_within_three_radii_and_its_step_of_where_it_was_going(
    missed: int, distance: float, radius: float, *, known: bool
) -> None:
    light = blob(10.0, 20.0, velocity=(3.0, -4.0), missed=missed)
    at = light.expected()
    assert at == (10.0 + 3 * (1 + missed), 20.0 - 4 * (1 + missed))
    there, farther = blob(at[0] - distance, at[1], radius=radius), blob(at[0], at[1] + 99.0)
    assert lights._nearest(light, [farther, there]) is (there if known else None)
    assert lights._nearest(light, [blob(at[0] + 3.0, at[1]), nearer := blob(at[0] - 2.0, at[1])]) is nearer


def test_a_light_that_was_missed_has_moved_by_a_part_of_the_way_in_each_frame() -> None:
    light = blob(0.0, first=(5.0, 6.0), missed=1)
    moved = lights._moved_on(light, blob(4.0, -6.0, missed=3))
    assert (moved.velocity, moved.first, moved.missed) == ((2.0, -3.0), (5.0, 6.0), 0)
    assert [lights._has_moved(blob(3.0, y, first=(3.0, 0.0))) for y in (2.9, 3.1)] == [False, True]


def test_places_of_a_field_are_those_of_the_full_frame() -> None:
    seen = lights._sighting(blob(7.0, 10.0), FIELD)
    assert (seen.x, seen.y, seen.var_x, seen.var_y, seen.cov_xy, seen.status) == (7.0, 21.0, 0.01, 0.08, 0.0, "ok")
    assert explain._in_frame((7.0, 10.0), FIELD) == (7.0, 21.0)
    for place, inside in (((7.0, 10.0), True), ((6.9, 10.0), False), ((7.0, 9.9), False), ((9.1, 10.0), False)):
        assert lights._inside(place, (7, 21, 9, 30), FIELD) is inside
    assert lights._inside((9.0, 14.5), (7, 21, 9, 30), FIELD)
    assert not lights._inside((9.0, 14.6), (7, 21, 9, 30), FIELD)
    boxes = TrackingSettings.model_validate({"region_px": (0, 0, 50, 50), "mask_px": [(20, 20, 30, 30)]})
    assert [lights.allowed((x, 25.0), WHOLE, boxes) for x in (10.0, 25.0, 51.0)] == [True, False, False]


def test_lights_are_named_by_their_regions_and_then_from_left_to_right() -> None:
    chosen = [blob(30.0), blob(10.0), blob(20.0)]
    marks = {"a": MarkSettings(kind="light"), "b": MarkSettings(kind="light", region_px=(25, 0, 35, 9)),
             "c": MarkSettings(kind="light", region_px=(80, 0, 90, 9))}  # fmt: skip
    found = lights._named(chosen, marks, WHOLE)
    assert {name: one.place[0] for name, one in found.items()} == {"b": 30.0, "a": 10.0, "c": 20.0}


class Shown:
    """Frames of blobs that are known, in place of images."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, names: str) -> None:
        self.blobs: list[_Blob] = []
        monkeypatch.setattr(lights, "bright_blobs", lambda _: SimpleNamespace(blobs=list(self.blobs)))
        marks = {name: MarkSettings(kind="light") for name in names}
        self.finder = lights.LightFinder(marks, TrackingSettings(mark=marks))

    def look(self, *blobs: _Blob) -> list[Any]:
        self.blobs = list(blobs)
        return [one.x if one.status == "ok" else one.status for one in self.finder.look(WHOLE).values()]


@pytest.mark.parametrize(("third", "told"), [(31.0, True), (32.0, False)])
def test_a_blob_of_a_third_of_the_weakest_light_is_none(
    third: float, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of two lights the weaker has 90: 0.35 of that is 31.5."""
    shown = Shown(monkeypatch, "ab")
    blobs = blob(30.0, light=100.0), blob(10.0, light=90.0), blob(20.0, light=third)
    assert shown.look(*blobs) == ([10.0, 30.0] if told else ["ambiguous", "ambiguous"])


def test_lights_among_glare_are_those_that_move_by_a_radius_and_a_half(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = Shown(monkeypatch, "ab")
    assert shown.look(blob(10.0)) == ["not seen", "not seen"]  # fewer than lights
    assert shown.look(blob(10.0), blob(30.0), blob(50.0)) == ["ambiguous"] * 2
    assert shown.look(blob(12.9), blob(30.0), blob(47.1)) == ["ambiguous"] * 2
    assert shown.look(blob(13.1), blob(30.0), blob(46.9)) == [13.1, 46.9]
    assert shown.look(blob(13.3), blob(30.0), blob(46.7, cut=True)) == [13.3, "outside the image"]
    assert shown.look(blob(30.0), blob(46.5)) == ["not seen", 46.5]
    assert shown.look(blob(13.7), blob(30.0), blob(46.3)) == [13.7, 46.3]


def test_of_many_bright_blobs_the_two_dozen_strongest_are_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    for moving, found in ((23, [1000.0]), (24, ["ambiguous"])):
        shown = Shown(monkeypatch, "a")
        shown.look(*(blob(40.0 * k, light=100.0 - k) for k in range(25)))
        after = [blob(40.0 * k, light=100.0 - k) for k in range(25)]
        after[moving] = blob(40.0 * moving, 4.0, light=100.0 - moving)
        said = shown.look(*after)
        assert (said == [40.0 * moving]) == (moving == 23) == (found != ["ambiguous"])


def test_what_is_as_bright_is_told_with_its_place_in_the_frame_and_why_it_is_no_light() -> None:
    """A field of odd rows with lights of 5 by 5 px, one of which is dim, a stripe and a single pixel."""
    luma = np.zeros((50, 100), np.uint8)
    for row, column, half, level in ((30, 60, 2, 250), (40, 20, 2, 240), (20, 80, 1, 200)):
        luma[row - half : row + half + 1, column - half : column + half + 1] = level
    luma[10:13, 20:40] = 220
    luma[5, 70] = 210
    frame = frame_of(luma, origin=1, step=2)

    def told(*names: str) -> list[tuple[tuple[float, float], float, str, bool]]:
        settings = TrackingSettings.model_validate({"mark": {name: {"kind": "light"} for name in names}})
        shown = explain.explain_luma(frame, settings)
        assert [(seen.mark, seen.cell_px, seen.origin_px) for seen in shown] == [
            (name, (1.0, 2.0), (0.0, 1.0)) for name in names
        ]
        np.testing.assert_array_equal(shown[0].mask, luma > 0)
        assert shown[0].sought.startswith(f"sought: {len(names)} of lights, luma above 100 of 255")
        return [(thing.center_px, thing.radius_px, thing.verdict, thing.chosen) for thing in shown[0].things]

    refused = [
        ((29.5, 23.0), 10.0, "a stripe: 20 by 3 px", False),
        ((70.0, 11.0), 0.5, "too small: 1 px, at least 3 are needed", False),
    ]
    strong, weak = [((60.0, 61.0), 2.5), ((20.0, 81.0), 2.5)], ((80.0, 41.0), 1.5)
    two = told("a", "b")
    assert [thing[:2] for thing in two] == [*strong, weak, *(thing[:2] for thing in refused)]
    assert [thing[2:] for thing in two[:2]] == [("likely a light", True)] * 2
    assert two[2][2:] == (
        f"too weak: {100 * 9 * 200 / (25 * 240):.0f} % of the light of the weakest that is sought",
        False,
    )
    assert two[3:] == refused
    one, three, four = told("a"), told("a", "b", "c"), told("a", "b", "c", "d")
    assert [thing[2] for thing in one[:2]] == [
        "one of 2 where 1 are sought: lights are those that move; say region_px"
    ] * 2
    assert [thing[3] for thing in three] == [True] * 3 + [False] * 2
    assert {thing[2] for thing in four[:3]} == {"likely a light, but only 3 of 4 that are sought are seen"}
