"""Kernels: functions compiled by numba and kept on disk, so that a second process does not compile.

numba notices a change of the file a kernel stands in, not of the files whose kernels it calls. Callees are decorated
before their callers, so a kernel is compiled anew where any file with kernels decorated so far is younger than it.
Processes that start at the same time share the work: each kernel is compiled by one of them, and read by the others.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar, cast

Function = TypeVar("Function", bound=Callable[..., Any])

# A kernel that is called with a number of the source text is compiled for this number, then for all; so it counts with
# numbers made by this function, for which it is compiled once.
counter = int

_youngest_source_s = 0.0
_sources: set[str] = set()
_held: set[str] = set()


def compiled(**options: Any) -> Callable[[Function], Function]:
    """Compile a function with numba.njit(cache=True, **options); the type of the function is kept.

    Division by zero gives infinity or NaN, as in numpy: one run out of thousands that leaves the model's range must not
    stop the others.
    """

    def decorate(function: Function) -> Function:
        from numba import njit

        kernel = njit(cache=True, error_model="numpy", **options)(function)
        if kernel is function:  # NUMBA_DISABLE_JIT: plain Python, to step through a kernel or to mutate it
            return function
        _forget_stale(function, kernel)
        _compile_alone(function.__code__.co_filename, kernel)
        return cast("Function", kernel)

    return decorate


def is_kept(kernel: Callable[..., Any]) -> bool:
    """Whether the kernel is on disk, compiled from the present source for whatever it was called with.

    With NUMBA_DISABLE_JIT there is nothing to compile, and nothing to wait for.
    """
    return not hasattr(kernel, "py_func") or any(_kept(kernel))


def _kept(kernel: Any) -> Iterator[Path]:
    function = kernel.py_func
    stem = Path(function.__code__.co_filename).stem
    return Path(kernel.stats.cache_path).glob(f"{stem}.{function.__qualname__}-*.nbi")


def _forget_stale(function: Callable[..., Any], kernel: Any) -> None:
    global _youngest_source_s  # noqa: PLW0603  # one clock for all kernels of the process
    source = function.__code__.co_filename
    if source not in _sources and Path(source).exists():
        _sources.add(source)
        _youngest_source_s = max(_youngest_source_s, Path(source).stat().st_mtime)
    for index in _kept(kernel):
        with suppress(FileNotFoundError):  # another process that starts at the same time may be first
            if index.stat().st_mtime < _youngest_source_s:
                index.unlink()


def _compile_alone(source: str, kernel: Any) -> None:
    """Let the kernel be compiled, or read from disk, by one process at a time."""
    from numba.core.compiler_lock import global_compiler_lock

    compile_now = kernel.compile

    def compile_alone(signature: Any) -> Any:
        with global_compiler_lock, _alone(source):
            return compile_now(signature)

    kernel.compile = compile_alone


@contextmanager
def _alone(source: str) -> Iterator[None]:
    """Hold the lock of a source file, where the system has such locks: no other process compiles its kernels.

    Kernels call those of files imported before theirs, so that processes never wait for each other in a circle.
    """
    if source in _held or sys.platform == "win32":
        yield
        return
    import fcntl

    try:
        held = Path(source).open("rb")  # noqa: SIM115  # closed below; a file that cannot be opened locks nothing
    except OSError:
        yield
        return
    with held:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(held, fcntl.LOCK_EX)
        _held.add(source)
        try:
            yield
        finally:
            _held.discard(source)
