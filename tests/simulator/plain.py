"""The kernels as plain Python: what the compiler is given, without waiting for it, so that any change shows at once."""

from __future__ import annotations

import sys
from functools import cache
from importlib import import_module
from types import ModuleType

import numba

import simulator.dynamics
import simulator.integrator
import simulator.slip

# In the order of their imports, so that none imports a compiled one.
KERNELS = (
    *("simulator.slip.magic_formula", "simulator.slip.law"),
    *(f"simulator.dynamics.{name}" for name in ("bases", "body", "wheel", "axles", "contact", "equations", "motors")),
    *(f"simulator.integrator.{name}" for name in ("workspace", "rosenbrock", "stability", "implicit_euler")),
    *(
        f"simulator.integrator.{name}"
        for name in ("step_control", "slow_manifold", "collocation", "run_kernel", "balance")
    ),
)


@cache
def plain(name: str) -> ModuleType:
    """A module of KERNELS by the last part of its name, whose functions are not compiled."""
    return _all()[name]


@cache
def _all() -> dict[str, ModuleType]:
    rooms = simulator.slip, simulator.dynamics, simulator.integrator
    packages: dict[str, ModuleType] = {room.__name__.rpartition(".")[2]: room for room in rooms}
    held = {name: sys.modules.pop(name) for name in KERNELS if name in sys.modules}
    off, numba.config.DISABLE_JIT = numba.config.DISABLE_JIT, True
    try:
        return {name.rpartition(".")[2]: import_module(name) for name in KERNELS}
    finally:
        numba.config.DISABLE_JIT = off
        for name in KERNELS:
            _, package, last = name.split(".")
            sys.modules.pop(name, None)
            vars(packages[package]).pop(last, None)
            if name in held:
                sys.modules[name] = held[name]
                setattr(packages[package], last, held[name])
