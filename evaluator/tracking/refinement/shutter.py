"""Share of the frame interval for which the shutter is open, from the residuals of a fit at several shares."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

# Shares that are tried: within a step of the true share, the residual is a parabola.
SHARES, STEP = (0.1, 0.3, 0.5, 0.7, 0.9, 1.1), 0.2
SHARE_SIGMA = STEP * 12**-0.5  # standard uncertainty of the result: uniform over one step
UNKNOWN = (0.5, 12**-0.5)  # a share of which nothing is known, and its standard uncertainty: uniform from 0 to 1


def best_share(residual: Callable[[float], float]) -> float:
    """Share with the smallest residual, by a parabola through the three lowest; at most 1.

    residual: of a fit with a share; NaN where it failed.
    """
    tried = np.nan_to_num([residual(share) for share in SHARES], nan=np.inf)
    k = int(np.argmin(tried))
    best = SHARES[k]
    if 0 < k < len(SHARES) - 1 and np.isfinite(tried[k - 1 : k + 2]).all():
        below, least, above = tried[k - 1 : k + 2]
        best += STEP * 0.5 * (below - above) / max(below - 2.0 * least + above, 1e-9)
    return min(float(best), 1.0)
