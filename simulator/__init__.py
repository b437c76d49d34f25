"""Robot + slip law + effects → motion; scene → video.

The public names below are imported when they are first used, so that `import simulator` costs nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from simulator.command import Command
    from simulator.errors import SimulationError
    from simulator.observation import marks_of_run
    from simulator.robot import Robot, load_robot, shipped_robots
    from simulator.run import Run, State
    from simulator.simulation import simulate
    from simulator.steady import SteadyTurn, steady_turn

__all__ = [
    "Command",
    "Robot",
    "Run",
    "SimulationError",
    "State",
    "SteadyTurn",
    "load_robot",
    "marks_of_run",
    "shipped_robots",
    "simulate",
    "steady_turn",
]

_HOMES = {
    "simulator.command": ("Command",),
    "simulator.errors": ("SimulationError",),
    "simulator.simulation": ("simulate",),
    "simulator.observation": ("marks_of_run",),
    "simulator.robot": ("Robot", "load_robot", "shipped_robots"),
    "simulator.run": ("Run", "State"),
    "simulator.steady": ("SteadyTurn", "steady_turn"),
}


def __getattr__(name: str) -> object:
    """Import a public name from its home (PEP 562)."""
    from importlib import import_module

    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(home), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Public names, also those that are not imported yet."""
    return sorted(__all__)
