"""Video → marks → pose → turning → comparison → diagnosis → report; the command line.

`__init__.pyi` lists the public names; each is imported when it is first used, so that `import evaluator` costs nothing.
"""

from __future__ import annotations

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
