from __future__ import annotations

from pathlib import Path

import pytest

from evaluator.workflow import prepare_samples


@pytest.fixture(scope="session")
def samples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the shipped recordings and the camera calibrated from the shipped gauge images."""
    return prepare_samples(tmp_path_factory.mktemp("samples")).experiment.parent
