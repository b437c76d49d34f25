"""turnscope circular-test: radius, yaw rate and sideslip against speed, and the understeer gradient."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from evaluator.cli.options import PATH, dask_option, json_option, out_option, quiet_option, workers_option

if TYPE_CHECKING:
    from evaluator.workflow import CircularResult


@click.command(
    epilog="\b\nExamples:\n  turnscope plan --circular-test -o circular.toml\n"
    "  turnscope circular-test circular.toml -o out/\n  turnscope circular-test --robot four_driven"
)
@click.argument("experiment", type=PATH, required=False, metavar="[EXPERIMENT.toml]")
@click.option("--robot", metavar="NAME|FILE", help="Simulate the test of this robot instead.")
@click.option("--rpm", type=float, multiple=True, help="With --robot: a speed of the faster wheel; repeat for more.")
@click.option("--ratio", type=float, multiple=True, help="With --robot: slower over faster wheel; repeat for more.")
@click.option("--radius", "radius_mm", type=float, metavar="MM", help="With --robot: a constant radius instead.")
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

    Of an experiment, every turn is measured as turnscope analyze does and set beside the simulated robot;
    circular_test.csv and circular_test.json are written to DIR. Runs of one command at three speeds or more make a
    series, by side and direction; what is left, runs of one radius. With --robot nothing is read or written: the model
    alone is evaluated.
    """
    from evaluator.cli.progress import progress_bar
    from evaluator.errors import InputError
    from evaluator.workflow import circular_test_content, evaluate_circular_test, simulate_circular_test

    if (experiment is None) == (robot is None):
        raise InputError("circular-test: give either an EXPERIMENT.toml or --robot")
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
    """Every series, measured beside simulated, for a terminal."""
    from evaluator.cli.tables import text_table
    from evaluator.report.numbers import SERIES_HEAD, series_row

    sides = [(name, test) for name, test in (("measured", found.measured), ("simulated", found.simulated)) if test]
    count = len(sides[0][1].series)
    rows = [series_row(name, test.series[number]) for number in range(count) for name, test in sides]
    if not rows:
        return "No command and no radius was driven at three speeds or more, so that there is no gradient."
    where = f"\n\n{found.out / 'circular_test.json'}" if found.out else ""
    return text_table(SERIES_HEAD, rows) + where
