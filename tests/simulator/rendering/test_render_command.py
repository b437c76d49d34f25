"""`turnscope render`: files where they are wanted, faults in one sentence, nothing half written."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner, Result

from calibration.errors import CalibrationError
from evaluator.cli.simulation.render import render
from evaluator.errors import InputError
from simulator.errors import SimulationError

SCENE = """format = 1
duration_s = 0.05
{}
[camera]
size_px = [160, 120]
focal_px = 600.0
[motion]
kind = "line"
speed_mm_s = 2.0
"""


def run(*arguments: object) -> Result:
    return CliRunner().invoke(render, [str(argument) for argument in arguments])


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_clip_and_truth_go_where_they_are_wanted(tmp_path: Path) -> None:
    scene = write(tmp_path / "scene.toml", SCENE.format('output = "clips/a.mp4"\ntruth = "truth/a.csv"'))
    assert run(scene).exit_code == 0
    assert (tmp_path / "clips" / "a.mp4").stat().st_size > 500
    assert len(pd.read_csv(tmp_path / "truth" / "a.csv")) == 3
    assert run(scene, "-o", tmp_path / "b.mp4").exit_code == 0
    assert (tmp_path / "b.mp4").exists()


def test_many_scenes_are_rendered_and_a_bad_one_does_not_stop_the_rest(tmp_path: Path) -> None:
    good = [write(tmp_path / f"{k}.toml", SCENE.format(f'seed = {k}\noutput = "{k}.mp4"')) for k in range(3)]
    bad = write(tmp_path / "bad.toml", SCENE.format('output = "bad.mp4"\n[timing]\ndropped = [99]'))
    result = run(bad, *good, "--workers", 1)
    assert isinstance(result.exception, InputError)
    assert "1 of 4 scenes" in str(result.exception)
    assert "frame 99" in str(result.exception)
    assert [path.name for path in sorted(tmp_path.glob("*.mp4"))] == ["0.mp4", "1.mp4", "2.mp4"]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("sed = 3", "did you mean seed"),
        ('rig = "nowhere.toml"', "nowhere.toml: no such file"),
        ('robot = "barel"', "barrel"),
        ('robot = "robot.toml"', "robot.toml: no such file"),
        ("[exposure]\ntime_s = 0.1", "longer than a frame"),
        ('frame_rate = "sixty"', "60000/1001"),
        ('kind = "film"', 'kind "run" or "gauge"'),
        ('kind = "gauge"', "gauge is missing"),
        (
            '[motion]\nkind = "circle"\nradius = 3.0\nspeed_mm_s = 1.0',
            "unknown key motion.radius; did you mean radius_mm",
        ),
        ("[[wire]]\npoints_px = [[1, 2]]", "wire[1].points_px"),
    ],
)
def test_faults_of_a_scene_are_one_sentence(tmp_path: Path, more: str, said: str) -> None:
    tables = more.startswith("[")
    text = SCENE.format("" if tables else more) + (more if tables else "")
    text = text.replace('[motion]\nkind = "line"\nspeed_mm_s = 2.0\n', "", int(more.startswith("[motion]")))
    result = run(write(tmp_path / "scene.toml", text), "-o", tmp_path / "clip.mp4")
    assert isinstance(result.exception, InputError | SimulationError | CalibrationError)
    assert said in str(result.exception)
    assert "\n" not in str(result.exception)
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


def test_bad_pose_files_are_explained(tmp_path: Path) -> None:
    text = SCENE.format("").replace('kind = "line"\nspeed_mm_s = 2.0', 'kind = "poses"\nfile = "poses.csv"')
    scene = write(tmp_path / "scene.toml", text)
    for content, said in (
        ("time_s,x_mm\n0,0\n", "lacks y_mm, heading_deg"),
        ("time_s,x_mm,y_mm,heading_deg\n0,0,0,0\n0,1,1,1\n", "time_s that increases"),
        ("", "the file is empty"),
    ):
        write(tmp_path / "poses.csv", content)
        result = run(scene, "-o", tmp_path / "clip.mp4")
        assert said in str(result.exception)
        assert not (tmp_path / "clip.mp4").exists()
