"""The page of the demo, which a person may open after the first seconds: it is written anew with every result."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import cv2
from markupsafe import escape

from evaluator.files import named_from, write_text
from evaluator.recording import open_recording
from evaluator.recording.long_exposure import long_exposure
from evaluator.report.pages.html import Page, Section, page_html

RELOADED_S = 2  # while results are to come


@dataclass
class DemoPage:
    """The page and its content so far; every addition writes the file."""

    path: Path
    sections: list[Section] = field(default_factory=list)

    def show_recording(self, video: Path) -> None:
        """Add a recording as one image."""
        image = cv2.cvtColor(long_exposure(open_recording(video, threads=1)), cv2.COLOR_RGB2BGR)
        jpeg = base64.b64encode(cv2.imencode(".jpg", image)[1].tobytes()).decode()
        html = f'<figure><div class="drawing"><img alt="paths" src="data:image/jpeg;base64,{jpeg}"></div></figure>'
        text = f"{video.name} in one image: the two marks draw their paths, and the robot is where it began."
        self._add("A recording", (text,), html)

    def show_result(self, title: str, text: str, *, table: bool) -> None:
        """Add a result: a table of text, or lines of sentences."""
        if table:
            self._add(title, html=f"<pre>{escape(text)}</pre>")
        else:
            self._add(title, text.splitlines())

    def show_report(self, title: str, report: Path, *, last: bool) -> None:
        """Add a link to a report. last: nothing follows, and browsers do not load the page again."""
        where = escape(named_from(self.path.parent, report))
        self._add(title, html=f'<p><a href="{where}">{where}</a></p>', last=last)

    def _add(self, title: str, text: Iterable[str] = (), html: str = "", *, last: bool = False) -> None:
        self.sections.append(Section(f"part-{len(self.sections)}", title, tuple(text), html=html))
        page = Page(
            kind="demo",
            title="From recordings to reports",
            facts=(),
            summary=("Finished." if last else "Under way: every result appears here as soon as it is known.",),
            sections=tuple(self.sections),
            footer="Made by turnscope demo.",
            reloaded_s=0 if last else RELOADED_S,
        )
        write_text(self.path, page_html(page))
