"""Kernels that are compiled into their callers.

numba makes a library of every kernel: it links all callees, optimises the whole, generates machine code, and adds
wrappers for Python and C. A function three calls down is therefore copied, optimised and generated four times. A part
is only typed and lowered; it is linked and optimised within the kernel that Python calls.

This uses internals of numba: its documented compiler pipeline, and the class of its code libraries.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from numba import _dynfunc, njit
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler


class _OptimizedLibrary(JITCodeLibrary):  # type: ignore[misc, unused-ignore]  # numba is untyped
    """Code of a part and its callees, never run by itself."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _LoweredLibrary(_OptimizedLibrary):
    """Code of a part after lowering, neither optimised nor linked to its callees."""

    def finalize(self) -> None:
        """Do not link callees: whoever calls the part links them, each once."""
        self._raise_if_finalized()
        self._finalize_final_module()

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout  # noqa: SLF001


class _PartCompiler(Compiler):  # type: ignore[misc, unused-ignore]
    """numba's pipeline, ending with code that can be linked."""

    def __init__(
        self, typing: Any, target: Any, library: Any, args: Any, returned: Any, flags: Any, *rest: Any
    ) -> None:
        flags = flags.copy()
        flags.no_compile = True
        # Functions that allow sums in any order are optimised here, so that the order does not depend on the caller.
        kind = _OptimizedLibrary if flags.fastmath else _LoweredLibrary
        library = kind(target.codegen(), "part")
        super().__init__(typing, target, library, args, returned, flags, *rest)

    def compile_extra(self, func: Any) -> Any:
        """Compile, and register the code with numba under a key in place of an address."""
        result = super().compile_extra(func)
        module, library = result.fndesc.lookup_module(), result.library
        key = _dynfunc.make_function(module, "part", "", 0, result.environment, (library,))
        # Callees follow their callers, as the linker drops functions that nothing before them calls.
        callees = library._linking_libraries if isinstance(library, _LoweredLibrary) else []  # noqa: SLF001
        self.state.targetctx.insert_user_function(key, result.fndesc, [library, *dict.fromkeys(callees)])
        return result._replace(entry_point=key)


def call_as_part(kernel: Any, options: dict[str, Any]) -> None:
    """Make other kernels include this one as a part; calls from Python do not change."""

    @cache
    def part() -> Any:
        return njit(pipeline_class=_PartCompiler, **{**options, "no_cpython_wrapper": True})(kernel.py_func)

    kernel.get_call_template = lambda args, kws: part().get_call_template(args, kws)
    kernel.get_overload = lambda sig: part().get_overload(sig)
