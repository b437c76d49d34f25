"""Kernels: functions compiled by numba and kept on disk, so that a second process does not compile.

numba notices a change of the file a kernel stands in, not of the files whose kernels it calls. Callees are decorated
before their callers, so a kernel is compiled anew where any file with kernels decorated so far is younger than it.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, cast

Function = TypeVar("Function", bound=Callable[..., Any])

_youngest_source_s = 0.0
_sources: set[str] = set()


def compiled(**options: Any) -> Callable[[Function], Function]:
    """Compile a function with numba.njit(cache=True, **options); the type of the function is kept.

    Division by zero gives infinity or NaN, as in numpy: one run out of thousands that leaves the model's range must not
    stop the others.
    """

    def decorate(function: Function) -> Function:
        from numba import njit

        kernel = njit(cache=True, error_model="numpy", **options)(function)
        _forget_stale(function, kernel)
        return cast("Function", kernel)

    return decorate


def _forget_stale(function: Callable[..., Any], kernel: Any) -> None:
    global _youngest_source_s  # noqa: PLW0603  # one clock for all kernels of the process
    source = function.__code__.co_filename
    if source not in _sources and Path(source).exists():
        _sources.add(source)
        _youngest_source_s = max(_youngest_source_s, Path(source).stat().st_mtime)
    pattern = f"{Path(source).stem}.{function.__qualname__}-*.nbi"
    for index in Path(kernel.stats.cache_path).glob(pattern):
        with suppress(FileNotFoundError):  # another process that starts at the same time may be first
            if index.stat().st_mtime < _youngest_source_s:
                index.unlink()
