"""Runs of a report that are known by their rows alone and need no file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from evaluator.report.runs import RunView
from evaluator.workflow.results.outputs import Outputs


@dataclass(frozen=True)
class Shown(RunView):
    """A run with two marks that need no file."""

    @property
    def mark_names(self) -> tuple[str, ...]:
        """Both marks."""
        return ("green", "yellow")


def shown(run: str, left: float, right: float, compared: dict[str, Any] | None = None, **values: Any) -> Shown:
    """A run of a command with the numbers of its rows in comparison.csv (compared) and turning.csv (values)."""
    row = {"left_rpm": left, "right_rpm": right, **values}
    return Shown(run, "", row, compared or {}, Outputs(Path("nowhere")))


def turned(
    run: str, radius: float, off: float = 0.0, simulated: float = 0.0, half: float = 0.1, **values: Any
) -> Shown:
    """A turn of a radius within half a millimetre or so; off, simulated: what comparison.csv holds."""
    compared = {"radius_difference_percent": off, "simulated_radius_mm": simulated}
    bounds = {"radius_mm": radius, "radius_low_mm": radius - half, "radius_high_mm": radius + half}
    return shown(run, 30.0, 20.0, compared, **{"turned_deg": 90.0, **bounds, **values})


def undrawn(monkeypatch: pytest.MonkeyPatch, *modules: ModuleType) -> list[MagicMock]:
    """Let figures of some modules be drawn on axes that only note what they are asked for; gives these axes."""
    used: list[MagicMock] = []

    @contextmanager
    def drawing(*_: object, **__: object) -> Iterator[MagicMock]:
        axes = MagicMock()
        axes.get_ylim.return_value = axes.get_xlim.return_value = (1.0, 2.0)
        used.append(axes)
        canvas = MagicMock(axes=(axes,), svg="<svg/>")
        yield canvas

    for module in modules:
        monkeypatch.setattr(module, "drawing", drawing)
    return used


def lines(axes: MagicMock) -> list[tuple[list[float], list[float]]]:
    """Coordinates of all lines and points, in the order in which they are drawn."""
    return [tuple(np.ravel(part).tolist() for part in call.args[:2]) for call in axes.plot.call_args_list]  # type: ignore[misc]


def labels(axes: MagicMock) -> tuple[str, str]:
    """Words at both axes."""
    return axes.set_xlabel.call_args.args[0], axes.set_ylabel.call_args.args[0]


def limits(axes: MagicMock) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Bounds of both axes."""
    return axes.set_xlim.call_args.args, axes.set_ylim.call_args.args
