"""The page of the demo: what it shows at once, and until when browsers load it again."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np

from evaluator.recording import Frame
from evaluator.recording.long_exposure import EVERY, long_exposure
from evaluator.report.pages.demo import DemoPage
from evaluator.workflow.samples import sample_folder


def frame_with_mark(column: int, tint: int = 0) -> Frame:
    """A grey frame of 60 by 20 pixels with a green mark four pixels wide; tint: of the plate, in levels."""
    luma, u, v = np.full((20, 60), 90, np.uint8), np.full((10, 30), 128, np.uint8), np.full((10, 30), 128, np.uint8)
    u += np.uint8(tint)
    luma[8:12, column : column + 4] = 150
    u[4:6, column // 2 : column // 2 + 2], v[4:6, column // 2 : column // 2 + 2] = 70, 60
    return Frame(0, 0, Fraction(1, 60), luma, u, v, 8, False, "bt601", 0, 1, "", False, None)


def test_a_mark_is_seen_wherever_it_was_and_a_tint_of_the_plate_is_not() -> None:
    frames = [frame_with_mark(6 if k == 0 else 30 if k == EVERY else 50, tint=k) for k in range(EVERY + 2)]
    image = long_exposure(frames).astype(int)
    green = image[9, :, 1] > image[9, :, 0] + 60
    assert np.flatnonzero(green).tolist() == [6, 7, 8, 9, 30, 31, 32, 33]  # frames between are not taken
    np.testing.assert_array_equal(image[0], frames[0].to_rgb()[0])
    assert (image[9, 30] == image[9, 6]).all()


def test_of_a_grey_recording_the_first_frame_is_shown() -> None:
    frames = [replace(frame_with_mark(column), u=None, v=None) for column in (6, 30)]
    np.testing.assert_array_equal(long_exposure(frames), frames[0].to_rgb())


def test_the_page_shows_the_paths_of_the_marks_at_once_and_ends_with_links(tmp_path: Path) -> None:
    page = DemoPage(tmp_path / "a b" / "index.html")
    page.show_recording(sample_folder() / "straight-60.mp4")
    html = page.path.read_text(encoding="utf-8")
    assert '<meta http-equiv="refresh"' in html
    shown = re.search(r"data:image/jpeg;base64,([^\"]+)", html)
    assert shown
    image = cv2.imdecode(np.frombuffer(base64.b64decode(shown[1]), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    blue, green, red = (image[..., channel].astype(int) for channel in range(3))
    yellow = (red > 150) & (green > 150) & (blue < 100)
    once = (6 * 14) * 5  # px: far more than a mark of some 14 px in diameter
    assert ((green > 150) & (red < 100)).sum() > once
    assert yellow.sum() > once
    page.show_result("Runs", "R < 3 & more", table=True)
    page.show_result("Verdict", "Nothing is missing.\nOr 1 > 2.", table=False)
    page.show_report("First", tmp_path / "a b" / "r" / "report.html", last=False)
    assert "Under way" in page.path.read_text(encoding="utf-8")
    page.show_report("Last", tmp_path / "other" / "report.html", last=True)
    html = page.path.read_text(encoding="utf-8")
    assert "refresh" not in html
    assert "Finished" in html
    assert "<pre>R &lt; 3 &amp; more</pre>" in html
    assert "<p>Nothing is missing.</p><p>Or 1 &gt; 2.</p>" in html
    assert 'href="r/report.html"' in html
    assert 'href="../other/report.html"' in html
