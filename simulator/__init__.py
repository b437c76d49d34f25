"""Robot + slip law + effects → motion; scene → video.

`__init__.pyi` lists the public names; each is imported when it is first used, so that `import simulator` costs nothing.
"""

from __future__ import annotations

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
