"""From poses to turning: steady turn, smallest sustained radius, speeds, each with an interval that holds.

What stands in `__init__.pyi` is imported when it is first used: who needs the shape of a robot alone pays for no fit.
"""

from __future__ import annotations

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
