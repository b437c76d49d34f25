"""Results, diagnosis and sandbox as the browser gets them."""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path
from typing import Any

import pytest

from evaluator.mark_geometry import MarkGeometry
from evaluator.pose import poses_from_marks
from evaluator.workflow import analyze, out_folder, sandbox_motions
from simulator.command import Command
from simulator.observation import marks_of_run
from simulator.robot import Robot, load_robot, shipped_robot_text
from simulator.simulation import simulate
from tests.evaluator.studio.serving import Serving
from tests.evaluator.synthetic import three_runs

EFFECT = {"id": "plate-tilt", "name": "the plate is not level", "probability": 0.99, "equivalent": []}
NEXT = {
    "left_rpm": 30.0,
    "right_rpm": 10.0,
    "x_mm": 1.0,
    "y_mm": -2.0,
    "heading_deg": 90.0,
    "duration_s": 5.0,
    "times": 2,
}


def found() -> dict[str, Any]:
    """A diagnosis.json by hand."""
    value = {"value": 1.8, "low": 1.7, "high": 1.9}
    empty: dict[str, Any] = {"negligible": [], "known_to": [], "where": [], "rivals": [], "skipped_runs": {}}
    return {
        "format": 1, "verdict": "effect", "reason": "it pays for itself", **empty,
        "effects": [{**EFFECT, "parameters": {"angle_deg": value}}],
        "gap": None, "findings": [], "runs_not_followed": [],
        "mistakes": [{"runs": ["r02"], "kind": "reversed", "sentence": "r02 drives the opposite way to its command"}],
        "next_experiment": {"runs": [NEXT], "separation_sigmas": {}, "inseparable_sigmas": {}, "most_runs": 6},
    }  # fmt: skip


@pytest.fixture(scope="module")
def analysed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    experiment = three_runs(tmp_path_factory.mktemp("circles"))
    analyze(experiment, out_folder(experiment), simulate=True, workers=1)
    robot = (
        shipped_robot_text("barrel") + '\n[[effect]]\nid = "plate-tilt"\nangle_deg = 1.8  # found\nazimuth_deg = 40.0\n'
    )
    (out_folder(experiment) / "robot_with_effect.toml").write_text(robot)
    (out_folder(experiment) / "diagnosis.json").write_text(json.dumps(found()))
    return experiment


@pytest.fixture(scope="module")
def prepared(analysed: Path) -> Path:
    return analysed.parent


def path_of(studio: Serving) -> str:
    return f"/api/experiments/{studio.get('/api/home')['experiments'][0]['id']}"


def test_results_are_those_of_the_analysis(studio: Serving) -> None:
    answer = studio.get(f"{path_of(studio)}/results")
    runs = {run["id"]: run for run in answer["runs"]}
    assert runs["r01"]["radius_mm"] == pytest.approx(6.0, rel=0.01)
    assert runs["r03"]["radius_mm"] is None
    assert answer["gap_mm"] > 0
    assert max(runs["r01"]["path"]["y_mm"]) == pytest.approx(6 * (1 - math.cos(359 / 60 * 2 / 6)), abs=0.05)


def test_the_effect_found_is_added_to_the_robot_and_the_experiment_names_it(studio: Serving, tmp_path: Path) -> None:
    path = path_of(studio)
    view = studio.get(f"{path}/diagnosis")
    assert "drives the opposite way" in view["lines"][0]
    view = studio.post(f"{path}/robot", {"version": view["robot"]["version"]})
    assert view["in_robot"] == [{"id": "plate-tilt", "angle_deg": 1.8, "azimuth_deg": 40.0}]
    assert 'robot = "robot.toml"' in (tmp_path / "folder" / "experiment.toml").read_text()
    assert "# found" in (tmp_path / "folder" / "robot.toml").read_text()
    state = studio.get(f"{path}/state")
    assert state["outdated"]["r01"] == ["simulate"]
    assert state["diagnosis"] == "stale"


def test_a_robot_changed_meanwhile_is_not_overwritten(studio: Serving) -> None:
    path = path_of(studio)
    version = studio.get(f"{path}/diagnosis")["robot"]["version"]
    studio.post(f"{path}/robot", {"version": version})
    status, sentence = studio.refused(f"{path}/robot", {"version": version})
    assert (status, "changed meanwhile" in sentence) == (409, True)


def test_an_effect_of_ones_own_is_added_with_comments_kept(studio: Serving, tmp_path: Path) -> None:
    path = path_of(studio)
    version = studio.get(f"{path}/diagnosis")["robot"]["version"]
    studio.post(f"{path}/robot", {"version": version, "effects": {"scrub-torque": {"radius_mm": 0.2}}})
    text = (tmp_path / "folder" / "robot.toml").read_text()
    assert tomllib.loads(text)["effect"] == [{"id": "scrub-torque", "radius_mm": 0.2}]
    assert text.count("#") == shipped_robot_text("barrel").count("#")
    status, sentence = studio.refused(f"{path}/robot", {"version": version, "effects": {"scrub": {"radius_mm": 1}}})
    assert (status, "unknown effect" in sentence) == (400, True)


def test_a_reversed_command_is_mended(studio: Serving) -> None:
    path = path_of(studio)
    assert studio.post(f"{path}/mend", {"mistake": "reversed", "runs": ["r02"]}) == {"changed": 1}
    rows = {row["id"]: row for row in studio.get(path)["rows"]}
    assert (rows["r02"]["left_rpm"], rows["r02"]["right_rpm"]) == (-5.0, -33.0)
    assert studio.refused(f"{path}/mend", {"mistake": "pushed", "runs": ["r02"]})[0] == 400


def test_a_mended_copy_is_not_written_where_no_run_shows_a_mistake(studio: Serving) -> None:
    status, sentence = studio.refused(f"{path_of(studio)}/mended", {})
    assert (status, "no run shows a mistake" in sentence) == (400, True)


def test_the_next_experiment_is_written_out(studio: Serving) -> None:
    made = studio.post(f"{path_of(studio)}/next", {})
    rows = studio.get(f"/api/experiments/{made['id']}")["rows"]
    assert [row["left_rpm"] for row in rows] == [30.0, 30.0]
    assert "heading 90 deg" in rows[0]["notes"]


def test_sandbox_draws_what_the_simulation_says() -> None:
    effects = {"plate-tilt": {"angle_deg": 10.0, "azimuth_deg": 40.0}, "mark-offset": {"x_mm": 0.3, "angle_deg": 2.0}}
    (drawn,) = sandbox_motions("barrel", [(33.3, 14.4)], nominal={}, effects=effects, duration_s=4.0)
    content = tomllib.loads(shipped_robot_text("barrel"))
    robot = Robot.model_validate({**content, "effect": [{"id": name, **values} for name, values in effects.items()]})
    run = simulate(robot, Command.constant(33.3, 14.4), [i / 20 for i in range(81)])
    seen = poses_from_marks(marks_of_run(robot, run), MarkGeometry.of_robot(robot))
    assert drawn["x_mm"] == pytest.approx(seen.x_mm, abs=1e-3)
    assert drawn["y_mm"] == pytest.approx(seen.y_mm, abs=1e-3)


def test_the_next_runs_are_drawn_at_the_size_of_the_robot_file(studio: Serving) -> None:
    answer = studio.post("/api/sandbox", {"robot": "four_driven", "commands": [[30, 10]], "duration_s": 0.1})
    body = load_robot("four_driven").body
    assert answer["body"] == {"length_mm": body.length_mm, "width_mm": body.width_mm}


def test_sandbox_refuses_what_cannot_be(studio: Serving) -> None:
    ask = {"robot": "barrel", "commands": [[30, 10]]}
    assert studio.refused("/api/sandbox", {**ask, "effects": {"plate-tilt": {"slope": 1}}})[0] == 400
    assert studio.refused("/api/sandbox", {**ask, "nominal": {"body.colour": 1}})[0] == 400
    assert studio.refused("/api/sandbox", {**ask, "duration_s": 1e9})[0] == 400
    assert studio.refused("/api/sandbox", {**ask, "robot": "../../etc/passwd"})[0] == 400
    assert studio.refused("/api/sandbox", {"robot": "barrel", "commands": [[1, 2]] * 61})[0] == 400


def test_every_effect_has_sliders_with_bounds(studio: Serving) -> None:
    for effect in studio.get("/api/sandbox?robot=column")["effects"]:
        for slider in effect["sliders"]:
            assert slider["low"] <= slider["value"] <= slider["high"], effect["id"]
            assert slider["step"] > 0
