"""To which experiment the results in an output folder belong, so that those of another do not replace or join them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from evaluator.errors import InputError
from evaluator.files import quoted, write_text
from evaluator.settings import Experiment
from evaluator.workflow.results.outputs import Outputs
from evaluator.workflow.results.validity import file_hash


@contextmanager
def claimed(outputs: Outputs, experiment: Experiment) -> Iterator[None]:
    """Note that an output folder is of this experiment while results are written into it, and after if there are any.

    An experiment is known by its name, and a renamed one by any of its recordings. These are read only if the name or
    their number differs from what is noted, because videos are large. Raises InputError if the folder holds results of
    another experiment.
    """
    name, noted, further = _noted(outputs)
    if name != experiment.name or len(noted) != len(_sources(experiment)):
        recordings = _hashes(experiment)
        if name not in (None, experiment.name) and {*noted, *further}.isdisjoint(recordings) and _has_results(outputs):
            raise InputError(
                f"{outputs.folder}: holds results of the experiment {quoted(name)}; write those of "
                f"{quoted(experiment.name)} to another folder (-o), or remove these results first"
            )
        if recordings:  # without any there will be no result
            note = {"name": experiment.name, "recordings_sha256": recordings}
            write_text(outputs.experiment, json.dumps(note, indent=1, ensure_ascii=False) + "\n")
    try:
        yield
    finally:
        if not _has_results(outputs):
            outputs.experiment.unlink(missing_ok=True)


def _noted(outputs: Outputs) -> tuple[str | None, list[str], list[str]]:
    """Name of the experiment of a folder, None if it is not known, hashes of its recordings, and of its last inputs.

    Folders of earlier versions have provenance.json only, which is also newer if recordings were replaced.
    """
    note, provenance = _content(outputs.experiment), _content(outputs.provenance)
    try:
        name = note.get("name", provenance.get("settings", {}).get("name"))
        recordings, inputs = note.get("recordings_sha256", []), provenance.get("inputs_sha256", {}).values()
        return name, list(map(str, recordings)), list(map(str, inputs))
    except (AttributeError, TypeError):  # another program wrote them
        return None, [], []


def _content(path: Path) -> dict[str, Any]:
    """Content of a JSON file; of one that is absent or unreadable, none."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _sources(experiment: Experiment) -> set[Path]:
    return {run.source for run in experiment.run}


def _hashes(experiment: Experiment) -> list[str]:
    """Sorted hashes of the recordings that can be read; the analysis says why the others cannot."""
    hashes = []
    for source in _sources(experiment):
        with suppress(OSError, InputError):
            hashes.append(file_hash(source))
    return sorted(hashes)


def _has_results(outputs: Outputs) -> bool:
    """Whether there is anything but the note, which is alone if no run could be analysed."""
    return any(path != outputs.experiment for path in outputs.folder.rglob("*") if path.is_file())
