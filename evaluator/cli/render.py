"""`turnscope render`: scene.toml → video or gauge picture, with exact truth beside it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from evaluator.progress import Progress
    from simulator.rendering import GaugeScene, Scene

PICTURES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")


@click.command(
    epilog="""\b
Examples:
  turnscope render turn.toml -o turn.mp4
  turnscope render turn.toml -o clips/turn.mp4 --truth truth/turn.csv
  turnscope render gauge-tilted.toml -o gauge-tilted.png
  turnscope render sample_videos/recipes/*.toml"""
)
@click.argument("scenes", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Video or picture; else what the scene says.")
@click.option(
    "--truth", type=click.Path(path_type=Path), help="Truth CSV; else what the scene says, or NAME-truth.csv."
)
@click.option("-q", "--quiet", is_flag=True, help="Say nothing but errors.")
def render(scenes: tuple[Path, ...], output: Path | None, truth: Path | None, quiet: bool) -> None:
    """Draw the video that a rig's camera would see of each of SCENES, with exact truth.

    A scene of kind "gauge" gives a picture of the dot gauge. No analysis reads the truth.
    """
    from evaluator.cli.progress import progress_bar
    from evaluator.errors import InputError
    from evaluator.files import read_with
    from simulator.rendering.scene import load_gauge_scene, load_run_scene, scene_kind

    if len(scenes) > 1 and (output or truth):
        raise InputError(f"{len(scenes)} scenes cannot go to one file; say output = … in each scene instead")
    loaded = []
    for path in scenes:
        scene: Scene | GaugeScene
        if read_with(scene_kind, path) == "gauge":
            scene = read_with(load_gauge_scene, path)
        else:
            scene = read_with(load_run_scene, path)
        target = output or _shown_from_here(scene.output)
        if target is None:
            raise InputError(f"{path}: where to? Give -o FILE, or say output = … in the scene")
        loaded.append(
            (scene, target, truth or _shown_from_here(scene.truth) or target.with_name(f"{target.stem}-truth.csv"))
        )
    for scene, target, beside in loaded:
        with progress_bar(target.name, quiet=quiet) as report:
            said = _render_one(scene, target, beside, report)
        if not quiet:
            click.echo(said)


def _shown_from_here(path: Path | None) -> Path | None:
    """A path in its shortest form, so that messages read well."""
    if path is None:
        return None
    return min(Path(os.path.relpath(path)), Path(os.path.normpath(path)), key=lambda form: len(str(form)))


def _render_one(scene: Scene | GaugeScene, output: Path, truth: Path, report: Progress) -> str:
    """Render a scene to its files; returns what to say."""
    from evaluator.files import written_whole
    from simulator.rendering import GaugeScene, render_clip, render_gauge

    if isinstance(scene, GaugeScene):
        picture, table = render_gauge(scene)
        _write_picture(picture, output)
    else:
        with written_whole(output) as temporary:
            table = render_clip(scene, temporary, report)
    with written_whole(truth) as temporary:
        table.to_csv(temporary, index=False, float_format="%.7f")
    what = (
        f"{int(table['visible'].sum())} dots" if isinstance(scene, GaugeScene) else f"{table['frame'].max() + 1} frames"
    )
    return f"{output}: {what}; truth in {truth}"


def _write_picture(picture: object, output: Path) -> None:
    import cv2
    import numpy as np

    from evaluator.errors import InputError
    from evaluator.files import written_whole

    if output.suffix.lower() not in PICTURES:
        raise InputError(f"{output}: a gauge picture is written as {', '.join(PICTURES)}")
    numbers = np.asarray(picture)
    stored = numbers[..., ::-1] if numbers.ndim == 3 else numbers  # OpenCV writes blue, green, red
    with written_whole(output) as temporary:
        cv2.imwrite(str(temporary), np.ascontiguousarray(stored))
