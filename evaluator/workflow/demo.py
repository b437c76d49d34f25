"""The shipped samples, copied and calibrated."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from evaluator.progress import Progress, no_progress
from evaluator.workflow.calibration import Calibrated, calibrate
from evaluator.workflow.execution.precompile import precompile
from evaluator.workflow.samples import copy_samples


@dataclass(frozen=True)
class Samples:
    """A copy of the samples: the experiment, a second one with a hidden effect, and their calibration.

    compiling: whether other processes still compile kernels.
    """

    experiment: Path
    puzzle: Path
    calibrated: Calibrated
    compiling: bool = False


def prepare_samples(folder: Path | str, progress: Progress = no_progress) -> Samples:
    """Copy the samples into a folder and solve their camera from the gauge images.

    Kernels for the analysis are compiled in parallel if necessary. Raises InputError if there are no samples.
    """
    experiment = copy_samples(Path(folder))
    compiling = precompile(experiment.parent / "turn-33-5.mp4")
    images = sorted(experiment.parent.glob("gauge-*.png"))
    found = calibrate(images, experiment.parent / "gauge.toml", progress=progress)
    found.save(experiment.parent / "camera.json")
    return Samples(experiment, experiment.parent / "puzzle" / "experiment.toml", found, compiling)
