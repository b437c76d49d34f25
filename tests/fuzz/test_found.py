"""What fuzzing found, each a file that once ended in a traceback, a crash, a hang or too much memory."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from evaluator.cli.failures import run_safely
from evaluator.cli.group import turnscope
from tests.calibration.test_calibrate_command import GAUGE
from tests.evaluator.synthetic import circling_marks
from tests.evaluator.test_interchange import project_text

TRUTH = circling_marks(6.0, seconds=0.2, sigma_mm=0.0)
FOREIGN = ("--green", "mass A", "--yellow", "mass B", "--unit", "mm", "--rate-hz", "60", "--robot", "barrel")


def zip_whose_directory_lies(folder: Path) -> tuple[str, ...]:
    path = folder / "run.trz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("run.trk", project_text(TRUTH))
    content = bytearray(path.read_bytes())
    entry = content.rfind(b"PK\x01\x02")
    content[entry + 42 : entry + 46] = b"\xf0\xff\xff\xff"  # where the file begins
    path.write_bytes(content)
    return ("turning", str(path), *FOREIGN)


def classic_netcdf_of_unknown_type(folder: Path) -> tuple[str, ...]:
    path = folder / "r.nc"
    name = b"\x00\x00\x00\x04time"
    dimensions = b"\x00\x00\x00\x0a\x00\x00\x00\x01" + name + b"\x00\x00\x00\x02"
    variable = (
        name + b"\x00\x00\x00\x01\x00\x00\x00\x00" + bytes(8) + b"\x00\x00\x00\x7f\x00\x00\x00\x08\x00\x00\x00\x80"
    )
    path.write_bytes(b"CDF\x01" + bytes(4) + dimensions + bytes(8) + b"\x00\x00\x00\x0b\x00\x00\x00\x01" + variable)
    return ("turning", str(path), *FOREIGN)


def netcdf_of_more_numbers_than_a_track_has(folder: Path) -> tuple[str, ...]:
    h5py = pytest.importorskip("h5py", reason="reading HDF5 is an optional extra")
    path = folder / "r.nc"
    with h5py.File(path, "w") as file:
        scale = file.create_dataset("time", shape=(60_000_000,), dtype="f8", chunks=(1000,))
        scale.make_scale("time")
    return ("turning", str(path), *FOREIGN)


def movement_with_a_name_longer_than_the_file(folder: Path) -> tuple[str, ...]:
    h5py = pytest.importorskip("h5py", reason="reading HDF5 is an optional extra")
    path = folder / "r.nc"
    with h5py.File(path, "w") as file:
        file.create_dataset("keypoints", data=["mass A", "mass B"], dtype=h5py.string_dtype())
    with h5py.File(path, "r") as file:
        offset = file["keypoints"].id.get_offset()
    content = bytearray(path.read_bytes())
    content[offset : offset + 4] = b"\xf0\xff\xff\xff"
    path.write_bytes(content)
    return ("turning", str(path), *FOREIGN)


def number_of_four_hundred_digits(folder: Path) -> tuple[str, ...]:
    table = TRUTH.copy()
    text = table.to_csv(index=False).replace("0.0,", f"{'9' * 400},", 1)
    (folder / "m.csv").write_text(text, encoding="utf-8")
    return ("turning", str(folder / "m.csv"), "--robot", "barrel")


def command_of_four_hundred_digits(folder: Path) -> tuple[str, ...]:
    path = folder / "c.csv"
    path.write_text(f"time_s,left_rpm,right_rpm\n0,10,20\n1,{'9' * 400},20\n", encoding="utf-8")
    return ("simulate", "--robot", "barrel", "--command", str(path), "--duration", "0.2", "-o", str(folder / "s.csv"))


def sleap_names_that_are_no_text(folder: Path) -> tuple[str, ...]:
    h5py = pytest.importorskip("h5py", reason="reading HDF5 is an optional extra")
    path = folder / "r.h5"
    with h5py.File(path, "w") as file:
        file["tracks"], file["node_names"] = np.zeros((1, 2, 2, 9)), np.array([b"le\xd7ft", b"right"])
    return ("turning", str(path), *FOREIGN)


def deeplabcut_that_is_no_utf8(folder: Path) -> tuple[str, ...]:
    path = folder / "r.csv"
    path.write_bytes(b"scorer,net,net,net\nbodyparts,a,a,a\ncoords,x,y,likelihood\n0,1,2,\xff\n")
    return ("turning", str(path), *FOREIGN)


def deeplabcut_with_fewer_columns_than_names(folder: Path) -> tuple[str, ...]:
    path = folder / "r.csv"
    head = "scorer,n,n,n,n\nbodyparts,mass A,mass A,mass B,mass B\ncoords,x,y,x,y\n"
    path.write_text(head + "0,1,2\n1,1,2\n", encoding="utf-8")
    return ("turning", str(path), *FOREIGN)


def camera_with_a_ragged_covariance(folder: Path) -> tuple[str, ...]:
    from tests.evaluator.synthetic import write_experiment

    experiment = write_experiment(folder, [("r01", 14.4, 33.3, TRUTH)])
    camera = _camera(folder)
    camera["covariance"][3] = camera["covariance"][3][:-1]
    (folder / "camera.json").write_text(json.dumps(camera), encoding="utf-8")
    text = experiment.read_text(encoding="utf-8")
    experiment.write_text(text.replace("[[run]]", 'camera = "camera.json"\n[[run]]', 1), encoding="utf-8")
    return ("check", str(experiment))


def camera_of_no_size(folder: Path) -> tuple[str, ...]:
    camera = _camera(folder)
    camera["size_px"] = [0, -3]
    (folder / "camera.json").write_text(json.dumps(camera), encoding="utf-8")
    TRUTH.to_csv(folder / "m.csv")
    return ("turning", str(folder / "m.csv"), "--camera", str(folder / "camera.json"))


def gauge_of_millions_of_dots(folder: Path) -> tuple[str, ...]:
    path = folder / "gauge.toml"
    path.write_text(GAUGE.replace("rows = 8", "rows = 5000000"), encoding="utf-8")
    return ("gauge", str(path), "-o", str(folder / "g.pdf"))


def number_in_place_of_the_runs(folder: Path) -> tuple[str, ...]:
    (folder / "experiment.toml").write_text('format = 1\nname = "n"\nrobot = "barrel"\nrun = 5\n', encoding="utf-8")
    return ("check", str(folder / "experiment.toml"))


def marks_of_a_name_that_no_file_can_have(folder: Path) -> tuple[str, ...]:
    lines = ("format = 1", 'name = "n"', 'robot = "barrel"', "[[run]]", 'id = "a"', r'marks = "a\u0000.csv"')
    text = "\n".join((*lines, "left_rpm = 1.0", "right_rpm = 2.0", ""))
    (folder / "experiment.toml").write_text(text, encoding="utf-8")
    return ("check", str(folder / "experiment.toml"))


def key_that_commands_the_terminal(folder: Path) -> tuple[str, ...]:
    path = folder / "robot.toml"
    path.write_text('"a\\u001bb\\u009b\\u202e" = 1\n', encoding="utf-8")
    return ("simulate", "--robot", str(path), "--left", "1", "--right", "1", "--duration", "1", "-o", str(folder / "o"))


def _camera(folder: Path) -> dict[str, object]:
    from calibration.camera import PARAMETERS

    del folder
    numbers = dict.fromkeys(("scale_sigma", "plate_scale_sigma", "tilt_spread_deg", "coverage"), 0.1)
    words = {"level": "sound", "summary": "s", "reasons": [], "next_steps": [], "notes": []}
    verdict = {**words, "mark_height_mm": 6.5, **numbers}
    return {
        "format": 1, "size_px": [640, 480], "lens": "brown", "parameters": dict.fromkeys(PARAMETERS, 1.0),
        "sigma": dict.fromkeys(PARAMETERS, 0.0), "free": [], "covariance": [[0.0] * len(PARAMETERS)] * len(PARAMETERS),
        "gauge": {"format": 1, "name": "g", "dots": {"columns": 3, "rows": 3, "pitch_mm": 3.0, "diameter_mm": 1.0}},
        "variance": 1.0, "images": [], "rms_px": 0.1, "verdict": verdict,
    }  # fmt: skip


FOUND: dict[Callable[[Path], tuple[str, ...]], str] = {
    zip_whose_directory_lies: "cannot be unpacked",
    classic_netcdf_of_unknown_type: "not in the format",
    netcdf_of_more_numbers_than_a_track_has: "no track",
    movement_with_a_name_longer_than_the_file: "more than the file",
    number_of_four_hundred_digits: "time_s = inf is not a time",
    command_of_four_hundred_digits: "not a finite number",
    sleap_names_that_are_no_text: "not a readable HDF5 file",
    deeplabcut_that_is_no_utf8: "utf-8",
    deeplabcut_with_fewer_columns_than_names: "not in the format",
    camera_with_a_ragged_covariance: "covariance are incomplete",
    camera_of_no_size: "not a camera.json",
    number_in_place_of_the_runs: "run = 5",
    marks_of_a_name_that_no_file_can_have: "the character U+0000, which no name may have",
    gauge_of_millions_of_dots: "an image can resolve",
    key_that_commands_the_terminal: r"unknown key a\x1bb\x9b\u202e",
}


@pytest.mark.parametrize("make", FOUND, ids=lambda make: make.__name__)
def test_what_fuzzing_found_ends_in_one_sentence(
    make: Callable[[Path], tuple[str, ...]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("sys.argv", ["turnscope", *make(tmp_path)])
    assert run_safely(turnscope) == 2
    said = capsys.readouterr().err.strip()
    assert FOUND[make] in said
    assert len(said.splitlines()) == 1


def test_bench_that_is_noise_gives_a_law_within_its_bounds() -> None:
    import pandas as pd

    from simulator.slip.bench import checked_bench
    from simulator.slip.fit import fit_slip_law

    rng = np.random.default_rng(1)
    angle = np.linspace(-40, 40, 12)
    torques = {"wheel_torque_mN_mm": rng.normal(2, 1, 12), "disk_torque_mN_mm": rng.normal(20, 5, 12)}
    bench = pd.DataFrame(
        {"slip_angle_deg": angle, "wheel_rpm": 30.0, "disk_rpm": 3.0, "normal_force_mN": 30.0, **torques}
    )
    assert 0 < fit_slip_law(checked_bench(bench)).slip.longitudinal_shape <= 2


def test_course_of_marks_beside_a_long_gap_in_time_is_finite() -> None:
    from evaluator.tracking.uncertainty.course import Course

    time = np.concatenate([np.arange(8) / 50, 1e6 + np.arange(8) / 50])
    course = Course(time, np.column_stack([time * 0 + 5.0, time * 0]))
    assert np.isfinite(course.weights).all()
    np.testing.assert_allclose(course.error[course.known], 0.0, atol=1e-9)


def test_size_of_a_blob_too_faint_to_have_one_stays_a_number() -> None:
    from evaluator.tracking.following.follow_blob import BlobFollower
    from evaluator.tracking.observation import OK, Sighting
    from evaluator.tracking.refinement.blob import Blob

    blob = Blob((5.0, 5.0), np.eye(2), 9.0, -np.eye(2), 0.5, whole=True)
    follower = BlobFollower(np.ones(8), 9.0, 0.5, None, (5.0, 5.0))
    follower.blob = blob
    follower.accept(Sighting(5.0, 5.0, 0.1, 0.1, 0.0, OK), 0.02)
    assert follower.long_px == 0.0
