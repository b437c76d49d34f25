"""turnscope diagnose: what is missing in the model."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from evaluator.cli.analyze import SOME_FAILED
from evaluator.cli.options import (
    PATH,
    dask_option,
    json_option,
    out_option,
    quiet_option,
    say_mended,
    workers_option,
    write_mended_option,
)

if TYPE_CHECKING:
    from evaluator.workflow import DiagnosisResult

STATUS_NOTE = """Exit status: 0 every run was used; 1 some could not be (a reason for each on standard error,
a diagnosis from the others); 2 the input cannot be used at all."""


@click.command(
    epilog=f"""{STATUS_NOTE}

\b
Examples:
  turnscope diagnose experiment.toml -o out/
  turnscope diagnose monday.toml tuesday.toml -o out/ --workers 2"""
)
@click.argument("experiments", nargs=-1, required=True, type=PATH, metavar="EXPERIMENT.toml...")
@out_option
@workers_option
@dask_option
@click.option(
    "--effect",
    "effects",
    type=PATH,
    multiple=True,
    metavar="FILE",
    help="Try an effect of your own, a .toml or .py file, too; repeat for more. A Python file is run.",
)
@click.option(
    "--write-effect",
    type=PATH,
    metavar="FILE",
    help="Where the verdict is unknown: write what explains the runs as an effect of your own.",
)
@click.option(
    "--seconds",
    type=click.FloatRange(min=0, min_open=True),
    default=180.0,
    show_default=True,
    help="Stop a search after so many seconds of processor time; the next call goes on from there. inf: never.",
)
@write_mended_option
@json_option
@quiet_option
def diagnose(
    experiments: tuple[Path, ...],
    out: Path,
    workers: int | None,
    dask: str | None,
    effects: tuple[Path, ...],
    write_effect: Path | None,
    seconds: float,
    mend: bool,
    as_json: bool,
    quiet: bool,
) -> int:
    """Name the missing effect that makes model and data disagree.

    Writes diagnosis.json, disagreement.csv and, where something is missing, robot_with_effect.toml, a robot for every
    other command and for experiment files. Runs given as videos are tracked first; runs that cannot be used are named
    and left out. Nominal values move only within the [tolerance] of the robot file; a robot file without tolerances is
    taken as exact. Where nothing has changed since the last time, that answer is given again at once; where it was
    interrupted or stopped (--seconds), it goes on with the fits made so far.

    Effects of your own, files effects/*.toml beside the experiment, are tried like those of the catalogue (turnscope
    effects new ID writes one). Where the verdict is "unknown", own_effect.toml in DIR holds the form that explains the
    runs: put it into effects/, and the next diagnosis names it.

    Several experiments are diagnosed side by side, each into a folder of its own name in DIR. No result depends on
    --workers or --dask.
    """
    from evaluator.cli.progress import progress_bar
    from evaluator.workflow import diagnose as diagnose_experiment

    if len(experiments) > 1:
        if effects or write_effect is not None or mend:
            raise click.UsageError("--effect, --write-effect and --write-mended take one experiment at a time")
        return _diagnose_several(experiments, out, workers, dask, seconds, as_json=as_json, quiet=quiet)
    with progress_bar("diagnosis", quiet=quiet) as progress:
        found = diagnose_experiment(
            experiments[0], out, workers=workers, dask=dask, effects=effects, seconds=seconds, progress=progress
        )
    if write_effect is not None:
        _write_effect(found, write_effect)
    if as_json:
        click.echo(json.dumps(found.content, indent=2, ensure_ascii=False))
    elif not quiet:
        _say(found)
    if mend:
        say_mended(experiments[0], out)
    return _left_out(found.content)


def _diagnose_several(
    experiments: tuple[Path, ...],
    out: Path,
    workers: int | None,
    dask: str | None,
    seconds: float,
    *,
    as_json: bool,
    quiet: bool,
) -> int:
    from evaluator.cli.progress import progress_bar
    from evaluator.errors import InputError
    from evaluator.workflow import DiagnosisResult, diagnose_each

    with progress_bar("experiments", quiet=quiet) as progress:
        answers = diagnose_each(experiments, out, workers=workers, dask=dask, seconds=seconds, progress=progress)
    if all(answer.fault for answer in answers):
        raise InputError("; ".join(str(answer.fault) for answer in answers))
    if as_json:
        click.echo(json.dumps({str(a.experiment): a.content for a in answers}, indent=2, ensure_ascii=False))
    status = 0
    for answer in answers:
        if answer.content is None:
            click.echo(answer.fault, err=True)
            status = SOME_FAILED
            continue
        if not (quiet or as_json):
            click.echo(f"{answer.experiment}:")
            _say(DiagnosisResult(answer.experiment, answer.out, answer.content, answer.anew))
            click.echo()
        status = max(status, _left_out(answer.content))
    return status


def _write_effect(found: DiagnosisResult, path: Path) -> None:
    """Write what explains the runs of an unknown verdict where it was asked for, under the name of the file."""
    from evaluator.errors import InputError
    from evaluator.files import write_text
    from evaluator.workflow import Outputs
    from simulator.own_effects.template import ID_LINE, id_of_file

    if changed := found.content.get("changed_meanwhile"):
        click.echo(f"{', '.join(changed)} changed during the search, whose answer is for what was there before")
    form = Outputs(found.out).own_effect
    if found.verdict != "unknown" or not form.is_file():
        raise InputError(f"--write-effect {path}: the verdict is {found.verdict}; there is no new form to write")
    first, rest = form.read_text(encoding="utf-8").split(ID_LINE, 1)
    write_text(path, first + f'{ID_LINE}"{id_of_file(path)}"' + rest[rest.index("\n") :])
    click.echo(path, err=True)


def _say(found: DiagnosisResult) -> None:
    """Say what a diagnosis found and where it is written."""
    from evaluator.report.verdict import verdict_lines
    from evaluator.workflow import Outputs

    same = "" if found.anew else "  (nothing has changed since it was made)"
    click.echo("\n".join(verdict_lines(found.content)))
    click.echo(f"\n{found.out / 'diagnosis.json'}{same}")
    if changed := found.content.get("changed_meanwhile"):
        click.echo(f"{', '.join(changed)} changed during the search, whose answer is for what was there before")
    form = Outputs(found.out).own_effect
    if found.verdict == "unknown" and form.is_file():
        click.echo(f"{form}  (the form that explains the runs: put it into effects/ to add it as your effect)")


def _left_out(content: dict[str, Any]) -> int:
    """Say which runs are missing in a diagnosis, and why; gives the exit status."""
    skipped = content.get("skipped_runs") or {}
    for run, reason in skipped.items():
        click.echo(f"{run} is left out: {reason}", err=True)
    return SOME_FAILED if skipped else 0
