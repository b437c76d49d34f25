"""Compilation of the simulator's kernels, by calibration.compilation."""

from calibration.compilation import compiled, counter, is_cached

__all__ = ["compiled", "counter", "is_cached"]
