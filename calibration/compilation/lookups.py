"""Faster look-ups of numba's compiler, which spends most of its time in Python, and no wrappers that nothing calls.

numba finds the implementation of every call in a kernel by trying all candidates, some forty for an addition, each time
with all options of the compiler compared one by one. A kernel has thousands of calls with a few hundred combinations of
argument types. It also wraps each of its own functions that a kernel calls, such as max, for callers in C: half of the
code of these. The kernels do not change.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from numba.core.lowering import BaseLower
from numba.core.targetconfig import ConfigStack, TargetConfig
from numba.core.types.functions import BaseFunction

_resolve, _equal, _wrap = BaseFunction.get_call_type, TargetConfig.__eq__, BaseLower.create_cfunc_wrapper
_known: dict[Any, Any] = {}  # results of _resolve, some hundreds


@contextmanager
def fast_lookups() -> Iterator[None]:
    """Compile without looking up a call twice and without wrappers for C; the caller holds numba's compiler lock.

    May be nested.
    """
    if BaseFunction.get_call_type is not _resolve:
        yield
        return
    hashed = TargetConfig.__hash__
    BaseFunction.get_call_type = _resolve_once
    TargetConfig.__hash__, TargetConfig.__eq__ = _hash_of_names, _equal_values
    BaseLower.create_cfunc_wrapper = _no_wrapper
    try:
        yield
    finally:
        BaseFunction.get_call_type = _resolve
        TargetConfig.__hash__, TargetConfig.__eq__ = hashed, _equal
        BaseLower.create_cfunc_wrapper = _wrap


def _resolve_once(function: Any, context: Any, args: Any, kws: Any) -> Any:
    """BaseFunction.get_call_type, once for each function, types of arguments and options of the compiler."""
    options = ConfigStack.top_or_none()
    key = id(function), context, tuple(args), tuple(kws.items()), options
    if key not in _known:
        found = _resolve(function, context, args, kws)  # an error is raised again by each call
        # Options may change later. The function is kept alive, so that no other one gets its id.
        _known[(*key[:-1], options and options.copy())] = function, found
        return found
    return _known[key][1]


def _no_wrapper(lowering: Any) -> None:
    """Nothing in place of BaseLower.create_cfunc_wrapper."""


def _hash_of_names(options: Any) -> int:
    """Hash of options as numba computes it, from their names only."""
    kind: type[TargetConfig] = type(options)
    return _hash(kind)


@cache
def _hash(kind: Any) -> int:
    return hash(tuple(sorted(kind.options)))


def _equal_values(one: Any, other: Any) -> Any:
    """Whether options are equal; those that are set are compared first, and only if they differ also the defaults."""
    return (type(one) is type(other) and one._values == other._values) or _equal(one, other)  # noqa: SLF001
