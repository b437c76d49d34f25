from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from evaluator.interchange.tracks import Tracks, read_any_marks
from evaluator.marks import columns_of, read_marks
from evaluator.workflow import Analysis, analyze
from evaluator.workflow.exporting import export
from tests.evaluator.synthetic import three_runs

COLUMNS = ("time_s", *columns_of(("green", "yellow")))


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Analysis:
    folder = tmp_path_factory.mktemp("export")
    found = analyze(three_runs(folder), folder / "out", simulate=True, workers=1, command_line=["export", "x"])
    export(found)
    return found


def test_json_holds_every_row_and_where_it_comes_from(exported: Analysis) -> None:
    results = json.loads(exported.outputs.results.read_text(encoding="utf-8"))
    assert [row["run"] for row in results["turning"]] == ["r01", "r02", "r03"]
    assert results["turning"][0]["radius_mm"] == pytest.approx(exported.turning["radius_mm"][0], rel=1e-12)
    assert results["turning"][2]["radius_mm"] is None
    provenance = results["provenance"]
    assert set(provenance["inputs_sha256"]) == {"experiment.toml", "r01.csv", "r02.csv", "r03.csv"}
    assert provenance["command_line"] == ["export", "x"]
    assert provenance["settings"]["run"][0]["left_rpm"] == 14.4


def test_netcdf_comes_back_as_the_same_marks(exported: Analysis) -> None:
    pytest.importorskip("xarray", reason="reading netCDF is an optional extra")
    again = read_any_marks(exported.outputs.netcdf("r01"), Tracks(unit="mm"))
    marks = read_marks(exported.outputs.marks("r01"))
    np.testing.assert_array_equal(again[list(COLUMNS)], marks[list(COLUMNS)])


def test_netcdf_is_a_movement_dataset_with_provenance(exported: Analysis) -> None:
    xr = pytest.importorskip("xarray", reason="reading netCDF is an optional extra")
    data = xr.load_dataset(exported.outputs.netcdf("r02"), engine="scipy")
    assert data["position"].dims == ("time", "space", "keypoints", "individuals")
    assert list(data["keypoints"].to_numpy()) == ["green", "yellow", "center"]
    assert data.attrs["time_unit"] == "seconds"
    assert json.loads(data.attrs["provenance"])["experiment"] == "experiment.toml"
    poses = pd.read_csv(exported.outputs.poses("r02"))
    center = data["position"].sel(keypoints="center", space="x").to_numpy()[:, 0]
    np.testing.assert_array_equal(center, poses["x_mm"])


def test_movement_opens_the_netcdf_and_finds_the_speed_of_the_robot(exported: Analysis) -> None:
    xr = pytest.importorskip("xarray", reason="reading netCDF is an optional extra")
    reason = "movement is an optional extra: pip install turnscope[movement]"
    datasets = pytest.importorskip("movement.validators.datasets", reason=reason)
    kinematics = pytest.importorskip("movement.kinematics", reason=reason)
    data = xr.load_dataset(exported.outputs.netcdf("r01"), engine="scipy")
    datasets.ValidPosesInputs.validate(data)
    speed = kinematics.compute_speed(data["position"]).sel(keypoints="center", individuals="robot")
    expected = exported.turning.set_index("run").loc["r01", "speed_mm_s"]
    assert float(speed.median()) == pytest.approx(expected, rel=0.01)


def test_the_same_results_give_the_same_bytes(exported: Analysis) -> None:
    before = exported.outputs.netcdf("r03").read_bytes(), exported.outputs.results.read_bytes()
    export(exported)
    assert (exported.outputs.netcdf("r03").read_bytes(), exported.outputs.results.read_bytes()) == before
