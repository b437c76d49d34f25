"""Fit cache on disk, so that an interrupted diagnosis continues where it stopped.

The search of a diagnosis is deterministic, so that a second run needs the same fits in the same order. Only the end
point of a fit is stored, as a line of JSON; its linearization is computed again, which takes one of the several steps
of a fit.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluator.files import write_text

DIGITS = 9  # of the numbers in a key: separately compiled kernels may differ in the last bits


@dataclass(frozen=True)
class End:
    """End point of a fit: per_run (n, 7), nominal, terms as in Point; number of steps; other fields as in Fit."""

    per_run: NDArray[np.float64]
    nominal: Mapping[str, float]
    terms: Mapping[str, tuple[float, ...]]
    converged: bool
    steps: int = 1
    shortfall: float = 0.0


class FitCache:
    """End points of all fits of one diagnosis, by the hash of their conditions; on disk if a path is given."""

    def __init__(self, path: Path | None = None, key: str = "") -> None:
        """key: of the inputs and the code of the diagnosis; a file with another key is replaced."""
        self._path = path
        self._known: dict[str, End | None] = {}
        if path is None:
            return
        lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
        if not lines or lines[0] != key:
            lines = [key]
        for line in lines[1:]:
            try:
                question, content = json.loads(line)
            except ValueError:
                continue  # the interruption came in the middle of this line
            self._known[question] = _end_of(content)
        write_text(path, "\n".join([*lines, ""]))

    def __contains__(self, question: str) -> bool:
        """Whether a fit was made before."""
        return question in self._known

    def __getitem__(self, question: str) -> End | None:
        """The end point of an earlier fit; None if it met runs that cannot be simulated."""
        return self._known[question]

    def __setitem__(self, question: str, end: End | None) -> None:
        """Store the end point of a fit."""
        self._known[question] = end
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps([question, _content_of(end)]) + "\n")


def question_of(*conditions: object) -> str:
    """Hash of the start of a fit and of everything else on which its result depends."""
    return hashlib.sha256(json.dumps(_rounded(conditions), sort_keys=True).encode()).hexdigest()


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return f"{value:.{DIGITS}g}"
    if isinstance(value, Mapping):
        return {str(key): _rounded(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _rounded(value.tolist())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_rounded(item) for item in value]
    return value


def _content_of(end: End | None) -> list[Any] | None:
    if end is None:
        return None
    return [
        end.per_run.tolist(),
        dict(end.nominal),
        dict(end.terms),
        end.converged,
        end.steps,
        end.shortfall,
    ]


def _end_of(content: list[Any] | None) -> End | None:
    if content is None:
        return None
    per_run, nominal, terms, converged, steps, shortfall = content
    placed = {key: tuple(values) for key, values in terms.items()}
    return End(np.array(per_run), nominal, placed, converged, steps, shortfall)
