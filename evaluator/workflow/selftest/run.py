"""The self-test: render, calibrate, track, fit, simulate, diagnose, and compare each figure with its claim."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from calibration.errors import CalibrationError
from evaluator.errors import InputError
from evaluator.progress import Progress, no_progress
from evaluator.workflow.analysis import analyze
from evaluator.workflow.calibration import calibrate
from evaluator.workflow.diagnosis.experiment import diagnose
from evaluator.workflow.execution.machine import available_cores
from evaluator.workflow.rendering import render_scenes
from evaluator.workflow.results.validity import code_hash, installed_version, library_versions
from evaluator.workflow.samples import sample_folder
from evaluator.workflow.selftest import laboratory
from evaluator.workflow.selftest.claims import (
    CALIBRATING,
    CLAIMS,
    DIAGNOSING,
    FITTING,
    SIMULATING,
    TRACKING,
    Claim,
)
from evaluator.workflow.tracking import track_recording
from simulator.errors import SimulationError

Figures = dict[str, float]
RENDERING = "render"
# Stages that need the files of another one; if it fails, files of an earlier self-test must not be used instead.
NEED_FILES_OF = {
    RENDERING: (CALIBRATING, TRACKING, FITTING),
    CALIBRATING: (TRACKING, FITTING),
    TRACKING: (FITTING,),
}
STEADY_S = 1.0  # after the start of the motors: much longer than the transient of some 10 ms
SETTLED_S = 0.5 + STEADY_S


@dataclass(frozen=True)
class Outcome:
    """A claim and its measured value; NaN with the reason if it could not be measured."""

    claim: Claim
    value: float
    reason: str = ""

    @property
    def holds(self) -> bool:
        """Whether the claim holds."""
        return self.claim.holds(self.value)


@dataclass(frozen=True)
class SelfTest:
    """Result of a self-test; seconds: wall time of every stage; machine: properties by name."""

    outcomes: tuple[Outcome, ...]
    seconds: Mapping[str, float]
    machine: Mapping[str, str]
    seed: int

    @property
    def holds(self) -> bool:
        """Whether all claims hold."""
        return all(outcome.holds for outcome in self.outcomes)


def self_test(folder: Path | str, *, seed: int = 1, progress: Progress = no_progress) -> SelfTest:
    """Check the accuracy claims of this version on this machine; all files are kept in the folder.

    A stage that fails does not stop the others, except those that need its files: their figures are NaN with the
    reason. Raises InputError if the sample recipes are not installed, OSError if the folder cannot be written.
    """
    here = Path(folder)
    here.mkdir(parents=True, exist_ok=True)
    sample_folder()
    stages: tuple[tuple[str, Callable[[Path, int], Figures]], ...] = (
        (RENDERING, _render),
        (CALIBRATING, _calibrate),
        (TRACKING, _track),
        (FITTING, _fit),
        (SIMULATING, _simulate),
        (DIAGNOSING, _diagnose),
    )
    figures: Figures = {}
    seconds, reasons = dict[str, float](), dict[str, str]()
    for number, (stage, work) in enumerate(stages):
        if stage in reasons:
            continue
        progress(stage, number, len(stages))
        begun = time.perf_counter()
        try:
            figures |= work(here, seed)
        except (InputError, CalibrationError, SimulationError) as error:
            reasons |= dict.fromkeys((stage, *NEED_FILES_OF.get(stage, ())), str(error))
        seconds[stage] = time.perf_counter() - begun
    progress("done", len(stages), len(stages))
    reason = {claim.id: reasons.get(claim.stage, "not measured") for claim in CLAIMS if claim.id not in figures}
    outcomes = tuple(Outcome(claim, figures.get(claim.id, np.nan), reason.get(claim.id, "")) for claim in CLAIMS)
    return SelfTest(outcomes, seconds, machine_facts(), seed)


def machine_facts() -> dict[str, str]:
    """Properties of this machine for a maintainer, without its name or that of its user."""
    return {
        "turnscope": f"{installed_version('turnscope')}, code {code_hash()[:12]}",
        "system": f"{platform.system()} {platform.release()}, {platform.machine()}",
        "processor": f"{_processor()}, {available_cores()} of {os.cpu_count()} cores",
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        **library_versions(),
    }


def _processor() -> str:
    """Name of the processor, as reported by the system."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown"
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown"


def _render(folder: Path, seed: int) -> Figures:
    orders = [*laboratory.gauge_orders(folder, seed), laboratory.turn_order(folder, seed)]
    faults = [f"{done.path}: {done.fault}" for done in render_scenes(orders) if done.fault]
    if faults:
        raise InputError("; ".join(faults))
    return {}


def _calibrate(folder: Path, seed: int) -> Figures:
    del seed
    found = calibrate(sorted(folder.glob("gauge-*.png")), sample_folder() / "gauge.toml")
    found.save(folder / "camera.json")
    return {"residual_px": float(found.calibration.rms_px)}


def _clip(folder: Path) -> tuple[Path, pd.DataFrame]:
    clip = folder / "turn-33.3-14.4.mp4"
    return clip, pd.read_csv(clip.with_name(f"{clip.stem}-truth.csv"))


def _track(folder: Path, seed: int) -> Figures:
    del seed
    clip, truth = _clip(folder)
    marks = track_recording(clip, folder / "turn.csv", camera=folder / "camera.json").marks
    places = [f"{name}_{axis}_mm" for name in ("green", "yellow") for axis in "xy"]
    error = marks[places].to_numpy()[: len(truth)] - truth[places].to_numpy()[: len(marks)]
    distance2 = np.array([(error[:, :2] ** 2).sum(axis=1), (error[:, 2:] ** 2).sum(axis=1)])
    return {
        "marks_um": 1e3 * float(np.sqrt(np.nanmean(distance2))),
        "frames": float(np.isfinite(error).all(axis=1).sum() / len(truth)),
    }


def _fit(folder: Path, seed: int) -> Figures:
    del seed
    measured = analyze(laboratory.write_turn(folder, folder / "turn.csv"), folder / "turn").turning
    if measured.empty:
        raise InputError(f"{folder / 'turn.csv'}: no turn could be fitted")
    row = measured.iloc[0]
    _, truth = _clip(folder)
    steady = truth[truth["time_s"] > SETTLED_S]
    heading = np.unwrap(np.radians(steady["heading_deg"]))
    length_mm = float(np.hypot(np.diff(steady["x_mm"]), np.diff(steady["y_mm"])).sum())
    radius_mm = length_mm / abs(float(heading[-1] - heading[0]))
    error = abs(float(row["radius_mm"]) - radius_mm)
    half = 0.5 * float(row["radius_high_mm"] - row["radius_low_mm"])
    return {"radius_percent": 100.0 * error / radius_mm, "radius_intervals": error / half}


def _simulate(folder: Path, seed: int) -> Figures:
    """Simulate the first sample turn and compare it with its shipped path."""
    del folder, seed
    from simulator.command import Command
    from simulator.robot import load_robot
    from simulator.run import State
    from simulator.simulation import simulate

    truth = pd.read_csv(sample_folder() / "truth" / "turn-33-5.csv")
    times_s = np.arange(len(truth)) / 60.0
    run = simulate(
        load_robot("barrel"), Command.constant(33.0, 5.0, 0.5), times_s, State(-3.0, 2.0, float(np.radians(60.0)))
    )
    off_mm = np.hypot(run.x_mm - truth["x_mm"], run.y_mm - truth["y_mm"])
    return {"simulated_um": 1e3 * float(off_mm.max())}


def _diagnose(folder: Path, seed: int) -> Figures:
    hidden = laboratory.write_hidden_effect(folder, seed)
    found = diagnose(hidden.experiment, folder / "hidden")
    figures: Figures = {"named": float(found.effects == (laboratory.HIDDEN,))}
    left_out = [run for item in found.content["mistakes"] for run in item["runs"]]
    figures["swapped"] = float(left_out == [hidden.swapped])
    for effect in found.content["effects"]:
        if effect["id"] == laboratory.HIDDEN:
            size = effect["parameters"][laboratory.PARAMETER]
            figures["size_intervals"] = abs(size["value"] - laboratory.SIZE) / (0.5 * (size["high"] - size["low"]))
    return figures
