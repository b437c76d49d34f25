"""Functions for all front ends: analysis, comparison, diagnosis, simulation, calibration, rendering.

Each takes paths or values, reports to a Progress that may cancel it, and never leaves incomplete files. Results of an
experiment are computed in parallel and reused while they are up to date. `__init__.pyi` lists the functions and the
files that define them; each is imported on first use.
"""

from __future__ import annotations

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
