"""`turnscope render`: scene.toml → video or gauge picture, with exact truth beside it."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(
    epilog="""\b
Examples:
  turnscope render turn.toml -o turn.mp4
  turnscope render turn.toml -o clips/turn.mp4 --truth truth/turn.csv
  turnscope render gauge-tilted.toml -o gauge-tilted.png"""
)
@click.argument("scene", type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), help="Video (.mp4 …) or picture (.png)."
)
@click.option(
    "--truth", type=click.Path(path_type=Path), help="Truth CSV; beside the output, ending -truth.csv, if not given."
)
def render(scene: Path, output: Path, truth: Path | None) -> None:
    """Draw the video that a rig's camera would see of SCENE, with exact truth.

    A scene of kind "gauge" gives a picture of the dot gauge. No analysis reads the truth.
    """
    from evaluator.files import read_with, written_whole
    from simulator.rendering import GaugeScene, render_clip, render_gauge
    from simulator.rendering.scene import load_gauge_scene, load_run_scene, load_scene, scene_kind

    kind = read_with(scene_kind, scene)
    read_with(load_gauge_scene if kind == "gauge" else load_run_scene, scene)  # explains faults by the right model
    content = read_with(load_scene, scene)
    truth = truth or output.with_name(f"{output.stem}-truth.csv")
    if isinstance(content, GaugeScene):
        picture, table = render_gauge(content)
        _write_picture(picture, output)
    else:
        with written_whole(output) as temporary:
            table = render_clip(content, temporary)
    with written_whole(truth) as temporary:
        table.to_csv(temporary, index=False, float_format="%.7f")
    click.echo(f"{output}: {len(table)} {'dots' if kind == 'gauge' else 'exposures'}; truth in {truth}")


def _write_picture(picture: object, output: Path) -> None:
    import cv2
    import numpy as np

    from evaluator.errors import InputError
    from evaluator.files import written_whole

    if output.suffix.lower() not in {".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp"}:
        raise InputError(f"{output}: a gauge picture is written as .png, .tif, .jpg or .bmp")
    numbers = np.asarray(picture)
    stored = numbers[..., ::-1] if numbers.ndim == 3 else numbers  # OpenCV writes blue, green, red
    with written_whole(output) as temporary:
        cv2.imwrite(str(temporary), np.ascontiguousarray(stored))
