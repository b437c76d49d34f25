"""turnscope slip-bench: torques of the slip evaluation apparatus → forces and a fitted slip law."""

from __future__ import annotations

from pathlib import Path

import click

from evaluator.cli.options import PATH, out_option, quiet_option, seed_option


@click.command(
    epilog="\b\nExamples:\n  turnscope slip-bench bench.csv -o slip/\n"
    "  turnscope slip-bench --virtual barrel --seed 1 -o slip/"
)
@click.argument("bench", type=PATH, metavar="BENCH.csv", required=False)
@click.option("--wheel-radius", "wheel_mm", default=4.0, show_default=True, metavar="MM", help="Radius of the wheel.")
@click.option(
    "--contact-radius",
    "contact_mm",
    default=38.0,
    show_default=True,
    metavar="MM",
    help="Distance from the disk axis to the contact.",
)
@click.option("--virtual", metavar="NAME|FILE", help="Simulate the bench with this robot's slip law instead.")
@seed_option(0, "Seed of the virtual bench's torque noise.")
@out_option
@quiet_option
def slip_bench(
    bench: Path | None, wheel_mm: float, contact_mm: float, virtual: str | None, seed: int, out: Path, quiet: bool
) -> None:
    """Fit a slip law to torques of a slip test bench.

    BENCH.csv has the columns slip_angle_deg, wheel_rpm, disk_rpm, wheel_torque_mN_mm, disk_torque_mN_mm and
    normal_force_mN, and optionally wheel_torque_sigma_mN_mm and disk_torque_sigma_mN_mm. Torques are those of the
    motors, positive in the direction of rotation. Writes forces.csv, slip.toml (the [slip] table of a robot.toml), the
    curves as SVG, and index.html.
    """
    from evaluator.cli.tables import text_table
    from evaluator.errors import InputError
    from evaluator.report.pages.slip_bench import HEAD, fit_rows, fit_sentences, write_slip_bench
    from evaluator.workflow import evaluate_slip, evaluate_virtual_slip
    from simulator.slip.bench import Apparatus

    apparatus = Apparatus(wheel_mm, contact_mm)
    if bench is not None and virtual is None:
        found = evaluate_slip(bench, apparatus)
    elif bench is None and virtual is not None:
        found = evaluate_virtual_slip(virtual, seed, apparatus)
    else:
        raise InputError("slip-bench: expected either a BENCH.csv or --virtual ROBOT")
    forces = write_slip_bench(found, out)
    if not quiet:
        click.echo(text_table(HEAD, fit_rows(found.fit)))
        for sentence in fit_sentences(found.fit, forces):
            click.echo(sentence)
        click.echo(f"\n{out / 'index.html'}")
