"""The page that every report is: one HTML file that needs nothing else."""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib.resources import files

from jinja2 import Environment, StrictUndefined

from evaluator.report.style import THEME, Figure, Line
from evaluator.report.summary import Number


@dataclass(frozen=True)
class Table:
    """A table of the page; cells are text. words: cells hold sentences, which are broken into lines."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: bool = False


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
    """Everything the template shows."""

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


def page_html(page: Page) -> str:
    """The page as text, its style and script inside."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return environment.from_string(_resource("page.html")).render(page=page, css=_css(), script=_resource("page.js"))


def _css() -> str:
    light = " ".join(f"{variable}: {color};" for color, (variable, _) in THEME.items())
    dark = " ".join(f"{variable}: {color};" for variable, color in THEME.values())
    return _resource("page.css").replace("{{ light }}", light).replace("{{ dark }}", dark)


def _resource(name: str) -> str:
    return (files("evaluator.report.pages.assets") / name).read_text(encoding="utf-8")
