"""How far predictions from commands are off after one window (2 s), on steps of a driven robot kept aside.

    python -m tests.benchmarks.husky FOLDER [--robot robot.toml] [--diagnose STEPS]

FOLDER: see tests/driven_robot/drive.py. robot.toml: in SI units if you like; that of a Clearpath Husky without it.
Encoders, where there are any, check what was found and are never an input.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evaluator.workflow.results.outputs import Outputs
from simulator.robot import Robot, load_robot
from tests.driven_robot.corrected import MM_PER_M, Corrected, Model, bands, fit, mixed
from tests.driven_robot.drive import Drive, command_of, load, write_experiment
from tests.driven_robot.peers import (
    best_yaw_factor,
    differential,
    rotation_centres,
    with_process,
    wrapped,
)

Array = NDArray[np.float64]
SETTLED_S = 2.0  # after a change of command: motors have come up
LEAST_CHANGE_RAD_S = 3.0  # of a command whose response is drawn out of the encoders
GAINS = {"common": np.array([0.5, 0.5]), "difference": np.array([-1.0, 1.0])}


def main() -> None:
    """Print the table, the bands, and what was found beside what the encoders show."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--robot", type=Path, default=Path(__file__).parents[1] / "driven_robot" / "husky.toml")
    parser.add_argument("--diagnose", type=int, default=0, metavar="STEPS", help="diagnose so many steps, too")
    given = parser.parse_args()
    drive, robot = load(given.folder), load_robot(given.robot)
    windows = np.arange(len(drive))
    fitted, aside = windows[~drive.aside], windows[drive.aside]
    print(f"{len(drive)} windows of {drive.time_s[-1]:g} s, {len(aside)} of them kept aside, by steps")
    model = Model(robot, drive)
    found = fit(model, fitted)
    poses = model.poses(found.values, windows)[:, -1]
    print(f"\n{'error at the end of a window kept aside':42s}     position, m       heading, rad")
    print(f"{'':42s}   median    90 %    median    90 %")
    for name, predict in predictions(drive, robot, poses).items():
        place, turn = errors(predict(), drive, aside)
        cells = [float(np.quantile(part, share)) for part in (place, turn) for share in (0.5, 0.9)]
        print(f"{name:42s} {cells[0]:8.3f} {cells[1]:7.3f}  {cells[2]:8.3f} {cells[3]:7.3f}")
    tell_bands(found, poses, drive, aside)
    tell_numbers(found)
    if np.isfinite(drive.encoder_rad_s).any():
        tell_encoders(found, drive)
    if given.diagnose:
        diagnose_some(drive, fitted, given.robot, given.diagnose)


def predictions(drive: Drive, robot: Robot, poses: Array) -> Mapping[str, Callable[[], Array]]:
    """Last poses (n, 3) of every window by every way of predicting, by name; poses: those of the corrected model."""
    wheels = robot.wheel_positions_mm()
    radius, track = robot.driving_radius_mm / MM_PER_M, float(np.ptp(wheels[:, 1])) / MM_PER_M
    fitted = ~drive.aside
    centres = rotation_centres(drive, radius, track, fitted)
    return {
        "ideal differential drive": lambda: differential(drive, radius, track),
        "with the best constant yaw factor": lambda: best_yaw_factor(drive, radius, track, fitted),
        "instantaneous centres of rotation": lambda: centres,
        "Gaussian process on what they leave": lambda: with_process(centres, drive, fitted),
        "turnscope, corrected": lambda: poses,
        "Gaussian process on what that leaves": lambda: with_process(poses, drive, fitted),
        "(measured wheel speeds, yaw × 0.44)": lambda: differential(drive, radius, track, 0.44, encoders=True),
    }


def errors(poses: Array, drive: Drive, windows: NDArray[np.int64]) -> tuple[Array, Array]:
    """Distance (k,), m, and difference of heading (k,), rad, from the measured last pose."""
    off = (poses - drive.pose[:, -1])[windows]
    return np.hypot(off[:, 0], off[:, 1]), np.abs(wrapped(off[:, 2]))


def tell_bands(found: Corrected, poses: Array, drive: Drive, aside: NDArray[np.int64]) -> None:
    """How many of the windows kept aside lie within the 95 % bands."""
    off = np.abs(poses - drive.pose[:, -1])
    off[:, 2] = np.abs(wrapped(off[:, 2]))
    held = 100 * (off <= bands(found, poses))[aside].mean(axis=0)
    print(f"\n95 % bands of turnscope hold x of {held[0]:.0f} %, y of {held[1]:.0f} %, heading of {held[2]:.0f} %")


def tell_numbers(found: Corrected) -> None:
    """The fitted numbers; sigma is relative, of numbers that may be nought absolute."""
    print("\nfitted to commands and poses:")
    for name, value in found.values.items():
        print(f"  {name:34s} {value:8.3f}   sigma {found.sigma[name]:.2g}")
    dead, lag = found.values["dead_time_s"], found.values["time_constant_s"]
    print(f"  half of a change of speed {dead + lag * np.log(2):.2f} s after the command")


def tell_encoders(found: Corrected, drive: Drive) -> None:
    """What the encoders show of the same: gains of common part and difference in steady windows, and the response."""
    steady = [
        k for k in range(len(drive)) if np.ptp(drive.log(k)[0][-round(SETTLED_S / drive.interval_s) :], 0).max() == 0
    ]
    steady = [k for k in steady if k and (drive.command_rad_s[k] == drive.command_rad_s[k - 1]).all()]
    told = drive.command_rad_s[steady, 0]
    modelled = []
    for k in steady:
        left, right = mixed(command_of(*drive.log(k)), found.values).at(drive.time_s[-1])
        modelled.append((float(left), float(right)))
    measured = drive.encoder_rad_s[steady].mean(axis=1)
    print(f"\ngain of the wheels over the command in {len(steady)} steady windows: by the model, and by the encoders")
    for name, weights in GAINS.items():
        x = told @ weights
        gains = [float(x @ (wheels @ weights) / (x @ x)) for wheels in (np.array(modelled) * np.pi / 30, measured)]
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


def diagnose_some(drive: Drive, fitted: NDArray[np.int64], robot: Path, count: int) -> None:
    """What `turnscope diagnose` finds in whole steps, from commands and poses alone.

    A form without a name that it offers as an own effect is taken, and the steps are diagnosed again.
    """
    from evaluator.workflow.diagnosis.experiment import diagnose_experiment

    steps = np.unique(drive.step[fitted])
    steps = steps[np.unique(np.linspace(0, len(steps) - 1, count).astype(int))]
    windows = np.flatnonzero(np.isin(drive.step, steps))
    with tempfile.TemporaryDirectory() as name:
        path, out = write_experiment(drive, windows, robot, Path(name)), Path(name) / "out"
        tell_diagnosis(f"{len(windows)} windows of {len(steps)} steps", diagnose_experiment(path, out, workers=1)[1])
        offered = Outputs(out).own_effect
        if offered.is_file():
            (Path(name) / "effects").mkdir()
            shutil.copy(offered, Path(name) / "effects")
            tell_diagnosis("the same with the form that it offers", diagnose_experiment(path, out, workers=1)[1])


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
