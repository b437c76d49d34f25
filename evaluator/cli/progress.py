"""Progress bars with remaining time, on standard error and only on terminals, so that output stays clean in pipes."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from evaluator.progress import Progress, no_progress


@contextmanager
def progress_bar(what: str, *, quiet: bool = False) -> Iterator[Progress]:
    """Show a bar with a name and the current stage while the block runs; yields its Progress.

    Without a terminal on standard error, or if quiet, the yielded Progress does nothing.
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
            # A total of 1 means that work reports its share; larger totals are counts.
            count = f"{done:.0f}/{total:.0f}" if total > 1 else f"{done / total:.0%}" if total else f"{done:.0f}"
            described = what if stage in what else f"{what}: {stage}"
            shown.update(task, completed=done, total=total or None, count=count, description=described)

        yield report
