"""turnscope circular-test: radius, yaw rate and sideslip against speed, and the understeer gradient."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from evaluator.cli.options import PATH, dask_option, json_option, out_option, quiet_option, refuse_both, workers_option

if TYPE_CHECKING:
    from evaluator.workflow import CircularResult


@click.command(
    epilog="\b\nExamples:\n  turnscope plan --circular-test -o circular.toml\n"
    "  turnscope circular-test circular.toml -o out/\n  turnscope circular-test --robot four_driven"
)
@click.argument("experiment", type=PATH, required=False, metavar="[EXPERIMENT.toml]")
@click.option("--robot", metavar="NAME|FILE", help="Simulate the test of this robot, without an experiment.")
@click.option("--rpm", type=float, multiple=True, help="With --robot: speed of the faster wheel; may be repeated.")
@click.option(
    "--ratio", type=float, multiple=True, help="With --robot: speed of slower over faster wheel; may be repeated."
)
@click.option("--radius", "radius_mm", type=float, metavar="MM", help="With --robot: constant radius.")
@out_option
@workers_option
@dask_option
@json_option
@quiet_option
def circular_test(
    experiment: Path | None,
    robot: str | None,
    rpm: tuple[float, ...],
    ratio: tuple[float, ...],
    radius_mm: float | None,
    out: Path,
    workers: int | None,
    dask: str | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Evaluate a steady-state circular test (ISO 4138, SAE J266): understeer gradient with its 95 % interval.

    Measures every turn of an experiment like turnscope analyze, compares it with the simulated robot and writes
    circular_test.csv and circular_test.json to DIR. Runs with one command ratio at three speeds or more form a series
    for each side and direction; the other runs form series of equal radius. With --robot, only the model is evaluated
    and no file is read or written.
    """
    from evaluator.cli.progress import progress_bar
    from evaluator.errors import InputError
    from evaluator.workflow import circular_test_content, evaluate_circular_test, simulate_circular_test

    refuse_both(ratio, radius_mm)
    if (experiment is None) == (robot is None):
        raise InputError("circular-test: expected either an EXPERIMENT.toml or --robot")
    if experiment is not None:
        with progress_bar("runs", quiet=quiet) as progress:
            found = evaluate_circular_test(experiment, out, workers=workers, dask=dask, progress=progress)
    else:
        levels = {"rpm": rpm} if rpm else {}
        ratios = {"ratios": ratio} if ratio else {}
        found = simulate_circular_test(str(robot), radius_mm=radius_mm, **levels, **ratios)
    if as_json:
        click.echo(json.dumps(circular_test_content(found), indent=2, ensure_ascii=False))
    elif not quiet:
        click.echo(_text(found))
    return 0


def _text(found: CircularResult) -> str:
    """Text table of every series, measured and simulated."""
    from evaluator.cli.tables import text_table
    from evaluator.report.numbers import SERIES_HEAD, series_row

    sides = [(name, test) for name, test in (("measured", found.measured), ("simulated", found.simulated)) if test]
    count = len(sides[0][1].series)
    rows = [series_row(name, test.series[number]) for number in range(count) for name, test in sides]
    if not rows:
        return "No gradient: no command ratio and no radius was driven at three speeds or more."
    where = f"\n\n{found.out / 'circular_test.json'}" if found.out else ""
    return text_table(SERIES_HEAD, rows) + where
