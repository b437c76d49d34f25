"""Runs with the same recording, which counts once, with the command that its motion agrees with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.jump import rounding_mm
from evaluator.diagnosis.mistakes.recognised import Found

Floats = NDArray[np.float64]

FEWEST = 10  # frames with both marks: rounded values of fewer frames could agree by chance
FEWEST_UNITS = 20  # of rounding that a run moves by at least: of coarser values many agree
# Frames of a rounded copy that agree to half a unit, but for those that are outliers in one of them only. Another run
# that is off by a hundredth of the unit misses two of a hundred frames in four coordinates.
SAME_SHARE, ROUNDING = 0.99, 1e-6
SAME_UNIT = 0.01  # relative difference of two units of rounding up to which they are one


def copies(data: Sequence[RunData]) -> list[Found]:
    """Runs whose marks are those of an earlier run of the same command, frame for frame.

    A copy under another command is left to `contradicting_copies`: a simulation may show which command is wrong.
    Two recordings never agree to the last digit: noise differs. Times may be shifted: a copy may count from elsewhere.
    """
    found = []
    for runs in _same_marks(data):
        first: dict[object, str] = {}
        for run in runs:
            original = first.setdefault(_command(run), run.id)
            if original != run.id:
                words = f"has the same marks as {original}, frame for frame, and counts once"
                found.append(Found(run.id, "duplicate", words, "is it the right recording?"))
    return found


def contradicting_copies(data: Sequence[RunData], known: Sequence[Found]) -> list[Found]:
    """Runs with the same marks under several commands: those whose command the marks contradict, otherwise all.

    known: mistakes of runs. A run that contradicts its command is a copy of one that does not, and has no command of
    its own to be corrected. If all contradict theirs, they are not copies of a run in its place.
    """
    kinds = {item.run: item.kind for item in known}
    found = []
    for runs in _same_marks(data):
        once = [run for run in runs if kinds.get(run.id) != "duplicate"]
        if len({_command(run) for run in once}) < 2:
            continue
        right, wrong = ([run.id for run in once if (run.id in kinds) == bad] for bad in (False, True))
        if right and wrong:
            words = f"has the same marks as {right[0]}, frame for frame, but another command, which they contradict"
            remedy = "is it the right recording?"
            found += [Found(run, "duplicate", words, remedy, equivalent=(kinds[run],)) for run in wrong]
        elif right:
            words = "have the same marks, frame for frame, but different commands"
            remedy = "find out which command belongs to this recording, and remove the other run"
            found += [Found(run, "duplicate", words, remedy, group=tuple(right)) for run in right]
    return found


def _same_marks(data: Sequence[RunData]) -> list[list[RunData]]:
    """Runs with the same marks, where several have them, also if some are rounded."""
    alike: dict[bytes, list[RunData]] = {}
    for run in data:
        seen = _seen(run)
        if len(seen) >= FEWEST and np.ptp(seen, axis=0).any():
            alike.setdefault(seen.tobytes(), []).append(run)
    groups = list(alike.values())
    links = _rounded([runs[0] for runs in groups])
    _, label = connected_components(links, directed=False)
    joined: dict[int, list[RunData]] = {}
    for group, runs in zip(label.tolist(), groups, strict=True):
        joined.setdefault(group, []).extend(runs)
    order = {id(run): place for place, run in enumerate(data)}
    return [sorted(runs, key=lambda run: order[id(run)]) for runs in joined.values() if len(runs) > 1]


def _rounded(runs: Sequence[RunData]) -> coo_array:
    """Which of these runs (n, n) have the marks of another, rounded to fewer places.

    Two recordings that agree so well have other noise, of which some frames round to another place.
    """
    pairs: list[tuple[int, int]] = []
    of_length: dict[int, list[int]] = {}
    for place, run in enumerate(runs):
        of_length.setdefault(len(run.marks_mm), []).append(place)
    for places in of_length.values():
        if len(places) < 2:
            continue
        units = [rounding_mm(_seen(runs[place])) for place in places]
        if max(units) - min(units) <= SAME_UNIT * min(units):  # in one unit, copies agree to the last digit
            continue
        middles = np.array([np.nanmedian(runs[place].marks_mm, axis=0) for place in places])
        # half a unit in each of four coordinates, and what frames that differ may shift a median by
        way_mm = float(np.median([np.ptp(_seen(runs[place]), axis=0).max() for place in places]))
        near = cKDTree(middles).query_pairs(max(units) + (1 - SAME_SHARE) * way_mm)
        pairs += [
            (places[i], places[k])
            for i, k in near
            if abs(units[i] - units[k]) > SAME_UNIT * units[i]
            and (
                _is_rounded(runs[places[i]], runs[places[k]], units[k])
                or _is_rounded(runs[places[k]], runs[places[i]], units[i])
            )
        ]
    rows, columns = np.array(pairs, dtype=int).reshape(-1, 2).T
    return coo_array((np.ones(len(pairs)), (rows, columns)), shape=(len(runs), len(runs)))


def _is_rounded(run: RunData, copy: RunData, unit_mm: float) -> bool:
    """Whether a run of as many frames has the marks of another, rounded to a unit, which the other has not."""
    both = np.isfinite(run.marks_mm).all(axis=1) & np.isfinite(copy.marks_mm).all(axis=1)
    if np.count_nonzero(both) < FEWEST:
        return False
    marks, rounded = run.marks_mm[both], copy.marks_mm[both]
    within = (np.abs(marks - rounded) <= unit_mm / 2 * (1 + ROUNDING)).all(axis=1)
    if np.mean(within) < SAME_SHARE or np.ptp(marks, axis=0).max() < FEWEST_UNITS * unit_mm:
        return False
    return _are_multiples(rounded, unit_mm) and not _are_multiples(marks, unit_mm)


def _are_multiples(marks_mm: Floats, unit_mm: float) -> bool:
    """Whether all coordinates are multiples of a unit, to a hundredth of it."""
    return bool((np.abs(marks_mm / unit_mm - np.round(marks_mm / unit_mm)) < 0.01).all())


def _seen(run: RunData) -> Floats:
    return run.marks_mm[np.isfinite(run.marks_mm).all(axis=1)]


def _command(run: RunData) -> object:
    return tuple((stretch.left_rpm, stretch.right_rpm) for stretch in run.run_command.driven)
