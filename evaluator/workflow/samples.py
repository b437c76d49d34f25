"""The shipped sample recordings: their location, and a working copy."""

from __future__ import annotations

import shutil
from importlib.resources import files
from pathlib import Path

from evaluator.errors import InputError

NOT_COPIED = ("truth", "recipes")  # not needed for an analysis


def sample_folder() -> Path:
    """Folder of the shipped samples. Raises InputError if they are not installed."""
    try:
        experiment = Path(str(files("sample_videos") / "experiment.toml"))
    except ModuleNotFoundError:
        experiment = Path()
    if not experiment.is_file():
        raise InputError("the sample recordings are not installed; reinstall turnscope from its source or wheel")
    return experiment.parent


def copy_samples(folder: Path) -> Path:
    """Copy the samples into folder, except for identical files that exist already; return the experiment file."""
    source = sample_folder()
    for path in sorted(source.rglob("*")):
        relative = path.relative_to(source)
        if path.is_dir() or relative.parts[0] in NOT_COPIED or relative.name.startswith((".", "__")):
            continue
        target = folder / relative
        if not target.is_file() or target.read_bytes() != path.read_bytes():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, target)
    return folder / "experiment.toml"
