"""The studio open on a folder: two runs of one video, or what a module prepares or makes in their place."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.evaluator.studio.recordings import two_runs


@pytest.fixture(scope="session")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder, with its camera solved; nobody writes into it."""
    return two_runs(tmp_path_factory.mktemp("recordings"))


@pytest.fixture
def folder(prepared: Path, tmp_path: Path) -> Path:
    """A copy of the folder for one test."""
    return Path(shutil.copytree(prepared, tmp_path / "folder"))


@pytest.fixture
def studio(folder: Path) -> Iterator[object]:
    from tests.evaluator.studio.serving import serving  # skips where the libraries of the studio are missing

    with serving(folder) as found:
        yield found
