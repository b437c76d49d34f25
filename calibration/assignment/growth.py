"""Growth of a lattice over scattered dots: from a seed with a local basis, neighbour by neighbour.

Each step predicts the position of the next dot from the dots around it, so that the lattice may be curved (distortion),
converge (perspective), have holes and end anywhere. Nothing is assumed about its size.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from calibration.compilation import compiled

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# A dot is accepted within this share of the shorter basis vector from its prediction. Half would reach the neighbour's
# cell; lenses and tilt move dots by a few percent per step.
CAPTURE = 0.28
# A dot of another size than those around it may be a fiducial or dirt: it is accepted only within this share of that
# distance, an eighth of the basis vector, and not used for predictions.
ODD_SHARE = 0.45
OPPOSITE = 0.22  # mismatch of the two arms of a seed, as a share of an arm
SLANTED = 0.45  # the same, in an oblique view of few large dots, where the pitch shrinks by a third from dot to dot
NEIGHBOURS = 12  # enough to see both directions of a lattice with pitches 1 : 2.5
# Beside a hole the arms of a seed may span two pitches; its cell is then at least twice that of a correct seed nearby,
# while perspective changes cells by some percent from dot to dot.
WIDE_CELL = 1.4
STEPS = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1), (2, 0), (-2, 0), (0, 2), (0, -2))


def seed_bases(points: Array, neighbours: Integers, opposite_share: float = OPPOSITE) -> tuple[Array, Array]:
    """Local basis (n, 4) ux, uy, vx, vy of each dot, and its mismatch as a seed (n,), infinite without a basis.

    points: (n, 2). neighbours: (n, k) nearest first. An arm is a neighbour with another one opposite to it, to
    opposite_share of its length.
    """
    arm = points[neighbours] - points[:, None]
    x, y = arm[..., 0], arm[..., 1]
    length = np.sqrt(x * x + y * y)
    off = (x[:, :, None] + x[:, None]) ** 2 + (y[:, :, None] + y[:, None]) ** 2  # squared, of each pair of arms
    opposite = off.argmin(axis=2)
    error = np.sqrt(np.take_along_axis(off, opposite[..., None], axis=2)[..., 0]) / length
    half = (arm - np.take_along_axis(arm, opposite[..., None], axis=1)) / 2
    paired = error <= opposite_share
    dot = np.arange(len(points))
    first = paired.argmax(axis=1)
    u = half[dot, first]
    reach = np.maximum(length * np.hypot(*u.T)[:, None], 1e-12)  # a dot without a pair has no arm
    sine = np.abs(x * u[:, None, 1] - y * u[:, None, 0]) / reach
    apart = paired & (sine >= 0.5)  # at least 30 degrees from the first arm
    second = apart.argmax(axis=1)
    v = half[dot, second]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    mismatch = np.where(apart.any(axis=1), np.maximum(error[dot, first], error[dot, second]), np.inf)
    cell = np.where(np.isfinite(mismatch), np.abs(area), np.inf)
    wide = cell > WIDE_CELL * cell[neighbours].min(axis=1)
    return np.column_stack([u, np.where(area < 0, -1.0, 1.0)[:, None] * v]), mismatch + np.where(wide, 1.0, 0.0)


def bucket(points: Array, size: float) -> tuple[Integers, Integers, Array]:
    """Linked cells of the given size, in which a neighbour is found without a search over all dots."""
    origin = points.min(axis=0)
    column, row = ((points - origin) // size).astype(np.int64).T
    cells, following = np.full((row.max() + 1, column.max() + 1), -1), np.full(len(points), -1)
    number = row * cells.shape[1] + column
    order = np.argsort(number, kind="stable")
    same = number[order[1:]] == number[order[:-1]]
    following[order[1:]] = np.where(same, order[:-1], -1)
    last = np.append(~same, True)
    cells.ravel()[number[order[last]]] = order[last]
    return cells, following, origin


@compiled()
def _nearest(points, odd, x, y, reach, cells, following, size, origin):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Index of the dot nearest to (x, y) within reach, -1 for none; an odd one must be nearer."""
    left, right = int((x - reach - origin[0]) // size), int((x + reach - origin[0]) // size)
    top, bottom = int((y - reach - origin[1]) // size), int((y + reach - origin[1]) // size)
    best, found = reach * reach, -1
    for row in range(max(top, 0), min(bottom, cells.shape[0] - 1) + 1):
        for column in range(max(left, 0), min(right, cells.shape[1] - 1) + 1):
            k = cells[row, column]
            while k >= 0:
                distance = (points[k, 0] - x) ** 2 + (points[k, 1] - y) ** 2
                if distance < best:
                    best, found = distance, k
                k = following[k]
    if found >= 0 and odd[found] and sqrt(best) > ODD_SHARE * reach:
        return -1
    return found


@compiled()
def _local_basis(points, grid, odd, a, b, here, basis):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Basis at a dot: mean of the arms to its assigned neighbours, else what it inherited."""
    for axis in range(2):
        ahead, behind = grid[a + 1 - axis, b + axis], grid[a - 1 + axis, b - axis]
        if ahead >= 0 and odd[ahead]:
            ahead = -1
        if behind >= 0 and odd[behind]:
            behind = -1
        if ahead < 0 and behind < 0:
            continue
        steps = 2.0 if ahead >= 0 and behind >= 0 else 1.0
        after, before = ahead if ahead >= 0 else here, behind if behind >= 0 else here
        for k in range(2):
            basis[2 * axis + k] = (points[after, k] - points[before, k]) / steps


@compiled()
def grow(points, seed, basis, odd, taken, cells, following, size, origin):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Indices (n, 2) of the dots reached from a seed; dots not reached, or taken before, hold -1 in `member` (n,).

    odd: (n,) dots of another size than their neighbours.
    """
    n = len(points)
    limit = min(n, 600) + 4
    grid = np.full((2 * limit + 1, 2 * limit + 1), -1)
    index, member = np.zeros((n, 2), dtype=np.int64), np.full(n, -1)
    bases = np.zeros((n, 4))
    queue, head, tail = np.empty(n, dtype=np.int64), 0, 1
    queue[0], member[seed] = seed, 0
    for k in range(4):
        bases[seed, k] = basis[k]
    grid[limit, limit] = seed
    while head < tail:
        here = queue[head]
        head += 1
        a, b = index[here, 0] + limit, index[here, 1] + limit
        _local_basis(points, grid, odd, a, b, here, bases[here])
        ux, uy, vx, vy = bases[here, 0], bases[here, 1], bases[here, 2], bases[here, 3]
        shorter = min(sqrt(ux * ux + uy * uy), sqrt(vx * vx + vy * vy))
        for k in range(len(STEPS)):
            da, db = STEPS[k]
            na, nb = a + da, b + db
            if min(na, nb) < 3 or max(na, nb) > 2 * limit - 3 or grid[na, nb] >= 0:
                continue
            if k >= 8 and grid[a + da // 2, b + db // 2] >= 0:
                continue  # no hole between: the nearer dot predicts better
            x = points[here, 0] + da * ux + db * vx
            y = points[here, 1] + da * uy + db * vy
            behind = grid[a - da, b - db]
            if behind >= 0 and not odd[behind]:  # continue with constant second difference
                x += 0.5 * (points[behind, 0] - points[here, 0] + da * ux + db * vx)
                y += 0.5 * (points[behind, 1] - points[here, 1] + da * uy + db * vy)
            found = _nearest(points, odd, x, y, CAPTURE * shorter, cells, following, size, origin)
            if found < 0 or member[found] >= 0 or taken[found]:
                continue
            grid[na, nb], member[found] = found, 0
            index[found, 0], index[found, 1] = na - limit, nb - limit
            for m in range(4):
                bases[found, m] = bases[here, m]
            if not odd[found]:
                queue[tail] = found
                tail += 1
    return index, member
