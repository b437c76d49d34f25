"""Kernels: functions compiled by numba and cached on disk, so that later processes do not compile.

All packages compile their kernels here. The cache of the user is keyed by the text of the sources, so a new
installation of the same version compiles nothing, and a changed callee recompiles its callers. If several processes
start at once, each kernel is compiled by one of them and read by the others.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

Function = TypeVar("Function", bound=Callable[..., Any])

# numba compiles a kernel that is called with a literal number twice: for this literal, then for all numbers. A number
# from this function is not a literal.
counter = int


def compiled(**options: Any) -> Callable[[Function], Function]:
    """Compile a function with numba.njit(**options) and cache it on disk; its static type does not change.

    A kernel called by another one is compiled as a part of it and optimised only there.

    Division by zero gives infinity or NaN, as in numpy, so that one run out of thousands that leaves the range of the
    model does not stop the others.
    """

    def decorate(function: Function) -> Function:
        from numba import njit

        from calibration.compilation.cache import keep_on_disk
        from calibration.compilation.parts import call_as_part

        # No wrapper for C: kernels are called from Python and from other kernels only. numba gives forceinline and
        # fastmath of a kernel to all that it calls, unless they refuse: they would be written out at each of their
        # calls, and what they round would depend on who called them first.
        wanted = {"error_model": "numpy", "no_cfunc_wrapper": True, "forceinline": False, "fastmath": False, **options}
        kernel = njit(**wanted)(function)
        if kernel is function:  # NUMBA_DISABLE_JIT: plain Python, to step through a kernel or to mutate it
            return function
        keep_on_disk(kernel)
        call_as_part(kernel, wanted)
        return cast("Function", kernel)

    return decorate


def is_cached(kernel: Callable[..., Any]) -> bool:
    """Whether the kernel is on disk, compiled from the present sources for some types of arguments.

    True with NUMBA_DISABLE_JIT, where nothing is compiled.
    """
    from calibration.compilation.cache import is_on_disk

    return not hasattr(kernel, "py_func") or is_on_disk(kernel)
