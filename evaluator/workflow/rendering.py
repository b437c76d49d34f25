"""Rendering of scene files to videos and gauge images, with their exact truth."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from evaluator.errors import InputError
from evaluator.files import named_from, read_with, write_image, written_whole
from evaluator.progress import Progress, counting, no_progress
from evaluator.workflow.execution.answers import answers_of

if TYPE_CHECKING:
    from simulator.rendering import GaugeScene, Scene


@dataclass(frozen=True)
class SceneOrder:
    """A scene that has been read, and the paths of its results."""

    path: Path
    scene: Scene | GaugeScene
    output: Path
    truth: Path


@dataclass(frozen=True)
class Rendered:
    """Result of a scene: its files and their number of frames or dots, or the reason why there are none."""

    path: Path
    output: Path
    truth: Path
    frames: int = 0
    dots: int = 0
    fault: str | None = None


def read_scene(path: Path | str, output: Path | None = None, truth: Path | None = None) -> SceneOrder:
    """Read a scene and the files that it names, so that all faults are reported before rendering.

    output, truth: paths of the results, by default those in the scene file.
    Raises InputError, SimulationError, CalibrationError.
    """
    from calibration.gauge.geometry import load_gauge
    from simulator.rendering.scene import load_gauge_scene, load_run_scene, scene_kind
    from simulator.robot import load_robot

    path = Path(path)
    scene: Scene | GaugeScene
    if read_with(scene_kind, path) == "gauge":
        scene = read_with(load_gauge_scene, path)
        read_with(load_gauge, scene.gauge)
    else:
        scene = read_with(load_run_scene, path)
        read_with(load_robot, Path(scene.robot))
    target = output or _shown_from_here(scene.output)
    if target is None:
        raise InputError(f"{path}: no output; give -o FILE, or set output = … in the scene")
    beside = truth or _shown_from_here(scene.truth) or target.with_name(f"{target.stem}-truth.csv")
    return SceneOrder(path, scene, target, beside)


def render_scene(order: SceneOrder, progress: Progress = no_progress) -> Rendered:
    """Render a scene to its files. Raises as read_scene does, and OSError."""
    from simulator.rendering import GaugeScene, check_container, render_clip, render_gauge

    scene = order.scene
    if isinstance(scene, GaugeScene):
        image, table = render_gauge(scene)
        write_image(image, order.output)
    else:
        check_container(scene.encoding, order.output)
        with written_whole(order.output) as temporary:
            table = render_clip(scene, temporary, counting(progress, "rendering"))
    with written_whole(order.truth) as temporary:
        table.to_csv(temporary, index=False, float_format="%.7f")
    if isinstance(scene, GaugeScene):
        return Rendered(order.path, order.output, order.truth, dots=int(table["visible"].sum()))
    return Rendered(order.path, order.output, order.truth, frames=int(table["frame"].max()) + 1)


def render_scenes(
    orders: Sequence[SceneOrder], *, workers: int | None = None, progress: Progress = no_progress
) -> list[Rendered]:
    """Render scenes in parallel on all cores; a scene that fails does not stop the others."""
    found: dict[int, Rendered] = {}

    def report() -> None:
        progress("scenes", len(found), len(orders))

    report()
    with answers_of(_attempt, orders, when_killed=_killed, workers=workers, waiting=report) as answers:
        for number, answer in answers:
            found[number] = answer
            report()
    return [found[number] for number in range(len(orders))]


def _attempt(order: SceneOrder) -> Rendered:
    """Render an order in a worker process."""
    from calibration.errors import CalibrationError
    from simulator.errors import SimulationError

    try:
        return render_scene(order)
    except (CalibrationError, InputError, SimulationError, OSError) as error:
        return Rendered(order.path, order.output, order.truth, fault=str(error))


def _killed(order: SceneOrder) -> Rendered:
    return Rendered(order.path, order.output, order.truth, fault="its process was killed (out of memory?)")


def _shown_from_here(path: Path | None) -> Path | None:
    """A path in its shortest form, for messages."""
    if path is None:
        return None
    return min(Path(named_from(Path(), path)), Path(os.path.normpath(path)), key=lambda form: len(str(form)))
