"""Effects hidden in rendered videos: `python -m tests.benchmarks.diagnosis_video --seed 1 --keep FOLDER`.

Every experiment has its own camera (lens distortion, tilt), calibrated on its own rendered gauge images, 18 clips in
H.264 with run-to-run scatter of friction and wheel gains, and one effect of a family of its own, or none. It is
diagnosed as a lab would, through its experiment.toml with videos; the label stays outside its folder and is opened by
the scorer only. Sizes are drawn from the seed, in the upper two thirds of what the blind bank draws. Some two minutes
an experiment. With --keep a study that was interrupted goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.estimation.calibrate import calibrate
from calibration.gauge.geometry import load_gauge
from calibration.store import camera_to_json
from evaluator.diagnosis.output.robot_file import with_value
from evaluator.files import written_whole
from evaluator.workflow.diagnosis.experiment import diagnose_experiment
from simulator.command import Command
from simulator.effects.entry import EffectEntry
from simulator.rendering import Scene, render_clip
from simulator.rendering.tables import CameraTable
from simulator.robot import Robot, load_robot
from tests.bank.draw import COMMANDS, TOLERANCE, robot_text, seen, sized, slip_changed
from tests.bank.visible import visible_sigmas
from tests.benchmarks.turning_video import GAUGE, gauge_images, random_rig

Array = NDArray[np.float64]

KINDS = (
    *("plate-tilt", "magnet-imbalance", "drive-speed-mismatch", "scrub-torque", "tether-pull", "viscous-drag"),
    *("mark-offset", "friction-gradient", "clean", "clean"),
)
CLIPS, SECONDS, FRAMES_PER_S, START_S = 18, 5.5, 30, 0.5
PERIODS_DEG = {"azimuth_deg": 360.0, "phase_deg": 360.0, "direction_deg": 180.0}
LEAST_SIZE = 1 / 3
MARGIN_MM = 4.0  # of the marks' path to the edge of the image
FRICTION_SCATTER, GAIN_SCATTER = (0.005, 0.02), (0.001, 0.004)


@dataclass(frozen=True)
class Clip:
    """What one recording hides: rpm that the wheels really make, its own factors of friction, where it starts."""

    rpm: tuple[float, float]
    true_rpm: tuple[float, float]
    friction: dict[str, float]
    pose: tuple[float, float, float]
    seed: int


def draw(rng: np.random.Generator, kind: str, rig: CameraTable) -> dict[str, Any]:
    """The label of an experiment: effects with their sizes, scatter, clips."""
    effects = {} if kind == "clean" else {kind: sized(rng, kind, LEAST_SIZE)}
    friction, gain = rng.uniform(*FRICTION_SCATTER), rng.uniform(*GAIN_SCATTER)
    moved = {key.split(".")[1]: 1 + rng.normal() * share for key, share in TOLERANCE.items()}
    clips = []
    for number in range(CLIPS):
        rpm = COMMANDS[number % len(COMMANDS)]
        share, gains = 1 + rng.normal() * friction, 1 + rng.normal(size=2) * gain
        own = {key: value * share for key, value in moved.items()}
        heading = rng.uniform(-np.pi, np.pi)
        place = rng.uniform(-1, 1, 2) * _room(rig, rpm, heading)[0] + _room(rig, rpm, heading)[1]
        clips.append(
            Clip(
                (float(rpm[0]), float(rpm[1])),
                (float(rpm[0] * gains[0]), float(rpm[1] * gains[1])),
                {key: float(value) for key, value in own.items()},
                (float(place[0]), float(place[1]), float(heading)),
                int(rng.integers(2**31)),
            )
        )
    return {"kind": kind, "effects": effects, "scatter": [friction, gain, gain], "clips": [asdict(c) for c in clips]}


def _room(rig: CameraTable, rpm: tuple[float, float], heading: float) -> tuple[Array, Array]:
    """Half of the room (x, y) within which a run may start so that it stays in the image, and its middle."""
    nominal = load_robot("barrel")
    moments = np.linspace(0, SECONDS, 30)
    marks = seen(nominal, Command.constant(*rpm, START_S), moments, (0.0, 0.0, heading), 0)[:, 1:].reshape(-1, 2)
    low, high = marks.min(axis=0), marks.max(axis=0)
    half = np.array(rig.size_px) * rig.distance_mm / rig.focal_px / 2 - MARGIN_MM
    return np.maximum(half - (high - low) / 2, 0.0), -(low + high) / 2


def write(folder: Path, hidden: Path, kind: str, seed: int, number: int) -> dict[str, Any]:
    """Write an experiment's files and videos that are not there yet; gives its label, which is kept in hidden."""
    rng = np.random.default_rng([seed, number])
    rig = random_rig(rng)
    label = draw(rng, kind, rig)
    optics, sensor = {"blur_px": float(rng.uniform(0.6, 1.2))}, {"read_noise_e": float(rng.uniform(20, 100))}
    crf = float(rng.uniform(15, 25))
    folder.mkdir(parents=True, exist_ok=True)
    hidden.mkdir(parents=True, exist_ok=True)
    if not (folder / "camera.json").is_file():
        gauge = load_gauge(GAUGE)
        images = gauge_images(rig, gauge, rng, sensor)
        for index, image in enumerate(images):
            cv2.imwrite(str(folder / f"gauge-{index}.png"), image)
        (folder / "camera.json").write_text(camera_to_json(calibrate(images, gauge)), encoding="utf-8")
    (folder / "robot.toml").write_text(robot_text(), encoding="utf-8")
    runs = ['format = 1\nname = "videos"\nrobot = "robot.toml"\ncamera = "camera.json"\n']
    for index, clip in enumerate(label["clips"]):
        video = folder / f"r{index:02d}.mp4"
        runs.append(f'[[run]]\nid = "r{index:02d}"\nleft_rpm = {clip["rpm"][0]}\nright_rpm = {clip["rpm"][1]}\n'
                    f'start_s = {START_S}\nvideo = "{video.name}"\n')  # fmt: skip
        if video.is_file():
            continue
        robot = hidden / f"{folder.name}-r{index:02d}.toml"
        robot.write_text(_true_text(clip["friction"]), encoding="utf-8")
        x, y, heading = clip["pose"]
        motion = {"kind": "simulate", "left_rpm": clip["true_rpm"][0], "right_rpm": clip["true_rpm"][1],
                  "start_s": START_S, "x_mm": x, "y_mm": y, "heading_deg": float(np.degrees(heading)),
                  "run_index": index}  # fmt: skip
        content = {"format": 1, "seed": clip["seed"], "duration_s": SECONDS, "frame_rate": FRAMES_PER_S,
                   "robot": str(robot), "effect": [{"id": key, **values} for key, values in label["effects"].items()],
                   "motion": motion, "optics": optics, "sensor": sensor, "camera": rig.model_dump(),
                   "encoding": {"codec": "h264", "crf": crf, "preset": "veryfast"}}  # fmt: skip
        with written_whole(video) as temporary:
            render_clip(Scene.model_validate(content), temporary)
    (folder / "experiment.toml").write_text("\n".join(runs), encoding="utf-8")
    return label


def _true_text(factors: dict[str, float]) -> str:
    text, nominal = robot_text(), load_robot("barrel")
    for name, factor in factors.items():
        text = with_value(text, "slip", name, getattr(nominal.slip, name) * factor, "as drawn")
    return text


def scored(folder: Path, label: dict[str, Any]) -> dict[str, Any]:
    """Diagnose an experiment from its file and compare the answer with its label."""
    began = time.perf_counter()
    diagnosis, found = diagnose_experiment(folder / "experiment.toml", folder / "out", _silent)
    seconds = time.perf_counter() - began
    truth, named = label["effects"], {effect["id"]: effect for effect in found["effects"]}
    inside, shown = [], {}
    for effect, shape in named.items():
        for name, spread in shape["parameters"].items():
            shown[f"{effect} {name}"] = [spread["value"], spread["low"], spread["high"]]
            if effect in truth:
                period = PERIODS_DEG.get(name, 1e9)
                middle = (spread["low"] + spread["high"]) / 2
                off = truth[effect][name] - middle
                off -= period * round(off / period)
                inside.append(bool(abs(off) <= (spread["high"] - spread["low"]) / 2))
    credited = {item for name, shape in named.items() for item in (name, *shape["equivalent"])}
    gap = found["gap"]
    return {
        "kind": label["kind"],
        "truth": truth,
        "verdict": found["verdict"],
        "reason": found["reason"],
        "named": shown or sorted(named),
        "right": set(named) == set(truth) and found["verdict"] == ("effect" if truth else "none"),
        "credit": found["verdict"] == ("effect" if truth else "none")
        and len(named) == len(truth)
        and set(truth) <= credited,
        "inside": inside,
        "equivalent": {name: shape["equivalent"] for name, shape in named.items()},
        "gap_before_um": 1e3 * gap["before"]["held_out"],
        "gap_after_um": 1e3 * gap["after"]["held_out"],
        "floor_um": 1e3 * gap["noise_floor"],
        "visible": _visible(diagnosis, label) if diagnosis else {},
        "rivals": found["rivals"][:3],
        "seconds": seconds,
    }


def _visible(diagnosis: Any, label: dict[str, Any]) -> dict[str, float]:
    """Sigmas by which each hidden effect shows in these marks; see bank.visible."""
    found = {}
    for effect in label["effects"]:
        shifts = []
        for run in diagnosis.session.data:
            clip, number = label["clips"][run.order], run.order
            bare = slip_changed(load_robot("barrel"), clip["friction"])
            full = bare.model_copy(update={"effect": (EffectEntry(id=effect, **label["effects"][effect]),)})
            command = Command.constant(*clip["true_rpm"], START_S)
            with_it, without = (_marks(robot, command, run.time_s, clip["pose"], number) for robot in (full, bare))
            shifts.append(with_it - without)
        found[effect] = visible_sigmas(diagnosis, shifts, label["effects"].keys() - {effect})
    return found


def _marks(robot: Robot, command: Command, time_s: Array, pose: tuple[float, float, float], number: int) -> Array:
    return seen(robot, command, time_s, pose, number)[:, 1:]


def _silent(what: str, share: float) -> None:
    del what, share


def line_of(row: dict[str, Any]) -> str:
    """A scored experiment, for people."""
    truth = json.dumps({key: {k: float(f"{v:.4g}") for k, v in item.items()} for key, item in row["truth"].items()})
    named = row["named"]
    told = (
        ", ".join(f"{name} = {v:.4g} [{low:.4g}, {high:.4g}]" for name, (v, low, high) in named.items())
        if isinstance(named, dict)
        else ", ".join(named)
    )
    visible = min(row["visible"].values(), default=float("nan"))
    mark = "" if row["right"] else " (by credit)" if row["credit"] else "  WRONG"
    return (
        f"{truth}\n  -> {row['verdict']}{mark}: {told}; inside {sum(row['inside'])}/{len(row['inside'])}; "
        f"gap aside {row['gap_before_um']:.1f} -> {row['gap_after_um']:.1f} um, noise floor {row['floor_um']:.1f}; "
        f"visible {visible:.0f} sigma; {row['seconds']:.0f} s"
    )


def main() -> None:
    """Render, diagnose, score, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", type=int, default=len(KINDS), help="only so many of the experiments")
    parser.add_argument("--from", dest="first", type=int, default=0, help="leave out so many of them")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="folder of the experiments, to go on from")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        base = options.keep or Path(temporary)
        rows = []
        for number in range(options.first, min(options.first + options.kinds, len(KINDS))):
            kept = base / "labels" / f"{options.seed}-{number}.json"
            if kept.is_file():
                row = json.loads(kept.read_text(encoding="utf-8"))
            else:
                folder = base / f"{options.seed}-{number}"
                label = write(folder, base / "labels", KINDS[number], options.seed, number)
                row = scored(folder, label)
                kept.write_text(json.dumps(row, indent=1), encoding="utf-8")
            rows.append(row)
            print(line_of(row), flush=True)
    hidden = [row for row in rows if row["truth"]]
    clean = [row for row in rows if not row["truth"]]
    print(f"\nnamed {sum(row['right'] for row in hidden)} of {len(hidden)}, with equivalents ", end="")
    print(f"{sum(row['credit'] for row in hidden)}; clean called none {sum(row['right'] for row in clean)} of ", end="")
    print(f"{len(clean)}; intervals cover {sum(sum(row['inside']) for row in rows)} of ", end="")
    print(sum(len(row["inside"]) for row in rows))


if __name__ == "__main__":
    main()
