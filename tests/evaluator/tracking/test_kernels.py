"""The compiled kernels as a whole."""

from __future__ import annotations

import importlib

import pytest
from numba.core.dispatcher import Dispatcher

MODULES = (
    "detection.color_kernels",
    "refinement.fast_path",
    "refinement.kernels",
    "refinement.motion_blur",
    "refinement.occluded_pixels",
    "refinement.occlusion",
    "refinement.shape_kernel",
    "uncertainty.rim",
)


@pytest.mark.parametrize("name", MODULES)
def test_what_kernels_call_is_compiled_into_them_so_that_the_cache_changes_no_result(name: str) -> None:
    module = importlib.import_module(f"evaluator.tracking.{name}")
    kernels = [value for value in vars(module).values() if isinstance(value, Dispatcher)]
    assert kernels
    for kernel in kernels:
        known = kernel.py_func.__globals__
        called = [known.get(word) for word in kernel.py_func.__code__.co_names]
        for other in called:
            if isinstance(other, Dispatcher):
                options = other.targetoptions
                assert options.get("forceinline") or options.get("inline") == "always", (
                    f"{kernel.py_func.__name__} calls {other.py_func.__name__} through a symbol"
                )
