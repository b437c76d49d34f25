"""Arguments and options that several commands share, so that they read the same everywhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any

import click

from evaluator.errors import InputError

PATH: click.Path = click.Path(path_type=Path)


class _Folder(click.Path):
    """A folder of results, which may not exist yet; a file in its place is refused before the work."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """The path. Raises InputError for a file."""
        path = Path(str(super().convert(value, param, ctx)))
        if path.is_file():
            raise InputError(f"{path}: is a file; give a folder for the results (-o)")
        return path


FOLDER = _Folder(path_type=Path)

experiment_argument = click.argument("experiment", type=PATH, metavar="EXPERIMENT.toml")
out_option = click.option(
    "-o", "--out", type=FOLDER, default=Path("out"), show_default=True, metavar="DIR", help="Folder of the results."
)
workers_option = click.option(
    "--workers", type=click.IntRange(min=1), metavar="N", help="Processes to work with. [default: one per core]"
)
dask_option = click.option(
    "--dask",
    metavar="ADDRESS",
    help="Compute on a Dask cluster with this scheduler, e.g. tcp://host:8786. Start its workers with "
    "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED=False in long batches: it saves each of them 0.3 MB a recording.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print the results as JSON.")
quiet_option = click.option("-q", "--quiet", is_flag=True, help="Print errors only.")
verbose_option = click.option("-v", "--verbose", is_flag=True, help="Print more about every run.")
dry_run_option = click.option("--dry-run", is_flag=True, help="List what would be computed, without computing it.")

# Of the 32 bits of seeds in a scene, so that those of its images can count on from it.
MOST_SEED = 2**31 - 1


def seed_option(default: int, text: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """The option --seed of a command that draws random numbers."""
    return click.option("--seed", type=click.IntRange(0, MOST_SEED), default=default, show_default=True, help=text)


write_mended_option = click.option(
    "--write-mended",
    "mend",
    is_flag=True,
    help="Write NAME-mended.toml beside the experiment, with the mistakes in its runs corrected.",
)


def say_mended(experiment: Path, out: Path | None = None) -> None:
    """Write the experiment with its mistakes corrected, and print the changes to standard error."""
    from evaluator.workflow import write_mended

    mended = write_mended(experiment, out)
    if mended is None:
        click.echo(f"{experiment}: no run shows a mistake; nothing is written", err=True)
        return
    for change in mended.changes:
        click.echo(change, err=True)
    click.echo(str(mended.path), err=True)


@dataclass(frozen=True)
class BatchOptions:
    """Options of a command that works through the runs of an experiment."""

    experiment: Path
    out: Path
    workers: int | None = None
    dask: str | None = None
    as_json: bool = False
    quiet: bool = False
    verbose: bool = False
    dry_run: bool = False


def batch_options(command: Callable[[BatchOptions], int]) -> Callable[..., int]:
    """Decorate a command with the options of `BatchOptions`, which it receives as one value."""

    @wraps(command)
    def with_options(**given: Any) -> int:
        return command(BatchOptions(**given))

    options = (out_option, workers_option, dask_option, json_option, quiet_option, verbose_option, dry_run_option)
    found: Callable[..., int] = with_options
    for option in reversed((experiment_argument, *options)):
        found = option(found)
    return found


def refuse_both(ratio: tuple[float, ...], radius_mm: float | None) -> None:
    """Raise UsageError if a circular test is to have constant commands and a constant radius."""
    if ratio and radius_mm is not None:
        raise click.UsageError("--ratio (constant commands) and --radius (a constant radius) exclude each other")
