"""The notebook of the main job runs as it stands and shows what it says; values are shown in a line, not as arrays."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pytest

import calibration
import evaluator
import simulator
from evaluator.errors import InputError
from evaluator.workflow.samples import copy_samples
from tests.end_to_end.notebook import NOTEBOOK, run_cells

LARGEST_BYTES = 150_000
CAMERA = calibration.camera_above(size_px=(640, 480), focal_px=2300.0, distance_mm=150.0)


def test_the_notebook_gives_the_text_that_it_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mpl.use("Agg")
    copy_samples(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert (tmp_path / NOTEBOOK).stat().st_size < LARGEST_BYTES
    notebook = json.loads((tmp_path / NOTEBOOK).read_text(encoding="utf-8"))
    stored = [cell["outputs"] for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert [texts(cell) for cell in run_cells(notebook)] == [texts(cell) for cell in stored]


def texts(outputs: list[dict[str, Any]]) -> list[list[str]]:
    return [output.get("text") or output["data"]["text/plain"] for output in outputs]


@pytest.mark.parametrize("package", [calibration, simulator, evaluator])
def test_dir_shows_every_public_name(package: Any) -> None:
    assert set(package.__all__) <= set(dir(package))


def test_values_are_shown_in_a_line_and_as_html() -> None:
    run = evaluator.simulate("barrel", 33.3, 14.4, duration_s=1.0)
    assert repr(run).startswith("Run(samples 61, time 0 to 1 s, from (0.00, 0.00) mm, to (")
    marks = simulator.marks_of_run(simulator.load_robot("barrel"), run)
    robot = simulator.load_robot("barrel")
    poses = evaluator.poses_from_marks(marks, evaluator.MarkGeometry.of_robot(robot))
    turning = evaluator.measure_turning(poses)
    camera, steady = CAMERA, simulator.steady_turn(robot, 33.3, 14.4)
    for value in (run, turning, poses, camera, steady, robot, simulator.Command.constant(33.3, 14.4)):
        assert "\n" not in repr(value)
        assert "array" not in repr(value)
    assert repr(camera).startswith("Camera(640 × 480 px, brown lens, focal length ")
    assert repr(steady).startswith("SteadyTurn(radius -5.93")
    assert repr(poses).startswith("Poses(frames 61, with a pose 61, time 0 to 1 s, from (0.00, 0.00) mm, to (")
    for value in (run, turning, poses, camera):
        assert "<table>" in value._repr_html_()


def test_marks_that_have_no_place_on_the_plate_are_refused_in_a_sentence() -> None:
    run = evaluator.simulate("barrel", 33.3, 14.4, duration_s=1.0)
    robot = simulator.load_robot("barrel")
    marks = simulator.marks_of_run(robot, run)
    in_px = marks.rename(columns=lambda name: name.replace("_mm", "_px"))
    with pytest.raises(InputError, match="must be placed on the plate with a camera"):
        evaluator.poses_from_marks(in_px, evaluator.MarkGeometry.of_robot(robot))
    with pytest.raises(InputError, match=r"use MarkGeometry\.of_robot"):
        evaluator.poses_from_marks(marks, evaluator.MarkGeometry(robot.points_mm), CAMERA)
    with pytest.raises(InputError, match="compute poses with evaluator"):
        evaluator.plot_run(marks)


def test_a_diagnosis_is_drawn_before_and_after() -> None:
    from matplotlib.figure import Figure

    gap = {"unit": "mm", "noise_floor": 0.006, "before": {"fit": 0.41}, "after": {"fit": 0.007, "held_out": 0.008}}
    axes = evaluator.plot_diagnosis({"gap": gap}, Figure().subplots())
    assert [bar.get_height() for bar in axes.patches] == [0.41, 0.007, 0.008]


def test_a_plan_takes_a_robot_or_its_name_and_refuses_a_plate_without_room() -> None:
    with pytest.raises(InputError, match=r"a plate of 3 by 3 mm leaves .* no room to drive"):
        evaluator.plan(simulator.load_robot("barrel"), 4, plate_mm=(3.0, 3.0))
