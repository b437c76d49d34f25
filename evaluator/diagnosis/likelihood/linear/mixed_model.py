"""Linear mixed model of an experiment with common parameters, scatter between runs and tracking noise; its evidence.

Whitened features of run i are z_i = J_i θ + F_i a_i + B_i b_i + ε, ε ~ N(0, 1): θ are common parameters (nominal values
within their tolerances, effects), a_i is the start pose (flat prior), b_i ~ N(0, diag τ²) are the random effects of the
run: friction, wheel gains and start of motion. Start poses are projected out; τ is marginalized over a grid, so that
the uncertainty of the scatter enters every probability and interval, as with Student's t for a mean. Effects have a
unit-information prior that counts runs, not frames, because the frames of a run are not independent evidence.
Sources: Laird & Ware (1982), Biometrics 38, 963; Kass & Wasserman (1995), JASA 90, 928.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from evaluator.diagnosis.likelihood.linear.normal_equations import explained, normal_matrices, solved

Floats = NDArray[np.float64]

FLAT = 3  # start x, y, heading
SCATTER = ("friction", "left_gain", "right_gain", "start")  # per run: relative; start in its standard deviations
FRICTION_SCATTER = np.geomspace(5e-4, 0.3, 15)  # from a polished plate to a dirty one
GAIN_SCATTER = np.geomspace(1e-4, 0.1, 16)  # from quartz-driven steppers to poor DC motors
START_SCATTER = 1.0  # fixed, because the standard deviation of starts is stated
# Friction and gains: typical of wet or dusty plates and DC motors. Start: in its stated standard deviations.
USUAL_SCATTER = (0.03, 0.006, 0.006, START_SCATTER)
UNLIKELY = 1e-6  # probability below which a grid point is neglected in means and covariances
RIDGE = 1e-11  # of normal equations with ones on the diagonal, for collinear parameters


@dataclass(frozen=True)
class Linearized:
    """Linearization of one run: z = J θ + F a + B b + ε in whitened features; θ = 0 is the nominal model."""

    response: Floats  # (d,)
    common: Floats  # (d, p)
    start: Floats  # (d, 3)
    scatter: Floats  # (d, 4)


@dataclass(frozen=True)
class Reduced:
    """Sufficient statistics of every run for the mixed model, with start poses projected out."""

    s: Floats  # (n,)
    g: Floats  # (n, p)
    G: Floats  # (n, p, p)
    c: Floats  # (n, 4)
    C: Floats  # (n, 4, p)
    A: Floats  # (n, 4, 4)
    size: NDArray[np.int64]  # (n,) remaining features per run

    def of_columns(self, keep: NDArray[np.bool_], fixed: Floats) -> Reduced:
        """Statistics of the common parameters in keep, given values fixed (p,) of the others."""
        return Reduced(
            self.s - 2 * self.g @ fixed + np.einsum("p,npq,q->n", fixed, self.G, fixed),
            (self.g - self.G @ fixed)[:, keep],
            self.G[:, keep][:, :, keep],
            self.c - self.C @ fixed,
            self.C[:, :, keep],
            self.A,
            self.size,
        )


def reduce_runs(runs: Sequence[Linearized]) -> Reduced:
    """Project start poses out of every run and form inner products."""
    inner = []
    for run in runs:
        basis = np.linalg.qr(run.start)[0]
        block = np.column_stack([run.response, run.common, run.scatter])
        block = block - basis @ (basis.T @ block)
        inner.append(block.T @ block)
    return of_inner_products(np.array(inner), np.array([len(run.response) - FLAT for run in runs]))


def of_inner_products(inner: Floats, size: NDArray[np.int64]) -> Reduced:
    """Statistics of runs from inner products (n, m, m) of response, common parameters and scatter; size: (n,)."""
    common, scatter = slice(1, -len(SCATTER)), slice(-len(SCATTER), None)
    return Reduced(
        inner[:, 0, 0],
        inner[:, common, 0],
        inner[:, common, common],
        inner[:, scatter, 0],
        inner[:, scatter, common],
        inner[:, scatter, scatter],
        size,
    )


@dataclass(frozen=True)
class Posterior:
    """Common parameters of one model given the data: log evidence, mean, covariance, scatter, fit."""

    log_evidence: float
    mean: Floats  # (k,)
    covariance: Floats  # (k, k)
    scatter: Floats  # (4,) posterior mean of τ
    misfit: float  # -2 log likelihood at the best scatter, without the cost of parameters
    best: int  # index of the best scatter on the grid


class MixedModel:
    """Inner products of an experiment at every scatter of the grid; models are subsets of its columns."""

    def __init__(self, reduced: Reduced, prior_precision: Floats) -> None:
        """reduced: the runs. prior_precision: (p,) 1/σ² of columns with a prior, 0 for the others."""
        free = bool(reduced.A[:, :-1, :-1].any())  # else friction and gains are no random effects: one scatter
        axes = (FRICTION_SCATTER, GAIN_SCATTER) if free else (FRICTION_SCATTER[:1], GAIN_SCATTER[:1])
        friction, gain = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
        self.tau = np.column_stack([friction, gain, gain, np.full(len(gain), START_SCATTER)])
        self.runs = len(reduced.s)
        self.prior = prior_precision
        grid, p = len(self.tau), reduced.g.shape[1]
        inverse = self.tau**-2.0
        sides = np.concatenate([reduced.C, reduced.c[:, :, None]], axis=2)
        # Square root of each correction, so that the sum over runs is one product.
        half, log_det = _halves(reduced.A, inverse, sides)
        columns, response = half[:, :p], half[:, p]
        self.s = float(reduced.s.sum()) - np.sum(response**2, axis=1)
        self.g = reduced.g.sum(axis=0) - np.matmul(columns, response[:, :, None])[:, :, 0]
        self.whole = reduced.G.sum(axis=0)
        self.corrections = [(columns, columns)]  # (grid, p, r) each: subtracted for random effects and for a given base
        self.redundant = np.zeros((grid, p), dtype=np.bool_)  # columns that are collinear with the given base
        self.rounding = RIDGE * np.diag(self.whole)  # rounding error of the remainder of a column
        self.logdet = log_det - self.runs * np.log(inverse).sum(axis=1)

    def inner(
        self, rows: NDArray[np.int64] | None = None, columns: NDArray[np.int64] | None = None, at: Any = slice(None)
    ) -> Floats:
        """Inner products (t, r, c) of rows and columns at grid points; default: all.

        Computed on demand, because the products between all pairs of hundreds of candidates are never needed.
        """
        every = np.arange(len(self.prior))
        rows, columns = (every if part is None else part for part in (rows, columns))
        found = np.empty((len(self.tau[at]), len(rows), len(columns)))
        found[:] = self.whole[np.ix_(rows, columns)]
        for left, right in self.corrections:
            own = np.ascontiguousarray(left[at][:, rows])
            # a product of a matrix with its own transpose is four times as fast if both are the same array
            alike = left is right and rows is columns
            other = own if alike else np.ascontiguousarray(right[at][:, columns])
            found -= np.matmul(own, other.transpose(0, 2, 1))
        redundant = self.redundant[at]
        if redundant.any():
            found[redundant[:, rows, None] | redundant[:, None, columns]] = 0.0
        return found

    def given(self, base: Sequence[int]) -> MixedModel:
        """The model of the other columns, with the columns of base eliminated at each scatter.

        Evidence and parameters of the other columns are those of the model with base. If it has effects, and not every
        column with a prior, the cost of these columns is approximate, which suffices for screening.
        """
        keep = np.asarray(base, dtype=np.int64)
        rest = np.setdiff1d(np.arange(len(self.prior)), keep)
        H = self._normal(keep, slice(None))
        sides = np.concatenate([self.inner(keep, rest), self.g[:, keep, None]], axis=2)
        solution = solved(H, sides)
        left, right = (np.zeros((len(self.tau), len(self.prior), len(keep))) for _ in range(2))
        left[:, rest], right[:, rest] = (part[:, :, :-1].transpose(0, 2, 1) for part in (sides, solution))
        found = copy(self)
        found.corrections = [*self.corrections, (left, right)]
        found.s = self.s - np.sum(sides[:, :, -1] * solution[:, :, -1], axis=1)
        found.g = self.g - np.matmul(left, solution[:, :, -1:])[:, :, 0]
        own = np.diag(self.whole) - sum(np.einsum("tpr,tpr->tp", *pair) for pair in found.corrections)
        # collinear with base: the remainder is rounding error of either sign
        found.redundant = own < self.rounding
        found.g[found.redundant] = 0.0
        found.logdet = self.logdet + self._explained(keep, H, sides[:, :, -1])[1]
        return found

    def taken(self, columns: Sequence[int]) -> MixedModel:
        """The model in which the parameters of these columns are fixed at 1."""
        if not columns:
            return self
        of = np.asarray(columns, dtype=np.int64)
        found = copy(self)
        found.s = self.s - 2 * self.g[:, of].sum(axis=1) + self.inner(of, of).sum(axis=(1, 2))
        found.g = self.g - self.inner(None, of).sum(axis=2)
        return found

    def _normal(self, keep: NDArray[np.int64], at: Any) -> Floats:
        """Normal matrices (t, k, k) of some columns, with their priors, at some grid points."""
        return normal_matrices(self.inner(keep, keep, at), self.prior[keep])

    def _explained(self, keep: NDArray[np.int64], H: Floats, g: Floats) -> tuple[Floats, Floats]:
        """Decrease of -2 log likelihood by the parameters of some columns, (t,), and their cost in it, (t,).

        Parameters with a prior cost the log ratio of prior to posterior volume. Unit information about an effect is the
        information of one run with unknown nominal values, so that an effect that is nearly collinear with a nominal
        value does not cost less than others.
        """
        known = self.prior[keep] > 0
        gain, log_det = explained(H, g, known)
        return gain, log_det - np.log(self.prior[keep][known]).sum() + np.sum(~known) * np.log(self.runs)

    def _scored(self, keep: NDArray[np.int64], at: Any) -> tuple[Floats, Floats, Floats, Floats]:
        """Log evidence and misfit (t,) at grid points, and their normal equations (t, k, k), (t, k)."""
        H, g = self._normal(keep, at), self.g[at][:, keep]
        gain, cost = self._explained(keep, H, g)
        misfit = self.s[at] - gain + self.logdet[at]
        return -0.5 * (misfit + cost), misfit, H, g

    def log_evidence(self, columns: Sequence[int]) -> float:
        """Log evidence of the model with these columns, as in its posterior."""
        return _log_mean(self._scored(np.asarray(columns, dtype=np.int64), slice(None))[0])

    def posterior(self, columns: Sequence[int], at: NDArray[np.int64] | None = None) -> Posterior:
        """Evidence and parameters of the model with these columns; at: grid points to use (default: all)."""
        keep = np.asarray(columns, dtype=np.int64)
        chosen = slice(None) if at is None else at
        score, misfit, H, g = self._scored(keep, chosen)
        weight = np.exp(score - score.max())
        weight /= weight.sum()
        likely = weight > UNLIKELY
        share = weight[likely] / weight[likely].sum()
        identity = np.broadcast_to(np.eye(len(keep)), H[likely].shape)
        both = solved(H[likely], np.concatenate([g[likely, :, None], identity], axis=2))
        mean, inverse = both[:, :, 0], both[:, :, 1:]
        center = share @ mean
        spread = mean - center
        covariance = np.einsum("t,tij->ij", share, inverse) + np.einsum("t,ti,tj->ij", share, spread, spread)
        best = int(np.arange(len(self.tau))[chosen][np.argmin(misfit)])
        return Posterior(_log_mean(score), center, covariance, weight @ self.tau[chosen], float(misfit.min()), best)

    def scatter_interval(self, columns: Sequence[int], share: float = 0.95) -> Floats:
        """Interval (2, 2) of the scatter of friction and of the gains, in the model with these columns.

        A point of the grid stands for the scatters up to halfway to its neighbours, in logarithms. The lower end is the
        least one of the grid if the runs show no scatter.
        """
        score = self._scored(np.asarray(columns, dtype=np.int64), slice(None))[0]
        weight = np.exp(score - score.max())
        ends = np.empty((2, 2))
        for kind in range(2):
            grid, of = np.unique(self.tau[:, kind], return_inverse=True)
            middles = np.sqrt(grid[1:] * grid[:-1])
            below = np.concatenate([[0.0], np.cumsum(np.bincount(of, weight))]) / weight.sum()
            edges = np.log(np.concatenate([grid[:1], middles, grid[-1:]]))
            ends[kind] = np.exp(np.interp([(1 - share) / 2, (1 + share) / 2], below, edges))
        return ends


def _halves(A: Floats, inverse: Floats, sides: Floats) -> tuple[Floats, Floats]:
    """L⁻¹·sides of every run, with L·Lᵀ = A + diag(inverse), and the sums (t,) over runs of its log determinant.

    A: (n, q, q). inverse: (t, q). sides: (n, q, m). The first result is (t, m, n·q). All small matrices are eliminated
    together, element by element: a library that factorizes one after the other takes three times as long.
    """
    size, count = A.shape[1], len(inverse)
    whole = np.repeat(A.transpose(1, 2, 0)[:, :, None, :], count, axis=2)  # (q, q, t, n)
    L, root = np.zeros_like(whole), np.zeros_like(whole)
    for i in range(size):
        whole[i, i] += inverse[:, i, None]
        for j in range(i):
            L[i, j] = (whole[i, j] - np.sum(L[i, :j] * L[j, :j], axis=0)) / L[j, j]
        L[i, i] = np.sqrt(whole[i, i] - np.sum(L[i, :i] ** 2, axis=0))
        root[i, i] = 1 / L[i, i]
        for j in range(i):
            root[i, j] = -np.sum(L[i, j:i] * root[j:i, j], axis=0) / L[i, i]
    log_det = -2 * np.log(root[range(size), range(size)]).sum(axis=(0, 2))
    half = np.matmul(root.transpose(3, 2, 0, 1).reshape(len(A), count * size, size), sides)
    return half.reshape(len(A), count, size, -1).transpose(1, 3, 0, 2).reshape(count, sides.shape[2], -1), log_det


def _log_mean(score: Floats) -> float:
    """Logarithm of the mean of values with these logarithms."""
    top = score.max()
    return float(top + np.log(np.mean(np.exp(score - top))))


def solve_at(reduced: Reduced, prior_precision: Floats, tau: Floats) -> Floats:
    """Most probable common parameters (p,) at one scatter."""
    normal, right, scale = _normal_at(reduced, prior_precision, tau)
    solution: Floats = np.linalg.lstsq(normal, right, rcond=RIDGE)[0] / scale
    return solution


def solve_within(reduced: Reduced, prior_precision: Floats, tau: Floats, low: Floats, high: Floats) -> Floats:
    """Most probable common parameters (p,) within bounds (p,). Source: Stark & Parker (1995), Comput. Stat. 10, 129.

    A parameter that the runs do not respond to, such as a limit above all commands, has no optimum and gets the value
    at which it is absent.
    """
    free = solve_at(reduced, prior_precision, tau)
    if ((free >= low) & (free <= high)).all():
        return free
    normal, right, scale = _normal_at(reduced, prior_precision, tau)
    shown = np.flatnonzero(np.diag(normal) > 0)
    scale, limits = scale[shown], (low[shown] * scale[shown], high[shown] * scale[shown])
    values, vectors = np.linalg.eigh(normal[np.ix_(shown, shown)])
    roots = np.sqrt(np.maximum(values, RIDGE * values[-1]))
    target = vectors.T @ right[shown] / roots
    found = np.zeros(len(low))
    found[shown] = lsq_linear(roots[:, None] * vectors.T, target, limits, method="bvls").x / scale
    return np.asarray(np.clip(found, low, high))


def _normal_at(reduced: Reduced, prior_precision: Floats, tau: Floats) -> tuple[Floats, Floats, Floats]:
    """Normal equations (p, p), (p,) of the common parameters at one scatter, divided by their scale (p,).

    The information that remains after the random effects is a difference; below a share RIDGE it is rounding error.
    """
    weight = np.linalg.inv(reduced.A + np.diag(tau**-2.0))
    weighted = np.einsum("nij,njp->nip", weight, reduced.C)
    whole = reduced.G.sum(axis=0) + np.diag(prior_precision)
    normal = whole - np.einsum("nip,niq->pq", reduced.C, weighted)
    right = reduced.g.sum(axis=0) - np.einsum("nip,ni->p", weighted, reduced.c)
    scale = np.sqrt(np.maximum(np.diag(normal), np.maximum(RIDGE * np.diag(whole), 1e-300)))
    return normal / np.outer(scale, scale), right / scale, scale


def run_effects(reduced: Reduced, theta: Floats, tau: Floats) -> tuple[Floats, Floats]:
    """Random effects of each run (friction, gains, start) at common parameters: means (n, 4), covariances (n, 4, 4)."""
    covariance = np.linalg.inv(reduced.A + np.diag(tau**-2.0))
    mean = np.einsum("nij,nj->ni", covariance, reduced.c - reduced.C @ theta)
    return np.asarray(mean, dtype=np.float64), np.asarray(covariance, dtype=np.float64)


def at_scatter(reduced: Reduced, tau: Floats) -> tuple[Floats, Floats, Floats]:
    """Inner products of every run, (n,), (n, p), (n, p, p), with its random effects marginalized at a scatter."""
    weight = np.linalg.inv(reduced.A + np.diag(tau**-2.0))
    weighted = np.einsum("nij,njp->nip", weight, reduced.C)
    s = reduced.s - np.einsum("ni,nij,nj->n", reduced.c, weight, reduced.c)
    g = reduced.g - np.einsum("nip,ni->np", weighted, reduced.c)
    G = reduced.G - np.einsum("nip,niq->npq", reduced.C, weighted)
    return s, g, G
