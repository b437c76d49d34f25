"""The compiled kernels as a whole."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

from evaluator.tracking.refinement import kernels
from evaluator.tracking.refinement.disc import make_disc

MODULES = (
    "detection.color_kernels",
    "refinement.kernels",
    "refinement.motion_blur",
    "refinement.occluded_pixels",
    "refinement.occlusion",
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


def fitted(columns: int, *, sloping: bool = False) -> np.ndarray:
    """Fit a disc of 6 px radius whose centre lies 3 px inside the right border of the frame, or in the middle."""
    disc, (j, i) = make_disc(6.0, 0.8, (0.05, -0.02), (100.0, 30.0), 1.0), np.indices((41, columns))
    r = np.sqrt(1.05 * (i - 20.0) ** 2 - 0.04 * (i - 20.0) * (j - 21.0) + 0.95 * (j - 21.0) ** 2)
    luma = np.round(30.0 + 100.0 * np.interp(r, np.arange(len(disc.profile)) / 32, disc.profile)).astype(np.uint8)
    result, start = np.zeros(kernels.RESULTS), np.array([20.3, 20.8, 90.0, 35.0])
    kernels.fit_disc(luma, 0, 1, start, sloping, disc.numbers(), disc.table, np.array([1.0, 4.0]), result)
    return result


def test_share_of_a_mark_inside_the_frame_is_of_the_pixels_that_it_has_elsewhere() -> None:
    whole, cut = fitted(41), fitted(24)
    assert whole[[kernels.X, kernels.Y]] == pytest.approx([20.0, 21.0], abs=0.02)
    assert cut[[kernels.X, kernels.Y]] == pytest.approx([20.0, 21.0], abs=0.05)
    assert whole[[kernels.AMPLITUDE, kernels.BASE]] == pytest.approx([100.0, 30.0], abs=0.5)
    assert whole[kernels.INSIDE] == 1.0
    assert cut[kernels.INSIDE] == pytest.approx(cut[kernels.PIXELS] / whole[kernels.PIXELS], abs=1e-9)
    assert 0.5 < cut[kernels.INSIDE] < 0.9


def test_a_fit_with_slopes_takes_the_kernel_that_one_without_has_compiled() -> None:
    fitted(41)
    known = list(kernels._fit_disc.signatures)
    assert fitted(41, sloping=True)[[kernels.X, kernels.Y]] == pytest.approx([20.0, 21.0], abs=0.02)
    assert kernels._fit_disc.signatures == known
