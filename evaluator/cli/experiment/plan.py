"""turnscope plan: which runs to drive, and what they can detect."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from evaluator.cli.options import PATH, json_option, refuse_both

if TYPE_CHECKING:
    from evaluator.workflow import Plan


@click.command(
    epilog="\b\nExamples:\n  turnscope plan --robot barrel --runs 18 --rpm 30 --rpm 60 --plate 40 30\n"
    "  turnscope plan --robot mine/robot.toml -o mine/experiment.toml\n"
    "  turnscope plan --circular-test --rpm 20 --rpm 40 --rpm 60 --ratio 0.5 -o circular.toml"
)
@click.option("--robot", default="barrel", show_default=True, metavar="NAME|FILE", help="Shipped robot or robot.toml.")
@click.option("--runs", type=click.IntRange(min=1, max=200), default=18, show_default=True, help="Number of runs.")
@click.option(
    "--rpm",
    "levels",
    type=click.FloatRange(min=0, min_open=True),
    multiple=True,
    default=(30.0, 60.0),
    show_default=True,
    help="Speed of the faster wheel; may be repeated.",
)
@click.option(
    "--plate",
    type=click.FloatRange(min=0, min_open=True),
    nargs=2,
    default=(40.0, 30.0),
    show_default=True,
    metavar="X Y",
    help="Visible part of the plate along x and y, mm; the origin is in its middle.",
)
@click.option("--circular-test", "circular", is_flag=True, help="Plan a steady-state circular test (ISO 4138) instead.")
@click.option(
    "--ratio", type=float, multiple=True, help="Circular test: speed of slower over faster wheel; may be repeated."
)
@click.option("--radius", "radius_mm", type=float, metavar="MM", help="Circular test at this constant radius.")
@click.option(
    "--repetitions", type=click.IntRange(1, 50), default=3, show_default=True, help="Circular test: repetitions."
)
@click.option(
    "-o",
    "--out",
    "output",
    type=PATH,
    metavar="TOML",
    help="Write an experiment.toml with these runs and a command file for each in commands/. Never overwrites.",
)
@json_option
@click.pass_context
def plan(
    context: click.Context,
    robot: str,
    runs: int,
    levels: tuple[float, ...],
    plate: tuple[float, float],
    circular: bool,
    ratio: tuple[float, ...],
    radius_mm: float | None,
    repetitions: int,
    output: Path | None,
    as_json: bool,
) -> int:
    """Plan the runs of an experiment, and predict which effects they can detect.

    The first table lists the runs in the order to drive them: straight runs and turns to both sides, forward and
    backward, then repetitions. Each start pose is chosen to carry the most information about all effects together, and
    each run stays on the plate.

    The second table lists every effect at a modest size: the significance with which it would be detected, in sigmas,
    given usual tracking noise and run-to-run scatter, and the significance with which it would be distinguished from
    the most similar effect. Tolerances (start of motion, marks, wheels, level of the plate) can mimic an effect. Where
    one does, the last columns name the quantity to measure better, and the significance after that.

    With --circular-test: turns to both sides, forward and backward, at three speeds or more (--rpm), with constant
    commands (--ratio) or constant radius (--radius), with the radii that the model predicts.
    """
    if circular:
        refuse_both(ratio, radius_mm)
        given = {"rpm": levels} if context.get_parameter_source("levels") == ParameterSource.COMMANDLINE else {}
        return _plan_circular_test(robot, given, ratio, radius_mm, repetitions, output, as_json=as_json)
    if ratio or radius_mm is not None:
        raise click.UsageError("--ratio and --radius belong to --circular-test")
    from evaluator.files import plain
    from evaluator.workflow import plan as plan_experiment
    from evaluator.workflow import planned_files, write_plan

    if output is not None:
        planned_files(output, runs)  # existing files are refused before the plan is computed
    found = plan_experiment(robot, runs, rpm=levels, plate_mm=plate)
    written = write_plan(found, robot, output) if output is not None else None
    if as_json:
        click.echo(json.dumps(plain(asdict(found)), indent=2))
    elif written is not None:
        _say_written(written)
    else:
        click.echo(_plan_text(found))
    return 0


def _plan_circular_test(
    robot: str,
    levels: dict[str, tuple[float, ...]],
    ratio: tuple[float, ...],
    radius_mm: float | None,
    repetitions: int,
    output: Path | None,
    *,
    as_json: bool,
) -> int:
    """Propose the runs of a circular test, and write them where asked for."""
    from evaluator.cli.tables import text_table
    from evaluator.files import plain
    from evaluator.report.numbers import true_minus
    from evaluator.workflow import circular_runs, write_circular_test

    ratios = {"ratios": ratio} if ratio else {}
    found = circular_runs(robot, radius_mm=radius_mm, repetitions=repetitions, **levels, **ratios)
    written = write_circular_test(found, robot, output) if output is not None else None
    if as_json:
        click.echo(json.dumps(plain([asdict(run) for run in found]), indent=2))
    elif written is not None:
        _say_written(written)
    else:
        head = ["run", "left rpm", "right rpm", "drive, s", "circle, mm", "speed, mm/s"]
        rows = [
            [f"r{number:02d}", f"{run.left_rpm:g}", f"{run.right_rpm:g}", f"{run.duration_s:g}", f"{run.radius_mm:.4g}",
             f"{run.speed_mm_s:.4g}"]
            for number, run in enumerate(found, 1)
        ]  # fmt: skip
        click.echo(true_minus(text_table(head, rows)))
    return 0


def _say_written(paths: list[Path]) -> None:
    from evaluator.wording import counted

    experiment, *commands = paths
    click.echo(f"{experiment}: {counted(len(commands), 'run')}, commands in {commands[0].parent}")
    click.echo(f"next: record the runs, then turnscope check {experiment}")


def _plan_text(plan: Plan) -> str:
    from evaluator.cli.tables import text_table
    from evaluator.report.numbers import true_minus

    head = ["run", "left rpm", "right rpm", "start x, mm", "y, mm", "heading, deg", "drive, s"]
    rows = [
        [f"r{number:02d}", f"{run.left_rpm:g}", f"{run.right_rpm:g}", f"{run.x_mm:z.1f}", f"{run.y_mm:z.1f}",
         f"{run.heading_deg:g}", f"{run.duration_s:g}"]
        for number, run in enumerate(plan.runs, 1)
    ]  # fmt: skip
    effects = [
        [item.effect, f"{item.parameter} = {item.size:.3g}", f"{item.sigmas:.0f}", item.nearest,
         f"{item.apart_sigmas:.1f}", item.measure, f"{item.measured_sigmas:.0f}" if item.measure else ""]
        for item in plan.effects
    ]  # fmt: skip
    titles = [
        "effect",
        "size",
        "detected, sigmas",
        "most similar effect",
        "distinguished from it, sigmas",
        "measure better",
        "then detected, sigmas",
    ]
    return true_minus(f"{text_table(head, rows)}\n\n{text_table(titles, effects)}")
