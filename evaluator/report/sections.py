"""The sections of a report, in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from collections.abc import Set as AbstractSet
from pathlib import Path

import numpy as np

from calibration.store import load_camera_file
from evaluator.errors import InputError
from evaluator.files import read_with
from evaluator.report.diagnosis.sections import diagnosis_sections
from evaluator.report.diagnosis.view import DiagnosisView
from evaluator.report.figures.agreement import radius_agreement
from evaluator.report.figures.calibration import distortion_map
from evaluator.report.figures.quality import camera_uncertainty, lost_frames, scale_check
from evaluator.report.figures.radius import radius_against_difference, radius_against_ratio, radius_by_group
from evaluator.report.figures.repetitions import repetitions
from evaluator.report.figures.speed import straight_speed
from evaluator.report.figures.trajectory import representative, trajectories
from evaluator.report.figures.wheel_states import wheel_states_figure
from evaluator.report.measurement.budget import budget_section
from evaluator.report.numbers import UNKNOWN, command_text, interval, number, true_minus
from evaluator.report.pages.circular_test import circular_test_section
from evaluator.report.pages.html import Section, Table
from evaluator.report.runs import RunView, column, unit_of
from evaluator.report.style import Figure
from evaluator.report.summary import tightest
from evaluator.report.tables import (
    directions_table,
    of_marks,
    outline_table,
    pooled_table,
    slip_table,
    standard_sentence,
    table_of_runs,
)
from evaluator.workflow import Analysis, budget_of, circular_test_of
from simulator.errors import SimulationError
from simulator.robot import Robot
from simulator.steady import steady_turn


def sections(
    runs: Sequence[RunView], robot: Robot, cameras: Sequence[Path], diagnosis: DiagnosisView | None, analysis: Analysis
) -> tuple[Section, ...]:
    """All sections for which these runs have data."""
    right = [run for run in runs if run.run not in analysis.excluded_runs]
    turning = [run for run in right if run.turns]
    there = [
        *diagnosis_sections(diagnosis),
        _figures("trajectories-section", "Trajectories", trajectories(right)),
        _figures(
            "radius",
            "Turning radius",
            radius_against_difference(right),
            radius_against_ratio(right, magnetic=any(wheel.attraction_mN for wheel in robot.all_wheels)),
            radius_by_group(right),
            radius_agreement(right),
            tables=(outline_table(turning),) if turning else (),
        ),
        _repetitions(right, analysis),
        _circular_test(analysis, robot),
        _figures("speed", "Straight-line speed", straight_speed(right, robot.driving_radius_mm)),
        _wheels(right, robot),
        _quality(runs, analysis.notes),
        _budget(turning, analysis),
        *(_calibration(path, robot) for path in cameras),
        _run_table(runs, analysis.excluded_runs),
    ]
    return tuple(section for section in there if section is not None)


def _figures(name: str, title: str, *figures: Figure | None, tables: tuple[Table, ...] = ()) -> Section | None:
    there = tuple(figure for figure in figures if figure is not None)
    return Section(name, title, figures=there, tables=tables) if there else None


def _repetitions(runs: Sequence[RunView], analysis: Analysis) -> Section | None:
    """Repetitions of each command, and backward against forward."""
    if analysis.pooled.empty or not (analysis.pooled["side"] != "").any():
        return None
    tables = [pooled_table(analysis.pooled, unit_of(runs))]
    if not analysis.directions.empty:
        tables.append(directions_table(analysis.directions, unit_of(runs)))
    figure = repetitions(runs, analysis.pooled)
    return Section(
        "repetitions-section",
        "Repetitions, sides and directions",
        (standard_sentence(analysis.pooled),),
        (figure,) if figure else (),
        tuple(tables),
    )


def _circular_test(analysis: Analysis, robot: Robot) -> Section | None:
    """The steady-state circular test, if turns were driven at several speeds."""
    try:
        return circular_test_section(circular_test_of(analysis, robot))
    except (InputError, SimulationError):  # no turn, or one without a steady state of the model
        return None


def _wheels(runs: Sequence[RunView], robot: Robot) -> Section | None:
    """Figures 20 and 21: a forward and a backward turn of the same speeds, if there are both."""
    turning = [run for run in runs if run.turns]
    both = [run for run in turning if np.isfinite(run.value("simulated_radius_mm", "comparison"))]
    chosen = {run.backward: run for run in reversed(representative(both, len(both)))}
    figures = []
    for backward in sorted(chosen):
        run = chosen[backward]
        turn = steady_turn(robot, run.left_rpm, run.right_rpm)
        title = f"{'Backward' if backward else 'Forward'}, {run.command}"
        figures.append(wheel_states_figure(f"wheels-{'backward' if backward else 'forward'}", title, robot, turn))
    text = (
        "Forces are simulated. The larger the friction across the wheels, the more of the motors' work goes into "
        "skidding. (Figures 20 and 21 of the paper.)"
    )
    if not figures:
        return None
    measured = [run for run in turning if run.only_mark is None]
    tables = (slip_table(measured),) if measured else ()
    return Section("wheels", "Wheels in a turn", (text,), tuple(figures), tables)


def _quality(runs: Sequence[RunView], notes: dict[str, tuple[str, ...]]) -> Section:
    unit = unit_of(runs)
    columns: dict[str, Callable[[RunView], str]] = {
        "run": lambda run: run.id,
        "frames": lambda run: f"{len(run.marks)}",
        "marks seen, %": lambda run: number(100 * float(run.poses["x_mm"].notna().mean()), 1),
        **of_marks("µm", runs, lambda run, name: number(_mark_sigma_um(run, name), 2)),
        f"residual, {unit.small}": lambda run: number(run.value("residual_rms_mm") / unit.small_mm, 2),
        "frame-to-frame correlation": lambda run: number(run.value("noise_correlation"), 2),
        "start delay, s": lambda run: number(run.value("start_delay_s"), 3),
    }
    by_mark = "Marks: median standard uncertainty of a coordinate as stated by the tracker. "
    residual = (
        "Residual: RMS distance of the poses from the fitted motion; if much larger than the uncertainty of the marks, "
        "the motion is not steady or the camera vibrates."
    )
    delay = " Start delay: a dash where the recording does not show the robot at rest before it starts."
    stated = any(np.isfinite(_mark_sigma_um(run, name)) for run in runs for name in run.mark_names)
    delayed = np.isfinite(column(runs, "start_delay_s")).any()
    caption = (by_mark if stated else "") + residual + (delay if delayed else "")
    figures = tuple(figure for figure in (scale_check(runs), lost_frames(runs)) if figure)
    odd = tuple(f"{run}: {'; '.join(found)}." for run, found in notes.items())
    return Section("quality", "Quality of the measurement", odd, figures, (table_of_runs(caption, columns, runs),))


def _budget(turning: Sequence[RunView], analysis: Analysis) -> Section | None:
    """The budget of the tightest turn among runs without phases and with observed marks that give a heading."""
    whole = {run.id for run in analysis.experiment.run if run.commands is None and run.poses is None}
    able = [run for run in turning if run.run in whole and run.only_mark is None]
    if not able:
        return None
    run = tightest(able)
    return budget_section(run, budget_of(analysis.experiment, analysis.outputs, run.run))


def _calibration(path: Path, robot: Robot) -> Section:
    stored = read_with(load_camera_file, path)
    text = (stored.verdict.summary, *stored.verdict.reasons, *stored.verdict.notes, *stored.verdict.next_steps)
    rows = tuple(
        (Path(image.name).name, f"{image.dots}", f"{image.left_out}", f"{image.rms_px:.4f}") for image in stored.images
    )
    table = Table("Gauge images.", ("image", "dots used", "left out", "residual, px RMS"), rows)
    camera = stored.camera()
    figures = (camera_uncertainty(camera, robot.layout[0].height_mm), distortion_map(camera))
    return Section(f"calibration-{path.stem}", f"Calibration ({path.name})", _sentences(text), figures, (table,))


def _sentences(parts: Sequence[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(part[0].upper() + part[1:].rstrip(".") + "." for part in parts if part))


def _mark_sigma_um(run: RunView, mark: str) -> float:
    names = [f"{mark}_{axis}_sigma_mm" for axis in "xy"]
    if not all(name in run.marks for name in names):
        return float("nan")
    return 1000 * float(np.nanmedian(run.marks[names].to_numpy()))


def _run_table(runs: Sequence[RunView], excluded: AbstractSet[str]) -> Section:
    unit = unit_of(runs)
    columns: dict[str, Callable[[RunView], str]] = {
        "run": lambda run: f"{run.id} (left out)" if run.run in excluded else run.id,
        "left / right, rpm": lambda run: command_text(run.left_rpm, run.right_rpm),
        f"radius, {unit.name}": lambda run: run.length("radius_mm") if run.turns else UNKNOWN,
        f"95 %, {unit.name}": lambda run: (
            interval(run.value("radius_low_mm") / unit.mm, run.value("radius_high_mm") / unit.mm)
            if run.turns
            else UNKNOWN
        ),
        f"simulated, {unit.name}": lambda run: run.length("simulated_radius_mm", "comparison"),
        "difference, %": lambda run: number(run.value("radius_difference_percent", "comparison"), 2, sign=True),
        f"speed, {unit.name}/s": lambda run: run.length("speed_mm_s"),
        "yaw rate, deg/s": lambda run: number(run.value("yaw_rate_deg_s"), 2),
        f"path gap RMS, {unit.name}": lambda run: run.length("gap_rms_mm", "comparison"),
        "frames used, %": lambda run: number(100 * run.value("share_used"), 1),
    }
    if any(run.group for run in runs):
        columns["group"] = lambda run: run.group
    caption = (
        "Radius: minimum turning radius of the robot's centre, sustained for a quarter turn, or over the whole of a "
        "shorter turn; a dash if the run does not turn. Full tables: turning.csv and comparison.csv."
    )
    status = {run.id: str(run.turning["radius_status"]) for run in runs}
    text = tuple(
        true_minus(f"{run}: {reason.replace(': ', ', ')}.") for run, reason in status.items() if reason != "ok"
    )
    return Section("runs", "All runs", text, tables=(table_of_runs(caption, columns, runs),))
