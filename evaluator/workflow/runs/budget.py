"""The uncertainty budget of an analysed run."""

from __future__ import annotations

from pathlib import Path

from calibration.store import load_camera
from evaluator.files import read_with
from evaluator.mark_geometry import MarkGeometry
from evaluator.marks import read_marks
from evaluator.settings import Experiment
from evaluator.turning.budget import Budget, Knowledge, uncertainty_budget
from evaluator.workflow.results.outputs import Outputs
from simulator.robot import load_robot


def budget_of(experiment: Experiment, outputs: Outputs, run_id: str) -> Budget:
    """Uncertainty budget of an analysed run: the contribution of each source.

    Raises InputError if its marks or its camera cannot be read, KeyError for an unknown run.
    """
    run = {item.id: item for item in experiment.run}[run_id]
    robot = read_with(load_robot, Path(run.robot or experiment.robot))
    path = run.camera or experiment.camera
    known = Knowledge(robot.known_to.mark_position_mm, robot.known_to.mark_height_mm, experiment.known_to.time_base)
    return uncertainty_budget(
        read_marks(outputs.marks(run_id)),
        MarkGeometry.of_robot(robot),
        read_with(load_camera, path) if run.video and path else None,
        known=known,
        start_s=run.start_s,
        stop_s=run.stop_s,
    )
