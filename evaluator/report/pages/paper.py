"""The published figures and numbers, recomputed, as figures, tables and one page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from evaluator.files import write_text, written_whole
from evaluator.progress import Progress
from evaluator.report.figures.paper_slip import slip_figures
from evaluator.report.figures.paper_turns import (
    difference_figure,
    prototype_figure,
    ratio_figure,
    speed_figure,
    tire_figure,
    trajectory_figure,
)
from evaluator.report.figures.wheel_states import wheel_states_figure
from evaluator.report.numbers import true_minus
from evaluator.report.pages.html import Page, Section, Table, page_html
from evaluator.report.style import Figure, plain_svg
from simulator.paper import tables
from simulator.paper.checks import CLOSE, COMPUTED, CONJECTURE, FITTED, NOT_REPRODUCED, OUT_OF_SCOPE, Check
from simulator.paper.machines import PUBLISHED_TURNS, TIRE_PEAK_FRICTION, tire_machine
from simulator.paper.numbers import EQUATION_10, EQUATION_11, power_law, published_numbers
from simulator.paper.readings import reading_table
from simulator.robot import load_robot
from simulator.slip.curves import slip_curves


@dataclass(frozen=True)
class Paper:
    """Recomputed figures, checks and readings."""

    figures: tuple[Figure, ...]
    checks: tuple[Check, ...]
    readings: pd.DataFrame


def recompute(progress: Progress) -> Paper:
    """Compute and draw all; progress is called after every part."""
    parts: list[Callable[[], list[Figure]]] = [_slip_figures, _attraction_figures, _magnetic_figures, _wheel_figures]
    figures: list[Figure] = []
    for done, part in enumerate(parts):
        progress("recomputing", done, len(parts) + 2)
        figures += part()
    progress("recomputing", len(parts), len(parts) + 2)
    checks = tuple(published_numbers())
    progress("recomputing", len(parts) + 1, len(parts) + 2)
    readings = reading_table()
    progress("recomputing", len(parts) + 2, len(parts) + 2)
    return Paper(tuple(figures), checks, readings)


def write_paper(paper: Paper, out: Path) -> Path:
    """Write index.html, every figure as SVG and its data as CSV, numbers.csv and readings.csv; return the page."""
    for figure in paper.figures:
        write_text(out / f"{figure.name}.svg", plain_svg(figure.panels[0]))
        write_text(out / f"{figure.name}.csv", figure.csv)
    for name, table in (("numbers", check_table(paper.checks)), ("readings", paper.readings)):
        with written_whole(out / f"{name}.csv") as temporary:
            table.to_csv(temporary, index=False, float_format="%.6g")
    write_text(out / "index.html", page_html(_page(paper)))
    return out / "index.html"


def check_table(checks: tuple[Check, ...]) -> pd.DataFrame:
    """Checks as a table: source, quantity, published, ours, difference, verdict, standing."""
    return pd.DataFrame([check.__dict__ for check in checks])


def _slip_figures() -> list[Figure]:
    tire = tire_machine(friction=TIRE_PEAK_FRICTION).slip
    known = (
        ("figure-3", "Figure 3: tire", f"Equations (4) to (8), friction {TIRE_PEAK_FRICTION} (peak 0.8).", tire),
        (
            "figure-7",
            "Figure 7: column",
            "The shipped law of the column.",
            load_robot("column").slip,
        ),
        (
            "figure-8",
            "Figure 8: barrel",
            "The shipped law of the barrel.",
            load_robot("barrel").slip,
        ),
    )
    drawn = [slip_figures(name, title, caption, slip_curves(slip)) for name, title, caption, slip in known]
    return [figure for pair in drawn for figure in pair]


def _attraction_figures() -> list[Figure]:
    published = {name: turn.radius_mm for turn in PUBLISHED_TURNS for name in turn.case.split(", ")}
    return [trajectory_figure(number, tables.trajectories(number), published) for number in ("9", "10")]


def _magnetic_figures() -> list[Figure]:
    turning = tables.turning_map(load_robot("barrel"))
    law = power_law(turning["ratio"], turning["radius_mm"])
    return [
        tire_figure(tables.tire_against_magnetic()),
        speed_figure(tables.straight_speeds(), *EQUATION_10),
        difference_figure(turning),
        ratio_figure(turning, EQUATION_11, (law.factor, law.exponent)),
        prototype_figure(tables.prototype_turns()),
    ]


def _wheel_figures() -> list[Figure]:
    robot = load_robot("barrel")
    titles = {1: ("figure-20", "Figure 20: forward, to the left"), -1: ("figure-21", "Figure 21: backward")}
    return [wheel_states_figure(*titles[way], robot, tables.prototype_turn(way)) for way in (1, -1)]


def _page(paper: Paper) -> Page:
    head = tuple(check_table(paper.checks).columns)
    rows = tuple(tuple(map(true_minus, check.__dict__.values())) for check in paper.checks)
    readings = tuple(
        (str(row[0]), *(f"{value:.2f}" for value in row[1:-1]), f"{row[-1]:.2f}")
        for row in paper.readings.itertuples(index=False)
    )
    names = {figure.name: figure for figure in paper.figures}
    slip = tuple(names[f"figure-{number}{panel}"] for number in (3, 7, 8) for panel in "ab")
    turns = tuple(names[f"figure-{number}"] for number in (9, 10, 11, 12, 13, 14, 18))
    states = tuple(names[f"figure-{number}"] for number in (20, 21))
    caption = (
        "Numbers agree within 0.1 % or half the last published digit; close is within 3 %. Only rows that are computed "
        "test the model. A law fitted to a figure meets that figure by design: the tire friction of Figure 3 was "
        "set to its peak, the magnetic laws to Figures 7, 8, 22 and Eq. (11)."
    )
    table = Table(caption, head, rows)
    tried = Table(
        "Radius in mm of each published turn (52.52, 46.3, 18.27, 52.06, 15.73 mm), and the largest deviation in %. A "
        "selection of what was tried; the last one was chosen after the radii were known, and is a conjecture.",
        tuple(name.replace("_percent", ", %").replace("_", " ") for name in paper.readings.columns),
        readings,
    )
    return Page(
        kind="the paper, recomputed",
        title="Slip and magnetic attraction effects in a microrobot: every published number",
        facts=("shipped robots: tire, column, barrel",),
        summary=_summary(paper),
        sections=(
            Section("numbers", "Published and ours", tables=(table,)),
            Section("slip", "Slip characteristics", figures=slip),
            Section("turns", "Turns and speeds", figures=turns),
            Section("states", "State of each wheel", figures=states),
            Section("readings", "Readings of Equations (3) to (8)", tables=(tried,)),
        ),
        footer="Made by turnscope. Each figure and its data lie beside this page as SVG and CSV.",
    )


def _summary(paper: Paper) -> tuple[str, ...]:
    return (*summary_lines(paper.checks), _nearest_reading(paper.readings))


def summary_lines(checks: tuple[Check, ...]) -> list[str]:
    """Number of rows by verdict, and all rows that are not reproduced."""
    count = Counter(check.standing for check in checks)
    near = sum(check.standing == COMPUTED and check.verdict == CLOSE for check in checks)
    worth = (
        f"{count[COMPUTED]} published numbers and statements are computed with nothing fitted to them, {near} of these "
        f"only within 3 %; {count[FITTED]} are met by laws fitted to them; {count[CONJECTURE]} rests on a conjecture; "
        f"{count[NOT_REPRODUCED]} are not reproduced; {count[OUT_OF_SCOPE]} are out of scope."
    )
    missed = [
        f"Not reproduced: {item.source}, {item.quantity}: published: {item.published}; ours: {item.ours}."
        for item in checks
        if item.standing == NOT_REPRODUCED
    ]
    return [true_minus(line) for line in (worth, *missed)]


def _nearest_reading(readings: pd.DataFrame) -> str:
    best = min(zip(readings["largest_deviation_percent"], readings["reading"], strict=True))
    return (
        f"All five radii of Figures 9 and 10 are met within {best[0]:.2f} % in one reading, a conjecture chosen after "
        f"the radii were known: {best[1]}. The shipped tire keeps Eq. (5) as printed."
    )
