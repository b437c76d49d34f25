"""Common style of all figures: colours of the page (pages/colors.py), and distinct markers and lines without colour.

Each series has its own marker and line style. In the SVG every colour is a CSS variable with the light colour as its
fallback.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure as Canvas
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from evaluator.report.fewer_elements import fewer_elements
from evaluator.report.pages.colors import BLUE, FAINT, GREEN, INK, ORANGE, PURPLE, SKY, SOFT, THEME, VERMILLION


@dataclass(frozen=True)
class Series:
    """Style of one series; filled markers are measured, open ones are not."""

    color: str
    marker: str
    line: str
    filled: bool = True

    def markers(self) -> dict[str, Any]:
        """Arguments for points."""
        look: dict[str, Any] = {"color": self.color, "marker": self.marker, "ls": "none"}
        return look if self.filled else {**look, "mfc": "none", "ms": 7.5, "zorder": 3}


MEASURED = Series(BLUE, "o", "-")
SIMULATED = Series(VERMILLION, "s", "--", filled=False)
THEORY = Series(SOFT, "", ":")
GROUPS = (
    Series(BLUE, "o", "-"), Series(VERMILLION, "s", "--"), Series(GREEN, "^", "-."), Series(PURPLE, "D", ":"),
    Series(ORANGE, "v", "-"), Series(SKY, "P", "--"),
)  # fmt: skip

STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",  # text is kept as text: it can be searched, and has the font of the page
    "font.family": "sans-serif",
    "font.size": 9.0,
    "text.color": INK,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": INK,
    "axes.facecolor": "none",
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
    "figure.facecolor": "none",
    "grid.color": FAINT,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.4,
    "lines.markersize": 5.0,
    "lines.markeredgewidth": 1.2,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
}


@dataclass(frozen=True)
class Line:
    """Style of a line in figures, their legend and the player: CSS colour, width, dashes in widths.

    marker: "square" (open) or "dot" if points are drawn instead.
    """

    color: str
    text: str
    width: float = 1.0
    dash: tuple[float, ...] = ()
    marker: str = ""

    @property
    def drawn(self) -> dict[str, Any]:
        """Arguments for matplotlib."""
        light = next(light for light, (variable, _) in THEME.items() if variable == f"--{self.color}")
        return {"color": light, "lw": self.width, "ls": (0, self.dash) if self.dash else "-"}

    @property
    def dasharray(self) -> str:
        """The dashes in the units of the page, for SVG."""
        return " ".join(f"{part * self.width:g}" for part in self.dash) or "none"


# Marks in order: CSS colour and dashes; a mark whose name begins with a colour of the page has that colour.
MARK_LOOKS: tuple[tuple[str, tuple[float, ...]], ...] = (
    ("green", ()),
    ("yellow", (6.4, 1.6, 1.0, 1.6)),
    ("purple", (3.0, 1.5)),
    ("orange", (1.0, 1.5)),
    ("sky", (8.0, 2.0)),
)


def mark_lines(names: Sequence[str]) -> tuple[Line, ...]:
    """Styles of the paths of marks."""
    colors = {variable.removeprefix("--") for variable, _ in THEME.values()}
    lines = []
    for k, name in enumerate(names):
        color, dash = MARK_LOOKS[k % len(MARK_LOOKS)]
        word = name.split("_", maxsplit=1)[0]
        lines.append(Line(word if word in colors else color, f"{name.replace('_', ' ')} mark", 1.0, dash))
    return tuple(lines)


@dataclass(frozen=True)
class Figure:
    """A finished figure: caption, panels as inline SVG, and its data.

    legend: lines of a legend shared by all panels, drawn by the page.
    """

    name: str
    title: str
    caption: str
    panels: tuple[str, ...]
    data: pd.DataFrame
    legend: tuple[Line, ...] = ()

    @property
    def wide(self) -> bool:
        """Whether it takes the whole width of the page."""
        return len(self.panels) > 1

    @property
    def csv(self) -> str:
        """The data as CSV text."""
        return self.data.to_csv(index=False, float_format="%.6g")


class Drawing:
    """A canvas during drawing; `svg` contains the SVG after the end of the `drawing` block."""

    def __init__(self, canvas: Canvas, axes: list[Axes]) -> None:
        """Start with an empty canvas."""
        self.canvas = canvas
        self.axes = axes
        self.svg = ""


@contextmanager
def drawing(
    name: str, *, width: float = 4.7, height: float = 3.4, rows: int = 1, columns: int = 1
) -> Iterator[Drawing]:
    """Draw in the style of the page; name makes the ids of the SVG unique on the page. Sizes in inches."""
    with mpl.rc_context({**STYLE, "svg.hashsalt": name}):
        canvas = Canvas(figsize=(width, height), layout="constrained")  # without pyplot, which has global state
        axes = canvas.subplots(rows, columns, squeeze=False)
        result = Drawing(canvas, list(axes.flat))
        yield result
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Glyph .* missing")  # text is drawn by the browser, in its fonts
            _break_cut_labels(canvas)
            result.svg = _themed_svg(canvas)


def _break_cut_labels(canvas: Canvas) -> None:
    """Break titles and axis labels that would leave the canvas into two lines; computes the layout."""
    canvas.draw_without_rendering()
    cut = [text for text in _labels(canvas) if _leaves(text, canvas)]
    for text in cut:
        lines = text.get_text().split("\n")
        longest = max(lines, key=len)
        spaces = [place for place, letter in enumerate(longest) if letter == " "]
        if spaces:
            middle = min(spaces, key=lambda place: abs(2 * place - len(longest)))
            lines[lines.index(longest)] = f"{longest[:middle]}\n{longest[middle + 1 :]}"
            text.set_text("\n".join(lines))
    if not cut:
        canvas.set_layout_engine(None)  # otherwise the layout would be computed again before writing


def _labels(canvas: Canvas) -> list[Text]:
    """Titles and axis labels that are not empty."""
    found: list[Text] = []
    for axes in canvas.axes:
        titles = [item for item in axes.get_children() if isinstance(item, Text) and item not in axes.texts]
        found += [*titles, axes.xaxis.label, axes.yaxis.label]
    return [text for text in found if text.get_text()]


def _leaves(text: Text, canvas: Canvas) -> bool:
    box, edge = text.get_window_extent(), canvas.bbox
    return bool(box.x0 < edge.x0 or box.x1 > edge.x1 or box.y0 < edge.y0 or box.y1 > edge.y1)


def _themed_svg(canvas: Canvas) -> str:
    buffer = io.StringIO()
    canvas.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", text, count=1)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1)
    text = fewer_elements(re.sub(r"\n\s*", "\n", text))
    for color, (variable, _) in THEME.items():
        text = text.replace(color, f"var({variable}, {color})")
    return text


def plain_svg(svg: str) -> str:
    """The drawing with plain colours on white, for programs without support for CSS variables."""
    text = re.sub(r"var\(--[a-z]+, (#[0-9a-f]{6})\)", r"\1", svg)
    text = re.sub(r"(<svg[^>]*>)", r'\1\n<rect width="100%" height="100%" fill="white"/>', text, count=1)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + text


def plain_numbers(axis: Axis, unit: float = 1.0) -> None:
    """Label a logarithmic axis 1, 2, 5, 10, … in numbers of a unit, without overlaps and exponents."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    in_units(axis, unit)
    axis.set_minor_formatter(NullFormatter())


def in_units(axis: Axis, unit: float) -> None:
    """Label an axis in a unit of this size."""
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / unit:g}".replace("-", "−")))
