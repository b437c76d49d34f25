"""From poses to turning: steady turn, minimum sustained radius and speeds, with intervals.

Names of `__init__.pyi` are imported on first use, so that light uses do not import the fits.
"""

from __future__ import annotations

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
