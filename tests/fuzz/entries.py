"""Every file that turnscope reads, with the command that reads it: a valid file, spoilt, goes in under its name."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from calibration.camera import camera_above
from calibration.gauge.geometry import load_gauge
from tests.calibration.drawing import draw_gauge, random_poses
from tests.evaluator.synthetic import circling_marks, three_runs
from tests.evaluator.test_interchange import deeplabcut_text, project_text
from tests.evaluator.tracking.synthetic import draw, turning_marks, write_video
from tests.fuzz import mutations
from tests.fuzz.bags import has_rosbags, write_bags
from tests.fuzz.mutations import Mutation

ROOT = Path(__file__).parents[2]
GAUGE = """format = 1
name = "plate"
[dots]
columns = 7
rows = 5
pitch_mm = 3.0
diameter_mm = 1.2
[tolerance]
dot_mm = 0.002
[[fiducial]]
column = 3
row = 2
diameter_mm = 1.6
"""
TRACKING = """format = 1
distance_diameters = 3.66
exposure = 0.2
region_px = [0, 0, 96, 80]
mask_px = [[0.0, 0.0, 5.0, 5.0]]
[mark.green]
hue_deg = [82.0, 172.0]
diameter_px = 7.0
[mark.yellow]
color = "yellow"
region_px = [0.0, 0.0, 96.0, 80.0]
"""
EXPERIMENT = """format = 1
name = "one run"
robot = "robot.toml"
tracking = "tracking.toml"
notes = "a note"
[[run]]
id = "r01"
left_rpm = 14.0
right_rpm = 33.0
start_s = 0.0
stop_s = 5.0
marks = "marks.csv"
group = "barrel"
notes = "n"
[[run]]
id = "r02"
left_rpm = 14.0
right_rpm = 33.0
video = "wide.mp4"
camera = "camera.json"
rate_hz = 60.0
[known_to]
start_common_s = 0.01
time_base = 1e-4
[relevant]
path_noise_floors = 0.5
[tracks]
unit = "mm"
"""
FOREIGN = ("--green", "mass A", "--yellow", "mass B", "--unit", "mm", "--rate-hz", "60")


@dataclass(frozen=True)
class Entry:
    """A file that a command reads. name: of the file to spoil; arguments: of the command, OUT for its output."""

    name: str
    arguments: tuple[str, ...]
    mutations: tuple[Mutation, ...]
    is_slow: bool = False  # takes a second where the file stays valid: rarely tried in the default suite

    def __str__(self) -> str:
        return f"{self.arguments[0]} {self.name}"


OUT = "OUT"
BYTES, BOXES, PNG, TEXT, TABLE, TOML, JSON = (
    mutations.of_bytes, mutations.of_boxes, mutations.of_png_head, mutations.of_text, mutations.of_table,
    mutations.of_toml, mutations.of_json,
)  # fmt: skip
OF_TOML, OF_TABLE, OF_VIDEO = (TOML, TOML, TOML, TEXT, BYTES), (TABLE, TABLE, TABLE, TEXT, BYTES), (BOXES, BOXES, BYTES)
IMAGES = ("g0.png", "g1.png", "g2.png", "g3.png")


def _entries() -> Iterator[Entry]:
    yield Entry("experiment.toml", ("check", "experiment.toml"), OF_TOML)
    yield Entry("robot.toml", ("check", "experiment.toml"), OF_TOML)
    yield Entry("tracking.toml", ("check", "experiment.toml"), OF_TOML)
    yield Entry("marks.csv", ("check", "experiment.toml"), OF_TABLE)
    yield Entry("camera.json", ("check", "experiment.toml"), (JSON, JSON, TEXT, BYTES))
    yield Entry("wide.mp4", ("check", "experiment.toml"), OF_VIDEO)
    yield Entry("runs.toml", ("analyze", "runs.toml", "-o", OUT, "-q", "--workers", "1"), OF_TOML, is_slow=True)
    yield Entry("r01.csv", ("analyze", "runs.toml", "-o", OUT, "-q", "--workers", "1"), OF_TABLE, is_slow=True)
    yield Entry("robot.toml", ("turning", "marks.csv", "--robot", "robot.toml", "-o", f"{OUT}/t.csv"), OF_TOML)
    yield Entry("robot.toml", ("simulate", "--robot", "robot.toml", "--left", "33", "--right", "5", "--duration", "0.2",
                               "-o", f"{OUT}/s.csv"), OF_TOML)  # fmt: skip
    yield Entry("commands.csv", ("simulate", "--robot", "barrel", "--command", "commands.csv", "--duration", "0.2",
                                 "-o", f"{OUT}/s.csv"), OF_TABLE)  # fmt: skip
    yield Entry("marks.csv", ("turning", "marks.csv", "--robot", "barrel", "-o", f"{OUT}/t.csv"), OF_TABLE)
    yield Entry("one.csv", ("turning", "one.csv", "--scale-px", "0", "0", "100", "0", "--length-mm", "10"), OF_TABLE)
    for name in ("tracker.txt", "run.trk", "dlc.csv"):
        own = (TABLE, TEXT, BYTES) if name != "run.trk" else (TEXT, BYTES, BYTES)
        yield Entry(name, ("turning", name, "--robot", "barrel", *FOREIGN), own)
    for name in ("run.trz", "movement.nc", "classic.nc", "sleap.h5"):
        yield Entry(name, ("turning", name, "--robot", "barrel", *FOREIGN), (BYTES,))
    yield Entry("camera.json", ("turning", "marks.csv", "--robot", "barrel", "--camera", "camera.json"),
                (JSON, JSON, TEXT, BYTES))  # fmt: skip
    yield Entry("gauge.toml", ("gauge", "gauge.toml", "-o", f"{OUT}/g.pdf"), OF_TOML)
    yield Entry("gauge.toml", ("calibrate", *IMAGES, "--gauge", "gauge.toml", "-o", f"{OUT}/c.json", "--no-page"),
                OF_TOML, is_slow=True)  # fmt: skip
    yield Entry("g1.png", ("calibrate", *IMAGES, "--gauge", "gauge.toml", "-o", f"{OUT}/c.json", "--no-page"),
                (PNG, BOXES, BYTES), is_slow=True)  # fmt: skip
    yield Entry("camera.json", ("check-camera", "camera.json", "g0.png", "--gauge", "gauge.toml"), (JSON, TEXT, BYTES))
    for name in ("g0.png", "g0.tiff", "g0.jpg", "g0.bmp"):
        yield Entry(name, ("dots", name), (PNG, PNG, BYTES) if name.endswith("png") else (BOXES, BYTES))
    for name in ("clip.mp4", "clip.avi", "clip.mkv", "clip.ts", "clip.mov", "clip.gif", "times.mkv"):
        yield Entry(name, ("track", name, "-o", f"{OUT}/m.csv", "-q"), OF_VIDEO)
    yield Entry(
        "tracking.toml", ("track", "clip.mp4", "--settings", "tracking.toml", "-o", f"{OUT}/m.csv", "-q"), OF_TOML
    )
    yield Entry(
        "camera.json", ("track", "wide.mp4", "--camera", "camera.json", "-o", f"{OUT}/m.csv", "-q"), (JSON, BYTES)
    )
    yield Entry("corrections.csv", ("track", "clip.mp4", "--corrections", "corrections.csv", "-o", f"{OUT}/m.csv"),
                OF_TABLE)  # fmt: skip
    yield Entry("images/01.png", ("track", "images", "--rate", "60", "-o", f"{OUT}/m.csv", "-q"), (PNG, PNG, BYTES))
    yield Entry("bench.csv", ("slip-bench", "bench.csv", "-o", OUT, "-q"), OF_TABLE, is_slow=True)
    yield Entry(
        "scene.toml", ("render", "scene.toml", "-o", f"{OUT}/v.mp4", "-q", "--workers", "1"), OF_TOML, is_slow=True
    )
    yield Entry(
        "sweep.toml", ("sweep", "sweep.toml", "-o", f"{OUT}/w.csv", "-q", "--workers", "1"), OF_TOML, is_slow=True
    )
    if has_rosbags():
        yield Entry("run.mcap", ("check", "ros.toml"), (BYTES,))


ENTRIES = tuple(_entries())


def lay_out(folder: Path) -> None:
    """Write all the valid files that the entries and readers name."""
    if has_rosbags():
        write_bags(folder)
    _tables(folder)
    _videos(folder)
    camera = _gauge_images(folder)
    _foreign(folder)
    text = (ROOT / "simulator/robots/barrel.toml").read_text(encoding="utf-8")
    effect = '[[effect]]\nid = "plate-tilt"\nangle_deg = 1.8\nazimuth_deg = 4.0\n[tolerance]\n"body.mass_g" = 0.05\n'
    (folder / "robot.toml").write_text(text + effect, encoding="utf-8")
    (folder / "tracking.toml").write_text(TRACKING, encoding="utf-8")
    (folder / "experiment.toml").write_text(EXPERIMENT, encoding="utf-8")
    three_runs(folder).rename(folder / "runs.toml")
    (folder / "experiment.toml").write_text(EXPERIMENT, encoding="utf-8")
    (folder / "camera.json").write_text(camera, encoding="utf-8")
    (folder / "scene.toml").write_text(
        'format = 1\nname = "s"\nseed = 3\nrobot = "barrel"\nduration_s = 0.1\nframe_rate = 20.0\n'
        "[camera]\nsize_px = [96, 80]\nfocal_px = 400.0\ndistance_mm = 150.0\ntilt_deg = 2.0\nk1 = -0.2\n"
        "[sensor]\nfull_well_e = 12000.0\nread_noise_e = 20.0\n"
        '[motion]\nkind = "simulate"\nleft_rpm = 33.0\nright_rpm = 5.0\n',
        encoding="utf-8",
    )
    (folder / "sweep.toml").write_text(
        'format = 1\nname = "s"\nrobot = "barrel"\nduration_s = 0.2\nsamples = 3\nseed = 1\n'
        "[grid]\nleft_rpm = [10.0, 30.0]\nright_rpm = [5.0, 20.0]\n",
        encoding="utf-8",
    )


def _tables(folder: Path) -> None:
    marks = circling_marks(5.81, speed_mm_s=1.287, seconds=2.0)  # as the robot of this command
    marks.loc[3, ["yellow_x_mm", "yellow_y_mm"]] = np.nan
    marks.to_csv(folder / "marks.csv", index=False)
    one = marks[["time_s", "green_x_mm", "green_y_mm"]].rename(columns=lambda name: name.replace("_mm", "_px"))
    one.to_csv(folder / "one.csv", index=False)
    (folder / "commands.csv").write_text("time_s,left_rpm,right_rpm\n0,10,20\n0.1,-5,20\n0.15,0,0\n", encoding="utf-8")
    poses = "time_s,x_mm,y_mm,heading_deg\n0,0,0,0\n0.1,1.5,0.1,3\n0.2,2.9,0.4,6.5\n"
    (folder / "poses.csv").write_text(poses, encoding="utf-8")
    (folder / "corrections.csv").write_text("frame,mark,x,y\n2,green,40.5,33.0\n3,yellow,absent,\n", encoding="utf-8")
    rng = np.random.default_rng(1)
    angle = np.linspace(-40, 40, 12)
    pd.DataFrame(
        {
            "slip_angle_deg": angle, "wheel_rpm": 30.0, "disk_rpm": 3.0, "wheel_torque_mN_mm": rng.normal(2, 1, 12),
            "disk_torque_mN_mm": rng.normal(20, 5, 12), "normal_force_mN": 30.0,
        }
    ).to_csv(folder / "bench.csv", index=False)  # fmt: skip


def _videos(folder: Path) -> None:
    rng = np.random.default_rng(5)
    truth = turning_marks(10, (46.0, 40.0), 6.0, 7.0, 0.02)
    frames = [draw(rng, (96, 80), {name: tuple(at[k]) for name, at in truth.items()}, 3.5, 0.7, 2.0) for k in range(10)]
    for name, codec, pixels in (
        ("clip.mp4", "libx264", "yuv420p"), ("clip.avi", "mjpeg", "yuvj420p"), ("clip.mkv", "ffv1", "bgr0"),
        ("clip.ts", "mpeg2video", "yuv420p"), ("clip.mov", "mpeg4", "yuv420p"), ("clip.gif", "gif", "rgb8"),
    ):  # fmt: skip
        write_video(folder / name, frames, codec=codec, pixels=pixels, rate=Fraction(50))
    wide = [draw(rng, (240, 180), {name: tuple(at[k]) for name, at in truth.items()}, 3.5, 0.7, 2.0) for k in range(10)]
    # of the size that camera.json has
    write_video(folder / "wide.mp4", wide, codec="libx264", pixels="yuv420p", rate=Fraction(50))
    far = [0, 1, 2, 3, 5_000_000, 5_000_001, 5_000_002, 5_000_003, 5_000_004, 5_000_005]
    write_video(folder / "times.mkv", frames, codec="libx264", pixels="yuv420p", pts=far)
    (folder / "images").mkdir()
    for k, frame in enumerate(frames[:4]):
        cv2.imwrite(str(folder / "images" / f"{k:02d}.png"), frame[..., ::-1])


def _gauge_images(folder: Path) -> str:
    """Images of a small gauge; gives the text of a camera.json solved from them."""
    from calibration.estimation.calibrate import calibrate
    from calibration.store import camera_to_json

    (folder / "gauge.toml").write_text(GAUGE, encoding="utf-8")
    gauge = load_gauge(folder / "gauge.toml")
    camera = camera_above(size_px=(240, 180), focal_px=1000, distance_mm=130, tilt_deg=4, k1=-0.3)
    rng = np.random.default_rng(2)
    images = [
        draw_gauge(view, gauge, rng=rng, snr=50) for view in random_poses(camera, 4, rng, tilt_deg=25, shift_mm=1)
    ]
    for name, image in zip(IMAGES, images, strict=True):
        cv2.imwrite(str(folder / name), image)
    for kind in ("tiff", "jpg", "bmp"):
        cv2.imwrite(str(folder / f"g0.{kind}"), images[0])
    return camera_to_json(calibrate(images, gauge, 0, names=list(IMAGES)))


def _foreign(folder: Path) -> None:
    truth = circling_marks(6.0, seconds=0.5, sigma_mm=0.01)
    columns = ["time_s", *(f"{mark}_{axis}_mm" for mark in ("green", "yellow") for axis in "xy")]
    lines = ["\tmass_A\t\tmass_B\t", "t\tx\ty\tx\ty"]
    lines += ["\t".join(f"{value:.9E}" for value in row) for row in truth[columns].itertuples(index=False)]
    (folder / "tracker.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "run.trk").write_text(project_text(truth), encoding="utf-8")
    with zipfile.ZipFile(folder / "run.trz", "w") as archive:
        archive.writestr("files/run.trk", project_text(truth))
    named = (("mass A", "green"), ("mass B", "yellow"))
    points = {name: truth[[f"{mark}_x_mm", f"{mark}_y_mm"]].to_numpy() for name, mark in named}
    (folder / "dlc.csv").write_text(deeplabcut_text(points, np.ones(len(truth))), encoding="utf-8")
    import h5py
    import xarray as xr

    place = np.stack([points[name].T for name, _ in named], axis=1)[None]
    with h5py.File(folder / "sleap.h5", "w") as file:
        file["tracks"], file["node_names"] = place, np.array([b"mass A", b"mass B"])
    data = xr.Dataset(
        {
            "position": (
                ("time", "space", "keypoints", "individuals"),
                np.stack(list(points.values()), axis=-1)[..., None],
            )
        },
        coords={
            "time": truth["time_s"].to_numpy(),
            "space": ["x", "y"],
            "keypoints": list(points),
            "individuals": ["a"],
        },
        attrs={"time_unit": "seconds", "fps": 60.0, "ds_type": "poses"},
    )
    data.to_netcdf(folder / "movement.nc", engine="h5netcdf")
    data.to_netcdf(folder / "classic.nc", engine="scipy")


Runner = Callable[[Entry, bytes], str]
