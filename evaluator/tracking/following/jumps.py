"""Impossible jumps of a mark, from codec residue or a wrong object.

A codec that saves bits skips blocks: the image of a mark then stands still while the robot drives on, and jumps when
the block is coded again; or a faded copy remains and is found now and then. Each single frame looks valid, but a body
does not jump. A track is cut at jumps and at standstills beside jumps. Of all sequences of pieces that one body can
have passed through, the one with the most frames is accepted.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evaluator.tracking.observation import OFF_COURSE
from evaluator.wording import counted

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

AROUND = 10  # steps on either side that determine the usual step
# A step is a jump if it is longer than FASTER usual steps plus SHARE of the mark's radius: a mark that stands still for
# two frames and then catches up makes a step of three usual ones.
FASTER, SHARE, LEAST_PX = 1.8, 0.35, 1.5
STILL, MOVING_PX = 0.25, 0.5  # of the usual step: largest step at a standstill; least usual step that shows motion
# Frames by which a path must be longer for each jump in it: it then follows a robot that was carried elsewhere, but not
# a residue of half a second. If some pieces move, pieces at rest count by a third, and all together at most half a
# jump, because residue is at rest.
JUMP, STANDING = 15.0, 1.0 / 3.0
OFTEN = 0.1  # of the frames: residue of a codec is mistaken for a mark in fewer


def astray_note(marks: pd.DataFrame) -> str:
    """A sentence on marks of a tracked recording that are often off their course; empty without any."""
    counts = {
        str(name).removesuffix("_status"): int((marks[name] == OFF_COURSE).sum())
        for name in marks
        if str(name).endswith("_status")
    }
    said = [
        f"{name} in {off} of {counted(len(marks), 'frame')}" for name, off in counts.items() if off > OFTEN * len(marks)
    ]
    if not said:
        return ""
    return (
        f"off its course: {', '.join(said)}; what is tracked, there or in the other frames, is then not the mark but "
        "something of its colour, such as dust: look at --overlay, and state diameter_px and region_px in [mark.NAME] "
        "of a tracking.toml (--settings)"
    )


def off_course(time_s: Array, centers_px: Array, radius_px: float) -> NDArray[np.bool_]:
    """Frames in which a mark is at a position that it cannot have reached; (n,).

    time_s: (n,). centers_px: (n, 2), NaN where absent. radius_px: of the mark.
    """
    wrong = np.zeros(len(time_s), bool)
    seen = np.flatnonzero(np.isfinite(centers_px).all(axis=1))
    if len(seen) < 4:
        return wrong
    lapse = np.maximum(np.diff(time_s[seen]) / float(np.median(np.diff(time_s))), 0.5)
    steps = np.hypot(*np.diff(centers_px[seen], axis=0).T) / lapse  # px in an interval
    room = max(SHARE * radius_px, LEAST_PX)
    far = steps * lapse > room + FASTER * float(np.median(steps)) * lapse
    if not far.any():
        return wrong  # the case of nearly all tracks
    usual = _usual(steps, room)
    jumps = steps * lapse > room + FASTER * usual * lapse
    if not jumps.any():
        return wrong
    still = (steps < STILL * usual) & (usual > MOVING_PX)
    pieces = _pieces(jumps, still)
    kept = _likeliest(pieces, time_s[seen], centers_px[seen], usual / float(np.median(np.diff(time_s))), room)
    for k, piece in enumerate(pieces):
        if k not in kept:
            wrong[seen[piece]] = True
    return wrong


def _usual(steps: Array, room: float) -> Array:
    """Usual step around each step: the larger of the medians of the moving steps before and after it; (n,)."""
    padded = np.pad(steps, AROUND, constant_values=np.nan)
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * AROUND + 1)
    usual = np.zeros_like(steps)
    for side in (around[:, :AROUND], around[:, AROUND + 1 :]):
        typical, most = _ranked(side, 0.5), _ranked(side, 0.8)
        # Residue rests for long, so that its zero steps must not count; neither must jumps.
        with np.errstate(invalid="ignore"):
            moving = (side > STILL * most[:, None]) & (side < 3.0 * typical[:, None] + 2.0 * room)
        of_moving = _ranked(np.where(moving, side, np.nan), 0.5)
        usual = np.fmax(usual, np.where(moving.sum(axis=1) >= 2, of_moving, typical))
    return usual


def _ranked(rows: Array, share: float) -> Array:
    """Quantile `share` of the finite values of each row (n, m); NaN for rows without any; (n,)."""
    count = np.isfinite(rows).sum(axis=1)
    return np.asarray(np.sort(rows, axis=1)[np.arange(len(rows)), (share * np.maximum(count - 1, 0)).astype(int)])


def _pieces(jumps: NDArray[np.bool_], still: NDArray[np.bool_]) -> list[slice]:
    """Cut at jumps, and at both ends of standstills beside a jump; slices of the frames with the mark."""
    cuts = {0, len(jumps) + 1}
    for k in np.flatnonzero(jumps):
        cuts.add(int(k) + 1)
        before, after = int(k), int(k) + 1
        while before > 0 and still[before - 1]:
            before -= 1
        while after < len(still) and still[after]:
            after += 1
        # In the first frame of a rest the position is right.
        cuts |= {before + 1, after + 1 if after > k + 1 else int(k) + 1}
    ordered = sorted(cuts)
    return [slice(first, last) for first, last in pairwise(ordered)]


def _worth(pieces: list[slice], centers_px: Array, room: float) -> Array:
    """Weight of each piece, in frames."""
    counts = np.array([piece.stop - piece.start for piece in pieces], float)
    stands = np.array([float(np.ptp(centers_px[piece], axis=0).max()) < room for piece in pieces])
    if stands.all():
        return counts
    standing = np.where(stands, STANDING * counts, 0.0)
    return np.where(stands, standing * min(1.0, JUMP / 2.0 / max(standing.sum(), 1e-9)), counts)


def _likeliest(pieces: list[slice], time_s: Array, centers_px: Array, usual_px_s: Array, room: float) -> set[int]:
    """Pieces on the path of one body: those with the most frames, minus JUMP for every jump between them."""
    worth = _worth(pieces, centers_px, room)
    best, before = worth.copy(), np.full(len(pieces), -1)
    for k, piece in enumerate(pieces):
        for j in range(max(k - 30, 0), k):
            last, first = pieces[j].stop - 1, piece.start
            speed = max(usual_px_s[max(last - 1, 0)], usual_px_s[min(first, len(usual_px_s) - 1)])
            way = float(np.hypot(*(centers_px[first] - centers_px[last])))
            jumped = way > room + FASTER * speed * (time_s[first] - time_s[last])
            value = best[j] + worth[k] - (JUMP if jumped else 0.0)
            if value > best[k]:
                best[k], before[k] = value, j
    kept, k = set[int](), int(np.argmax(best))
    while k >= 0:
        kept.add(k)
        k = int(before[k])
    return kept
