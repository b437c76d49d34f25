"""turnscope slip-bench: torques of the slip evaluation apparatus to forces and a fitted slip law."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from evaluator.cli.options import PATH, out_option, quiet_option

if TYPE_CHECKING:
    import pandas as pd

    from simulator.slip.bench import Apparatus


@click.command(
    epilog="\b\nExamples:\n  turnscope slip-bench bench.csv -o slip/\n"
    "  turnscope slip-bench --virtual barrel --seed 1 -o slip/"
)
@click.argument("bench", type=PATH, metavar="BENCH.csv", required=False)
@click.option("--wheel-radius", "wheel_mm", default=4.0, show_default=True, metavar="MM", help="Of the wheel tested.")
@click.option(
    "--contact-radius", "contact_mm", default=38.0, show_default=True, metavar="MM", help="Disk axis to contact."
)
@click.option("--virtual", metavar="NAME|FILE", help="Measure this robot's slip law on a virtual bench instead.")
@click.option("--seed", default=0, show_default=True, help="Seed of the virtual bench's torque noise.")
@out_option
@quiet_option
def slip_bench(
    bench: Path | None, wheel_mm: float, contact_mm: float, virtual: str | None, seed: int, out: Path, quiet: bool
) -> None:
    """Turn bench torques into forces and a fitted slip law.

    BENCH.csv has the columns slip_angle_deg, wheel_rpm, disk_rpm, wheel_torque_mN_mm, disk_torque_mN_mm and
    normal_force_mN, and, where known, wheel_torque_sigma_mN_mm and disk_torque_sigma_mN_mm. Torques are what the motors
    deliver, positive in the direction of rotation. Writes forces.csv, slip.toml (the [slip] table of a robot.toml), the
    curves as SVG, and index.html.
    """
    from evaluator.cli.tables import text_table
    from evaluator.errors import InputError
    from evaluator.report.pages.slip_bench import HEAD, fit_rows, fit_sentences, write_slip_bench
    from simulator.slip.bench import Apparatus, checked_bench
    from simulator.slip.fit import fit_slip_law

    if (bench is None) == (virtual is None):
        raise InputError("give either a recording BENCH.csv or --virtual ROBOT")
    apparatus = Apparatus(wheel_mm, contact_mm)
    if bench is not None:
        name, table = bench.stem, checked_bench(_read(bench), str(bench))
    else:
        name, table = f"{virtual}, virtual bench", _virtual(str(virtual), seed, apparatus, out)
    fit = fit_slip_law(table, apparatus)
    forces = write_slip_bench(name, table, fit, apparatus, out)
    if not quiet:
        click.echo(text_table(HEAD, fit_rows(fit)))
        for sentence in fit_sentences(fit, forces):
            click.echo(sentence)
        click.echo(f"\n{out / 'index.html'}")


def _read(path: Path) -> pd.DataFrame:
    import pandas as pd

    from evaluator.errors import InputError
    from evaluator.files import read_with

    def load(place: Path) -> pd.DataFrame:
        try:
            return pd.read_csv(place)
        except (pd.errors.ParserError, pd.errors.EmptyDataError) as error:
            raise InputError(f"{place}: not a CSV table ({str(error).strip()})") from error

    return read_with(load, path)


def _virtual(robot: str, seed: int, apparatus: Apparatus, out: Path) -> pd.DataFrame:
    """A virtual recording, kept beside its results."""
    import numpy as np

    from evaluator.files import read_with, written_whole
    from simulator.robot import load_robot
    from simulator.slip.bench import virtual_bench

    described = read_with(load_robot, Path(robot)) if robot.endswith(".toml") else load_robot(robot)
    table = virtual_bench(described.slip, np.random.default_rng(seed), apparatus=apparatus)
    with written_whole(out / "bench.csv") as temporary:
        table.to_csv(temporary, index=False, float_format="%.9g")
    return table
