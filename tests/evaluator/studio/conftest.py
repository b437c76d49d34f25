"""The studio open on two runs of one video, for tests in a browser; other modules open it on a folder of their own."""

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
def studio(prepared: Path, tmp_path: Path) -> Iterator[object]:
    from tests.evaluator.studio.serving import serving  # skips where the libraries of the studio are missing

    shutil.copytree(prepared, tmp_path / "folder")
    with serving(tmp_path / "folder") as found:
        yield found
