"""`turnscope render`: scene.toml → video or gauge image, with exact truth beside it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from evaluator.cli.options import PATH, quiet_option, workers_option

if TYPE_CHECKING:
    from evaluator.workflow import Rendered


@click.command(
    epilog="""\b
Examples:
  turnscope render turn.toml -o turn.mp4
  turnscope render turn.toml -o clips/turn.mp4 --truth truth/turn.csv
  turnscope render gauge-tilted.toml -o gauge-tilted.png
  turnscope render sample_videos/recipes/*.toml"""
)
@click.argument("scenes", nargs=-1, required=True, type=PATH, metavar="SCENE.toml...")
@click.option("-o", "--out", "output", type=PATH, help="Video or image to write. [default: from the scene]")
@click.option("--truth", type=PATH, help="Truth CSV to write. [default: from the scene, or NAME-truth.csv]")
@workers_option
@quiet_option
def render(scenes: tuple[Path, ...], output: Path | None, truth: Path | None, workers: int | None, quiet: bool) -> None:
    """Render the video that a camera would record of each SCENE, with exact truth.

    A scene of kind "gauge" gives an image of the dot gauge. No analysis reads the truth.
    """
    from evaluator.cli.progress import progress_bar
    from evaluator.errors import InputError
    from evaluator.workflow import read_scene, render_scene, render_scenes

    if len(scenes) > 1 and (output or truth):
        raise InputError(f"{len(scenes)} scenes cannot go to one file; set output = … in each scene instead")
    orders = [read_scene(path, output, truth) for path in scenes]
    if len(orders) == 1:
        with progress_bar(orders[0].output.name, quiet=quiet) as progress:
            found = [render_scene(orders[0], progress)]
    else:
        with progress_bar("scenes", quiet=quiet) as progress:
            found = render_scenes(orders, workers=workers, progress=progress)
    if not quiet:
        for each in found:
            if each.fault is None:
                click.echo(_text(each))
    faults = [f"{each.path}: {each.fault}" for each in found if each.fault is not None]
    if faults:
        raise InputError(f"{len(faults)} of {len(orders)} scenes were not rendered: {'; '.join(faults)}")


def _text(rendered: Rendered) -> str:
    from evaluator.wording import counted

    what = counted(rendered.dots, "dot") if rendered.dots else counted(rendered.frames, "frame")
    return f"{rendered.output}: {what}; truth in {rendered.truth}"
