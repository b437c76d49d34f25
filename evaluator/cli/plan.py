"""turnscope plan: which runs to make."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from evaluator.cli.options import PATH, json_option

if TYPE_CHECKING:
    from evaluator.workflow import Plan


@click.command(
    epilog="\b\nExamples:\n  turnscope plan --robot barrel --runs 18 --rpm 30 --rpm 60 --plate 40 30\n"
    "  turnscope plan --robot mine/robot.toml -o mine/experiment.toml\n"
    "  turnscope plan --circular-test --rpm 20 --rpm 40 --rpm 60 --ratio 0.5 -o circular.toml"
)
@click.option("--robot", default="barrel", show_default=True, metavar="NAME|FILE", help="The robot to be driven.")
@click.option(
    "--runs", type=click.IntRange(min=1, max=200), default=18, show_default=True, help="How many runs to plan."
)
@click.option(
    "--rpm",
    "levels",
    type=click.FloatRange(min=0, min_open=True),
    multiple=True,
    default=(30.0, 60.0),
    show_default=True,
    help="A speed of the faster wheel; repeat for more.",
)
@click.option(
    "--plate",
    type=click.FloatRange(min=0, min_open=True),
    nargs=2,
    default=(40.0, 30.0),
    show_default=True,
    metavar="X Y",
    help="What the camera sees of the plate, in mm along its x and y, the origin in the middle.",
)
@click.option("--circular-test", "circular", is_flag=True, help="Plan a steady-state circular test (ISO 4138) instead.")
@click.option("--ratio", type=float, multiple=True, help="Circular test: slower over faster wheel; repeat for more.")
@click.option("--radius", "radius_mm", type=float, metavar="MM", help="Circular test at a constant radius instead.")
@click.option("--repetitions", type=click.IntRange(1, 50), default=3, show_default=True, help="Circular test: of each.")
@click.option(
    "-o",
    "--out",
    "output",
    type=PATH,
    metavar="TOML",
    help="Write an experiment.toml with these runs, and commands/ with a file for each; overwrites nothing.",
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
    """Propose the runs of a good experiment, and say what they would show.

    Straight runs and turns to both sides, forward and backward, alternate, commands repeat once all were driven, and
    each run starts at the place and heading that tell most about all effects at once; it stays on the plate. Make them
    in this order. Then every effect at a modest size: by how many sigmas it would show, under a usual tracking noise
    and run-to-run scatter, and by how many it would differ from the effect that is nearest to it. What a laboratory
    knows only to within a tolerance (start of motion, marks, wheels, level) can stand for an effect; where it hides
    one, the last columns say what to measure better, and what the same runs would then show.

    With --circular-test: turns of both sides and directions at three speeds or more (--rpm), at constant commands
    (--ratio) or a constant radius (--radius), each repeated, with the circles that the model predicts.
    """
    if circular:
        given = {"rpm": levels} if context.get_parameter_source("levels") == ParameterSource.COMMANDLINE else {}
        return _plan_circular_test(robot, given, ratio, radius_mm, repetitions, output, as_json=as_json)
    if ratio or radius_mm is not None:
        raise click.UsageError("--ratio and --radius belong to --circular-test")
    from evaluator.files import plain
    from evaluator.workflow import plan as plan_experiment
    from evaluator.workflow import planned_files, write_plan

    if output is not None:
        planned_files(output, runs)  # what is there already is refused before the plan is computed
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
    click.echo(f"{experiment}: {counted(len(commands), 'run')}, the commands in {commands[0].parent}")
    click.echo(f"next: record them, then turnscope check {experiment}")


def _plan_text(plan: Plan) -> str:
    from evaluator.cli.tables import text_table
    from evaluator.report.numbers import true_minus

    head = ["run", "left rpm", "right rpm", "start x, mm", "y, mm", "heading, deg", "drive, s"]
    rows = [
        [f"r{number:02d}", f"{run.left_rpm:g}", f"{run.right_rpm:g}", f"{run.x_mm:.1f}", f"{run.y_mm:.1f}",
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
        "of this size",
        "shows, sigmas",
        "nearest other",
        "apart from it, sigmas",
        "to see it better, measure",
        "then, sigmas",
    ]
    return true_minus(f"{text_table(head, rows)}\n\n{text_table(titles, effects)}")
