"""Marks and cameras as the browser gets them: what the tracker sees, its settings, corrections, gauge images."""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest

from evaluator.workflow.samples import sample_folder
from tests.evaluator.studio.serving import Serving
from tests.waiting import HANGS_S

RUN = "turn-33-5"
EXPERIMENT = f"""format = 1
name = "one run"
robot = "barrel"
camera = "camera.json"

[[run]]
id = "{RUN}"
left_rpm = 33.0
right_rpm = 5.0
start_s = 0.5
video = "{RUN}.mp4"
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in (f"{RUN}.mp4", "gauge.toml", "gauge-1-plate.png", "gauge-3-tilted.png"):
        shutil.copy(sample_folder() / name, tmp_path / name)
    (tmp_path / "experiment.toml").write_text(EXPERIMENT)
    return tmp_path


def path_of(studio: Serving) -> str:
    return f"/api/experiments/{studio.get('/api/home')['experiments'][0]['id']}"


def test_marks_of_a_frame_are_found_with_sigma_and_reasons(studio: Serving) -> None:
    look = f"{path_of(studio)}/runs/{RUN}/look"
    truth = pd.read_csv(sample_folder() / "truth" / f"{RUN}.csv").iloc[100]
    (seen,) = studio.post(look, {"frames": [100]})["frames"]
    for mark in ("green", "yellow"):
        found = seen["marks"][mark]
        assert found["x_px"] == pytest.approx(truth[f"{mark}_x_px"], abs=0.2)
        assert 0 < found["x_sigma_px"] < 0.1
    blue = {"mark": {"green": {"hue_deg": [200, 240]}, "yellow": {}}}
    (seen,) = studio.post(look, {"frames": [100], "said": blue})["frames"]
    assert seen["marks"]["green"]["x_px"] is None
    assert any("hue" in blob["verdict"] for blob in seen["marks"]["green"]["blobs"])
    status, sentence = studio.refused(look, {"frames": [100], "said": {"mark": {"green": {"hue": 3}}}})
    assert (status, "unknown key mark.green.hue" in sentence) == (400, True)


def test_tracking_settings_are_written_and_named_by_the_experiment(studio: Serving, folder: Path) -> None:
    path = path_of(studio)
    (folder / "tracking.toml").write_text(
        "# mine\nformat = 1\n\n[mark.green]\nhue_deg = [82, 172]  # as seen\n[mark.yellow]\n"
    )
    found = studio.get(f"{path}/tracking")
    said = {**found["said"], "region_px": [10, 10, 600, 400]}
    found = studio.post(f"{path}/tracking", {"version": found["version"], "said": said})
    text = (folder / "tracking.toml").read_text()
    assert "# mine" in text
    assert "# as seen" in text
    assert "region_px = [10, 10, 600, 400]" in text
    assert 'tracking = "tracking.toml"' in (folder / "experiment.toml").read_text()
    assert studio.refused(f"{path}/tracking", {"version": "old", "said": said})[0] == 409
    wrong = {"version": found["version"], "said": {**said, "region_px": [5, 5, 1, 1]}}
    assert studio.refused(f"{path}/tracking", wrong)[0] == 400


def test_the_tracker_honours_corrections_and_says_so(studio: Serving, folder: Path) -> None:
    from evaluator.workflow import analyze, calibrate

    images = [folder / "gauge-1-plate.png", folder / "gauge-3-tilted.png"]
    calibrate(images, folder / "gauge.toml").save(folder / "camera.json")
    path = f"{path_of(studio)}/runs/{RUN}/corrections"
    rows = [{"frame": 100, "mark": "green", "x": 123.25, "y": 200.5}, {"frame": 101, "mark": "yellow", "x": None}]
    found = studio.post(path, {"version": "", "rows": rows})
    assert [row["x"] for row in found["rows"]] == [123.25, None]
    assert studio.refused(path, {"version": "", "rows": []})[0] == 409
    analysis = analyze(folder / "experiment.toml", folder / "out", workers=1)
    assert any("2 marks placed or removed by hand" in note for note in analysis.notes[RUN])
    marks = pd.read_csv(folder / "out" / "marks" / f"{RUN}.csv").set_index("frame")
    assert marks.loc[100, "green_x_px"] == 123.25
    assert marks.loc[100, "green_status"] == "corrected"
    assert np.isnan(marks.loc[101, "yellow_x_mm"])
    from evaluator.workflow import pending

    assert pending(folder / "experiment.toml", folder / "out")[RUN] == []
    studio.post(path, {"version": found["version"], "rows": rows[:1]})
    assert "track" in pending(folder / "experiment.toml", folder / "out")[RUN]


def test_dots_of_a_gauge_image_and_its_sheet(studio: Serving) -> None:
    rig = studio.get("/api/rig")
    image = next(one for one in rig["images"] if one["name"] == "gauge-1-plate.png")
    dots = studio.get(f"/api/images/{image['id']}/dots")
    assert sum(dots["of_array"]) == 221
    status, headers, body = studio.ask("GET", f"/api/images/{image['id']}")
    assert (status, headers["content-type"]) == (200, "image/jpeg")
    assert cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR).shape[1] == dots["size_px"][0]
    _, headers, body = studio.ask("GET", f"/api/gauges/{rig['gauges'][0]['id']}/sheet.pdf")
    assert body.startswith(b"%PDF")


def test_only_images_are_shown_as_images(studio: Serving) -> None:
    experiment = studio.get("/api/home")["experiments"][0]["id"]
    status, _, body = studio.ask("GET", f"/api/images/{experiment}")
    assert (status, b"is no image" in body) == (400, True)


def test_a_camera_is_solved_and_its_map_is_least_uncertain_in_the_middle(studio: Serving, folder: Path) -> None:
    rig = studio.get("/api/rig")
    ids = [one["id"] for one in rig["images"]]
    studio.post(f"/api/gauges/{rig['gauges'][0]['id']}/calibrate", {"images": ids, "plate": 0})
    deadline = time.monotonic() + HANGS_S
    while not studio.get(f"/api/undo/camera/{rig['gauges'][0]['id']}")["undo"]:
        assert time.monotonic() < deadline
        time.sleep(0.2)
    (camera,) = studio.get("/api/rig")["cameras"]
    found = studio.get(f"/api/cameras/{camera['id']}")
    grid = np.reshape(found["map"]["sigma_um"], (found["map"]["rows"], found["map"]["columns"]))
    assert grid[12, 16] < grid[0, 0]
    assert found["verdict"]["level"] == camera["level"]
    assert studio.step("camera", rig["gauges"][0]["id"]) == "the calibration"
    assert not (folder / "camera.json").exists()


def test_a_gauge_is_described_without_a_text_editor(studio: Serving, folder: Path) -> None:
    gauge = studio.get("/api/rig")["gauges"][0]["id"]
    path, text = f"/api/gauges/{gauge}/values", (folder / "gauge.toml").read_text()

    def change(place: list[str | int], value: object) -> dict[str, Any]:
        return {"version": studio.get(path)["version"], "place": place, "value": value}

    assert {"place": ["dots", "pitch_mm"], "value": 2.0} in studio.get(path)["values"]
    studio.post(path, change(["dots", "pitch_mm"], 3))
    assert (folder / "gauge.toml").read_text() == text.replace("pitch_mm = 2.0", "pitch_mm = 3.0")
    assert "whole number" in studio.refused(path, change(["dots", "columns"], 17.5))[1]
    assert "no longer in the file" in studio.refused(path, change(["fiducial", 7, "row"], 1))[1]
    assert studio.refused(path, {**change(["dots", "rows"], 9), "version": "older"})[0] == 409
    studio.post(path, change(["fiducial", 1], None))
    assert (folder / "gauge.toml").read_text().count("[[fiducial]]") == 1
    assert studio.step("camera", gauge) == "fiducial of the gauge"
    assert studio.step("camera", gauge) == "pitch_mm of the gauge"
    assert (folder / "gauge.toml").read_text() == text


def test_a_robot_is_described_without_a_text_editor(studio: Serving, folder: Path) -> None:
    experiment = studio.get("/api/home")["experiments"][0]["id"]
    path = f"/api/experiments/{experiment}/robot/values"
    found = studio.get(path)
    assert ({"place": ["marks", "green_mm", 1], "value": 1.83} in found["values"], found["version"]) == (True, "")
    wrong = {"version": "", "place": ["body", "mass_g"], "value": -1}
    assert "greater than 0" in studio.refused(path, wrong)[1]
    studio.post(path, {**wrong, "value": 0.75})  # a shipped robot becomes a file that the experiment names
    assert "mass_g = 0.75" in (folder / "robot.toml").read_text()
    assert 'robot = "robot.toml"' in (folder / "experiment.toml").read_text()
    assert studio.step("runs", experiment) == "mass_g of the robot"
    assert not (folder / "robot.toml").exists()
