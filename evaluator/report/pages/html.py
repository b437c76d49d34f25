"""The frame of all pages: a single self-contained HTML file."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from importlib.resources import files
from typing import TYPE_CHECKING

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup, escape

from evaluator.report.pages.colors import THEME

if TYPE_CHECKING:  # a page without figures is written before their libraries are imported
    from evaluator.report.style import Figure, Line
    from evaluator.report.summary import Number


# No line break between a number and its unit, nor within a command such as −33.3 / −14.4 rpm.
HELD_TOGETHER = re.compile(r"(?<=\d) (?=(?:%|(?:°|mm|µm|px|rpm|deg|s|mN|1/m)(?![\w]))|/ [−\d])|(?<=\d /) (?=[−\d])")
LONG = 100  # rows of a table, some 50 ms of layout if it has ten columns
CODE = re.compile(r"`([^`\n]+)`")


@dataclass(frozen=True)
class Table:
    """A table of the page; cells are text. words: cells contain sentences, which are broken into lines."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: bool = False

    @property
    def lines(self) -> int:
        """Lines of text in it, without its head."""
        return sum(max(cell.count("\n") for cell in row) + 1 for row in self.rows)

    @property
    def long(self) -> bool:
        """Whether it is laid out only when it comes into view."""
        return len(self.rows) > LONG


@dataclass(frozen=True)
class Section:
    """A section of the page."""

    name: str
    title: str
    text: tuple[str, ...] = ()
    figures: tuple[Figure, ...] = ()
    tables: tuple[Table, ...] = ()
    html: str = ""


@dataclass(frozen=True)
class Page:
    """Content of the template."""

    kind: str
    title: str
    facts: tuple[str, ...]
    summary: tuple[str, ...]
    sections: tuple[Section, ...]
    footer: str
    numbers: tuple[Number, ...] = ()
    faults: dict[str, str] = field(default_factory=dict)
    player: str = ""
    legend: tuple[Line, ...] = ()
    reloaded_s: int = 0  # interval at which a browser loads the page again; 0: never


def page_html(page: Page) -> str:
    """The page as text, including style and script."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["prose"] = prose
    return environment.from_string(_resource("page.html")).render(page=page, css=_css(), script=_resource("page.js"))


def prose(text: str) -> Markup:
    """Text for people as HTML: text between backticks as code, numbers on one line with their units."""
    return Markup(HELD_TOGETHER.sub("\u00a0", CODE.sub(r"<code>\1</code>", str(escape(text)))))  # noqa: S704 - escaped


def _css() -> str:
    light = " ".join(f"{variable}: {color};" for color, (variable, _) in THEME.items())
    dark = " ".join(f"{variable}: {color};" for variable, color in THEME.values())
    return _resource("page.css").replace("{{ light }}", light).replace("{{ dark }}", dark)


def _resource(name: str) -> str:
    return (files("evaluator.report.pages.assets") / name).read_text(encoding="utf-8")
