"""What frames, their times and their fields say, in closed form and without a file."""

from __future__ import annotations

from collections import OrderedDict
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.errors import InputError
from evaluator.recording import images, seek
from evaluator.recording.fields import field_order, fields_of
from evaluator.recording.frame import Frame
from evaluator.recording.groups import Groups, groups_of
from evaluator.recording.images import _planes
from evaluator.recording.layout import _same
from evaluator.recording.seek import Contents, Frames, _Seeking
from evaluator.recording.timing import clock_runs, in_order, summarise

COLORS = np.array([[255, 255, 255], [0, 0, 0], [200, 30, 60], [20, 220, 90], [40, 60, 210], [128, 128, 128]], float)


def frame(luma: np.ndarray, u: Any = None, v: Any = None, depth: int = 8, **said: Any) -> Frame:
    usual: dict[str, Any] = {"full_range": True, "matrix": "bt601", "row_origin": 0, "row_step": 1, "kind": ""}
    return Frame(3, 7, Fraction(1, 30), luma, u, v, depth, repeated=False, owner=None, **usual | said)


def coded(kr: float, kb: float, depth: int, *, full: bool) -> list[np.ndarray]:
    """Luma and colour planes of COLORS by the equations of ITU-R BT.601 and BT.709; 4:2:2, one colour a pair."""
    red, green, blue = COLORS.T / 255
    luma = kr * red + (1 - kr - kb) * green + kb * blue
    planes = luma, (blue - luma) / (2 * (1 - kb)), (red - luma) / (2 * (1 - kr))
    scale, (low, wide, colors) = 2 ** (depth - 8), (0, 255, 255) if full else (16, 219, 224)
    numbers = [scale * (low + wide * planes[0]), *(scale * (128 + colors * plane) for plane in planes[1:])]
    whole = [
        np.clip(np.rint(values), 0, 2**depth - 1).astype(np.uint16 if depth > 8 else np.uint8) for values in numbers
    ]
    return [np.tile(np.repeat(whole[0], 2), (3, 1)), *(np.tile(values, (3, 1)) for values in whole[1:])]


@pytest.mark.parametrize(("matrix", "kr", "kb"), [("bt601", 0.299, 0.114), ("bt709", 0.2126, 0.0722)])
@pytest.mark.parametrize(("depth", "full"), [(8, True), (8, False), (10, False), (12, True)])
def test_colours_come_back_from_the_equations_of_their_standard(
    matrix: str, kr: float, kb: float, depth: int, full: bool
) -> None:
    seen = frame(*coded(kr, kb, depth, full=full), depth, matrix=matrix, full_range=full)
    image = seen.to_rgb()
    assert image.shape == (3, 12, 3)
    assert np.abs(image[1].astype(float) - np.repeat(COLORS, 2, axis=0)).max() <= 2.0


@pytest.mark.parametrize("depth", [8, 16])
def test_an_image_is_the_frame_that_shows_its_colours(depth: int) -> None:
    kind, unit = (np.uint8, 1) if depth == 8 else (np.uint16, 257)
    image = (unit * np.tile(COLORS[:, ::-1], (2, 1, 1))).astype(kind)  # blue, green, red
    luma, u, v, found = _planes(image, "a.png")
    assert found == depth
    assert np.abs(frame(luma, u, v, depth, full_range=True).to_rgb().astype(float) - COLORS).max() <= 2.0
    grey, *colors = _planes(image[..., 0], "a.png")
    np.testing.assert_array_equal(grey, image[..., 0])
    assert colors == [None, None, depth]
    with pytest.raises(InputError, match="float32"):
        _planes(image.astype(np.float32), "a.png")


def test_images_of_a_stack_are_frames_at_its_rate_up_to_the_one_that_is_damaged(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    one, other = (np.full((4, 6), value, np.uint8) for value in (10, 20))
    held: list[Any] = [one, other, other, None, one]
    monkeypatch.setattr(images, "count_images", lambda _path: 5)
    monkeypatch.setattr(images, "read_stack", lambda _path: iter(held))
    stack = images.ImageSequence(tmp_path / "a.tif", Fraction(25))
    seen = list(stack)
    assert [(frame.index, frame.time_s, frame.repeated) for frame in seen] == [
        *((0, 0.0, False), (1, 0.04, False), (2, 0.08, True)),
    ]
    report = stack.report()
    assert (report.frames, report.duplicates) == (3, (2,))
    assert any("its image 4 cannot be read" in note for note in report.notes)
    held[0] = None
    with pytest.raises(InputError, match="image 1: not a readable image"):
        list(stack)
    held[:2] = [one, one[:3]]
    with pytest.raises(InputError, match="image 2: is 6×3 but the images before are 6×4"):
        list(stack)
    assert stack.size_px == (6, 4)


def test_grey_frames_and_fields_have_their_time_size_and_lines() -> None:
    luma = np.arange(12, dtype=np.uint8).reshape(3, 4)
    grey = frame(luma, row_step=2)
    assert (grey.time, grey.time_s, grey.size_px) == (Fraction(7, 30), 7 / 30, (4, 6))
    np.testing.assert_array_equal(grey.to_rgb(), np.repeat(np.repeat(luma[..., None], 3, axis=2), 2, axis=0))
    limited = frame(np.array([[16, 235]], np.uint8), full_range=False).to_rgb()
    assert limited[0, :, 0].tolist() == [0, 255]


@pytest.mark.parametrize(("depth", "middle", "within"), [(8, 128, 2), (10, 512, 8)])
def test_a_frame_is_grey_whose_colours_lie_within_two_levels_of_eight_bits(
    depth: int, middle: int, within: int
) -> None:
    luma = np.zeros((4, 4), np.uint16)
    for u, v, grey in (
        (within, -within, True),
        (within + 1, 0, False),
        (0, -within - 1, False),
        (0, within + 1, False),
    ):
        planes = [np.full((2, 2), middle, np.uint16) for _ in range(2)]
        planes[0][1, 1], planes[1][0, 1] = middle + u, middle + v
        assert frame(luma, *planes, depth).colourless == grey
    assert frame(luma).colourless


def test_two_frames_are_the_same_only_where_all_samples_are() -> None:
    one = np.random.default_rng(0).integers(0, 255, (100, 9)).astype(np.uint8)
    assert _same(one, one.copy())
    assert not _same(one, one[:99])
    for row in range(100):
        other = one.copy()
        other[row, 4] ^= 1
        assert not _same(one, other)


TICK = Fraction(1, 1000)


def test_rate_is_of_the_commonest_interval_and_gaps_are_counted_in_it() -> None:
    ticks = [0, 33, 67, 100, 200, 233, 267, 300]  # three a tenth of a second, two of them missing
    report = summarise(ticks, TICK, [2, 5], ["said before"])
    assert report.interval == Fraction(200, 6000)
    assert report.rate_hz == pytest.approx(30.0)
    assert (report.frames, report.first, report.last) == (8, 0, Fraction(3, 10))
    assert report.dropped == ((4, 2),)
    assert not report.variable
    assert report.notes == (
        "said before",
        "2 frames are missing in 1 gap, the first before frame 4",
    )
    assert report.duplicates == (2, 5)
    assert np.isnan(summarise([5], TICK, [], []).rate_hz)
    assert summarise([], TICK, [], []).first is None


@pytest.mark.parametrize(("step", "missing"), [(149, ()), (150, ((3, 1),)), (249, ((3, 1),)), (251, ((3, 2),))])
def test_a_gap_is_half_an_interval_longer_and_a_whole_number_of_intervals(step: int, missing: tuple[Any, ...]) -> None:
    ticks = np.cumsum([0, 100, 100, step, *[100] * 60]).tolist()
    assert summarise(ticks, TICK, [], []).dropped == missing


@pytest.mark.parametrize(("odd", "varies"), [(5, False), (6, True)])
def test_a_rate_varies_where_more_than_one_interval_of_twenty_is_off_by_more_than_two_ticks(
    odd: int, varies: bool
) -> None:
    steps = [102, 98, *[100] * (98 - odd), *[103] * odd]
    report = summarise(np.cumsum([0, *steps]).tolist(), TICK, [], [])
    assert report.variable == varies
    assert report.notes == (("the frame rate varies; the time stamp of each frame is used",) if varies else ())


@pytest.mark.parametrize(("step", "interval"), [(8, 8), (9, Fraction(91, 10))])
def test_intervals_of_nine_ticks_and_more_are_averaged_over_their_rounding(step: int, interval: Fraction) -> None:
    """A clock of few ticks a frame gives whole numbers of them; one of many rounds each time to a tick."""
    ticks = np.cumsum([0, *([step] * 9), step + 1])
    assert summarise(ticks.tolist(), Fraction(1), (), ()).interval == interval


def test_where_the_rate_varies_no_frame_is_missing() -> None:
    report = summarise(np.cumsum([0, *([100, 170] * 10)]).tolist(), Fraction(1, 1000), (), ())
    assert (report.variable, report.dropped) == (True, ())


def test_times_of_two_neighbours_that_run_backwards_are_exchanged_and_frames_stay_in_order() -> None:
    timed = [("a", 0), ("b", 2), ("c", 1), ("d", None), ("e", 3)]
    assert list(in_order(timed)) == [("a", 0), ("b", 1), ("c", 2), ("d", None), ("e", 3)]
    assert list(in_order([])) == []
    assert clock_runs([SimpleNamespace(pts=pts) for pts in (None, 4, 4, 5)])
    assert not clock_runs([SimpleNamespace(pts=4)] * 3)
    assert clock_runs([SimpleNamespace(pts=4), SimpleNamespace(pts=None)])


@pytest.mark.parametrize(("first", "lines"), [("top", (0, 1)), ("bottom", (1, 0))])
def test_fields_are_every_second_line_half_a_frame_apart(first: str, lines: tuple[int, int]) -> None:
    luma, u, v = np.arange(24).reshape(6, 4), np.arange(12).reshape(6, 2), 50 + np.arange(12).reshape(6, 2)
    early, late = fields_of(frame(luma, u, v), first, 1, 10)
    for field, index, line, ticks in ((early, 10, lines[0], 14), (late, 11, lines[1], 15)):
        assert (field.index, field.ticks, field.tick) == (index, ticks, Fraction(1, 60))
        assert (field.row_origin, field.row_step) == (line, 2)
        for plane, whole in ((field.luma, luma), (field.u, u), (field.v, v)):
            np.testing.assert_array_equal(plane, whole[line::2])
    assert next(fields_of(frame(luma), first, 1, 0)).u is None


def scene(t: float, level: float = 150.0) -> np.ndarray:
    """A soft spot that moves 3 px in a unit of time."""
    y, x = np.mgrid[:96, :128]
    return 30 + level / (1 + np.exp(np.hypot(x - 20 - 3 * t, y - 48) - 12))


@pytest.mark.parametrize("depth", [8, 10])
def test_order_of_fields_is_seen_from_what_moves(depth: int) -> None:
    def seen(kind: str, level: float = 150.0, step: float = 1.0) -> str | None:
        frames = []
        for k in range(round(12 / (step or 1.0))):
            woven = scene(step * k, level)
            if kind in ("top", "bottom"):
                woven[(kind == "top") :: 2] = scene(step * (k + 0.5), level)[(kind == "top") :: 2]
            frames.append(
                frame(np.rint(woven * 2 ** (depth - 8)).astype(np.uint16 if depth > 8 else np.uint8), None, None, depth)
            )
        return field_order(frames)

    for kind in ("none", "top", "bottom"):
        assert seen(kind) == kind
        assert seen(kind, step=0.1) == kind  # 0.15 px a field: lines differ by less than soft edges do
    assert seen("top", step=0.0) is None  # at rest
    assert seen("top", level=11.0) is None  # no edge of twelve levels


class Packet(bytes):
    """What a decoder is given of a frame."""

    is_keyframe = True


def gradients(lead: float, columns: int = 48) -> list[Frame]:
    """Three frames of a gradient of 4 levels per px that moves 2 px a frame; every second line leads by a share."""
    times = np.arange(3)[:, None, None] + lead * (np.arange(40) % 2 == 0)[:, None]
    levels = 4 * (np.arange(columns) + 8 - 2 * times)
    return [frame(np.rint(16 * one).astype(np.uint16), depth=12) for one in levels]


@pytest.mark.parametrize(("lead", "order"), [(0.24, "none"), (0.26, "bottom"), (-0.24, "none"), (-0.26, "top")])
def test_a_field_is_ahead_from_a_quarter_of_a_frame(lead: float, order: str) -> None:
    assert field_order(gradients(lead)) == order


@pytest.mark.parametrize(("columns", "told"), [(10, False), (11, True)])
def test_four_hundred_moved_pixels_tell_the_order(columns: int, *, told: bool) -> None:
    """In 38 of 40 lines, which have a neighbour above and below."""
    assert (field_order(gradients(0.5, columns)) is not None) == told


def test_single_pixels_that_flicker_tell_nothing() -> None:
    rng, frames = np.random.default_rng(1), []
    for _ in range(6):
        luma = np.full((80, 90), 100, np.uint8)
        luma[:, ::3] += (60 * (rng.random((80, 30)) < 0.5)).astype(np.uint8)
        frames.append(frame(luma))
    assert field_order(frames) is None


def units(*kinds: int, length_bytes: int = 4) -> Packet:
    """A packet of NAL units of 3 bytes: kind, and two more, each after its length."""
    return Packet(b"".join((3).to_bytes(length_bytes, "big") + bytes([0x60 | kind, 5, 5]) for kind in kinds))


def test_a_group_begins_with_an_idr_slice_whatever_stands_before_it() -> None:
    for length_bytes in (2, 4):
        groups = Groups(length_bytes)
        assert groups.begins(units(6, 7, 8, 5, length_bytes=length_bytes))
        assert not groups.begins(units(6, 1, 5, length_bytes=length_bytes))  # starts an open group
        assert not groups.begins(units(6, 7, length_bytes=length_bytes))
    plain = units(5)
    plain.is_keyframe = False
    assert not Groups(4).begins(plain)
    assert Groups(4).several([units(5), units(1), units(5)])
    assert not Groups(4).several([units(5), units(1), units(1)])


@pytest.mark.parametrize(
    ("name", "tables", "length_bytes"),
    [("h264", b"\x01\x64\x00\x1f\xff", 4), ("h264", b"\x01\x64\x00\x1f\xfd", 2), ("h264", b"\x01\x64\x00\x1f", None),
     ("h264", b"\x00\x00\x00\x01\x67", None), ("hevc", b"\x01\x64\x00\x1f\xff", None)],
)  # fmt: skip
def test_groups_are_told_where_h264_units_tell_their_length(name: str, tables: bytes, length_bytes: int | None) -> None:
    context = SimpleNamespace(extradata=tables, codec=SimpleNamespace(name=name))
    assert groups_of(SimpleNamespace(codec_context=context)) == (None if length_bytes is None else Groups(length_bytes))


def test_frames_that_were_asked_for_last_are_kept_up_to_the_size_of_the_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seek, "CACHE_BYTES", 30)
    decoded = []

    def until(index: int) -> Any:
        decoded.append(index)
        return [(index, f"image {index}")]

    frames: Any = Frames.__new__(Frames)
    contents = Contents(tuple(float(k) for k in range(9)), (0, 4, 8), (64, 48))
    frames._source = SimpleNamespace(contents=contents, until=until, frame_bytes=10, to_image=lambda image: image)
    frames._cache, frames._bytes = OrderedDict(), 0
    for index, again in ((0, 1), (1, 1), (2, 1), (0, 0), (3, 1), (0, 0), (2, 0), (1, 1)):  # 0 is kept: it was asked for
        decoded.clear()
        assert frames.image(index) == f"image {index}"
        assert len(decoded) == again
    assert [frames.key_frame(index) for index in (0, 3, 4, 7, 8)] == [0, 0, 4, 4, 8]


def test_a_recording_is_closed_once_it_was_opened() -> None:
    closed = []
    source = _Seeking.__new__(_Seeking)
    for source._container in (None, SimpleNamespace(close=lambda: closed.append(True))):
        source.close()
    assert closed == [True]
