"""A folder of recordings to open the studio on: a robot, a camera, and an experiment with two runs of one video."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from evaluator.workflow import calibrate
from evaluator.workflow.samples import sample_folder
from simulator.robot import shipped_robot_text
from tests.waiting import HANGS_S

RUN = "turn-33-5"
EXPERIMENT = """format = 1
name = "<img src=x onerror=alert(1)> & two runs"
robot = "robot.toml"
camera = "camera.json"

[[run]]
id = "left"
left_rpm = 5.0
right_rpm = 33.0
start_s = 0.2
video = "turn-33-5.mp4"

[[run]]
id = "right"
left_rpm = 33.0
right_rpm = 5.0
start_s = 0.5
video = "turn-33-5.mp4"
"""


def two_runs(folder: Path) -> Path:
    """Fill a folder; its experiment's name is HTML."""
    for name in (f"{RUN}.mp4", "gauge.toml", "gauge-1-plate.png", "gauge-3-tilted.png", "gauge-4-tilted.png"):
        shutil.copy(sample_folder() / name, folder / name)
    calibrate(sorted(folder.glob("gauge-*.png")), folder / "gauge.toml").save(folder / "camera.json")
    (folder / "experiment.toml").write_text(EXPERIMENT)
    (folder / "robot.toml").write_text(shipped_robot_text("barrel"))
    return folder


def finished(page: Any, words: str) -> None:
    """Wait until a sentence says that something is done; what is said of a failure instead ends the wait."""
    said = page.wait_for_function(
        """(words) => { const text = document.querySelector("#said").textContent;
        const failed = document.querySelector("#said .bad, #jobs .warn");
        return text.includes(words) ? text : failed && failed.textContent; }""",
        arg=words,
        timeout=1000 * HANGS_S,
    ).json_value()
    assert words in said, said
