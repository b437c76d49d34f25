"""turnscope diagnose: the physical effects that the model lacks."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from evaluator.cli.analysis import SOME_FAILED
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

STATUS_NOTE = """Exit status: 0, all runs could be read (those with a mistake are named and set aside); 1, some could
not (reasons on standard error, diagnosis from the others); 2, the input cannot be used."""


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
    help="Also test this effect of your own (.toml or .py); may be repeated. A Python file is executed.",
)
@click.option(
    "--write-effect",
    type=PATH,
    metavar="FILE",
    help='If the verdict is "unknown": write the free-form term that explains most as an effect of your own.',
)
@click.option(
    "--seconds",
    type=click.FloatRange(min=0, min_open=True),
    default=180.0,
    show_default=True,
    help="Limit of processor time for the search, twice as long once a model explains the runs; the next call "
    "continues it. inf: no limit.",
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
    """Find the physical effect that the model lacks, its size and its 95 % interval.

    Writes diagnosis.json, disagreement.csv and, if an effect is found, robot_with_effect.toml: the robot with that
    effect, for all other commands. Videos are tracked first. Runs that cannot be used are listed and left out. Nominal
    values vary only within the [tolerance] of the robot file; without that table they are exact. Unchanged input
    returns the stored answer; an interrupted search continues.

    Effects of your own (effects/*.toml beside the experiment; turnscope effects new ID writes a template) are tested
    like those of the catalogue. If the verdict is "unknown", DIR/own_effect.toml holds the best free-form
    term, and DIR/own_effect_2.toml another one, if two are needed. Move them to effects/ to have them tested as
    effects.

    Several experiments are diagnosed in parallel, each into a subfolder of DIR with its name. Results do not depend on
    --workers or --dask.
    """
    from evaluator.cli.progress import progress_bar
    from evaluator.workflow import diagnose as diagnose_experiment

    if len(experiments) > 1:
        if effects or write_effect is not None or mend:
            raise click.UsageError("--effect, --write-effect and --write-mended work with a single experiment only")
        return _diagnose_several(experiments, out, workers, dask, seconds, as_json=as_json, quiet=quiet)
    with progress_bar("diagnosis", quiet=quiet) as progress:
        found = diagnose_experiment(
            experiments[0], out, workers=workers, dask=dask, effects=effects, seconds=seconds, progress=progress
        )
    if write_effect is not None:
        _write_effect(found, write_effect)
    say_unused(experiments[0], found.content.get("own_effects", {}))
    say_doubts(experiments[0])
    if as_json:
        click.echo(json.dumps(found.content, indent=2, ensure_ascii=False))
    elif not quiet:
        _say(found)
    if mend:
        say_mended(experiments[0], out)
    return _left_out(found.content)


def say_doubts(experiment: Path) -> None:
    """Name values of robot files that seem to be in another unit, which a diagnosis would report as an effect."""
    from evaluator.settings import load_experiment
    from evaluator.workflow.runs.implausible import doubts_of_robots

    for doubt in doubts_of_robots(load_experiment(experiment)):
        click.echo(f"mistake? {doubt}", err=True)


def say_unused(experiment: Path, tested: Mapping[str, str]) -> None:
    """Name the Python effects beside an experiment that were not tested; tested: files by id."""
    from simulator.own_effects.files import FOLDER

    named = {Path(file).resolve() for file in tested.values()}
    for path in sorted((experiment.parent / FOLDER).glob("*.py")):
        if path.resolve() not in named:
            text = f"note: {path} was not tested: a Python file is executed only if you name it (--effect {path})"
            click.echo(text, err=True)


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
    """Write the free-form term of an "unknown" verdict to path; the effect gets the name of the file."""
    from evaluator.errors import InputError
    from evaluator.files import write_text
    from evaluator.workflow import Outputs
    from simulator.own_effects.template import ID_LINE, id_of_file

    if changed := found.content.get("changed_meanwhile"):
        click.echo(f"{', '.join(changed)} changed during the search; the answer is for the earlier content")
    form = Outputs(found.out).own_effect
    if found.verdict != "unknown" or not form.is_file():
        raise InputError(f"--write-effect {path}: the verdict is {found.verdict}; there is no free-form term to write")
    first, rest = form.read_text(encoding="utf-8").split(ID_LINE, 1)
    write_text(path, first + f'{ID_LINE}"{id_of_file(path)}"' + rest[rest.index("\n") :])
    click.echo(path, err=True)


def _say(found: DiagnosisResult) -> None:
    """Print what a diagnosis found and where it is written."""
    from evaluator.report.verdict import verdict_lines
    from evaluator.workflow import Outputs

    same = "" if found.anew else "  (up to date, not computed again)"
    click.echo("\n".join(verdict_lines(found.content)))
    click.echo(f"\n{found.out / 'diagnosis.json'}{same}")
    if changed := found.content.get("changed_meanwhile"):
        click.echo(f"{', '.join(changed)} changed during the search; the answer is for the earlier content")
    for form in Outputs(found.out).own_effects:
        if found.verdict == "unknown" and form.is_file():
            click.echo(f"{form}  (the best free-form term; move it to effects/ to use it as an effect)")


def _left_out(content: dict[str, Any]) -> int:
    """Print which runs a diagnosis left out, and why; return the exit status."""
    skipped = content.get("skipped_runs") or {}
    for run, reason in skipped.items():
        if f"({run}: {reason})" not in content["reason"]:  # once is enough
            click.echo(f"{run} is left out: {reason}", err=True)
    return SOME_FAILED if skipped else 0
