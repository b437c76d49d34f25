"""The report of an analysis: a single self-contained HTML file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from evaluator.files import write_text
from evaluator.report.diagnosis.view import OUTDATED, DiagnosisView, known_diagnosis
from evaluator.report.diagnosis.words import as_sentence
from evaluator.report.figures.trajectory import legend_of
from evaluator.report.pages.html import Page, page_html
from evaluator.report.player import player_data
from evaluator.report.runs import RunView, views_of
from evaluator.report.sections import sections
from evaluator.report.summary import headline, mistakes_first, summary
from evaluator.wording import counted
from evaluator.workflow import Analysis
from simulator.robot import Robot, load_robot


def write_report(analysis: Analysis) -> DiagnosisView | None:
    """Write report.html from an analysis with comparison, and from diagnosis.json if it exists, which is returned."""
    diagnosis = known_diagnosis(analysis.experiment, analysis.outputs)
    write_text(analysis.outputs.report, _html(analysis, diagnosis))
    return diagnosis


def report_html(analysis: Analysis) -> str:
    """The page as text."""
    return _html(analysis, known_diagnosis(analysis.experiment, analysis.outputs))


def _html(analysis: Analysis, diagnosis: DiagnosisView | None) -> str:
    robot = load_robot(analysis.experiment.robot)
    runs = views_of(analysis, robot)
    provenance = json.loads(analysis.outputs.provenance.read_text(encoding="utf-8"))
    right = [run for run in runs if run.run not in analysis.excluded_runs]
    page = Page(
        kind="turning report",
        title=analysis.experiment.name,
        facts=_facts(analysis, runs, robot),
        summary=(
            *((as_sentence(OUTDATED),) if diagnosis and diagnosis.outdated else ()),
            *mistakes_first(analysis),
            *summary(right, analysis.faults, diagnosis.content if diagnosis else None, analysis.directions),
        ),
        numbers=tuple(headline(right)),
        faults=analysis.faults,
        sections=sections(runs, robot, _cameras(analysis), diagnosis, analysis),
        player=player_data(runs, robot),
        legend=legend_of(runs),
        footer=_footer(provenance),
    )
    return page_html(page)


def _facts(analysis: Analysis, runs: Sequence[RunView], robot: Robot) -> tuple[str, ...]:
    total = len(analysis.experiment.run)
    shown = len({run.run for run in runs})  # a run with a command log has a view for each of its phases
    count = counted(total, "run") if shown == total else f"{shown} of {counted(total, 'run')}"
    videos = sum(run.video is not None for run in analysis.experiment.run)
    poses = sum(run.poses is not None for run in analysis.experiment.run)
    given = "from poses" if poses == total else "from marks"
    source = "from video" if videos == total else given if videos == 0 else f"{videos} from video"
    return tuple(filter(None, (f"robot: {robot.name}", f"{count}, {source}", analysis.experiment.notes)))


def _footer(provenance: dict[str, Any]) -> str:
    libraries = ", ".join(f"{name} {version}" for name, version in provenance["libraries"].items())
    version = provenance["turnscope"]
    made = f"Made by turnscope {version}" if version[0].isdigit() else "Made by turnscope"
    return (
        f"{made} (code {provenance['code_sha256'][:12]}) with Python {provenance['python']}, {libraries}. "
        f"Hashes of all inputs: provenance.json."
    )


def _cameras(analysis: Analysis) -> list[Path]:
    """Calibrations of the runs with results."""
    runs = [run for run in analysis.experiment.run if run.id not in analysis.faults]
    return list(dict.fromkeys(run.camera for run in runs if run.video and run.camera))
