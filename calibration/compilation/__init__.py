"""Kernels: functions compiled by numba and cached on disk, so that later processes do not compile.

All packages compile their kernels here. The cache of the user is keyed by the text of the sources, so a new
installation of the same version compiles nothing, and a changed callee recompiles its callers. If several processes
start at once, each kernel is compiled by one of them and read by the others.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

Function = TypeVar("Function", bound=Callable[..., Any])

# A kernel that is called with a number of the source text is compiled for this number, then for all; so it counts with
# numbers made by this function, for which it is compiled once.
counter = int


def compiled(*, shared: bool = False, **options: Any) -> Callable[[Function], Function]:
    """Compile a function with numba.njit(**options) and keep it on disk; the type of the function is kept.

    A kernel that another calls becomes a part of it, optimised there and nowhere else. shared: it is compiled and kept
    on its own and then linked, which pays for a large kernel that several others call, or Python as well.

    Division by zero gives infinity or NaN, as in numpy: one run out of thousands that leaves the model's range must not
    stop the others.
    """

    def decorate(function: Function) -> Function:
        from numba import njit

        from calibration.compilation.cache import keep_on_disk
        from calibration.compilation.parts import call_as_part

        # No wrapper for C: only Python and other kernels call.
        wanted = {"error_model": "numpy", "no_cfunc_wrapper": True, **options}
        kernel = njit(**wanted)(function)
        if kernel is function:  # NUMBA_DISABLE_JIT: plain Python, to step through a kernel or to mutate it
            return function
        keep_on_disk(kernel)
        if not shared:
            call_as_part(kernel, wanted)
        return cast("Function", kernel)

    return decorate


def is_kept(kernel: Callable[..., Any]) -> bool:
    """Whether the kernel is on disk, compiled from the present sources for whatever it was called with.

    With NUMBA_DISABLE_JIT there is nothing to compile, and nothing to wait for.
    """
    from calibration.compilation.cache import kept

    return not hasattr(kernel, "py_func") or kept(kernel)
