"""What a file of another program holds: named points over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NamedPoints:
    """time_s: (n,). points: (n, 2) by name, in the order and unit of the file; NaN where one is missing."""

    time_s: Array
    points: dict[str, Array]


class Said(Protocol):
    """What a user says of a file because the file does not."""

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
