from __future__ import annotations

import pickle
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click import NoSuchOption

from calibration.camera import camera_above
from evaluator.cli.measurement.turning import turning
from evaluator.errors import InputError
from evaluator.interchange.tracks import Tracks, read_any_marks, read_points
from evaluator.marks import columns_of
from evaluator.workflow.checks import check_experiment
from tests.evaluator.synthetic import circling_marks

COLUMNS = ("time_s", *columns_of(("green", "yellow")))
MARKS = ("green", "yellow")


@pytest.fixture
def truth() -> pd.DataFrame:
    table = circling_marks(6.0, seconds=1.0, sigma_mm=0.0)
    table.loc[3, ["yellow_x_mm", "yellow_y_mm"]] = np.nan
    return table


def assert_same(table: pd.DataFrame, truth: pd.DataFrame, within_mm: float = 1e-9) -> None:
    np.testing.assert_allclose(table[list(COLUMNS)], truth[list(COLUMNS)], atol=within_mm)


@pytest.mark.parametrize(("delimiter", "decimal"), [("\t", "."), (",", "."), (";", ",")])
def test_tracker_text_is_read_with_any_delimiter_and_decimal_sign(
    truth: pd.DataFrame, tmp_path: Path, delimiter: str, decimal: str
) -> None:
    lines = [delimiter.join(["", "mass_A", "", "mass_B", ""]), delimiter.join(["t", "x", "y", "x", "y"])]
    for row in truth[list(COLUMNS)].itertuples(index=False):
        values = [row[0], *(value / 1000 for value in row[1:])]
        lines.append(delimiter.join("" if np.isnan(v) else f"{v:.12E}".replace(".", decimal) for v in values))
    path = tmp_path / "tracker.txt"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    tracks = Tracks(green="mass A", yellow="mass B", unit="m")
    assert_same(read_any_marks(path, tracks), truth, within_mm=1e-8)


def test_tracker_text_without_a_unit_is_asked_for_it(tmp_path: Path) -> None:
    path = tmp_path / "tracker.txt"
    path.write_text("\tgreen\t\tyellow\t\nt\tx\ty\tx\ty\n0\t1\t2\t3\t4\n1\t1\t2\t3\t5\n", encoding="utf-8")
    with pytest.raises(InputError, match="unit"):
        read_any_marks(path)


def test_an_unknown_track_is_answered_with_the_known_ones(tmp_path: Path) -> None:
    path = tmp_path / "tracker.txt"
    path.write_text("\tmass_A\t\tmass_B\t\nt\tx\ty\tx\ty\n0\t1\t2\t3\t4\n", encoding="utf-8")
    with pytest.raises(InputError, match=r'no point named "green" \(there: mass_A, mass_B\)'):
        read_any_marks(path, Tracks(unit="mm"), marks=MARKS)


def deeplabcut_text(points: dict[str, np.ndarray], likelihood: np.ndarray) -> str:
    names = list(points)
    heads = {
        "scorer": ["net"] * 3 * len(names),
        "bodyparts": [name for name in names for _ in range(3)],
        "coords": ["x", "y", "likelihood"] * len(names),
    }
    lines = [",".join([head, *cells]) for head, cells in heads.items()]
    for frame in range(len(likelihood)):
        cells = [f"{value:.9f}" for name in names for value in (*points[name][frame], likelihood[frame])]
        lines.append(",".join([str(frame), *cells]))
    return "\n".join(lines) + "\n"


def test_deeplabcut_points_are_placed_by_the_camera_and_unlikely_ones_are_missing(tmp_path: Path) -> None:
    truth = circling_marks(6.0, seconds=1.0, sigma_mm=0.0)
    camera = camera_above(size_px=(640, 480), focal_px=2000, distance_mm=150, tilt_deg=8, k1=-0.2)
    height = 6.5
    points = {}
    for mark, name in zip(MARKS, ("left_led", "right_led"), strict=True):
        place = truth[[f"{mark}_x_mm", f"{mark}_y_mm"]].to_numpy()
        points[name] = camera.image_from_plate(np.column_stack([place, np.full(len(place), height)]))
    likelihood = np.full(len(truth), 0.99)
    likelihood[5] = 0.1
    path = tmp_path / "r01DLC.csv"
    path.write_text(deeplabcut_text(points, likelihood), encoding="utf-8")
    tracks = Tracks(green="left_led", yellow="right_led", rate_hz=60.0)
    table = read_any_marks(path, tracks, camera, height)
    expected = truth.copy()
    expected.loc[5, list(COLUMNS[1:])] = np.nan
    assert_same(table, expected, within_mm=1e-6)


def test_deeplabcut_without_rate_or_camera_is_asked_for_them(tmp_path: Path) -> None:
    points = {mark: np.zeros((4, 2)) for mark in MARKS}
    path = tmp_path / "dlc.csv"
    path.write_text(deeplabcut_text(points, np.ones(4)), encoding="utf-8")
    with pytest.raises(InputError, match="rate_hz"):
        read_any_marks(path)
    with pytest.raises(InputError, match="camera"):
        read_any_marks(path, Tracks(rate_hz=60.0))


def test_movement_dataset_is_read_in_seconds_and_in_frames(truth: pd.DataFrame, tmp_path: Path) -> None:
    xr = pytest.importorskip("xarray", reason="reading netCDF-4 is an optional extra")
    position = np.stack([truth[[f"{mark}_x_mm", f"{mark}_y_mm"]].to_numpy() for mark in MARKS], axis=-1)[..., None]
    dims = ("time", "space", "keypoints", "individuals")
    coords = {"space": ["x", "y"], "keypoints": list(MARKS), "individuals": ["robot"]}
    for unit, time in (("seconds", truth["time_s"].to_numpy()), ("frames", np.arange(len(truth)))):
        data = xr.Dataset(
            {"position": (dims, position), "confidence": (dims[:1] + dims[2:], np.ones((len(truth), 2, 1)))},
            coords={"time": time, **coords},
            attrs={"time_unit": unit, "fps": 60.0, "ds_type": "poses"},
        )
        path = tmp_path / f"{unit}.nc"
        data.to_netcdf(path, engine="h5netcdf")
        assert_same(read_any_marks(path, Tracks(unit="mm")), truth)


@pytest.mark.parametrize(("name", "dims"), [("place", ("time", "space", "keypoints")), ("position", ("time", "space"))])
def test_a_netcdf_file_without_places_of_points_is_no_movement_dataset(
    name: str, dims: tuple[str, ...], tmp_path: Path
) -> None:
    xr = pytest.importorskip("xarray", reason="reading netCDF-4 is an optional extra")
    path = tmp_path / "other.nc"
    data = xr.Dataset({name: (dims, np.ones((3, 2, 2)[: len(dims)]))}, coords={"time": np.arange(3.0)})
    data.to_netcdf(path, engine="h5netcdf")
    with pytest.raises(InputError, match=r"other\.nc: no position over time, space and keypoints in it"):
        read_any_marks(path, Tracks(unit="mm"))


def project_text(truth: pd.DataFrame, *, unit: str = "", yellow: str = "mass B") -> str:
    """The truth as OSP Tracker saves it: px, y down, on a turned system whose origin and scale stand beside it."""
    origin, angle, per_mm, marks = np.array([320.0, 240.0]), np.radians(30.0), 12.5, ""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for name, mark in (("mass A", "green"), (yellow, "yellow")):
        rows = ""
        for frame, place in enumerate(truth[[f"{mark}_x_mm", f"{mark}_y_mm"]].to_numpy() @ turn.T * per_mm):
            if np.isfinite(place).all():
                x, y = (origin + place * [1, -1]).tolist()
                rows += (
                    f'<property name="[{frame + 10}]" type="object"><object class="FrameData">'
                    f'<property name="x" type="double">{x!r}</property>'
                    f'<property name="y" type="double">{y!r}</property>'
                    "</object></property>"
                )
        marks += (
            f'<property name="item" type="object"><object class="org.opensourcephysics.cabrillo.tracker.PointMass">'
            f'<property name="name" type="string"><![CDATA[{name}]]></property>'
            f'<property name="framedata" type="array">{rows}</property></object></property>'
        )
    said = f'<property name="length_unit" type="string">{unit}</property>' if unit else ""
    system = {"xorigin": 320.0, "yorigin": 240.0, "angle": 30.0, "xscale": per_mm, "yscale": per_mm}
    frame = "".join(f'<property name="{key}" type="double">{value}</property>' for key, value in system.items())
    return (
        '<?xml version="1.0" encoding="UTF-8"?><object class="org.opensourcephysics.cabrillo.tracker.TrackerPanel">'
        '<property name="videoclip" type="object"><object class="VideoClip"><property name="startframe" type="int">10'
        '</property></object></property><property name="clipcontrol" type="object"><object class="ClipControl">'
        f'<property name="delta_t" type="double">{1000 / 60!r}</property></object></property>'
        '<property name="coords" type="object"><object class="System"><property name="framedata" type="array">'
        f'<property name="[0]" type="object"><object class="FrameData">{frame}</object></property></property></object>'
        f'</property>{said}<property name="tracks" type="collection">{marks}</property></object>'
    )


@pytest.mark.parametrize("packed", [False, True])
def test_tracker_project_is_read_with_its_origin_angle_scale_and_frame_rate(
    truth: pd.DataFrame, tmp_path: Path, packed: bool
) -> None:
    path = tmp_path / ("run.trz" if packed else "run.trk")
    if packed:
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("files/run.trk", project_text(truth))
    else:
        path.write_text(project_text(truth), encoding="utf-8")
    assert_same(read_any_marks(path, Tracks(green="mass A", yellow="mass B", unit="mm")), truth, within_mm=1e-6)
    with pytest.raises(InputError, match="unit of length"):
        read_any_marks(path, Tracks(green="mass A", yellow="mass B"))
    with pytest.raises(InputError, match=r"there: mass A, mass B"):
        read_any_marks(path, marks=MARKS)


def test_unit_that_a_tracker_project_names_is_used(truth: pd.DataFrame, tmp_path: Path) -> None:
    path = tmp_path / "run.trk"
    path.write_text(project_text(truth, unit="cm"), encoding="utf-8")
    table = read_any_marks(path, Tracks(green="mass A", yellow="mass B"))
    np.testing.assert_allclose(table["green_x_mm"], 10 * truth["green_x_mm"], atol=1e-6)


def test_broken_project_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "run.trk"
    path.write_text("<?xml version='1.0'?><object", encoding="utf-8")
    with pytest.raises(InputError, match="not a project of OSP Tracker"):
        read_any_marks(path, Tracks(unit="mm"))


def test_sleap_analysis_is_read(truth: pd.DataFrame, tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py", reason="reading HDF5 is an optional extra")
    place = np.stack([truth[[f"{mark}_x_mm", f"{mark}_y_mm"]].to_numpy().T for mark in MARKS], axis=1)[None]
    with h5py.File(tmp_path / "sleap.h5", "w") as file:
        file["tracks"], file["node_names"] = place, np.array([b"left", b"right"])
    said = Tracks(green="left", yellow="right", unit="mm", rate_hz=60.0)
    assert_same(read_any_marks(tmp_path / "sleap.h5", said), truth)
    with pytest.raises(InputError, match="rate_hz"):
        read_any_marks(tmp_path / "sleap.h5", Tracks(green="left", yellow="right", unit="mm"))


def test_individuals_in_csv_of_sleap_are_named_in_front_of_their_nodes(truth: pd.DataFrame, tmp_path: Path) -> None:
    places = truth[list(COLUMNS[1:])].to_numpy()
    lines = ["track,frame_idx,instance.score,left.x,left.y,left.score,right.x,right.y,right.score"]
    for k, (a, b, c, d) in enumerate(places):
        lines.append(f"robot,{k},0.9,{a},{b},{0.1 if k == 5 else 0.9},{c},{d},0.9")
        lines.append(f"other,{k},0.9,1,2,0.9,3,4,0.9")
    path = tmp_path / "sleap.csv"
    path.write_text("\n".join(lines).replace("nan", ""), encoding="utf-8")
    expected = truth.copy()
    expected.loc[5, ["green_x_mm", "green_y_mm"]] = np.nan
    assert_same(read_any_marks(path, Tracks(green="robot_left", yellow="robot_right", unit="mm", rate_hz=60)), expected)
    with pytest.raises(InputError, match=r'no point named "left" \(there: other_left, other_right, robot_left'):
        read_any_marks(path, Tracks(green="left", yellow="right", unit="mm", rate_hz=60.0))


def test_a_project_of_sleap_is_told_what_to_export(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py", reason="reading HDF5 is an optional extra")
    with h5py.File(tmp_path / "robot.slp", "w") as file:
        file["instances"], file["points"] = np.zeros(3), np.zeros(3)
    with pytest.raises(InputError, match="a project of SLEAP; export it"):
        read_any_marks(tmp_path / "robot.slp", Tracks(rate_hz=60.0))


@pytest.mark.parametrize("layout", ["table", "fixed", "animals"])
def test_hdf5_of_deeplabcut_is_read_as_its_csv_is(truth: pd.DataFrame, tmp_path: Path, layout: str) -> None:
    h5py = pytest.importorskip("h5py", reason="reading HDF5 is an optional extra")
    of_each = ("middle",) if layout == "animals" else ()  # the point of each of two animals
    columns = [("net", name, *of_each, part) for name in ("left", "right") for part in ("x", "y", "likelihood")]
    sure = np.full(len(truth), 0.99)
    values = np.column_stack([*truth[["green_x_mm", "green_y_mm"]].to_numpy().T, sure,
                              *truth[["yellow_x_mm", "yellow_y_mm"]].to_numpy().T, sure])  # fmt: skip
    values[5, [2, 5]] = 0.1
    with h5py.File(tmp_path / "dlc.h5", "w") as file:
        group = file.create_group("df_with_missing")
        if layout == "table":  # as pandas.to_hdf(format="table") has PyTables write it
            rows = np.zeros(len(truth), dtype=[("index", "i8"), ("values_block_0", "f8", (6,))])
            rows["index"], rows["values_block_0"] = np.arange(len(truth)), values
            group["table"] = rows
            group.attrs["non_index_axes"] = np.bytes_(pickle.dumps([(1, columns)], 0))
        else:
            group["axis1"], group["block0_values"] = np.arange(len(truth)), values
            for level in range(len(columns[0])):
                names = sorted({column[level] for column in columns})
                group[f"block0_items_level{level}"] = np.array(names, "S")
                group[f"block0_items_label{level}"] = [names.index(column[level]) for column in columns]
    expected = truth.copy()
    expected.loc[5, list(COLUMNS[1:])] = np.nan
    green, yellow = ("_".join((name, *of_each)) for name in ("left", "right"))
    said = Tracks(green=green, yellow=yellow, unit="mm", rate_hz=60.0)
    assert_same(read_any_marks(tmp_path / "dlc.h5", said), expected)


def test_hdf5_that_would_run_something_is_refused(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py", reason="reading HDF5 is an optional extra")
    with h5py.File(tmp_path / "dlc.h5", "w") as file:
        group = file.create_group("df_with_missing")
        group["table"] = np.zeros(3, dtype=[("index", "i8"), ("values_block_0", "f8", (6,))])
        group.attrs["non_index_axes"] = np.bytes_(pickle.dumps(print, 0))
    with pytest.raises(InputError, match="no list of names"):
        read_any_marks(tmp_path / "dlc.h5", Tracks(unit="mm", rate_hz=60.0), marks=MARKS)


def test_check_opens_marks_of_other_programs(tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_text(
        "\tgreen\t\nt\tx\ty\n" + "".join(f"{i}\t{i}\t2\n" for i in range(9)), encoding="utf-8"
    )
    head = 'format = 1\nname = "x"\nrobot = "barrel"\n'
    run = '[[run]]\nid = "r"\nleft_rpm = 1\nright_rpm = 2\nmarks = "t.txt"\n'
    path = tmp_path / "experiment.toml"
    path.write_text(head + run + '[tracks]\nunit = "mm"\n', encoding="utf-8")
    (fault,) = check_experiment(path).faults
    assert "holds the green mark alone" in fault
    path.write_text(head + run, encoding="utf-8")
    (fault,) = check_experiment(path).faults
    assert "unit of length" in fault


def test_project_without_named_marks_gives_every_point_of_the_file(truth: pd.DataFrame, tmp_path: Path) -> None:
    path = tmp_path / "project.trk"
    path.write_text(project_text(truth, unit="mm"), encoding="utf-8")
    assert set(read_points(path)[1]) == {"mass_A", "mass_B"}


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["--left", "mass A", "--right=mass B"], ["left=mass A", "right=mass B"]),  # though there is --left-rpm
        (["--front", "nose"], ["front=nose"]),
    ],
)
def test_option_of_a_mark_may_begin_like_a_known_one(arguments: list[str], names: list[str]) -> None:
    parsed = turning.make_context("turning", ["r.trk", *arguments])
    assert list(parsed.params["names"]) == names


@pytest.mark.parametrize("arguments", [["--left", "33"], ["--strat-s", "3"], ["--robt", "robot.toml"]])
def test_misspelt_option_is_no_mark(arguments: list[str]) -> None:
    with pytest.raises(NoSuchOption):
        turning.make_context("turning", ["r.trk", *arguments])


def test_marks_of_our_own_form_may_have_other_names_too(truth: pd.DataFrame, tmp_path: Path) -> None:
    """The two names exchanged, or one of another tracker; ignored without a word until 30 November."""
    path = tmp_path / "r01.csv"
    truth.to_csv(path, index=False)
    exchanged = read_any_marks(
        path, Tracks.model_validate({"green": "yellow", "yellow": "green"}), marks=("green", "yellow")
    )
    np.testing.assert_array_equal(exchanged["green_x_mm"], truth["yellow_x_mm"])
    np.testing.assert_array_equal(exchanged["yellow_y_mm"], truth["green_y_mm"])
    _, points, _ = read_points(path, Tracks.model_validate({"green": "yellow", "yellow": "green"}))
    np.testing.assert_array_equal(points["green"], truth[["yellow_x_mm", "yellow_y_mm"]])
    named = truth.rename(columns=lambda name: name.replace("green", "front_left"))
    named.assign(front_x_mm=1.0, front_y_mm=2.0, front_left_x_sigma_mm=0.1).to_csv(path, index=False)
    said = Tracks.model_validate({"green": "front_left", "blue": "of another file"})
    table = read_any_marks(path, said, marks=("green", "yellow"))
    np.testing.assert_array_equal(table["green_x_mm"], truth["green_x_mm"])
    assert {"front_x_mm", "green_x_sigma_mm", "yellow_x_mm"} <= set(table)
    with pytest.raises(InputError, match=r"lacks green_x_mm, green_y_mm"):
        read_any_marks(path, None, marks=("green", "yellow"))
    with pytest.raises(
        InputError, match=r"r01.csv: holds yellow itself beside front, which \[tracks\] calls yellow; name both"
    ):
        read_any_marks(
            path, Tracks.model_validate({"green": "front_left", "yellow": "front"}), marks=("green", "yellow")
        )
