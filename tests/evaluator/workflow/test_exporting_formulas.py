"""What is written for other programs and for a new experiment: names, units, values, and what stays as it is."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.io import netcdf_file

from evaluator.errors import InputError
from evaluator.files import read_with
from evaluator.workflow import demo, exporting, fresh, samples, simulation
from evaluator.workflow.analysis import Analysis
from evaluator.workflow.results.outputs import Outputs
from simulator.robot import load_robot


def two_frames(out: Path) -> Outputs:
    """Marks and poses of a run of two frames; the first mark is hidden in the second."""
    outputs = Outputs(out)
    marks = pd.DataFrame({"time_s": [0.5, 0.75]})
    for k, name in enumerate(("green", "red")):
        for axis, letter in enumerate("xy"):
            marks[f"{name}_{letter}_mm"] = [10.0 * k + axis, np.nan if k == 0 else 7.0 + axis]
    marks["red_x_sigma_mm"], marks["red_y_sigma_mm"] = 0.25, 0.5
    poses = pd.DataFrame({"x_mm": [1.0, 2.0], "y_mm": [3.0, 4.0], "heading_deg": [30.0, 390.0]})
    poses["x_sigma_mm"] = poses["y_sigma_mm"] = 0.125
    for path, table in ((outputs.marks("r"), marks), (outputs.poses("r"), poses)):
        path.parent.mkdir(parents=True)
        table.to_csv(path, index=False)
    return outputs


def test_a_run_is_written_as_a_dataset_of_its_marks_and_then_its_centre(tmp_path: Path) -> None:
    exporting.write_netcdf(two_frames(tmp_path), "r", tmp_path / "r.nc", {"b": 1, "a": 2})
    with netcdf_file(tmp_path / "r.nc", "r", mmap=False) as file:
        units = {
            name: variable.units.decode() for name, variable in file.variables.items() if hasattr(variable, "units")
        }
        found = {name: np.array(variable[:]) for name, variable in file.variables.items()}
        dimensions = {name: variable.dimensions for name, variable in file.variables.items()}
        said = {
            key: getattr(file, key).decode() for key in ("ds_type", "time_unit", "source_software", "run", "provenance")
        }
    np.testing.assert_array_equal(found["time"], [0.5, 0.75])
    np.testing.assert_array_equal(found["heading"], [30.0, 390.0])
    np.testing.assert_array_equal(
        found["position"][..., 0], [[[0.0, 10.0, 1.0], [1.0, 11.0, 3.0]], [[np.nan, 7.0, 2.0], [np.nan, 8.0, 4.0]]]
    )
    np.testing.assert_array_equal(found["position_sigma"][1, :, :, 0], [[np.nan, 0.25, 0.125], [np.nan, 0.5, 0.125]])
    np.testing.assert_array_equal(found["confidence"][..., 0], [[1, 1, 1], [0, 1, 1]])
    names = {key: [b"".join(row).rstrip(b"\0").decode() for row in found[key]] for key in ("space", "keypoints")}
    assert names == {"space": ["x", "y"], "keypoints": ["green", "red", "center"]}
    assert units == {
        "time": "s", "position": "mm", "position_sigma": "mm", "heading": "degree",
        "confidence": "1 measured, 0 absent",
    }  # fmt: skip
    assert dimensions["position"] == ("time", "space", "keypoints", "individuals")
    assert dimensions["confidence"] == ("time", "keypoints", "individuals")
    assert said == {
        "ds_type": "poses", "time_unit": "seconds", "source_software": "turnscope", "run": "r",
        "provenance": '{"a": 2, "b": 1}',
    }  # fmt: skip


@pytest.mark.parametrize("compared", [True, False])
def test_results_hold_every_table_and_a_file_of_each_run_that_did_not_fail(
    tmp_path: Path, compared: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exporting, "input_files", lambda _: [])
    outputs, table = two_frames(tmp_path), pd.DataFrame({"run": ["r"], "radius_mm": [np.inf]})
    outputs.provenance.write_text('{"experiment": "day"}', encoding="utf-8")
    runs: Any = SimpleNamespace(name="day", run=[SimpleNamespace(id="r"), SimpleNamespace(id="bad")])
    faults, notes = {"bad": "no marks"}, {"r": ("a note",)}
    analysis = Analysis(runs, outputs, table, table, table, table if compared else None, faults, notes, 0)
    assert exporting.export(analysis) == [outputs.results, outputs.netcdf("r")]
    assert outputs.netcdf("r").is_file()
    said = json.loads(outputs.results.read_text(encoding="utf-8"))
    assert (said["format"], said["provenance"]) == (1, {"experiment": "day"})
    assert (said["faults"], said["notes"]) == (faults, {"r": ["a note"]})
    assert said["turning"] == said["pooled"] == said["directions"] == [{"run": "r", "radius_mm": None}]
    assert ("comparison" in said) == compared


def test_a_new_experiment_takes_the_place_of_no_file(tmp_path: Path) -> None:
    written = fresh.new_experiment(str(tmp_path / "day"), "four_driven")
    assert [path.name for path in written] == ["experiment.toml", "gauge.toml", "tracking.toml", "robot.toml"]
    assert read_with(load_robot, written[3]) == load_robot("four_driven")
    for path in (written[0], written[2]):
        path.unlink()
    with pytest.raises(InputError, match=r"day: gauge\.toml, robot\.toml exist already"):
        fresh.new_experiment(tmp_path / "day")
    assert not written[0].exists()


def test_samples_are_copied_without_their_truth_and_without_files_that_are_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, copied = tmp_path / "source", list[str]()
    names = ("experiment.toml", "a.mp4", "puzzle/a.csv", "truth/a.csv", "recipes/a.toml", "__init__.py", ".hidden")
    for name in names:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).write_text(name, encoding="utf-8")
    copyfile = samples.shutil.copyfile
    monkeypatch.setattr(samples, "sample_folder", lambda: source)
    monkeypatch.setattr(samples.shutil, "copyfile", lambda at, to: copied.append(at.name) or copyfile(at, to))
    assert samples.copy_samples(tmp_path / "to") == tmp_path / "to" / "experiment.toml"
    there = sorted(str(path.relative_to(tmp_path / "to")) for path in (tmp_path / "to").rglob("*") if path.is_file())
    assert there == ["a.mp4", "experiment.toml", "puzzle/a.csv"]
    (tmp_path / "to" / "a.mp4").write_text("another", encoding="utf-8")
    copied.clear()
    samples.copy_samples(tmp_path / "to")
    assert copied == ["a.mp4"]
    assert (tmp_path / "to" / "a.mp4").read_text(encoding="utf-8") == "a.mp4"


def test_the_camera_of_the_samples_is_that_of_their_gauge_images(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, saved = list[Any](), list[Path]()
    for name in ("gauge-2.png", "gauge-1.png", "other.png"):
        (tmp_path / name).touch()
    found = SimpleNamespace(save=saved.append)
    monkeypatch.setattr(demo, "copy_samples", lambda folder: folder / "experiment.toml")
    monkeypatch.setattr(demo, "precompile", lambda video: asked.append(video.name) or True)
    monkeypatch.setattr(
        demo, "calibrate", lambda images, gauge, **_: asked.append(([one.name for one in images], gauge.name)) or found
    )
    ready = demo.prepare_samples(str(tmp_path))
    assert asked == ["turn-33-5.mp4", (["gauge-1.png", "gauge-2.png"], "gauge.toml")]
    assert saved == [tmp_path / "camera.json"]
    assert (ready.experiment, ready.puzzle) == (tmp_path / "experiment.toml", tmp_path / "puzzle" / "experiment.toml")
    assert ready.compiling is True


@pytest.mark.parametrize("kind", ["mjcf", "sdf"])
def test_a_robot_is_written_in_the_language_of_the_simulator_asked_for(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("mjcf", "sdf"):
        monkeypatch.setattr(
            f"simulator.exchange.{name}.{name}", lambda robot, *rpm, name=name: f"{name} {robot.name} {rpm}"
        )
    monkeypatch.setattr("simulator.exchange.losses.losses", lambda *said: said[1:])
    robot = load_robot("barrel")
    assert simulation.export_robot("barrel", tmp_path / "r", 30.0, 20.0, kind) == (30.0, 20.0, kind)
    assert (tmp_path / "r").read_text(encoding="utf-8") == f"{kind} {robot.name} (30.0, 20.0)"
