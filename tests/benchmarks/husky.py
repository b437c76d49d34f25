"""How far predictions from commands are off after one window (2 s) of a driven robot, on steps that were not fitted.

    python -m tests.benchmarks.husky FOLDER [--robot robot.toml] [--diagnose STEPS] [--choice N]

FOLDER: see tests/driven_robot/drive.py. robot.toml: in SI units if you like; that of a Clearpath Husky without it.
Encoders, where there are any, check what was found and are never an input.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from collections.abc import Callable, Mapping
from math import inf
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evaluator.workflow.results.outputs import Outputs
from simulator.robot import Robot, load_robot
from tests.driven_robot.corrected import MM_PER_M, Corrected, Model
from tests.driven_robot.drive import FOLDS, Drive, load, write_experiment
from tests.driven_robot.peers import (
    best_yaw_factor,
    differential,
    rotation_centres,
    with_process,
    wrapped,
)
from tests.driven_robot.predicted import Predicted, predicted

Array = NDArray[np.float64]
SETTLED_S = 2.0  # after a change of command: motors have come up
LEAST_CHANGE_RAD_S = 3.0  # of a command whose response is drawn out of the encoders
LATER_STEPS = 3  # of one choice of steps to be diagnosed than of the choice before: of eight, nine choices share none
GAINS = {"common": np.array([0.5, 0.5]), "difference": np.array([-1.0, 1.0])}


def main() -> None:
    """Print the table, the bands, and what was found beside what the encoders show."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--robot", type=Path, default=Path(__file__).parents[1] / "driven_robot" / "husky.toml")
    parser.add_argument("--diagnose", type=int, default=0, metavar="STEPS", help="only diagnose so many steps")
    parser.add_argument("--choice", type=int, default=0, metavar="N", help="which steps these are: 0, 1, 2, …")
    parser.add_argument("--folds", type=int, default=FOLDS, help="predict only so many of the folds")
    given = parser.parse_args()
    drive, robot = load(given.folder), load_robot(given.robot)
    if given.diagnose:
        diagnose_some(drive, given.robot, given.diagnose, given.choice)
        return
    print(
        f"{len(drive)} windows of {drive.time_s[-1]:g} s in {FOLDS} folds of whole steps, each predicted by the others"
    )
    model, told = Model(robot, drive), drive.fold < given.folds
    last: dict[str, Array] = {}
    held = np.zeros((len(drive), 3))
    for fold in range(given.folds):
        aside = drive.fold == fold
        found = predicted(model, ~aside)
        print(f"fold {fold + 1}: what physics leaves depends on {found.depends_on}")
        for name, predict in predictions(drive, robot, found, ~aside).items():
            last.setdefault(name, np.full((len(drive), 3), np.nan))[aside] = predict()[aside]
        off = found.pose - drive.pose[:, -1]
        off[:, 2] = wrapped(off[:, 2])
        held[aside] = (np.abs(off) <= found.half_width)[aside]
    print(f"\n{'error at the end of a window':42s}     position, m       heading, rad")
    print(f"{'':42s}   median    90 %    median    90 %")
    for name, pose in last.items():
        place, turn = (part[told] for part in errors(pose, drive))
        cells = [float(np.quantile(part, share)) for part in (place, turn) for share in (0.5, 0.9)]
        print(f"{name:42s} {cells[0]:8.3f} {cells[1]:7.3f}  {cells[2]:8.3f} {cells[3]:7.3f}")
    x, y, heading = 100 * held[told].mean(axis=0)
    print(f"\n95 % bands of turnscope hold x of {x:.0f} %, y of {y:.0f} %, heading of {heading:.0f} %")
    tell_numbers(found.corrected)
    if np.isfinite(drive.encoder_rad_s).any():
        tell_encoders(model, found.corrected)


def predictions(
    drive: Drive, robot: Robot, found: Predicted, fitted: NDArray[np.bool_]
) -> Mapping[str, Callable[[], Array]]:
    """Last poses (n, 3) of every window by every way of predicting, by name; found: those of the corrected model."""
    wheels = robot.wheel_positions_mm()
    radius, track = robot.driving_radius_mm / MM_PER_M, float(np.ptp(wheels[:, 1])) / MM_PER_M
    centres = rotation_centres(drive, radius, track, fitted)
    found_by: dict[str, Callable[[], Array]] = {
        "ideal differential drive": lambda: differential(drive, radius, track),
        "with the best constant yaw factor": lambda: best_yaw_factor(drive, radius, track, fitted),
        "instantaneous centres of rotation": lambda: centres,
        "Gaussian process on what they leave": lambda: with_process(centres, drive, fitted),
        "turnscope, physics alone": lambda: found.by_physics,
        "turnscope, corrected": lambda: found.pose,
    }
    if np.isfinite(drive.encoder_rad_s).any():
        by_encoders = differential(drive, radius, track, 0.44, encoders=True)
        found_by["(measured wheel speeds, yaw × 0.44)"] = lambda: by_encoders
    return found_by


def errors(poses: Array, drive: Drive) -> tuple[Array, Array]:
    """Distance (n,), m, and difference of heading (n,), rad, from the measured last pose."""
    off = poses - drive.pose[:, -1]
    return np.hypot(off[:, 0], off[:, 1]), np.abs(wrapped(off[:, 2]))


def tell_numbers(found: Corrected) -> None:
    """The fitted numbers; sigma is relative, of numbers that may be nought absolute."""
    print("\nfitted to commands and poses:")
    for name, value in found.values.items():
        print(f"  {name:34s} {value:8.3f}   sigma {found.sigma[name]:.2g}")
    dead, lag = found.values["dead_time_s"], found.values["time_constant_s"]
    print(f"  half of a small change of speed {dead + lag * np.log(2):.2f} s after the command")


def tell_encoders(model: Model, found: Corrected) -> None:
    """What the encoders show of the same: gains of common part and difference in steady windows, and the response."""
    drive = model.drive
    steady = [
        k for k in range(len(drive)) if np.ptp(drive.log(k)[0][-round(SETTLED_S / drive.interval_s) :], 0).max() == 0
    ]
    steady = [k for k in steady if k and (drive.command_rad_s[k] == drive.command_rad_s[k - 1]).all()]
    told = drive.command_rad_s[steady, 0]
    modelled = np.array([model.wheels_rad_s(found.values, command) for command in told])
    measured = drive.encoder_rad_s[steady].mean(axis=1)
    off = np.sqrt(np.mean((modelled - measured) ** 2))
    print(f"\nwheels in {len(steady)} steady windows: the model is {off:.2f} rad/s (RMS) off the encoders")
    print("gain of the wheels over the command: by the model, and by the encoders")
    for name, weights in GAINS.items():
        x = told @ weights
        gains = [float(x @ (wheels @ weights) / (x @ x)) for wheels in (modelled, measured)]
        print(f"  {name:12s} × {gains[0]:.2f}   × {gains[1]:.2f}")
    curve = response(drive)
    for share in (0.1, 0.5, 0.8):
        at = int(np.argmax(curve > share))
        print(f"  {100 * share:.0f} % of a change of speed by the encoders after {drive.time_s[at]:.2f} s")


def response(drive: Drive) -> Array:
    """Median share (m,) of a change of wheel speed that has come about by every sample after a change of command."""
    curves = []
    for k in range(1, len(drive)):
        change = drive.command_rad_s[k, 0] - drive.command_rad_s[k - 1, -1]
        if np.hypot(*change) < LEAST_CHANGE_RAD_S or np.ptp(drive.command_rad_s[k], axis=0).any():
            continue
        wheels = drive.encoder_rad_s[k]
        last = wheels[-round(0.25 * len(wheels)) :].mean(axis=0) - wheels[0]
        if np.hypot(*last) > LEAST_CHANGE_RAD_S:
            curves.append((wheels - wheels[0]) @ last / (last @ last))
    return np.asarray(np.median(curves, axis=0))


def chosen_steps(drive: Drive, count: int, choice: int) -> NDArray[np.int64]:
    """So many steps, spread over the recording; those of another choice come later by some steps."""
    steps = np.unique(drive.step)
    spread = np.linspace(0, len(steps) - 1, count).astype(int)
    return steps[np.unique((spread + LATER_STEPS * choice) % len(steps))]


def diagnose_some(drive: Drive, robot: Path, count: int, choice: int) -> None:
    """What `turnscope diagnose` finds in whole steps, from commands and poses alone.

    A form without a name that it offers as an own effect is taken, and the steps are diagnosed again.
    """
    from evaluator.workflow.diagnosis.experiment import diagnose_experiment

    steps = chosen_steps(drive, count, choice)
    windows = np.flatnonzero(np.isin(drive.step, steps))
    with tempfile.TemporaryDirectory() as name:
        path, out = write_experiment(drive, windows, robot, Path(name)), Path(name) / "out"
        tell_diagnosis(
            f"{len(windows)} windows of {len(steps)} steps", diagnose_experiment(path, out, workers=1, seconds=inf)[1]
        )
        offered = [file for file in Outputs(out).own_effects if file.is_file()]
        if offered:  # as `turnscope diagnose --effect own_effect.toml` does
            own = [Path(shutil.copy(file, Path(name))) for file in offered]
            content = diagnose_experiment(path, out, workers=1, effects=own, seconds=inf)[1]
            tell_diagnosis("the same with the form that it offers", content)


def tell_diagnosis(what: str, content: Mapping[str, object]) -> None:
    """The verdict, the effects with their sizes, and the gap."""
    kept = ("verdict", "reason", "effects", "gap", "mistakes", "skipped_runs")
    shown = {key: content[key] for key in kept if key in content}
    if isinstance(shown.get("gap"), dict):
        shown["gap"] = {key: value for key, value in shown["gap"].items() if key != "by_run"}
    print(f"\nturnscope diagnose, {what}:")
    print(json.dumps(shown, indent=1, ensure_ascii=False))


if __name__ == "__main__":
    main()
