"""Errors as the user sees them: one sentence, exit status 2, no traceback."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import click

from evaluator.cli.printable import Printable
from evaluator.progress import Cancelled


def run_safely(group: click.Group) -> int:
    """Run the group; return the exit status: 0 done, 2 bad input, 130 interrupted."""
    with _printable_streams():
        try:
            return int(group.main(standalone_mode=False) or 0)
        except click.ClickException as error:
            error.show()
            return 2
        except (click.Abort, Cancelled, KeyboardInterrupt):
            click.echo("interrupted; finished results are kept; run the same command again to continue", err=True)
            return 130
        except (ValueError, OSError, MemoryError) as error:
            sentence = sentence_of(error)
            if sentence is None:
                raise
            click.echo(f"error: {sentence}", err=True)
            return 2


@contextmanager
def _printable_streams() -> Iterator[None]:
    out, err = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = Printable(out), Printable(err)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = out, err


def sentence_of(error: ValueError | OSError | MemoryError) -> str | None:
    """Text of an error that the user caused; None for a defect of turnscope, which shows its traceback."""
    from calibration.errors import CalibrationError
    from evaluator.errors import InputError
    from simulator.errors import SimulationError

    if isinstance(error, MemoryError):
        asked = "is a size in one of the files, a duration or a rate too large?"
        return f"more memory is needed than this machine has ({error}); {asked}"
    if isinstance(error, (CalibrationError, SimulationError, InputError)):
        return str(error)
    if isinstance(error, OSError) and error.strerror:  # words of the system, for a full disk or a protected folder
        return f"{error.filename}: {error.strerror}" if error.filename is not None else error.strerror
    if "embedded null" in str(error):  # a string of TOML or JSON may hold it
        return "the name of a file holds the character U+0000, which no name may have; correct the file that states it"
    names = sys.getfilesystemencoding()
    if isinstance(error, UnicodeEncodeError) and names != "utf-8":  # a locale of one byte a character
        letters = error.object[error.start : error.end]
        return (
            f"{letters!r} cannot be in a file's name under this locale ({names}); set LC_ALL=C.UTF-8 and run it again"
        )
    return None
