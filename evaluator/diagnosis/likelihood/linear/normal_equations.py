"""Normal equations of many models at once, one for each scatter of a grid.

The evidence of a model needs only the decrease of its sum of squares and one determinant. Both result from one
elimination of the normal equations bordered by their right-hand side, with a fifth of the work of solving them; most
scatters are so improbable that nothing else of them is needed.
Source: Golub & Van Loan (2013), Matrix Computations, 4th ed., 4.1 (LDLᵀ); Siegel (1965), Commun. ACM 8, 59 (bordering).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.compilation import compiled

Floats = NDArray[np.float64]

LITTLE = 1e-12  # of the diagonal: regularization of equivalent columns


def normal_matrices(G: Floats, prior: Floats) -> Floats:
    """Normal matrices (t, k, k) from inner products G (t, k, k) and prior precisions (k,), slightly regularized.

    Regularization is relative to each column, because units differ: for a robot of a metre, one may be a moment in
    µN·mm with values of 10¹⁰, another the inverse of a speed.
    """
    H = G + np.diag(prior)
    own = np.diagonal(H, axis1=1, axis2=2)
    return np.asarray(H + (LITTLE * np.where(own > 0, own, 1.0))[:, None, :] * np.eye(len(prior)))


def solved(H: Floats, right: Floats) -> Floats:
    """Solutions (t, k, m) of normal equations (t, k, k), (t, k, m), whatever the units of their unknowns."""
    scale = np.sqrt(np.diagonal(H, axis1=1, axis2=2))[..., None]
    return np.asarray(np.linalg.solve(H / (scale * scale.transpose(0, 2, 1)), right / scale) / scale)


def explained(H: Floats, right: Floats, known: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Decrease of -2 log likelihood by the solutions of normal equations H (t, k, k), right (t, k); log determinants.

    The determinants (t,) are those of the known columns (k,) alone.
    """
    gain, log_det = np.zeros(len(H)), np.zeros(len(H))
    order = np.argsort(~known, kind="stable")
    _eliminate(np.ascontiguousarray(H), np.ascontiguousarray(right), order, int(known.sum()), gain, log_det)
    return gain, log_det


@compiled(nogil=True)
def _eliminate(H: Floats, right: Floats, order: NDArray[np.int64], first: int, gain: Floats, log_det: Floats) -> None:
    size = len(order)
    upper, border, scale = np.empty((size, size)), np.empty(size), np.empty(size)
    for t in range(len(H)):
        for i in range(size):
            scale[i] = np.sqrt(H[t, order[i], order[i]])
            border[i] = right[t, order[i]] / scale[i]
            for j in range(i + 1):
                upper[j, i] = H[t, order[j], order[i]] / (scale[j] * scale[i])
        for i in range(size):
            pivot = upper[i, i]
            gain[t] += border[i] ** 2 / pivot
            if i < first:
                log_det[t] += np.log(np.abs(pivot)) + 2 * np.log(scale[i])
            for j in range(i + 1, size):
                share = upper[i, j] / pivot
                border[j] -= share * border[i]
                for c in range(j, size):
                    upper[j, c] -= share * upper[i, c]
