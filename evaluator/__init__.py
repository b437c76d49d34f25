"""Video → marks → pose → turning → comparison → diagnosis → report; the command line.

The public names below are imported when they are first used, so that `import evaluator` costs nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from evaluator.errors import InputError
    from evaluator.mark_geometry import MarkGeometry
    from evaluator.marks import read_marks, write_marks
    from evaluator.pose import Poses, poses_from_marks
    from evaluator.progress import Cancelled, Progress
    from evaluator.recording import open_recording
    from evaluator.report.build import write_report
    from evaluator.report.plots import plot_camera, plot_diagnosis, plot_run, plot_turn
    from evaluator.settings import Experiment, load_experiment
    from evaluator.tracking import place_on_plate, track
    from evaluator.turning import Turning, measure_turning
    from evaluator.workflow import (
        Analysis,
        analyze,
        calibrate,
        check_experiment,
        compare,
        diagnose,
        export,
        plan,
        simulate,
    )

__all__ = [
    "Analysis",
    "Cancelled",
    "Experiment",
    "InputError",
    "MarkGeometry",
    "Poses",
    "Progress",
    "Turning",
    "analyze",
    "calibrate",
    "check_experiment",
    "compare",
    "diagnose",
    "export",
    "load_experiment",
    "measure_turning",
    "open_recording",
    "place_on_plate",
    "plan",
    "plot_camera",
    "plot_diagnosis",
    "plot_run",
    "plot_turn",
    "poses_from_marks",
    "read_marks",
    "simulate",
    "track",
    "write_marks",
    "write_report",
]

_HOMES = {
    "evaluator.errors": ("InputError",),
    "evaluator.marks": ("read_marks", "write_marks"),
    "evaluator.mark_geometry": ("MarkGeometry",),
    "evaluator.pose": ("Poses", "poses_from_marks"),
    "evaluator.progress": ("Cancelled", "Progress"),
    "evaluator.recording": ("open_recording",),
    "evaluator.report.build": ("write_report",),
    "evaluator.report.plots": ("plot_camera", "plot_diagnosis", "plot_run", "plot_turn"),
    "evaluator.settings": ("Experiment", "load_experiment"),
    "evaluator.tracking": ("place_on_plate", "track"),
    "evaluator.turning": ("Turning", "measure_turning"),
    "evaluator.workflow": (
        "Analysis",
        "analyze",
        "calibrate",
        "check_experiment",
        "compare",
        "diagnose",
        "export",
        "plan",
        "simulate",
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
