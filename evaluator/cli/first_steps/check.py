"""turnscope check: validation of all files of an experiment."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import click

from evaluator.cli.analysis import named_runs
from evaluator.cli.guard import BAD_INPUT
from evaluator.cli.options import experiment_argument, json_option, quiet_option, say_mended, write_mended_option
from evaluator.wording import counted

ANY_NUMBER = re.compile(r"\d+(?:\.\d+)?")  # in names of files, too
MOST_ALIKE = 50  # runs or files named together, of an experiment that may have thousands
FEW_ALIKE = 2  # sentences that differ in names and numbers only, and are printed each


@click.command(epilog="\b\nExamples:\n  turnscope check experiment.toml\n  turnscope check experiment.toml --json")
@experiment_argument
@write_mended_option
@json_option
@quiet_option
def check(experiment: Path, mend: bool, as_json: bool, quiet: bool) -> int:
    """Validate all files of an experiment and report all errors together.

    Of errors that differ in names and numbers only, one is printed; --json gives each.

    Exit status: 0, no error; 2, errors or probable mistakes.
    """
    from evaluator.workflow import check_experiment

    found = check_experiment(experiment)
    if as_json:
        content = {key: getattr(found, key) for key in ("faults", "mistakes", "runs", "videos", "unseen", "notes")}
        click.echo(json.dumps(content, indent=1, ensure_ascii=False))
    else:
        for kind, sentences in (("error:", found.faults), ("mistake?", found.mistakes)):
            for line in without_repeats(sentences):
                click.echo(f"{kind} {line}", err=True)
        for line in without_repeats(found.notes) if not quiet else ():
            click.echo(f"note: {line}", err=True)
        if not found.faults and not found.mistakes and not quiet:
            videos = f"{found.videos} from video" + ", whose motion turnscope analyze checks" * bool(found.videos)
            click.echo(f"{experiment}: no errors; {counted(found.runs, 'run')}, {videos}")
        if found.unseen and not quiet:
            click.echo(
                f"the motion of {named_runs(found.unseen)} could not be compared with commands; "
                "turnscope analyze says why",
                err=True,
            )
    if mend and not found.faults:
        if found.videos:
            click.echo("the motion in videos is not checked here, but by turnscope diagnose --write-mended", err=True)
        say_mended(experiment)
    return BAD_INPUT if found.faults or found.mistakes else 0


def without_repeats(sentences: Sequence[str]) -> list[str]:
    """Sentences 'run or file: fault', of which those that differ in names and numbers only are told once.

    Two are printed as they are; of more, the first, and of which runs or files the others are.
    """
    kinds: dict[str, list[tuple[str, str]]] = {}
    for sentence in sentences:
        subject, colon, fault = sentence.partition(": ")
        name = Path(subject.removeprefix("run ")).stem
        kind = re.sub(rf"(?<![^\W_]){re.escape(name)}(?![^\W_])", "#", fault) if colon else sentence
        kinds.setdefault(ANY_NUMBER.sub("#", kind), []).append((subject, sentence))
    lines = []
    for same in kinds.values():
        if len(same) <= FEW_ALIKE:
            lines += [sentence for _, sentence in same]
            continue
        others = list(dict.fromkeys(Path(subject.removeprefix("run ")).name for subject, _ in same[1:]))
        named = ", ".join(others[:MOST_ALIKE]) + ", …" * (len(others) > MOST_ALIKE)
        lines += [same[0][1], f"the same of {named}, with their own names and numbers"]
    return lines
