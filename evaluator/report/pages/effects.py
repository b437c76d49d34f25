"""The catalogue of effects as one page: description, law, source and limits of each."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from evaluator.mark_geometry import MarkGeometry
from evaluator.pose import poses_from_marks
from evaluator.report.figures.effects import effect_figure
from evaluator.report.numbers import true_minus
from evaluator.report.pages.html import Page, Section, Table, page_html
from simulator.command import Command
from simulator.effects.catalogue import EFFECTS
from simulator.effects.definition import Effect
from simulator.effects.entry import EffectEntry
from simulator.observation import marks_of_run
from simulator.robot import Robot, load_robot
from simulator.run import State
from simulator.simulation import simulate

ROBOT, OF_GROUND = "barrel", "four_driven"  # effects of open ground have little influence on a plate
LEFT_RPM, RIGHT_RPM, DURATION_S = 33.3, 14.4, 6.0  # the turn of the paper's Figure 19
FRAMES_PER_S = 30  # chords of a turn that are shorter than a pixel
RUN_INDEX = 10  # for effects that change from run to run, the eleventh run is drawn
SUMMARY = (
    f"Each drawing: measured path of the centre of the {ROBOT} robot at {LEFT_RPM:g}/{RIGHT_RPM:g} rpm for "
    f"{DURATION_S:g} s, without and with the effect. For effects of open ground: the {OF_GROUND} robot of 50 kg."
)
HEAD = ("parameter", "unit", "default", "fitted from", "to")


def effects_page() -> str:
    """The page as HTML text; it simulates every effect once."""
    robots = [load_robot(OF_GROUND if on_ground else ROBOT) for on_ground in (False, True)]
    plain = [_measured(robot, robot) for robot in robots]
    return page_html(
        Page(
            kind="catalogue",
            title="Effects that turnscope can simulate and find",
            facts=(f"{len(EFFECTS)} effects",),
            summary=(SUMMARY,),
            sections=tuple(_section(it, robots[it.of_ground], plain[it.of_ground]) for it in EFFECTS.values()),
            footer="Made by turnscope.",
        )
    )


def parameter_rows(effect: Effect) -> tuple[tuple[str, str, str, str, str], ...]:
    """Name, unit, default and bounds of a fit of every parameter, as text."""
    return tuple(
        (item.name, item.unit or "–", bound_text(item.absent), bound_text(item.low), bound_text(item.high))
        for item in effect.parameters
    )


def bound_text(bound: float) -> str:
    """A bound as text; a dash if there is none."""
    return true_minus(f"{bound:g}") if math.isfinite(bound) else "–"


def _section(effect: Effect, robot: Robot, plain: pd.DataFrame) -> Section:
    values = {item.name: item.shown_value for item in effect.parameters}
    entry = EffectEntry.model_validate({"id": effect.id, **values})
    changed = _measured(robot.model_copy(update={"effect": (entry,)}), robot)
    table = plain.assign(with_x_mm=changed["x_mm"], with_y_mm=changed["y_mm"])
    sizes = ", ".join(f"{name} = {value:g}" for name, value in values.items())
    return Section(
        effect.id,
        f"{effect.id}: {effect.name}",
        text=(
            effect.sentence,
            f"Law: {effect.law}.",
            f"Source: {effect.source}.",
            f"Limits: {effect.where_valid}",
        ),
        figures=(effect_figure(effect.id, sizes, table),),
        tables=(
            Table(
                "Parameters, and their bounds in a fit. At the default values the effect vanishes.",
                HEAD,
                parameter_rows(effect),
            ),
        ),
    )


def _measured(robot: Robot, stated: Robot) -> pd.DataFrame:
    """time_s, x_mm, y_mm of the centre of a robot as measured by its marks, with the mark positions of stated."""
    times = np.arange(round(1.25 * DURATION_S * FRAMES_PER_S) + 1) / FRAMES_PER_S  # a wrong clock may read less
    run = simulate(robot, Command.constant(LEFT_RPM, RIGHT_RPM), times, State(0.0, 0.0, 0.0), RUN_INDEX)
    marks = marks_of_run(robot, run)
    poses = poses_from_marks(marks, MarkGeometry.of_robot(stated))
    shown = np.arange(round(DURATION_S * FRAMES_PER_S) + 1) / FRAMES_PER_S
    measured_s = marks["time_s"].to_numpy()
    return pd.DataFrame(
        {
            "time_s": shown,
            "x_mm": np.interp(shown, measured_s, poses.x_mm),
            "y_mm": np.interp(shown, measured_s, poses.y_mm),
        }
    )
