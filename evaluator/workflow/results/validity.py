"""Whether a cached result is up to date, by hashes of inputs, settings and code, not by dates.

A record of a run contains, for every stage, the key of its inputs, the hashes of its files and its values. A stage is
reused only if its key is the same and its files are unchanged.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from evaluator.files import refuse_stream, write_text

PACKAGES = ("calibration", "simulator", "evaluator")
LIBRARIES = ("numpy", "scipy", "pandas", "opencv-python-headless", "av", "numba")  # on which results depend
NOT_RESULTS = ("cli", "report", "studio")  # folders of the evaluator on which no result depends


def file_hash(path: Path) -> str:
    """SHA-256 of a file's content; of a folder, of the names and contents of the files in it.

    Raises OSError if it cannot be read, InputError for a pipe or a device, which would be waited for or has no end.
    """
    refuse_stream(Path(path))
    if Path(path).is_dir():
        files = sorted(file for file in Path(path).iterdir() if file.is_file())
        names = "".join(f"{file.name}\0{file_hash(file)}\n" for file in files)
        return hashlib.sha256(names.encode()).hexdigest()
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def key_of(inputs: Mapping[str, Any]) -> str:
    """One hash of named inputs (any JSON values) and of the code on which results depend."""
    text = json.dumps({"inputs": inputs, "code": code_hash(), "libraries": library_versions()}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


@cache
def code_hash() -> str:
    """Hash of the installed sources that results depend on."""
    digest = hashlib.sha256()
    root = Path(__file__).parents[3]
    for path in sorted(path for package in PACKAGES for path in (root / package).rglob("*.py")):
        parts = path.relative_to(root).parts
        if parts[0] == "evaluator" and parts[1] in NOT_RESULTS:
            continue
        digest.update("/".join(parts).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


@cache
def library_versions() -> dict[str, str]:
    """Versions of the libraries that results depend on."""
    return {name: installed_version(name) for name in LIBRARIES}


def installed_version(name: str) -> str:
    """Version of an installed distribution, or a word if it is not installed as one."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _as_in_tables(text: str) -> float:
    """A number with nine digits, as in tables.

    Two processes that compile the kernels at once may round the last bit differently.
    """
    return float(f"{float(text):.9g}")


@dataclass
class Record:
    """Stored stages of one run: `load` it, query `fresh`, store new results with `keep` (written immediately)."""

    path: Path
    stages: dict[str, dict[str, Any]] = field(default_factory=dict)

    @staticmethod
    def load(path: Path) -> Record:
        """Read a record; an absent or unreadable one is empty, so that its stages are computed again."""
        try:
            stages = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return Record(path)
        return Record(path, stages if isinstance(stages, dict) else {})

    def fresh(self, stage: str, key: str) -> dict[str, Any] | None:
        """Values of a stage, if it was computed from exactly these inputs and its files are unchanged, else None."""
        cached = self.stages.get(stage)
        if not isinstance(cached, dict) or cached.get("key") != key:
            return None
        root = self.path.parents[1]
        for name, expected in cached["files"].items():
            if not (root / name).is_file() or file_hash(root / name) != expected:
                return None
        values: dict[str, Any] = cached["values"]
        return values

    def keep(self, stage: str, key: str, files: list[Path], values: Mapping[str, Any]) -> dict[str, Any]:
        """Store a finished stage; return its values as a later reader gets them."""
        root = self.path.parents[1]
        self.stages[stage] = {
            "key": key,
            "files": {str(path.relative_to(root).as_posix()): file_hash(path) for path in files},
            "values": json.loads(json.dumps(values), parse_float=_as_in_tables),
        }
        write_text(self.path, json.dumps(self.stages, indent=1) + "\n")
        result: dict[str, Any] = self.stages[stage]["values"]
        return result

    def forget(self) -> None:
        """Remove the record and all files listed in it, for an input that no longer has results."""
        root = self.path.parents[1]
        for stage in self.stages.values():
            for name in stage.get("files", {}):
                (root / name).unlink(missing_ok=True)
        self.path.unlink(missing_ok=True)
