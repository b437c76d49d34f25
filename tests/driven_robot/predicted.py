"""Predictions of the corrected model with bands, the form of what it still leaves chosen within the fitted windows.

Physics explains most, and a part that depends on the commands in ways nobody modelled remains: the discrepancy of
Kennedy & O'Hagan (2001), J. R. Stat. Soc. B 63, 425. A third of the fitted steps, by whole steps, is left out of a
first fit. These windows choose the form of the discrepancy, and their errors are the bands (split conformal
prediction: Lei et al. (2018), JASA 113, 1094). The model is then fitted to all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.driven_robot.corrected import STARTS, Corrected, Model, fit
from tests.driven_robot.drive import FOLDS, Drive
from tests.driven_robot.peers import SIGMAS, misfit, robust, with_process, wrapped

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
COVERED = 0.95
FORMS = ("nothing", "the commands", "the commands and the turns of the model")


@dataclass(frozen=True)
class Predicted:
    """Last poses (n, 3), m and rad, of all windows, with half-widths (n, 3) of their 95 % bands.

    by_physics: (n, 3) without the discrepancy; depends_on: of the discrepancy, one of FORMS; corrected: the numbers.
    """

    pose: Array
    half_width: Array
    by_physics: Array
    depends_on: str
    corrected: Corrected


def predicted(model: Model, fitted: Flags, starts: int = STARTS) -> Predicted:
    """Predict every window from what the fitted ones (n,) tell; nothing of the others is looked at.

    starts: of each of the two fits.
    """
    drive = model.drive
    judged = fitted & (_order_of_steps(drive, fitted) % FOLDS == 0)
    tried = _by_forms(model, fitted & ~judged, starts)[1]
    costs = {form: robust(misfit(pose, drive)[judged]) for form, pose in tried.items()}
    form = min(costs, key=lambda name: costs[name])
    scatter = _scatter(tried[form][judged], drive.pose[judged, -1])
    corrected, final = _by_forms(model, fitted, starts, form)
    return Predicted(final[form], scatter * widths(final[form]), final[FORMS[0]], form, corrected)


def _by_forms(model: Model, fitted: Flags, starts: int, *only: str) -> tuple[Corrected, dict[str, Array]]:
    """The fitted model, and last poses (n, 3) of all windows by it with every form of discrepancy, or some."""
    drive = model.drive
    corrected = fit(model, np.flatnonzero(fitted), starts)
    poses = model.poses(corrected.values, np.arange(len(drive)))
    last, middle = poses[:, -1], poses[:, poses.shape[1] // 2]
    turns = np.column_stack([middle[:, 2], last[:, 2] - middle[:, 2]])
    found = {FORMS[0]: last}
    for form, more in zip(FORMS[1:], (None, turns), strict=True):
        if not only or form in only:
            found[form] = with_process(last, drive, fitted, more)
    return corrected, found


def _order_of_steps(drive: Drive, fitted: Flags) -> NDArray[np.int64]:
    """Rank (n,) of every window's step among the fitted steps; of others nothing that counts."""
    return np.asarray(np.searchsorted(np.unique(drive.step[fitted]), drive.step))


def _scatter(pose: Array, measured: Array) -> Array:
    """Half-widths (3,) that hold COVERED of windows that were not fitted, in units of widths()."""
    off = np.abs(pose - measured)
    off[:, 2] = np.abs(wrapped(off[:, 2]))
    # As many parts as a new window would need: the rank of order statistics of one more.
    rank = min(COVERED * (len(off) + 1) / len(off), 1.0)
    return np.asarray(np.nanquantile(off / widths(pose), rank, axis=0))


def widths(pose: Array) -> Array:
    """How the error of a prediction (n, 3) may be expected to grow, (n, 3) in m, m, rad: with the way and the turn."""
    way, turn = np.hypot(pose[:, 0], pose[:, 1]), np.abs(pose[:, 2])
    place = SIGMAS[0] * (0.5 + way)
    return np.stack([place, place, SIGMAS[2] * (0.5 + turn)], axis=1)
