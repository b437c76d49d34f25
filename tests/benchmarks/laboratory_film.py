"""From video to verdict in the second world: `python -m tests.benchmarks.laboratory_film --clean 4 --keep FOLDER`.

Sessions of tests/laboratory, untidy as ever, are filmed by tests/laboratory/film.py: neither motion nor image comes
from turnscope. Every session has its own camera, light, robot and printed gauge. As a laboratory would, the benchmark
calls `turnscope calibrate` and `turnscope diagnose`; truths lie in another folder. Interrupted, it continues there.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from tests.benchmarks.laboratory import called, diagnosis_of, scored
from tests.laboratory import mess, outside
from tests.laboratory.effects import View
from tests.laboratory.experiment import Drawn, command_lines, ordinary_session, robot_toml, run_name, with_hidden
from tests.laboratory.film import (
    TOP_MM,
    Camera,
    Sheet,
    Studio,
    camera_above,
    film,
    random_body,
    random_look,
    write_video,
)
from tests.laboratory.reference import Array
from tests.laboratory.session import Noise, Session, motion, true_marks

EFFECTS = (
    *("drive-speed-mismatch", "magnet-imbalance", "scrub-torque", "plate-tilt", "axle-compliance", "command-lag"),
    *("motor-droop", "wheel-toe", "friction-gradient", "stray-magnet", "tether-pull", "viscous-drag", "speed-drift"),
    *("friction-level", "mass-offset", "rolling-drag", "speed-ripple", "friction-grain"),
)
MISTAKES = ("reversed", "sides-swapped", "wrong-command")
MESS = (
    *(mess.motors_lag, mess.starts_off_together, mess.starts_jitter, mess.friction_scatters, mess.motor_gains_scatter),
    *(mess.robot_measured_with_callipers, mess.marks_glued_by_hand, mess.mass_weighed, mess.plate_levelled_by_eye),
    *(mess.slip_within_tolerance, mess.magnets_within_tolerance, mess.plate_unevenly_clean),
)
MARGIN_MM = 6.0  # of the marks' paths to the edge of the field
PITCH_ERROR = 5e-4  # of a printed gauge, one sigma: half the tolerance that is usual


def main() -> None:
    """Draw, film, calibrate, diagnose, score, print."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.laboratory_film", description=__doc__)
    for name in ("clean", "odd", "singles", "outside"):
        parser.add_argument(f"--{name}", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0, help="of everything that is drawn")
    parser.add_argument("--minutes", type=float, default=1e6, help="begin no further session after so many minutes")
    parser.add_argument("--keep", type=Path, required=True, help="folder for sessions, truths and rows.jsonl")
    chosen = parser.parse_args()
    ends, file = time.monotonic() + 60 * chosen.minutes, chosen.keep / "rows.jsonl"
    known = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    rows = {row["key"]: row for row in known if row["seed"] == chosen.seed}
    for key in keys(chosen):
        if key not in rows and time.monotonic() < ends:
            rows[key] = {"key": key, "seed": chosen.seed, **measured(key, chosen.seed, chosen.keep)}
            with file.open("a", encoding="utf-8") as out:
                out.write(json.dumps(rows[key]) + "\n")
        if key in rows:
            print(line(rows[key]), flush=True)


def keys(chosen: argparse.Namespace) -> list[str]:
    """What to draw, as "kind/name/number", kinds interleaved."""
    parts = [
        [f"mess/everything/{i}" for i in range(chosen.clean)],
        [f"odd/{MISTAKES[i % len(MISTAKES)]}/{i}" for i in range(chosen.odd)],
        [f"single/{EFFECTS[i % len(EFFECTS)]}/{i}" for i in range(chosen.singles)],
        [f"outside/{list(outside.KINDS)[i % len(outside.KINDS)]}/{i}" for i in range(chosen.outside)],
    ]
    placed = [((i + 0.5) / len(part), key) for part in parts for i, key in enumerate(part)]
    return [key for _, key in sorted(placed, key=lambda pair: pair[0])]


def line(row: dict[str, Any]) -> str:
    """A row for people."""
    said = json.dumps({name: list(values.values()) for name, values in row["said"].items()})
    truth = json.dumps(row["truth"]["effects"] or row["truth"]["outside"] or row["truth"]["odd"])
    wrong = f" FALSE {[(m['runs'], m['kind']) for m in row['false_mistakes']]}" if row["false_mistakes"] else ""
    return (
        f"{row['key']:34s} {row['verdict']:12s} {said}{wrong} | {truth} | camera {row['camera']}, marks "
        f"{row['marks_um']:.1f} um, {row['seconds']:.0f} s {row['message']}"
    )


def measured(key: str, seed: int, folder: Path) -> dict[str, Any]:
    """Draw and film one session, calibrate and diagnose it, score the answer."""
    kind, name, _ = key.split("/")
    digest = hashlib.sha256(f"{seed}/{key}".encode()).digest()
    where, rng = folder / "sessions" / digest.hex()[:10], np.random.default_rng([*digest])
    where.mkdir(parents=True, exist_ok=True)
    camera = camera_above(rng, float(rng.uniform(55, 75)), (640, 480))
    drawn = draw(kind, name, camera, rng)
    frames = write(drawn, camera, where, rng)
    truths = folder / "truths"
    truths.mkdir(exist_ok=True)
    (truths / f"{where.name}.json").write_text(
        json.dumps(drawn.truth, indent=1, default=float) + "\n", encoding="utf-8"
    )
    began = time.perf_counter()
    images = sorted(map(str, where.glob("gauge-*.png")))
    solved = called("calibrate", *images, "--gauge", str(where / "gauge.toml"), "-o", str(where / "camera.json"))
    answer, message = diagnosis_of(where)
    return {
        **scored(drawn.truth, answer),
        "camera": next((word for word in ("sound", "limited", "ill-conditioned") if word in solved.stdout), "none"),
        "marks_um": 1e3 * marks_error_mm(where, frames),
        "runs": drawn.session.runs,
        "seconds": time.perf_counter() - began,
        "message": message,
    }


def draw(kind: str, name: str, camera: Camera, rng: np.random.Generator) -> Drawn:
    """A session that stays in the field of the camera, with its mess and what is hidden in it."""
    plain = in_view(ordinary_session(rng), camera, rng)
    session = plain
    for untidy in MESS:
        session = untidy(session, rng)
    session = replace(session, noise=Noise(white_mm=0.004))  # only sizes are drawn with it: the film makes the noise
    return with_hidden(kind, name, plain, session, rng)


def in_view(session: Session, camera: Camera, rng: np.random.Generator) -> Session:
    """The session with start poses and ends such that every run stays in the field."""
    half = np.array(camera.size_px) * camera.place_mm[2] / camera.focal_px / 2 - MARGIN_MM
    runs = session.runs
    last = rng.uniform(4.0, 6.5, runs)
    end = session.start_s + last
    pose = np.vstack([np.zeros((2, runs)), session.pose[2]])
    session = replace(session, end_s=end, stop_s=np.where(np.isnan(session.stop_s), np.nan, end - 0.5), pose=pose)
    places = np.empty((2, runs))
    for run, (times, marks) in enumerate(true_marks(session)):
        path = marks.reshape(2, 2, -1)
        first = np.minimum.accumulate(path.min(axis=0), axis=1)
        top = np.maximum.accumulate(path.max(axis=0), axis=1)
        inside = ((top - first) < 2 * half[:, None]).all(axis=0)
        count = int(inside.sum())
        end[run] = times[count - 1]
        room = half - (top[:, count - 1] - first[:, count - 1]) / 2
        places[:, run] = rng.uniform(-1, 1, 2) * room - (top[:, count - 1] + first[:, count - 1]) / 2
    # the middle of the field is where the camera looks at the height of the marks
    ahead = camera.rotation[2]
    middle = (camera.place_mm + ahead * (TOP_MM - camera.place_mm[2]) / ahead[2])[:2]
    pose[:2] = places + middle[:, None]
    return replace(session, pose=pose, end_s=end, stop_s=np.where(session.stop_s < end, session.stop_s, np.nan))


def write(drawn: Drawn, camera: Camera, folder: Path, rng: np.random.Generator) -> list[Array]:
    """Gauge images, videos and files of a session; gives the true marks (4, k) of every frame."""
    session, look = drawn.session, random_look(rng)
    studio = Studio(camera, look, rng)
    body = random_body(rng, session.said.length_mm, session.said.width_mm)
    write_gauge(studio, folder, rng)
    frames_per_s = int(rng.choice([30, 60]))
    session = replace(session, view=View(time_factor=session.view.time_factor))
    driven, result = motion(session), []
    lines = ["format = 1", 'name = "session"', 'robot = "robot.toml"', 'camera = "camera.json"']
    for run, recorded in enumerate(true_marks(session)):
        times, marks = (part[..., :: 60 // frames_per_s] for part in recorded)
        poses = driven.pose_at(run, (times - session.start_s[run]) - session.late_s[run])
        result.append(marks)
        moved = replace(session, start_s=session.start_s - times[0], stop_s=session.stop_s - times[0])
        name = run_name(run)
        lines += ["", "[[run]]", f'id = "{name}"', *command_lines(moved, run), f'video = "{name}.mp4"']
        if not (folder / f"{name}.mp4").exists():
            write_video(folder / "new.mp4", film(studio, body, poses, marks), camera.size_px, frames_per_s, look.crf)
            (folder / "new.mp4").rename(folder / f"{name}.mp4")
    (folder / "experiment.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "robot.toml").write_text(robot_toml(session.said, known_to=False), encoding="utf-8")
    return result


def write_gauge(studio: Studio, folder: Path, rng: np.random.Generator) -> None:
    """Seven images of a printed gauge: on the plate, on a spacer, and tilted."""
    said = 4.0
    factor = 1 + rng.normal(0, PITCH_ERROR)
    sheet = Sheet(15, 11, said * factor, 2.0 * factor, ((7, 5), (9, 5)), 3.0 * factor)
    turns = [(0.0, 0.0, 0.1), (0.0, 0.0, 6.6)]
    turns += [(rng.uniform(8, 20), 360 / 5 * i + rng.uniform(-15, 15), rng.uniform(4, 8)) for i in range(5)]
    for number, (tilt, way, height) in enumerate(turns):
        axis = np.radians(tilt) * np.array([-np.sin(np.radians(way)), np.cos(np.radians(way)), 0.0])
        turn = Rotation.from_rotvec(axis).as_matrix()
        shift = np.array([*(rng.uniform(-1.5, 1.5, 2) * (number > 0)), height])
        cv2.imwrite(str(folder / f"gauge-{number}.png"), studio.image(sheet.shapes(turn, shift)))
    text = [
        *("format = 1", 'name = "printed"', "", "[dots]", "columns = 15", "rows = 11", f"pitch_mm = {said}"),
        *("diameter_mm = 2.0", 'color = "black"', 'background = "white"', "height_mm = 0.1"),
    ]
    for column in (7, 9):
        text += ["", "[[fiducial]]", f"column = {column}", "row = 5", "diameter_mm = 3.0"]
    (folder / "gauge.toml").write_text("\n".join(text) + "\n", encoding="utf-8")


def marks_error_mm(folder: Path, true: list[Array]) -> float:
    """RMS error of the tracked marks in plate coordinates, outliers beyond 0.5 mm left out; NaN if none are there."""
    squares = []
    for run, marks in enumerate(true):
        for file in sorted((folder / "out").rglob(f"*{run_name(run)}*.csv")):
            table = pd.read_csv(file, comment="#")
            names = ["green_x_mm", "green_y_mm", "yellow_x_mm", "yellow_y_mm"]
            if set(names) <= set(table.columns) and len(table) == marks.shape[1]:
                off = table[names].to_numpy() - marks.T
                squares.append((off[np.abs(off) < 0.5]) ** 2)
                break
    return float(np.sqrt(np.mean(np.concatenate(squares)))) if squares else float("nan")


if __name__ == "__main__":
    main()
