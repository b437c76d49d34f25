from __future__ import annotations

from pathlib import Path

import pytest

from evaluator.cli.demo import calibrate_samples
from evaluator.workflow.samples import copy_samples


@pytest.fixture(scope="session")
def samples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the shipped recordings and the camera calibrated from the shipped gauge pictures."""
    experiment = copy_samples(tmp_path_factory.mktemp("samples"))
    calibrate_samples(experiment.parent)
    return experiment.parent
