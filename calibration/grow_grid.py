"""Growth of a lattice over scattered dots: from a seed with a local basis, neighbour by neighbour.

Each step predicts where the next dot lies from the dots around it, so the lattice may bend (distortion), converge
(perspective), have holes and end anywhere. Nothing is assumed about its size.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numba import njit

# A dot is taken where it lies within this share of the shorter basis vector from its prediction: half would be the
# neighbour's ground; lenses and tilt bend the lattice by a few percent per step.
CAPTURE = 0.28
OPPOSITE = 0.22  # mismatch of the two arms of a seed, as a share of an arm
NEIGHBOURS = 12  # enough to see both directions of a lattice with pitches 1 : 2.5


@njit(cache=True)
def seed_bases(points, neighbours):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201, C901
    """Local basis (n, 4) ux, uy, vx, vy of each dot from its neighbours, and its mismatch (n,), inf for none."""
    n = len(points)
    bases, mismatch = np.zeros((n, 4)), np.full(n, np.inf)
    for i in range(n):
        arms, worst = 0, 0.0
        for k in range(neighbours.shape[1]):
            if neighbours[i, k] >= n:
                break
            u = points[neighbours[i, k]] - points[i]
            length = sqrt(u[0] ** 2 + u[1] ** 2)
            if arms == 1:
                first = bases[i, :2]
                cross = abs(u[0] * first[1] - u[1] * first[0]) / (length * sqrt(first[0] ** 2 + first[1] ** 2))
                if cross < 0.5:  # within 30 degrees of the first arm
                    continue
            error, opposite = np.inf, -1
            for m in range(neighbours.shape[1]):
                if neighbours[i, m] >= n:
                    break
                w = points[neighbours[i, m]] - points[i]
                e = sqrt((u[0] + w[0]) ** 2 + (u[1] + w[1]) ** 2) / length
                if e < error:
                    error, opposite = e, neighbours[i, m]
            if error > OPPOSITE:
                continue
            half = (points[neighbours[i, k]] - points[opposite]) / 2
            bases[i, 2 * arms : 2 * arms + 2] = half
            worst = max(worst, error)
            arms += 1
            if arms == 2:
                break
        if arms == 2:
            if bases[i, 0] * bases[i, 3] - bases[i, 1] * bases[i, 2] < 0:
                bases[i, 2:] = -bases[i, 2:]
            mismatch[i] = worst
    return bases, mismatch


@njit(cache=True)
def _nearest(points, x, y, reach, cells, following, size, origin):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Index of the dot nearest to (x, y) within reach, -1 for none."""
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
    return found


@njit(cache=True)
def bucket(points, size):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Linked cells of the given size, so that a neighbour is found without a search over all dots."""
    origin = np.array([points[:, 0].min(), points[:, 1].min()])
    columns = int((points[:, 0].max() - origin[0]) // size) + 1
    rows = int((points[:, 1].max() - origin[1]) // size) + 1
    cells, following = np.full((rows, columns), -1), np.full(len(points), -1)
    for i in range(len(points)):
        row, column = int((points[i, 1] - origin[1]) // size), int((points[i, 0] - origin[0]) // size)
        following[i] = cells[row, column]
        cells[row, column] = i
    return cells, following, origin


@njit(cache=True)
def _local_basis(points, grid, a, b, here, basis):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Basis at a dot: mean of the arms to its assigned neighbours, else what it inherited."""
    for axis in range(2):
        da, db = (1, 0) if axis == 0 else (0, 1)
        ahead, behind = grid[a + da, b + db], grid[a - da, b - db]
        if ahead >= 0 and behind >= 0:
            basis[2 * axis : 2 * axis + 2] = (points[ahead] - points[behind]) / 2
        elif ahead >= 0:
            basis[2 * axis : 2 * axis + 2] = points[ahead] - points[here]
        elif behind >= 0:
            basis[2 * axis : 2 * axis + 2] = points[here] - points[behind]


@njit(cache=True)
def grow(points, seed, basis, taken, cells, following, size, origin):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Indices (n, 2) of the dots reached from a seed; dots not reached, or taken before, hold -1 in `member` (n,)."""
    n = len(points)
    limit = min(n, 600) + 4
    grid = np.full((2 * limit + 1, 2 * limit + 1), -1)
    index, member = np.zeros((n, 2), dtype=np.int64), np.full(n, -1)
    bases = np.zeros((n, 4))
    queue, head, tail = np.empty(n, dtype=np.int64), 0, 1
    queue[0], bases[seed], member[seed] = seed, basis, 0
    grid[limit, limit] = seed
    steps = np.array(
        [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1), (2, 0), (-2, 0), (0, 2), (0, -2)]
    )
    while head < tail:
        here = queue[head]
        head += 1
        a, b = index[here, 0] + limit, index[here, 1] + limit
        _local_basis(points, grid, a, b, here, bases[here])
        ux, uy, vx, vy = bases[here]
        shorter = min(sqrt(ux * ux + uy * uy), sqrt(vx * vx + vy * vy))
        for k in range(len(steps)):
            da, db = steps[k]
            na, nb = a + da, b + db
            if min(na, nb) < 3 or max(na, nb) > 2 * limit - 3 or grid[na, nb] >= 0:
                continue
            if k >= 8 and grid[a + da // 2, b + db // 2] >= 0:
                continue  # no hole to jump over: the nearer dot predicts better
            x = points[here, 0] + da * ux + db * vx
            y = points[here, 1] + da * uy + db * vy
            behind = grid[a - da, b - db]
            if behind >= 0:  # the lattice bends on as it bent: second differences vary slowly
                x += 0.5 * (points[behind, 0] - points[here, 0] + da * ux + db * vx)
                y += 0.5 * (points[behind, 1] - points[here, 1] + da * uy + db * vy)
            found = _nearest(points, x, y, CAPTURE * shorter, cells, following, size, origin)
            if found < 0 or member[found] >= 0 or taken[found]:
                continue
            grid[na, nb], member[found] = found, 0
            index[found, 0], index[found, 1] = na - limit, nb - limit
            bases[found] = bases[here]
            queue[tail] = found
            tail += 1
    return index, member
