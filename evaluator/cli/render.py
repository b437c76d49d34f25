"""`turnscope render`: scene.toml → video or gauge picture, with exact truth beside it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from evaluator.cli.options import PATH, quiet_option, workers_option

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
@click.argument("scenes", nargs=-1, required=True, type=PATH, metavar="SCENE.toml...")
@click.option("-o", "--out", "output", type=PATH, help="Video or picture; else what the scene says.")
@click.option("--truth", type=PATH, help="Truth CSV; else what the scene says, or NAME-truth.csv.")
@workers_option
@quiet_option
def render(scenes: tuple[Path, ...], output: Path | None, truth: Path | None, workers: int | None, quiet: bool) -> None:
    """Draw the video that a rig's camera would see of each SCENE, with exact truth.

    A scene of kind "gauge" gives a picture of the dot gauge. No analysis reads the truth.
    """
    from evaluator.cli.progress import progress_bar
    from evaluator.errors import InputError
    from evaluator.workflow.execution.batch import available_cores, in_processes

    if len(scenes) > 1 and (output or truth):
        raise InputError(f"{len(scenes)} scenes cannot go to one file; say output = … in each scene instead")
    orders = [_order(path, output, truth) for path in scenes]
    if len(orders) == 1:
        with progress_bar(orders[0].output.name, quiet=quiet) as report:
            said = _carry_out(orders[0], report)
        if not quiet:
            click.echo(said)
        return
    faults = []
    with progress_bar("scenes", quiet=quiet) as report:
        answers = in_processes(_attempt, orders, workers=workers or available_cores(), when_killed=_killed)
        for done, (said, well) in enumerate(answers, 1):
            report(done, len(orders))
            if not well:
                faults.append(said)
            elif not quiet:
                click.echo(said)
    if faults:
        raise InputError(f"{len(faults)} of {len(orders)} scenes were not rendered: {'; '.join(faults)}")


@dataclass(frozen=True)
class _Order:
    """A scene that has been read, and where its results go."""

    path: Path
    scene: Scene | GaugeScene
    output: Path
    truth: Path


def _order(path: Path, output: Path | None, truth: Path | None) -> _Order:
    """Read a scene and what it names, so that every fault is said before any work."""
    from calibration.gauge.geometry import load_gauge
    from evaluator.errors import InputError
    from evaluator.files import read_with
    from simulator.rendering.scene import load_gauge_scene, load_run_scene, scene_kind
    from simulator.robot import load_robot

    scene: Scene | GaugeScene
    if read_with(scene_kind, path) == "gauge":
        scene = read_with(load_gauge_scene, path)
        read_with(load_gauge, scene.gauge)
    else:
        scene = read_with(load_run_scene, path)
        read_with(load_robot, Path(scene.robot))
    target = output or _shown_from_here(scene.output)
    if target is None:
        raise InputError(f"{path}: where to? Give -o FILE, or say output = … in the scene")
    beside = truth or _shown_from_here(scene.truth) or target.with_name(f"{target.stem}-truth.csv")
    return _Order(path, scene, target, beside)


def _attempt(order: _Order) -> tuple[str, bool]:
    """Carry out an order in a worker process; what to say, and whether it went well."""
    from calibration.errors import CalibrationError
    from evaluator.errors import InputError
    from simulator.errors import SimulationError

    try:
        return _carry_out(order, _unseen), True
    except (CalibrationError, InputError, SimulationError, OSError) as error:
        return f"{order.path}: {error}", False


def _killed(order: _Order) -> tuple[str, bool]:
    return f"{order.path}: its process was killed (out of memory?)", False


def _unseen(done: int, total: int) -> None:
    del done, total


def _shown_from_here(path: Path | None) -> Path | None:
    """A path in its shortest form, so that messages read well."""
    if path is None:
        return None
    return min(Path(os.path.relpath(path)), Path(os.path.normpath(path)), key=lambda form: len(str(form)))


def _carry_out(order: _Order, report: Progress) -> str:
    """Render a scene to its files; returns what to say."""
    from evaluator.files import written_whole
    from simulator.rendering import GaugeScene, render_clip, render_gauge

    scene, output, truth = order.scene, order.output, order.truth
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
