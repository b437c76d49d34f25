"""turnscope diagnose, turnscope plan: what is missing in the model, and which runs would show it."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from evaluator.cli.analyze import SOME_FAILED
from evaluator.cli.options import PATH, dask_option, json_option, out_option, quiet_option, workers_option
from evaluator.cli.progress import progress_bar

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from evaluator.diagnosis.design.candidate_runs import CandidateRun
    from evaluator.diagnosis.design.plan import Expected
    from evaluator.workflow.diagnosis_batch import Answer

STEPS = 100  # of the progress bar
SENTENCES = 4  # of where, on the screen; all are in diagnosis.json


STATUS_NOTE = """\b
Exit status: 0 every run was used; 1 some could not be (a reason for each on standard error, a diagnosis from the
others); 2 the input cannot be used at all."""


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
@json_option
@quiet_option
def diagnose(
    experiments: tuple[Path, ...], out: Path, workers: int | None, dask: str | None, as_json: bool, quiet: bool
) -> int:
    """Name the missing effect that makes model and data disagree.

    Writes diagnosis.json, disagreement.csv and, where something is missing, robot_with_effect.toml, a robot for every
    other command and for experiment files. Runs given as videos are tracked first; runs that cannot be used are named
    and left out. Nominal values move only within the [tolerance] of the robot file; a robot file without tolerances is
    taken as exact. Where nothing has changed since the last time, that answer is given again at once; where it was
    interrupted, it goes on with the fits made so far.

    Several experiments are diagnosed side by side, each into a folder of its own name in DIR. No result depends on
    --workers or --dask.
    """
    if len(experiments) > 1:
        return _diagnose_several(tuple(dict.fromkeys(experiments)), out, workers, dask, as_json=as_json, quiet=quiet)
    from evaluator.workflow.diagnosis import diagnose_experiment
    from evaluator.workflow.diagnosis_batch import Answer

    with progress_bar("diagnosis", quiet=quiet) as bar:
        found, content = diagnose_experiment(experiments[0], out, _steps(bar), workers=workers, dask=dask)
    if as_json:
        click.echo(json.dumps(content, indent=2, ensure_ascii=False))
    return _said(Answer(experiments[0], out, content, anew=found is not None), quiet=quiet or as_json)


def _diagnose_several(
    experiments: tuple[Path, ...], out: Path, workers: int | None, dask: str | None, *, as_json: bool, quiet: bool
) -> int:
    from evaluator.errors import InputError
    from evaluator.workflow.diagnosis_batch import diagnose_each

    answers = []
    with progress_bar("experiments", quiet=quiet) as bar:
        bar(0, len(experiments))
        for answer in diagnose_each(experiments, out, workers=workers, dask=dask):
            answers.append(answer)
            bar(len(answers), len(experiments))
    answers.sort(key=lambda answer: [path.resolve() for path in experiments].index(answer.experiment))
    if all(answer.fault for answer in answers):
        raise InputError("; ".join(str(answer.fault) for answer in answers))
    if as_json:
        click.echo(json.dumps({str(a.experiment): a.content for a in answers}, indent=2, ensure_ascii=False))
    return max(_said(answer, quiet=quiet or as_json, titled=True) for answer in answers)


def _said(answer: Answer, *, quiet: bool, titled: bool = False) -> int:
    """Say what a diagnosis found and what is missing in it; gives the exit status."""
    if answer.content is None:
        click.echo(answer.fault, err=True)
        return SOME_FAILED
    if not quiet:
        same = "" if answer.anew else "  (nothing has changed since it was made)"
        title = [f"{answer.experiment}:"] if titled else []
        click.echo("\n".join([*title, *summary(answer.content)]))
        click.echo(f"\n{answer.out / 'diagnosis.json'}{same}" + ("\n" if titled else ""))
    skipped = answer.content.get("skipped_runs") or {}
    for run, reason in skipped.items():
        click.echo(f"{run} is left out: {reason}", err=True)
    return SOME_FAILED if skipped else 0


def _steps(bar: Callable[[int, int], None]) -> Callable[[str, float], None]:
    def report(what: str, share: float) -> None:
        del what
        bar(int(STEPS * share), STEPS)

    return report


def summary(content: dict[str, Any]) -> list[str]:
    """The verdict in a few lines."""
    from evaluator.report.diagnosis.words import (
        as_sentence,
        closes,
        equivalents_sentence,
        gap_sentence,
        in_words,
        next_runs_sentence,
        separations_sentence,
        verdict_sentence,
    )

    lines = [verdict_sentence(content), as_sentence(in_words(content["reason"]))]
    for effect in content["effects"]:
        lines.append(f"{effect['id']}, probability {effect['probability']:.3f}:")
        for name, value in effect["parameters"].items():
            lines.append(f"  {name} = {value['value']:.4g}  [{value['low']:.4g}, {value['high']:.4g}]")
        lines.append(equivalents_sentence(effect))
    lines.append(gap_sentence(content))
    if content.get("runs_not_followed") and closes(content):
        lines.append(f"Not followed, look at these recordings first: {', '.join(content['runs_not_followed'])}.")
    lines += [as_sentence(item["sentence"]) for item in content["where"][:SENTENCES]]
    lines += [next_runs_sentence(content), separations_sentence(content)]
    return [line for line in lines if line]


@click.command(epilog="\b\nExample:\n  turnscope plan --robot barrel --runs 18 --rpm 30 --rpm 60 --plate 40 30")
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
@json_option
def plan(robot: str, runs: int, levels: tuple[float, ...], plate: tuple[float, float], as_json: bool) -> int:
    """Propose the runs of a good experiment, and say what they would show.

    Straight runs and turns to both sides, forward and backward, alternate, commands repeat once all were driven, and
    each run starts at the place and heading that tell most about all effects at once; it stays on the plate. Make them
    in this order. Then every effect at a modest size: by how many sigmas it would show, under a usual tracking noise
    and run-to-run scatter, and by how many it would differ from the effect that is nearest to it.
    """
    from evaluator.diagnosis.candidates.coordinates import named_terms
    from evaluator.diagnosis.design.candidate_runs import Room
    from evaluator.diagnosis.design.plan import expected, plan_runs
    from evaluator.files import read_with
    from simulator.robot import load_robot

    described = read_with(load_robot, Path(robot))
    room = Room.of_plate(plate, max(described.body.length_mm, described.body.width_mm) / 2)
    terms = named_terms(max(room.half_mm), levels)
    chosen = plan_runs(described, terms, levels, room, runs)
    shown = expected(described, terms, chosen)
    if as_json:
        click.echo(json.dumps({"runs": [asdict(r) for r in chosen], "effects": [asdict(e) for e in shown]}, indent=2))
        return 0
    click.echo(_plan_text(chosen, shown))
    return 0


def _plan_text(chosen: Sequence[CandidateRun], shown: Sequence[Expected]) -> str:
    from evaluator.cli.tables import text_table

    head = ["run", "left rpm", "right rpm", "start x, mm", "y, mm", "heading, deg", "drive, s"]
    rows = [
        [f"r{number:02d}", f"{run.left_rpm:g}", f"{run.right_rpm:g}", f"{run.x_mm:.1f}", f"{run.y_mm:.1f}",
         f"{run.heading_deg:g}", f"{run.duration_s:g}"]
        for number, run in enumerate(chosen, 1)
    ]  # fmt: skip
    effects = [
        [item.effect, f"{item.parameter} = {item.size:.3g}", f"{item.sigmas:.0f}", item.nearest,
         f"{item.apart_sigmas:.1f}"]
        for item in shown
    ]  # fmt: skip
    titles = ["effect", "of this size", "shows, sigmas", "nearest other", "apart from it, sigmas"]
    return f"{text_table(head, rows)}\n\n{text_table(titles, effects)}"
