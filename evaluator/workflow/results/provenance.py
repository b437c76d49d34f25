"""Provenance of results: versions, settings, hashes of inputs, command line.

It contains no time and no host name, so that the same input gives the same file.
"""

from __future__ import annotations

import json
import platform
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path

from evaluator.files import named_from, write_text
from evaluator.workflow.results.validity import code_hash, file_hash, installed_version, library_versions


def write_provenance(
    path: Path,
    experiment_path: Path,
    experiment: str,
    inputs: Iterable[Path],
    changed: Iterable[Path],
    command_line: Sequence[str],
) -> None:
    """Write provenance.json; paths in it are relative to the folder of the experiment file.

    experiment: text of the experiment file as it was read. changed: files that changed since they were read, which are
    listed without a hash.
    """
    folder = experiment_path.resolve().parent

    def named(file: Path) -> str:
        return named_from(folder, Path(file).resolve())

    others = set(changed)
    content = {
        "format": 1,
        "turnscope": installed_version("turnscope"),
        "code_sha256": code_hash(),
        "python": platform.python_version(),
        "libraries": library_versions(),
        "command_line": list(command_line),
        "experiment": experiment_path.name,
        "inputs_sha256": {
            named(file): file_hash(file) for file in sorted({experiment_path, *inputs} - others) if file.is_file()
        },
        "settings": tomllib.loads(experiment),
    }
    if others:
        content["changed_meanwhile"] = sorted(map(named, others))
    write_text(path, json.dumps(content, indent=1, sort_keys=True, default=str) + "\n")
