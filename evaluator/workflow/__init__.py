"""All that a front end can do, as functions: from recordings to tables, from a robot to its motion, what is missing.

Each takes paths or values, reports to a Progress that may cancel it, and leaves whole files. What an experiment needs
is computed in parallel and reused while it is up to date. The names below are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from evaluator.capture.record import Captured, CaptureStart, record_camera
    from evaluator.capture.watch import watch_marks
    from evaluator.trends.trends import Trends, compare_sessions
    from evaluator.workflow.analysis import Analysis, analyze, compare, pending
    from evaluator.workflow.calibration import Calibrated, calibrate
    from evaluator.workflow.checks import Check, check_experiment
    from evaluator.workflow.demo import Samples, prepare_samples
    from evaluator.workflow.diagnosis.batch import diagnose_each
    from evaluator.workflow.diagnosis.experiment import DiagnosisResult, diagnose
    from evaluator.workflow.diagnosis.planning import Plan, plan
    from evaluator.workflow.exporting import export
    from evaluator.workflow.fresh import new_experiment
    from evaluator.workflow.rendering import Rendered, SceneOrder, read_scene, render_scene, render_scenes
    from evaluator.workflow.results.outputs import Outputs
    from evaluator.workflow.simulation import simulate, steady_turns
    from evaluator.workflow.slip_bench import SlipBench, evaluate_slip, evaluate_virtual_slip
    from evaluator.workflow.sweep import SweepDone, run_sweep
    from evaluator.workflow.tracking import Tracked, track_recording

__all__ = [
    "Analysis",
    "Calibrated",
    "CaptureStart",
    "Captured",
    "Check",
    "DiagnosisResult",
    "Outputs",
    "Plan",
    "Rendered",
    "Samples",
    "SceneOrder",
    "SlipBench",
    "SweepDone",
    "Tracked",
    "Trends",
    "analyze",
    "calibrate",
    "check_experiment",
    "compare",
    "compare_sessions",
    "diagnose",
    "diagnose_each",
    "evaluate_slip",
    "evaluate_virtual_slip",
    "export",
    "new_experiment",
    "pending",
    "plan",
    "prepare_samples",
    "read_scene",
    "record_camera",
    "render_scene",
    "render_scenes",
    "run_sweep",
    "simulate",
    "steady_turns",
    "track_recording",
    "watch_marks",
]

_HOMES = {
    "evaluator.capture.record": ("CaptureStart", "Captured", "record_camera"),
    "evaluator.capture.watch": ("watch_marks",),
    "evaluator.workflow.analysis": ("Analysis", "analyze", "compare", "pending"),
    "evaluator.workflow.calibration": ("Calibrated", "calibrate"),
    "evaluator.workflow.checks": ("Check", "check_experiment"),
    "evaluator.workflow.demo": ("Samples", "prepare_samples"),
    "evaluator.workflow.diagnosis.batch": ("diagnose_each",),
    "evaluator.workflow.diagnosis.experiment": ("DiagnosisResult", "diagnose"),
    "evaluator.workflow.exporting": ("export",),
    "evaluator.workflow.fresh": ("new_experiment",),
    "evaluator.workflow.diagnosis.planning": ("Plan", "plan"),
    "evaluator.workflow.rendering": ("Rendered", "SceneOrder", "read_scene", "render_scene", "render_scenes"),
    "evaluator.workflow.results.outputs": ("Outputs",),
    "evaluator.workflow.simulation": ("simulate", "steady_turns"),
    "evaluator.workflow.slip_bench": ("SlipBench", "evaluate_slip", "evaluate_virtual_slip"),
    "evaluator.workflow.sweep": ("SweepDone", "run_sweep"),
    "evaluator.workflow.tracking": ("Tracked", "track_recording"),
    "evaluator.trends.trends": ("Trends", "compare_sessions"),
}


def __getattr__(name: str) -> object:
    """Import a public name from its home (PEP 562)."""
    from importlib import import_module

    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(home), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Public names, also those that are not imported yet."""
    return sorted(__all__)
