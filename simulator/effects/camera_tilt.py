"""Keystone: measured coordinates are the true ones (x, y) times 1 + per_mm_x·x + per_mm_y·y."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.effects.view import View


def _view(view: View, values: Values) -> None:
    x, y = view.keystone_per_mm
    view.keystone_per_mm = (x + values["per_mm_x"], y + values["per_mm_y"])


EFFECT = Effect(
    id="camera-tilt",
    name="scale changes across the picture",
    kind="observation",
    where="observation",
    depends="place",
    pattern="common",
    parameters=(
        Parameter("per_mm_x", "1/mm", 0.0, -0.005, 0.005, 5e-05),
        Parameter("per_mm_y", "1/mm", 0.0, -0.005, 0.005, 5e-05),
    ),
    view=_view,
)
