"""Tables of a turning report: formatted numbers, a row per run or per command."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pandas as pd

from evaluator.report.numbers import UNKNOWN, LengthUnit, command_text, interval, number
from evaluator.report.pages.html import Table
from evaluator.report.runs import RunView, unit_of
from simulator.nominal_robot import WHEELS

MOST_NAMED = 6  # commands in a sentence
Column = Callable[[RunView], str]


def command(left_rpm: float, right_rpm: float, group: str = "") -> str:
    """A command as text."""
    return command_text(left_rpm, right_rpm) + (f" ({group})" if group else "")


def table_of_runs(caption: str, columns: dict[str, Column], runs: Sequence[RunView]) -> Table:
    """A row per run; columns are functions of the run; columns that are unknown for every run are omitted."""
    cells = {head: tuple(cell(run) for run in runs) for head, cell in columns.items()}
    known = {head: column for head, column in cells.items() if set(column) != {UNKNOWN}}
    return Table(caption, tuple(known), tuple(zip(*known.values(), strict=True)))


def slip_table(runs: Sequence[RunView]) -> Table:
    """Slip ratio of the driving and slip angle of all wheels, measured and simulated."""
    columns: dict[str, Column] = {"run": lambda run: run.id, "rpm": lambda run: command(run.left_rpm, run.right_rpm)}
    for name in ("front_left", "front_right"):
        columns[f"slip ratio, {name.replace('_', ' ')}"] = _beside(f"{name}_slip_ratio", 4)
    for name in WHEELS:
        columns[f"slip angle, {name.replace('_', ' ')}, °"] = _beside(f"{name}_slip_angle_deg", 2)
    columns["slip angle of the body, °"] = _beside("body_slip_angle_deg", 2)
    caption = (
        "Upper line: measured; lower: simulated. Measured slip ratios assume that the wheels turn as commanded, so a "
        "motor that turns slower than commanded appears as slip."
    )
    return table_of_runs(caption, columns, runs)


def of_marks(unit: str, runs: Sequence[RunView], cell: Callable[[RunView, str], str]) -> dict[str, Column]:
    """A column for every mark."""
    names = dict.fromkeys(name for run in runs for name in run.mark_names)
    return {f"{name}, {unit}": lambda run, name=name: cell(run, name) for name in names}  # type: ignore[misc]


def outline_table(runs: Sequence[RunView]) -> Table:
    """Radii of marks, wheels and corners, centre of rotation, and smoothness of the motion."""
    unit = unit_of(runs)
    columns: dict[str, Column] = {
        "run": lambda run: run.id,
        **of_marks(unit.name, runs, lambda run, name: run.length(f"{name}_radius_mm")),
        f"outermost wheel, {unit.name}": lambda run: run.length("outer_wheel_radius_mm"),
        f"wall to wall, {unit.name}": lambda run: run.length("wall_to_wall_radius_mm"),
        f"turns about (x, y), {unit.name}": lambda run: f"{run.length('rotation_x_mm')}, {run.length('rotation_y_mm')}",
        f"wander of this centre, {unit.small}": lambda run: number(run.value("center_wander_mm") / unit.small_mm, 1),
        "path efficiency, %": lambda run: number(100 * run.value("path_efficiency"), 2),
        "speed ripple, %": lambda run: number(100 * run.value("speed_ripple"), 1),
        "smoothness": lambda run: number(run.value("smoothness"), 2),
    }
    caption = (
        "Radii about the centre of rotation, of marks, the outermost wheel and the outermost corner (wall to wall, "
        "SAE J695), and position of this centre in the body frame. Path efficiency: length of the fitted over the "
        "driven path. Smoothness: spectral arc length of the speed; nearer zero is smoother."
    )
    return table_of_runs(caption, columns, runs)


def pooled_table(pooled: pd.DataFrame, unit: LengthUnit) -> Table:
    """Repetitions of every command that turns."""
    rows = [
        (
            command(row["left_rpm"], row["right_rpm"], str(row["group"])),
            f"{row['side']}, {row['direction']}",
            f"{row['runs']}",
            number(row["radius_mm"] / unit.mm, 3),
            interval(row["radius_low_mm"] / unit.mm, row["radius_high_mm"] / unit.mm),
            *(
                number(100 * row[f"radius_{part}_mm"] / row["radius_mm"], 3)
                for part in ("between", "within", "systematic")
            ),
        )
        for row in pooled[pooled["side"] != ""].to_dict("records")
    ]
    caption = (
        "Run to run: standard deviation between repetitions, measurement uncertainty subtracted; a dash for a single "
        "run. Noise: standard uncertainty of a run, reduced by more frames. Camera: standard uncertainty common to all "
        "runs, reduced by a better calibration only. The 95 % interval of the mean includes all three; of a single run "
        "it is the run's own."
    )
    radius = f"radius, {unit.name}", f"95 %, {unit.name}"
    head = ("left / right, rpm", "turn", "runs", *radius, "run to run, %", "noise, %", "camera, %")
    return Table(caption, head, tuple(rows))


def standard_sentence(pooled: pd.DataFrame) -> str:
    """Requirements of ISO 4138 that these runs do not meet, in one sentence."""
    turns = pooled[pooled["side"] != ""]
    asks = "ISO 4138 requires turns to both sides and at least three repetitions of each: "
    if (turns["note"] == "").all():
        return asks + "fulfilled."
    few = turns.loc[turns["note"].str.contains("repetitions")]
    alone = turns.loc[turns["note"].str.contains("side")]
    parts = [f"{len(few)} of {len(turns)} commands have fewer" if len(few) else ""]
    if len(alone):
        names = [command_text(left, right) for left, right in zip(alone["left_rpm"], alone["right_rpm"], strict=True)]
        listed = ", ".join(names[:MOST_NAMED]) + (", …" if len(names) > MOST_NAMED else "")
        parts.append(f"{listed} rpm {'were' if len(names) > 1 else 'was'} driven to one side only")
    return asks + "; ".join(filter(None, parts)) + "."


def directions_table(directions: pd.DataFrame, unit: LengthUnit) -> Table:
    """Backward against forward of the same speeds."""
    rows = [
        (
            command(row["left_rpm"], row["right_rpm"], str(row["group"])),
            f"{row['forward_runs']} + {row['backward_runs']}",
            number(row["forward_radius_mm"] / unit.mm, 3),
            number(row["backward_radius_mm"] / unit.mm, 3),
            number(row["radius_change_percent"], 2, sign=True),
            interval(row["radius_change_low_percent"], row["radius_change_high_percent"], 2, sign=True),
            number(row["forward_smoothness"], 3),
            number(row["backward_smoothness"], 3),
            interval(row["smoothness_change_low"], row["smoothness_change_high"], 3, sign=True),
        )
        for row in directions.to_dict("records")
    ]
    caption = (
        "Change: backward relative to forward. Its interval comes from the scatter of repetitions; with one run each "
        "way it contains the measurement uncertainty only, and smoothness has no interval."
    )
    head = (
        *("left / right, rpm", "runs", f"forward, {unit.name}", f"backward, {unit.name}", "change, %", "95 %, %"),
        *("smoothness forward", "backward", "change, 95 %"),
    )
    return Table(caption, head, tuple(rows))


def _beside(name: str, digits: int) -> Column:
    return lambda run: (
        f"{number(run.value(name), digits)}\n{number(run.value(f'simulated_{name}', 'comparison'), digits)}"
    )
