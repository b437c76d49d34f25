"""turnscope diagnose, turnscope plan: what is missing in the model, and which runs would show it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from evaluator.cli.options import experiment_argument, json_option, out_option, quiet_option
from evaluator.cli.progress import progress_bar

if TYPE_CHECKING:
    from collections.abc import Callable

STEPS = 100  # of the progress bar


@click.command(epilog="\b\nExample:\n  turnscope diagnose experiment.toml -o out/")
@experiment_argument
@out_option
@json_option
@quiet_option
def diagnose(experiment: Path, out: Path, as_json: bool, quiet: bool) -> int:
    """Name the missing effect that makes model and data disagree.

    Writes diagnosis.json and, where something is missing, robot_with_effect.toml, which every other command takes as
    --robot. Runs given as videos are tracked first. Nominal values move only within the [tolerance] of the robot file;
    a robot file without tolerances is taken as exact.
    """
    from evaluator.discrepancy.workflow import diagnose_experiment

    with progress_bar("diagnosis", quiet=quiet) as bar:
        found, content = diagnose_experiment(experiment, out, _steps(bar))
    if as_json:
        click.echo(json.dumps(content, indent=2, ensure_ascii=False))
    elif not quiet:
        click.echo("\n".join(summary(content)))
        click.echo(f"\n{out / 'diagnosis.json'}")
    del found
    return 0


def _steps(bar: Callable[[int, int], None]) -> Callable[[str, float], None]:
    def report(what: str, share: float) -> None:
        del what
        bar(int(STEPS * share), STEPS)

    return report


def summary(content: dict[str, Any]) -> list[str]:
    """The verdict in a few lines."""
    headline = {
        "none": "The model explains the data.",
        "effect": "Missing in the model:",
        "unknown": "Something is missing that no known effect explains:",
        "insufficient": "The data cannot decide:",
    }
    lines = [headline[content["verdict"]], f"  {content['reason']}."]
    for effect in content["effects"]:
        lines.append(f"  {effect['id']}: {effect['name']} (probability {effect['probability']:.3f})")
        lines += [
            f"    {name} = {p['value']:.4g}  [{p['low']:.4g}, {p['high']:.4g}]"
            for name, p in effect["parameters"].items()
        ]
        if effect["equivalent"]:
            lines.append(f"    these runs cannot tell it from {', '.join(effect['equivalent'])}")
    gap = content["gap"]
    if gap:
        before, after = gap["before"], gap["after"]
        lines.append(
            f"  gap on fitted runs {_mm(before['fit'])} -> {_mm(after['fit'])}, on runs kept aside "
            f"{_mm(before['held_out'])} -> {_mm(after['held_out'])}; noise floor {_mm(gap['noise_floor'])}"
        )
    return lines


def _mm(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f} mm"
