"""What the user sees when something is wrong: one sentence, exit status 2, no traceback."""

from __future__ import annotations

import click

from evaluator.progress import Cancelled


def run_safely(group: click.Group) -> int:
    """Run the group; return the exit status: 0 done, 2 bad input, 130 interrupted."""
    try:
        return int(group.main(standalone_mode=False) or 0)
    except click.ClickException as error:
        error.show()
        return 2
    except (click.Abort, Cancelled, KeyboardInterrupt):
        click.echo("interrupted; what was finished is kept, run the same command again to go on", err=True)
        return 130
    except (ValueError, OSError) as error:
        sentence = _sentence(error)
        if sentence is None:
            raise
        click.echo(f"error: {sentence}", err=True)
        return 2


def _sentence(error: ValueError | OSError) -> str | None:
    """Text of an error the user caused; None for a defect of ours, whose traceback we want to see."""
    from calibration.errors import CalibrationError
    from evaluator.errors import InputError
    from simulator.errors import SimulationError

    if isinstance(error, (CalibrationError, SimulationError, InputError)):
        return str(error)
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return None
