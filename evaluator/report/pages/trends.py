"""The page of `turnscope trends`: every quantity over the sessions, and its changes in words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from evaluator.files import write_text
from evaluator.files.csv_tables import write_table
from evaluator.report.diagnosis.words import as_sentence
from evaluator.report.numbers import UNKNOWN, interval, significant, true_minus
from evaluator.report.pages.colors import FAINT, VERMILLION
from evaluator.report.pages.html import Page, Section, Table, page_html
from evaluator.report.style import MEASURED, Figure, drawing
from evaluator.trends.changes import SIGNIFICANCE, Change
from evaluator.trends.series import TOGETHER, Series
from evaluator.trends.trends import Trends
from evaluator.wording import verb

HEAD = ("quantity", "changed with", "from", "to", "change", "95 % of the change", "p")
TITLES = {"radius": "Turning radius", "speed": "Speed"}


def change_sentences(found: Trends) -> tuple[str, ...]:
    """Changes in the order of the series; one sentence if there are none."""
    sentences = [
        as_sentence(f"{series.name}: {_sentence(found, series, change)}")
        for series in found.series
        for change in series.changes
    ]
    quantities = f"{len(found.series)} {verb(len(found.series), 'quantity', 'quantities')}"
    count = f"{quantities} over {len(found.sessions)} sessions {verb(len(found.series), 'was', 'were')} compared"
    if not sentences:
        return (f"No significant change; {count}.",)
    return (
        *map(true_minus, sentences),
        f"{count}; the probability of any false change is {100 * SIGNIFICANCE:g} %.",
    )


def write_trends(found: Trends, out: Path) -> pd.DataFrame:
    """Write the page and, beside it, its numbers as CSV; return the numbers."""
    table = found.table()
    write_table(table, out.with_suffix(".csv"))
    days = [session.day.isoformat() for session in found.sessions if session.day]
    page = Page(
        kind="trends",
        title=f"{len(found.sessions)} sessions",
        facts=(f"{days[0]} to {days[-1]}",) if days else ("in the order given",),
        summary=change_sentences(found),
        sections=(*_sections(found), _changes(found), _sessions(found)),
        footer="Made by turnscope.",
    )
    write_text(out, page_html(page))
    return table


def _sections(found: Trends) -> list[Section]:
    """A section per kind of quantity: radii, speeds, and each effect that was named."""
    kinds = sorted({_kind(series) for series in found.series}, key=lambda kind: (kind not in TITLES, kind))
    return [
        Section(
            f"trend-{kind}",
            TITLES.get(kind, kind),
            figures=tuple(_figure(found, series) for series in found.series if _kind(series) == kind),
        )
        for kind in kinds
    ]


def _kind(series: Series) -> str:
    """The quantity of a series, or its effect if it is a size."""
    return next((kind for kind, name in TOGETHER.items() if name == series.name), series.name.split(",")[0])


def _figure(found: Trends, series: Series) -> Figure:
    name = f"trend-{found.series.index(series)}"
    places = np.arange(len(found.sessions))
    values = np.array([level.value for level in series.levels])
    reach = np.array([level.reach for level in series.levels])
    with drawing(name, height=2.8) as canvas:
        (axes,) = canvas.axes
        _levels(axes, series, len(places))
        axes.errorbar(places, values, yerr=reach, **MEASURED.markers(), capsize=2, lw=1.0)
        axes.set_xticks(places, [_label(found, at) for at in range(len(places))], rotation=30, ha="right")
        axes.set_xlim(-0.5, len(places) - 0.5)
        axes.set_ylabel(
            true_minus(f"{series.name.split(',')[0] if series.unit != '%' else 'mean of its command'}, {series.unit}")
        )
    changed = " ".join(as_sentence(_sentence(found, series, change)) for change in series.changes)
    return Figure(
        name,
        as_sentence(series.name).rstrip("."),
        true_minus(f"Points: sessions with 95 % intervals of noise and repetitions. {changed or 'No change.'}"),
        (canvas.svg,),
        pd.DataFrame(
            {
                "session": [session.name for session in found.sessions],
                "value": values,
                "low": values - reach,
                "high": values + reach,
            }
        ),
    )


def _levels(axes: Axes, series: Series, count: int) -> None:
    """Bands of the levels between changes, and lines at the changes."""
    edges = [0, *(change.at for change in series.changes), count]
    means = [series.changes[0].before, *(change.after for change in series.changes)] if series.changes else []
    for start, stop, mean in zip(edges, edges[1:], means, strict=False):
        axes.fill_between([start - 0.5, stop - 0.5], mean.low, mean.high, color=FAINT, lw=0)
        axes.plot([start - 0.5, stop - 0.5], [mean.mean] * 2, color=VERMILLION, ls="--")
    for change in series.changes:
        axes.axvline(change.at - 0.5, color=VERMILLION, lw=0.8)


def _changes(found: Trends) -> Section:
    rows = tuple(
        (
            true_minus(series.name),
            _label(found, change.at),
            *(f"{_rounded(mean.mean, change)} {series.unit}" for mean in (change.before, change.after)),
            true_minus(f"{_rounded(change.difference, change)} {series.unit}"),
            interval(change.low, change.high, _digits(change), sign=True),
            f"{change.p:.1g}",
        )
        for series in found.series
        for change in series.changes
    )
    text = (
        "A change is reported if the mean of consecutive sessions before it differs from the mean after it, given "
        f"noise and scatter between sessions, at a significance of {100 * SIGNIFICANCE:g} % for all quantities and "
        "splits together. Calibration errors cancel between sessions that share a camera file and are included "
        "otherwise."
    )
    tables = (Table("Changes", HEAD, rows),) if rows else ()
    return Section("changes", "Changes", (text,), tables=tables)


def _sessions(found: Trends) -> Section:
    rows = tuple(
        (session.name, session.day.isoformat() if session.day else UNKNOWN, str(session.folder))
        for session in found.sessions
    )
    return Section("sessions", "Sessions", tables=(Table("In order of time.", ("session", "date", "folder"), rows),))


def _when(found: Trends, at: int) -> str:
    session = found.sessions[at]
    return f"since {session.day.isoformat()} ({session.name})" if session.day else f"since {session.name}"


def _label(found: Trends, at: int) -> str:
    session = found.sessions[at]
    return session.day.isoformat() if session.day else session.name


def _sentence(found: Trends, series: Series, change: Change) -> str:
    """One change in words."""
    before, after = (f"{_rounded(mean.mean, change)} {series.unit}".strip() for mean in (change.before, change.after))
    bounds = f"{interval(change.low, change.high, _digits(change), sign=True)} {series.unit}".strip()
    return f"{after} {_when(found, change.at)}, {before} before; the change is {bounds} (95 %)."


def _digits(change: Change) -> int:
    """Decimals that the uncertainty of the change supports: two figures of its half-interval."""
    reach = (change.high - change.low) / 2
    return max(0, 1 - int(np.floor(np.log10(reach)))) if np.isfinite(reach) and reach > 0 else 3


def _rounded(value: float, change: Change) -> str:
    return true_minus(f"{value:.{_digits(change)}f}") if np.isfinite(value) else significant(value)
