"""The page of the demo: what it shows at once, and until when browsers load it again."""

from __future__ import annotations

import base64
import re
from pathlib import Path

import cv2
import numpy as np

from evaluator.report.pages.demo import DemoPage
from evaluator.workflow.samples import sample_folder


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
