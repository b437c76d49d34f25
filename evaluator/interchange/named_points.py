"""Named points over time, as read from files of other programs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NamedPoints:
    """time_s: (n,). points: (n, 2) by name, in the order and unit of the file; NaN where one is missing.

    unit: of length, as the file states it or its program always has it; None if there is none.
    """

    time_s: Array
    points: dict[str, Array]
    unit: str | None = None


class FileHints(Protocol):
    """Properties of a file that the user has to state."""

    @property
    def unit(self) -> str | None:
        """Of lengths."""
        ...

    @property
    def rate_hz(self) -> float | None:
        """Frames a second, of files that count frames."""
        ...

    @property
    def likelihood(self) -> float:
        """Points that are less likely count as missing."""
        ...
