"""Kernels of the simulator: see calibration.compilation, which compiles those of all packages."""

from calibration.compilation import compiled, counter, is_kept

__all__ = ["compiled", "counter", "is_kept"]
