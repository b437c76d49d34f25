"""The report: one HTML file that needs nothing else, from the results of an analysis."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from evaluator.files import write_text
from evaluator.report.figures.agreement import radius_agreement
from evaluator.report.figures.radius import radius_against_difference, radius_against_ratio, radius_by_group
from evaluator.report.figures.speed import straight_speed
from evaluator.report.figures.trajectory import LEGEND, trajectories
from evaluator.report.pages import Page, Section, Table, page_html
from evaluator.report.player import player_data
from evaluator.report.runs import RunView, views_of
from evaluator.report.style import Figure
from evaluator.report.summary import headline, summary
from evaluator.workflow import Analysis, Outputs
from simulator.robot import Robot, load_robot


def write_report(analysis: Analysis) -> None:
    """Write report.html from an analysis with comparison (and diagnosis.json, where it is there)."""
    write_text(analysis.outputs.report, report_html(analysis))


def report_html(analysis: Analysis) -> str:
    """The page as text."""
    runs = views_of(analysis)
    robot = load_robot(analysis.experiment.robot)
    diagnosis = _diagnosis(analysis.outputs)
    provenance = json.loads(analysis.outputs.provenance.read_text(encoding="utf-8"))
    page = Page(
        kind="turning report",
        title=analysis.experiment.name,
        facts=_facts(analysis, runs, robot),
        summary=tuple(summary(runs, analysis.faults, diagnosis)),
        numbers=tuple(headline(runs)),
        faults=analysis.faults,
        sections=tuple(section for section in _sections(runs, robot) if section is not None),
        player=player_data(runs, robot),
        legend=LEGEND,
        footer=_footer(provenance),
    )
    return page_html(page)


def _sections(runs: Sequence[RunView], robot: Robot) -> list[Section | None]:
    return [
        _figures("trajectories-section", "Trajectories", trajectories(runs)),
        _figures(
            "radius",
            "How tightly it turns",
            radius_against_difference(runs),
            radius_against_ratio(runs),
            radius_by_group(runs),
            radius_agreement(runs),
        ),
        _figures("speed", "How fast it runs straight", straight_speed(runs, robot.wheels.radius_mm)),
        _run_table(runs),
    ]


def _figures(name: str, title: str, *figures: Figure | None) -> Section | None:
    there = tuple(figure for figure in figures if figure is not None)
    return Section(name, title, figures=there) if there else None


def _run_table(runs: Sequence[RunView]) -> Section:
    columns: dict[str, Callable[[RunView], str]] = {
        "run": lambda run: run.id,
        "left / right, rpm": lambda run: f"{run.left_rpm:g} / {run.right_rpm:g}".replace("-", "−"),
        "radius, mm": lambda run: _number(run.value("radius_mm"), 3),
        "95 %, mm": lambda run: _range(run.value("radius_low_mm"), run.value("radius_high_mm")),
        "simulated, mm": lambda run: _number(run.value("simulated_radius_mm", "comparison"), 3),
        "difference, %": lambda run: _number(run.value("radius_difference_percent", "comparison"), 2, sign=True),
        "speed, mm/s": lambda run: _number(run.value("speed_mm_s"), 3),
        "yaw rate, deg/s": lambda run: _number(run.value("yaw_rate_deg_s"), 2),
        "path gap RMS, mm": lambda run: _number(run.value("gap_rms_mm", "comparison"), 3),
        "frames used, %": lambda run: _number(100 * run.value("share_used"), 1),
        "remark": lambda run: "" if run.turning["radius_status"] == "ok" else str(run.turning["radius_status"]),
    }
    rows = tuple(tuple(cell(run) for cell in columns.values()) for run in runs)
    caption = (
        "Radius: smallest sustained turning radius of the robot's centre. The full tables are turning.csv and "
        "comparison.csv."
    )
    return Section("runs", "All runs", tables=(Table(caption, tuple(columns), rows),))


def _number(value: float, digits: int, *, sign: bool = False) -> str:
    if not np.isfinite(value):
        return "–" if np.isnan(value) else "∞"
    return f"{value:{'+' if sign else ''}.{digits}f}".replace("-", "−")


def _range(low: float, high: float) -> str:
    return "–" if np.isnan(low) else f"{_number(low, 3)} to {_number(high, 3)}"


def _facts(analysis: Analysis, runs: Sequence[RunView], robot: Robot) -> tuple[str, ...]:
    total = len(analysis.experiment.run)
    count = f"{total} runs" if len(runs) == total else f"{len(runs)} of {total} runs"
    videos = sum(run.video is not None for run in analysis.experiment.run)
    source = "from video" if videos == total else "from marks" if videos == 0 else f"{videos} from video"
    return tuple(filter(None, (f"robot: {robot.name}", f"{count}, {source}", analysis.experiment.notes)))


def _footer(provenance: dict[str, Any]) -> str:
    libraries = ", ".join(f"{name} {version}" for name, version in provenance["libraries"].items())
    version = provenance["turnscope"]
    made = f"Made by turnscope {version}" if version[0].isdigit() else "Made by turnscope"
    return (
        f"{made} (code {provenance['code_sha256'][:12]}) with Python {provenance['python']}, {libraries}. "
        f"Hashes of all inputs: provenance.json."
    )


def _diagnosis(outputs: Outputs) -> dict[str, Any] | None:
    if not outputs.diagnosis.is_file():
        return None
    found: dict[str, Any] = json.loads(outputs.diagnosis.read_text(encoding="utf-8"))
    return found
