"""Gauge images → camera model with uncertainty: pixels become millimetres on a plane above the plate.

`__init__.pyi` lists the public names. Each is imported when it is first used, so that `import calibration` costs
nothing.
"""

from __future__ import annotations

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
