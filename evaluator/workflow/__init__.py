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
    from evaluator.workflow.circular.evaluate import (
        CircularResult,
        circular_test_content,
        circular_test_of,
        circular_test_table,
        evaluate_circular_test,
        simulate_circular_test,
    )
    from evaluator.workflow.circular.runs import CircularRun, circular_runs, write_circular_test
    from evaluator.workflow.demo import Samples, prepare_samples
    from evaluator.workflow.diagnosis.batch import diagnose_each
    from evaluator.workflow.diagnosis.experiment import DiagnosisResult, diagnose
    from evaluator.workflow.diagnosis.planning import Plan, plan
    from evaluator.workflow.editing.documents import ChangedMeanwhileError, replace_text, version_of
    from evaluator.workflow.editing.experiments import Edit, edit_experiment, new_table, read_experiment
    from evaluator.workflow.editing.robots import effects_of, robot_file, with_effects, write_robot
    from evaluator.workflow.exporting import export
    from evaluator.workflow.frames.decoder import Decoder, Wanted
    from evaluator.workflow.fresh import new_experiment
    from evaluator.workflow.rendering import Rendered, SceneOrder, read_scene, render_scene, render_scenes
    from evaluator.workflow.results.outputs import Outputs
    from evaluator.workflow.runs.budget import budget_of
    from evaluator.workflow.simulation import export_robot, simulate, steady_turns
    from evaluator.workflow.slip_bench import SlipBench, evaluate_slip, evaluate_virtual_slip
    from evaluator.workflow.sweep import SweepDone, run_sweep
    from evaluator.workflow.tracking import Tracked, track_recording
    from evaluator.workflow.viewing.cameras import camera_view, gauge_pdf
    from evaluator.workflow.viewing.curves import run_curves, run_of
    from evaluator.workflow.viewing.marks import (
        corrections_file,
        corrections_of,
        tracking_file,
        write_corrections,
        write_tracking,
    )
    from evaluator.workflow.viewing.overview import (
        cameras_among,
        experiments_among,
        files_named,
        out_folder,
        results_state,
    )
    from evaluator.workflow.viewing.results import diagnosis_view, results_view
    from evaluator.workflow.viewing.sandbox import effect_sliders, robot_names, robot_sliders, sandbox_motions

__all__ = [
    "Analysis",
    "Calibrated",
    "CaptureStart",
    "Captured",
    "ChangedMeanwhileError",
    "Check",
    "CircularResult",
    "CircularRun",
    "Decoder",
    "DiagnosisResult",
    "Edit",
    "Outputs",
    "Plan",
    "Rendered",
    "Samples",
    "SceneOrder",
    "SlipBench",
    "SweepDone",
    "Tracked",
    "Trends",
    "Wanted",
    "analyze",
    "budget_of",
    "calibrate",
    "camera_view",
    "cameras_among",
    "check_experiment",
    "circular_runs",
    "circular_test_content",
    "circular_test_of",
    "circular_test_table",
    "compare",
    "compare_sessions",
    "corrections_file",
    "corrections_of",
    "diagnose",
    "diagnose_each",
    "diagnosis_view",
    "edit_experiment",
    "effect_sliders",
    "effects_of",
    "evaluate_circular_test",
    "evaluate_slip",
    "evaluate_virtual_slip",
    "experiments_among",
    "export",
    "export_robot",
    "files_named",
    "gauge_pdf",
    "new_experiment",
    "new_table",
    "out_folder",
    "pending",
    "plan",
    "prepare_samples",
    "read_experiment",
    "read_scene",
    "record_camera",
    "render_scene",
    "render_scenes",
    "replace_text",
    "results_state",
    "results_view",
    "robot_file",
    "robot_names",
    "robot_sliders",
    "run_curves",
    "run_of",
    "run_sweep",
    "sandbox_motions",
    "simulate",
    "simulate_circular_test",
    "steady_turns",
    "track_recording",
    "tracking_file",
    "version_of",
    "watch_marks",
    "with_effects",
    "write_circular_test",
    "write_corrections",
    "write_robot",
    "write_tracking",
]

_HOMES = {
    "evaluator.capture.record": (
        "CaptureStart",
        "Captured",
        "record_camera",
    ),
    "evaluator.capture.watch": ("watch_marks",),
    "evaluator.workflow.analysis": ("Analysis", "analyze", "compare", "pending"),
    "evaluator.workflow.calibration": ("Calibrated", "calibrate"),
    "evaluator.workflow.checks": ("Check", "check_experiment"),
    "evaluator.workflow.circular.evaluate": (
        "CircularResult",
        "circular_test_content",
        "circular_test_of",
        "circular_test_table",
        "evaluate_circular_test",
        "simulate_circular_test",
    ),
    "evaluator.workflow.circular.runs": ("CircularRun", "circular_runs", "write_circular_test"),
    "evaluator.workflow.demo": ("Samples", "prepare_samples"),
    "evaluator.workflow.diagnosis.batch": ("diagnose_each",),
    "evaluator.workflow.diagnosis.experiment": (
        "DiagnosisResult",
        "diagnose",
    ),
    "evaluator.workflow.exporting": ("export",),
    "evaluator.workflow.fresh": ("new_experiment",),
    "evaluator.workflow.diagnosis.planning": (
        "Plan",
        "plan",
    ),
    "evaluator.workflow.rendering": (
        "Rendered",
        "SceneOrder",
        "read_scene",
        "render_scene",
        "render_scenes",
    ),
    "evaluator.workflow.results.outputs": ("Outputs",),
    "evaluator.workflow.runs.budget": ("budget_of",),
    "evaluator.workflow.simulation": ("export_robot", "simulate", "steady_turns"),
    "evaluator.workflow.slip_bench": (
        "SlipBench",
        "evaluate_slip",
        "evaluate_virtual_slip",
    ),
    "evaluator.workflow.sweep": (
        "SweepDone",
        "run_sweep",
    ),
    "evaluator.workflow.tracking": (
        "Tracked",
        "track_recording",
    ),
    "evaluator.trends.trends": (
        "Trends",
        "compare_sessions",
    ),
    "evaluator.workflow.editing.documents": (
        "ChangedMeanwhileError",
        "replace_text",
        "version_of",
    ),
    "evaluator.workflow.editing.experiments": (
        "Edit",
        "edit_experiment",
        "new_table",
        "read_experiment",
    ),
    "evaluator.workflow.frames.decoder": (
        "Decoder",
        "Wanted",
    ),
    "evaluator.workflow.viewing.overview": (
        "cameras_among",
        "experiments_among",
        "files_named",
        "out_folder",
        "results_state",
    ),
    "evaluator.workflow.viewing.curves": (
        "run_curves",
        "run_of",
    ),
    "evaluator.workflow.viewing.results": (
        "diagnosis_view",
        "results_view",
    ),
    "evaluator.workflow.viewing.sandbox": (
        "effect_sliders",
        "robot_names",
        "robot_sliders",
        "sandbox_motions",
    ),
    "evaluator.workflow.editing.robots": (
        "effects_of",
        "robot_file",
        "with_effects",
        "write_robot",
    ),
    "evaluator.workflow.viewing.marks": (
        "corrections_file",
        "corrections_of",
        "tracking_file",
        "write_corrections",
        "write_tracking",
    ),
    "evaluator.workflow.viewing.cameras": (
        "camera_view",
        "gauge_pdf",
    ),
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
