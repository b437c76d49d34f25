"""Look-ups of numba's compiler are faster while kernels compile, with the same results."""

import pytest
from numba import njit
from numba.core.lowering import BaseLower
from numba.core.targetconfig import TargetConfig
from numba.core.types.functions import BaseFunction

from calibration.compilation import lookups
from calibration.compilation.lookups import fast_lookups


def twice(x: float) -> float:
    return x * x + x * x - max(x, 2.0) * x


def test_a_call_is_looked_up_once_for_each_types_of_arguments(monkeypatch: pytest.MonkeyPatch) -> None:
    njit(twice)(3.0)  # compiles what numba keeps, such as its own max
    asked, resolve = [], BaseFunction.get_call_type

    def counted(function: object, context: object, args: tuple[object, ...], kws: object) -> object:
        asked.append((function, tuple(args)))
        return resolve(function, context, args, kws)

    monkeypatch.setattr(BaseFunction, "get_call_type", counted)
    monkeypatch.setattr(lookups, "_resolve", counted)
    monkeypatch.setattr(lookups, "_known", {})
    assert njit(twice)(3.0) == 9.0
    usually = asked.copy()
    asked.clear()
    with fast_lookups():
        assert njit(twice)(3.0) == 9.0
    assert len(usually) > len(set(usually))
    assert sorted(map(str, asked)) == sorted(map(str, set(usually)))


def test_options_are_equal_and_hashed_as_usually() -> None:
    from numba.core.compiler import Flags

    one, same, other = Flags(), Flags(), Flags()
    same.nrt = False  # its default
    other.nrt = True
    usually = hash(one), hash(other), one == same, one == other
    with fast_lookups():
        assert (hash(one), hash(other), one == same, one == other) == usually == (hash(one), hash(one), True, False)


def test_numba_is_left_as_it_was() -> None:
    before = BaseFunction.get_call_type, TargetConfig.__hash__, TargetConfig.__eq__, BaseLower.create_cfunc_wrapper
    with pytest.raises(ZeroDivisionError), fast_lookups(), fast_lookups():
        raise ZeroDivisionError
    after = BaseFunction.get_call_type, TargetConfig.__hash__, TargetConfig.__eq__, BaseLower.create_cfunc_wrapper
    assert after == before


def test_what_numba_brings_has_no_wrapper_for_c() -> None:
    def largest(x: float) -> float:
        return max(x, 2.0, 5.0)

    with fast_lookups():
        kernel = njit(no_cfunc_wrapper=True)(largest)
        assert kernel(3.0) == 5.0
    linked = kernel.overloads[kernel.signatures[0]].library._linking_libraries
    assert linked
    assert not any("cfunc." in library.get_llvm_str() for library in linked)
