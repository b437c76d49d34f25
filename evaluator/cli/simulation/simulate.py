"""turnscope simulate: one run from commands to a simulated run CSV."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(
    epilog="\b\nExample:\n  turnscope simulate --robot barrel --left 33.3 --right 14.4 --duration 10 -o run.csv",
)
@click.option("--robot", required=True, metavar="NAME|FILE", help="Shipped robot or robot.toml.")
@click.option("--left", "left_rpm", type=float, metavar="RPM", help="Speed of the left wheels; negative: backward.")
@click.option("--right", "right_rpm", type=float, metavar="RPM", help="Speed of the right wheels; negative: backward.")
@click.option(
    "--command",
    "log",
    type=click.Path(path_type=Path),
    metavar="CSV",
    help="Command log, instead of constant speeds; each value holds until the next.",
)
@click.option("--duration", "duration_s", required=True, type=float, metavar="S", help="Duration of the run.")
@click.option(
    "--start-s", default=0.0, show_default=True, metavar="S", help="Time at which the motors start, or the log."
)
@click.option("--stop-s", type=float, metavar="S", help="Time at which the motors stop. [default: never]")
@click.option("--x", "x_mm", default=0.0, metavar="MM", help="Start position of the robot's centre.")
@click.option("--y", "y_mm", default=0.0, metavar="MM", help="Start position of the robot's centre.")
@click.option("--heading", "heading_deg", default=0.0, metavar="DEG", help="Start heading, counter-clockwise from +x.")
@click.option("--rate", "rate_hz", default=60.0, show_default=True, metavar="HZ", help="Rows per second.")
@click.option(
    "-o", "--out", "output", required=True, type=click.Path(path_type=Path), help="Simulated run CSV to write."
)
def simulate(
    robot: str,
    left_rpm: float | None,
    right_rpm: float | None,
    log: Path | None,
    duration_s: float,
    start_s: float,
    stop_s: float | None,
    x_mm: float,
    y_mm: float,
    heading_deg: float,
    rate_hz: float,
    output: Path,
) -> None:
    """Simulate one run: pose, velocities, and slip and friction of every wheel over time."""
    import math

    from evaluator.files import refuse_to_lose
    from evaluator.files.csv_tables import write_table
    from evaluator.workflow import simulate as simulate_run
    from simulator.run import State

    refuse_to_lose(output, ("time_s", "u_mm_s", "v_mm_s"))
    run = simulate_run(
        robot,
        left_rpm,
        right_rpm,
        duration_s=duration_s,
        commands=log,
        start_s=start_s,
        stop_s=stop_s,
        start=State(x_mm, y_mm, math.radians(heading_deg)),
        rate_hz=rate_hz,
    )
    write_table(run.to_table(), output)
    if run.is_by_chance:
        click.echo(
            "note: the robot may turn differently: it passes an unstable equilibrium, where a small disturbance "
            f"grows by a factor of {run.amplification:.0e} (for example when wheels start in opposite directions)",
            err=True,
        )
    if not run.is_converged:
        click.echo(
            f"note: the run has not converged to better than {run.unsettled_mm:.2g} mm: finer steps, or speeds that "
            "differ by 0.01 %, lead elsewhere; are the sizes of the effects plausible?",
            err=True,
        )
