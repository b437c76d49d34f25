"""Progress bars with remaining time, on standard error and only on terminals, so that output stays clean in pipes."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from evaluator.progress import Progress, no_progress


@contextmanager
def progress_bar(what: str, *, quiet: bool = False) -> Iterator[Progress]:
    """Show a bar named what, with the stage the work is in, while the block runs; yields the Progress to report to.

    Silent (the yielded function does nothing) where standard error is not a terminal, or where quiet.
    """
    if quiet or not sys.stderr.isatty():
        yield no_progress
        return
    from rich import progress as bars
    from rich.console import Console

    columns = (
        bars.TextColumn("{task.description}"),
        bars.BarColumn(),
        bars.TextColumn("{task.fields[count]}"),
        bars.TimeRemainingColumn(),
    )
    with bars.Progress(
        *columns, console=Console(file=getattr(sys.stderr, "original", sys.stderr)), transient=True
    ) as shown:
        task = shown.add_task(what, total=None, count="")

        def report(stage: str, done: float, total: float = 1.0, /) -> None:
            # One is the whole where work tells its share; where it counts, the count is shown.
            count = f"{done:.0f}/{total:.0f}" if total > 1 else f"{done / total:.0%}" if total else f"{done:.0f}"
            described = what if stage in what else f"{what}: {stage}"
            shown.update(task, completed=done, total=total or None, count=count, description=described)

        yield report
