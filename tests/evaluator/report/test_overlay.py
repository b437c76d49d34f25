"""What is drawn on frames: marks, trails, axes and words lie where the table says, and doubtful frames are found."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import cv2
import numpy as np
import pandas as pd
import pytest

from evaluator.report import overlay
from evaluator.report.measurement import search_sheet
from evaluator.report.overlay import CENTER, CIRCLE, INK, OTHER, WARNING, Drawing, color_of, doubtful, draw_frame
from evaluator.tracking.luma_marks.explain import SeenInLuma, Thing

GREEN = color_of("green")


def frame(index: int = 0, size: tuple[int, int] = (640, 480)) -> Any:
    """A grey frame; its red channel holds the column, its green one the row, both halved."""
    rows, columns = np.mgrid[: size[1], : size[0]]
    image = np.stack([columns // 3, rows // 2, np.full_like(rows, 40)], axis=-1).astype(np.uint8)
    return SimpleNamespace(to_rgb=image.copy, index=index, time=Fraction(index, 60), tick=Fraction(1, 60))


def table_of(x: list[float], y: list[float], sigma: list[float] | None = None, status: str = "ok") -> pd.DataFrame:
    """Marks of a table; a frame without a mark says why."""
    there = np.isfinite(x)
    spread = np.where(there, 0.01 if sigma is None else sigma, np.nan)
    return pd.DataFrame(
        {
            "frame": 10 + np.arange(len(x)),
            "time_s": 0.5 * np.arange(len(x)),
            "green_x_px": x,
            "green_y_px": y,
            "green_x_sigma_px": 0.6 * spread,
            "green_y_sigma_px": 0.8 * spread,
            "green_status": np.where(there, status, "not seen"),
        }
    )


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Any]]:
    """What draw_frame asks for, in order: lines, arrows and words."""
    found: dict[str, list[Any]] = {"lines": [], "arrows": [], "words": []}
    monkeypatch.setattr(
        overlay,
        "_line",
        lambda _, points, color, thick, closed=False: found["lines"].append((points.tolist(), color, thick, closed)),
    )
    monkeypatch.setattr(
        overlay,
        "_arrow",
        lambda _, start, tip, color, thick: found["arrows"].append((start.tolist(), tip.tolist(), color, thick)),
    )
    monkeypatch.setattr(
        overlay, "_write", lambda _, text, place, size, color: found["words"].append((text, place, size, color))
    )
    return found


def test_a_mark_is_ringed_by_four_strokes_behind_its_trail_which_has_gaps_where_it_was_absent(
    drawn: dict[str, list[Any]],
) -> None:
    table = table_of([90.0, 100.0, np.nan, 120.0, 130.0, 140.0], [50.0] * 6)
    draw_frame(frame(), table, 4, Drawing())
    trails, strokes = drawn["lines"][:2], drawn["lines"][2:]
    assert trails == [
        ([[90.0, 50.0], [100.0, 50.0]], GREEN, 1, False),
        ([[120.0, 50.0], [130.0, 50.0]], GREEN, 1, False),  # the last frame is not yet there
    ]
    ends = [np.subtract(points, [130.0, 50.0]) for points, color, _, _ in strokes if color == GREEN]
    ways = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    np.testing.assert_allclose(ends, np.stack([6.0 * ways, 2.2 * 6.0 * ways], axis=1))  # of an image 480 px high
    drawn["lines"].clear()
    draw_frame(frame(), table, 2, Drawing())
    assert len(drawn["lines"]) == 2  # no strokes about a mark that is absent
    assert [words for words, *_ in drawn["words"][-2:]] == ["   1.000 s   frame 12", "green: not seen"]


def test_trails_show_the_last_240_frames_and_strokes_grow_with_the_image(drawn: dict[str, list[Any]]) -> None:
    many = np.arange(300.0)
    draw_frame(frame(size=(1280, 960)), table_of(many.tolist(), many.tolist()), 290, Drawing())
    (trail, _, thick, _), stroke = drawn["lines"][0], drawn["lines"][1]
    assert (trail[0], trail[-1], thick) == ([50.0, 50.0], [290.0, 290.0], 2)
    assert stroke[0] == [[302.0, 290.0], [316.4, 290.0]]
    assert drawn["words"] == [(" 145.000 s   frame 300", (16, 40), 2.0, INK)]
    draw_frame(frame(size=(160, 120)), table_of([5.0], [5.0]), 0, Drawing())
    smallest = [[5 + 3.6, 5.0], [5 + 2.2 * 3.6, 5.0]]  # of 288 px
    np.testing.assert_allclose(drawn["lines"][-4][0], smallest)


def test_body_circle_and_axes_are_drawn_with_their_colors_and_the_caption_beside_the_time(
    drawn: dict[str, list[Any]],
) -> None:
    table = table_of([1.0, 2.0], [1.0, 2.0], status="corrected")
    places = {name: np.array([[10.0, 20.0], [30.0 + k, 40.0]]) for k, name in enumerate(("center", "nose", "left"))}
    shown = Drawing(
        *(places[name] for name in ("center", "nose", "left")),
        circle_px=np.array([[0.0, 0.0], [5.0, 5.0]]),
        axes_px=np.array([[100.0, 200.0], [140.0, 200.0], [100.0, 160.0]]),
        caption="R = 8.00 mm",
    )
    draw_frame(frame(), table, 1, shown)
    assert drawn["lines"][0] == ([[0.0, 0.0], [5.0, 5.0]], CIRCLE, 1, True)
    assert ([[10.0, 20.0], [30.0, 40.0]], CENTER, 1, False) in drawn["lines"]
    assert drawn["arrows"] == [
        ([30.0, 40.0], [31.0, 40.0], CENTER, 2),
        ([30.0, 40.0], [32.0, 40.0], CENTER, 1),
        ([100.0, 200.0], [140.0, 200.0], INK, 1),
        ([100.0, 200.0], [100.0, 160.0], INK, 1),
    ]
    assert drawn["words"] == [
        ("x", (147, 205), 1.0, INK),  # 12 px beyond the tip, in the middle of the letter
        ("y", (95, 153), 1.0, INK),
        ("   0.500 s   frame 11   R = 8.00 mm", (8, 20), 1.0, INK),
    ]
    drawn["arrows"].clear()
    lost = np.full((2, 2), np.nan)
    draw_frame(frame(), table, 1, Drawing(center_px=lost, nose_px=lost, left_px=lost))
    assert drawn["arrows"] == []
    draw_frame(frame(), table, 1, Drawing(center_px=places["center"], nose_px=places["nose"]))
    assert len(drawn["arrows"]) == 1


def test_lines_arrows_and_words_reach_the_pixels_that_they_are_asked_for() -> None:
    image = np.full((60, 200, 3), 90, np.uint8)
    overlay._line(image, np.array([[10.0, 20.0], [30.0, 20.0], [30.0, 40.0]]), (255, 0, 0), 1)
    assert (np.abs(image[[20, 30], [20, 30]] - np.array([255, 0, 0])) < 30).all()
    assert image[30, 20, 0] == 90  # not closed
    overlay._line(image, np.array([[12.0, 50.0]]), (255, 0, 0), 1)
    assert image[50, 12, 0] == 90  # a point is no line
    overlay._arrow(image, np.array([60.0, 30.0]), np.array([80.0, 30.0]), (0, 255, 0), 1)
    assert image[30, 70, 1] > 200
    assert image[26, 62, 1] == 90  # the head is at the tip
    assert image[33, 77, 1] > 90
    overlay._write(image, "M", (120, 30), 1.0, (255, 255, 255))
    assert image[25, 117].tolist() == [30, 30, 30]  # a darkened strip around it
    assert image[18:31, 120:132].max() > 200
    assert image[40, 117].tolist() == image[25, 112].tolist() == [90, 90, 90]


def test_doubtful_are_absent_marks_and_sigmas_far_above_the_usual_one_of_each_stretch_and_the_worst_are_kept() -> None:
    sigma, x = np.full(40, 0.1), np.full(40, 1.0)
    sigma[5], sigma[8], sigma[9] = 0.26, 0.3, 0.251  # one stretch: three frames apart
    sigma[20] = 0.249
    sigma[30] = 0.9
    x[13] = np.nan  # four frames after the stretch before
    table = table_of(x.tolist(), x.tolist(), sigma.tolist())
    assert doubtful(table, 9) == [(8, "green"), (13, "green"), (30, "green")]
    assert doubtful(table, 2) == [(13, "green"), (30, "green")]  # absent is worst, then ninefold, then a stretch
    assert doubtful(table.iloc[:5], 9) == []
    lost = table_of([np.nan] * 3, [np.nan] * 3)
    assert doubtful(lost, 9) == [(0, "green")]
    longer = table_of([1.0] * 20, [1.0] * 20, [0.1] * 8 + [0.3] * 4 + [0.1] * 4 + [0.4, 0.1, 0.1, 0.1])
    assert doubtful(longer, 1) == [(8, "green")]  # 3 · √4 is more than 4


def test_a_cut_out_shows_48_px_about_the_mark_five_times_as_large_and_why_it_is_doubtful(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    words: list[tuple[Any, ...]] = []
    monkeypatch.setattr(overlay, "_write", lambda _, text, place, __, color: words.append((text, place, color)))
    crosses: list[Any] = []
    monkeypatch.setattr(overlay, "_cross", lambda _, point, color, *__: crosses.append((point.tolist(), color)))
    table = table_of([100.0, np.nan, 300.0], [200.0] * 3, [0.1, 0.1, 0.3])
    tile = overlay._tile(frame(12), table, "green")
    assert tile.shape == (240, 240, 3)
    assert tile[120, 120].tolist() == [100, 100, 40]  # column 300, row 200
    assert tile[120, 20].tolist() == [(300 - 20) // 3, 100, 40]
    assert tile[220, 120].tolist() == [100, (200 + 20) // 2, 40]
    assert tile[-1, 5].tolist() == tile[5, -1].tolist() == [60, 60, 60]
    assert crosses == [([120.0, 120.0], GREEN)]
    assert [(text, place[0]) for text, place, _ in words] == [
        *(("frame 12: 1.000 s", 6), ("green:", 6), ("sigma 0.3 px, usually 0.2", 6)),
    ]
    assert [place[1] for _, place, _ in words] == [16, 213, 232]
    absent = overlay._tile(frame(11), table, "green")  # where it was in the nearest frame
    assert absent[120, 120].tolist() == [33, 100, 40]
    assert len(crosses) == 1
    assert words[-1][0] == "not seen"
    lost = overlay._tile(frame(10), table_of([np.nan], [np.nan]), "green")
    assert lost[120, 120].tolist() == [320 // 3, 120, 40]  # the middle of the image


def test_an_overlay_has_the_frames_the_times_and_the_even_size_of_its_recording(tmp_path: Path) -> None:
    frames = [frame(index, (97, 65)) for index in (0, 1, 3)]  # one frame is missing
    told: list[tuple[float, float]] = []
    overlay.write_overlay(
        frames,
        table_of([10.0] * 3, [20.0] * 3),
        tmp_path / "a.mp4",
        None,
        lambda _, done, total=1: told.append((done, total)),
    )
    with av.open(str(tmp_path / "a.mp4")) as video:
        shown = list(video.decode(video=0))
    assert [(one.width, one.height) for one in shown] == [(96, 64)] * 3
    assert [float(one.time or 0.0) for one in shown] == pytest.approx([0.0, 1 / 60, 3 / 60], abs=1e-3)
    assert told == [(1, 3), (2, 3), (3, 3)]


def test_a_sheet_has_six_cut_outs_in_a_row_and_none_where_nothing_is_doubtful(tmp_path: Path) -> None:
    assert overlay.write_contact_sheet([], table_of([1.0] * 3, [1.0] * 3), tmp_path / "a.png") == 0
    assert not (tmp_path / "a.png").exists()
    lost = [np.nan if row % 5 == 0 else 9.0 for row in range(40)]  # eight of them, five frames apart
    frames = [frame(10 + row, (64, 48)) for row in range(40)]
    assert overlay.write_contact_sheet(frames, table_of(lost, lost), tmp_path / "a.png") == 8
    sheet = cv2.imread(str(tmp_path / "a.png"))
    assert sheet is not None
    assert sheet.shape[:2] == (2 * 240, 6 * 240)
    assert sheet[240:, :480].max() > 0
    assert sheet[240:, 480:].max() == 0  # blank
    assert overlay.write_contact_sheet(frames, table_of(lost, lost), tmp_path / "a.png", most=2) == 2


def test_a_color_is_that_of_the_name_of_the_mark() -> None:
    assert color_of("left") == OTHER
    assert color_of("green_left") == GREEN
    red, green, blue = GREEN
    assert green == 255
    assert max(red, blue) < 200
    red, green, blue = color_of("blue")
    assert blue == 255
    assert max(red, green) < 200
    assert overlay._short(Fraction(1, 1_000_000)) == Fraction(1, 1_000_000)
    assert overlay._short(Fraction(1, 1_000_001)) == Fraction(1, 90_000)


def test_a_sheet_of_the_search_numbers_what_is_found_in_the_frame_and_in_the_mask(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A mask of cells of 4 by 2 px that begins at (40, 20) px; of 640 px the sheet shows 620."""
    put: list[tuple[str, tuple[int, int], Any]] = []
    circles: list[tuple[tuple[int, int], int, Any]] = []
    monkeypatch.setattr(search_sheet.cv2, "putText", lambda _, text, at, *rest: put.append((text, at, rest[2])))
    monkeypatch.setattr(search_sheet.cv2, "circle", lambda _, *asked: circles.append(asked[:3]))
    mask = np.zeros((100, 100), bool)
    mask[10, 20] = True  # about px 120, 40
    things = (
        Thing((122.0, 41.0), 8.0, "hue 120 deg", "chosen", chosen=True),
        Thing((300.0, 200.0), 2.0, "hue 125 deg", "too small", chosen=False),
    )
    table = table_of([1.0, 2.0], [1.0, 2.0])
    seen = SeenInLuma("green", mask, (4.0, 2.0), (40.0, 20.0), "sought: green", things)
    panel = search_sheet._panel(frame(11), seen, table, 1)
    scale = 620 / 640
    assert panel.shape == (465 + 5 * 20, 2 * 620, 3)
    row, column = round(40 * scale), 620 + round(120 * scale)
    assert panel[row, column].tolist() == list(GREEN)
    assert panel[[row, row - 4], [column + 6, column]].max() < 60  # dark beside the cell
    assert circles == [
        *[((118, 40), 12, search_sheet.CHOSEN)] * 2,
        *[((291, 194), 6, WARNING)] * 2,  # never smaller than 6 px
    ]
    assert [(text, at) for text, at, _ in put[:4]] == [*[("1", (130, 28))] * 2, *[("2", (297, 188))] * 2]
    assert [(text, at, ink) for text, at, ink in put[4:]] == [
        ("frame 11, 0.500 s, mark green: ok", (8, 20), INK),
        ("sought: green", (8, 40), INK),
        ("1: at 122, 41 px, 16 px across, hue 120 deg: chosen", (8, 60), search_sheet.CHOSEN),
        ("2: at 300, 200 px, 4 px across, hue 125 deg: too small", (8, 80), WARNING),
    ]
    put.clear()
    search_sheet._panel(frame(11), SeenInLuma("green", mask, (4.0, 2.0), (40.0, 20.0), "", ()), table, 1)
    assert put[-1] == ("no candidate in this frame", (8, 60), WARNING)
