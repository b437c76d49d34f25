"""Everything that a front end does, as functions: analysis, comparison, diagnosis, simulation, calibration, rendering.

Each takes paths or values, reports to a Progress that may cancel it, and leaves whole files. What an experiment needs
is computed in parallel and reused while it is up to date. `__init__.pyi` lists the functions and the files that define
them; each is imported when it is first used.
"""

from __future__ import annotations

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
