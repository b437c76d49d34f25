"""Adequacy of a model: absolute tests of whether its residuals are noise.

The residuals of every run, after start pose and random effects, are compared with the tracking noise mode by mode: slow
modes contain motion, fast ones noise, so that their ratio does not depend on the level of the noise. The random effects
of the runs, friction and gains, must be random: they must not depend on anything known about the runs.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.likelihood.linear.mixed_model import FRICTION_SCATTER, GAIN_SCATTER, SCATTER, run_effects
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.recognised import recording_of

Floats = NDArray[np.float64]


FEWEST_FREEDOM = 6  # degrees of freedom below which an F test has little power
# Share of the variance of a friction or gain that a run must determine; a straight run does not determine friction.
LEAST_SHARE = 0.01
FEWEST_OTHERS = 2  # other repetitions of a command, of which one alone may be the odd one
UNLIKE = 1e-3  # probability, by chance, that any run of an experiment is as unlike the others
SUSPECT = 0.01  # the same for a run that is only left out of a line over the others, and told if it is UNLIKE them
FEWEST_OF_GROUP = 2  # runs; a single one is an outlier
DRAWS = 20_000  # of normal values, which determine a probability of 3e-4 to a third
NORMAL_PARTED = 1.75  # that of many normal values in their best two groups: (2/π) / (1 - 2/π)
# Random effects that may depend on the order of the runs: a plate is wiped between two runs or gathers dust, and one
# clock drifts against another. That is no missing physics; session_changes.py reports the friction.
OF_SESSION = ("friction", "start")


@dataclass(frozen=True)
class Adequacy:
    """Tests of the residuals of a fit.

    excess: mean square of the whitened residuals, 1 for pure noise; excess_sigma: its distance from 1 in standard
    errors. by_run: the same per run. random_effects: friction, gains and start of each run (n, 4), shrunk toward 0;
    shares: (n, 4), of their variance that the run determines. order_p: probability of so strong a dependence of random
    effects on something known by chance, Bonferroni over all tests; depends_on: the quantity. widest: the random effect
    with an implausibly large scatter, in words; empty if there is none.
    """

    excess: float
    excess_sigma: float
    by_run: Floats
    random_effects: Floats
    shares: Floats
    order_p: float
    depends_on: str
    widest: str = ""


def adequacy(fit: Fit, data: Sequence[RunData], relevant_gain: float = 0.0) -> Adequacy:
    """Test the residuals of a fit.

    relevant_gain: relative; gains of the wheels that depend on something known by less are of no consequence.
    """
    theta = np.array([fit.point.value(column) for column in fit.columns])
    squares, freedom = fit.misfits
    excess = float(squares.sum() / freedom.sum())
    scatter = fit.posterior.scatter
    random_effects, unknown = run_effects(fit.reduced, theta, scatter)
    shares = 1 - np.diagonal(unknown, axis1=1, axis2=2) / scatter**2
    sigma = np.sqrt(2 / freedom.sum())
    relevant = np.array([0.0, relevant_gain, relevant_gain, 0.0]) / scatter
    order_p, depends_on = _order(random_effects / scatter, shares, [data[run] for run in fit.runs], relevant)
    found = Adequacy(excess, (excess - 1) / sigma, squares / freedom, random_effects, shares, order_p, depends_on)
    order = np.array([data[run].order for run in fit.runs], dtype=np.float64)
    return replace(found, widest=_widest(found, scatter, order))


def _widest(left: Adequacy, scatter: Floats, order: Floats) -> str:
    """The random effect whose scatter is at the upper end of the prior, which indicates missing physics.

    scatter: (4,), posterior mean, for which the largest scatter of the grid is more probable than all smaller ones. A
    plate that gathers dust and a sticky run are no physics: of friction, what is left beside a line over the order of
    the runs (n,) and runs unlike all others counts.
    """
    for number, what, asked in ((0, "friction", FRICTION_SCATTER), (1, "wheel speed", GAIN_SCATTER)):
        found, most = float(scatter[number]), float(np.sqrt(asked[-2] * asked[-1]))
        if found > most and (what not in OF_SESSION or _beside_session(left, order) > most):
            return f"{what} differs from run to run by {100 * found:.0f} %, more than is plausible as chance"
    return ""


def _beside_session(left: Adequacy, order: Floats) -> float:
    """Scatter of the friction beside a line over the session and its outliers; infinite for too few runs."""
    number = SCATTER.index("friction")
    seen = tells_friction(left, order)
    design, values = _over(order[seen], left.random_effects[seen, number], left.shares[seen, number])
    freedom = len(values) - 2
    return float(np.sqrt(_left(design, values) / freedom)) if freedom >= FEWEST_FREEDOM else np.inf


def tells_friction(left: Adequacy, order: Floats) -> NDArray[np.bool_]:
    """Runs (n,) of a fit that tell their friction, without its outliers; order: of these runs."""
    return ~odd_frictions(left, order) & (left.shares[:, SCATTER.index("friction")] > LEAST_SHARE)


def odd_frictions(left: Adequacy, order: Floats) -> NDArray[np.bool_]:
    """Runs (n,) of a fit whose friction is an outlier from a line over the order of the runs (n,), at most a quarter.

    A sticky first run and dust that gathers hide each other from tests of outliers and of lines.
    Source: externally Studentized residuals, Cook & Weisberg (1982), Residuals and Influence.
    """
    number = SCATTER.index("friction")
    rest = np.flatnonzero(left.shares[:, number] > LEAST_SHARE)
    odd: list[int] = []
    for _ in range(len(rest) // 4):
        design, values = _over(order[rest], left.random_effects[rest, number], left.shares[rest, number])
        freedom = len(rest) - 3
        if freedom < FEWEST_FREEDOM or np.ptp(order[rest]) == 0:
            break
        basis = np.linalg.qr(design)[0]
        free = np.maximum(1 - np.sum(basis**2, axis=1), 1e-12)
        off = values - basis @ (basis.T @ values)
        others = np.maximum(off @ off - off**2 / free, 1e-300) / freedom
        t = np.abs(off) / np.sqrt(others * free)
        worst = int(np.argmax(t))
        if not 2 * len(rest) * special.stdtr(freedom, -t[worst]) < SUSPECT:
            break
        odd.append(int(rest[worst]))
        rest = np.delete(rest, worst)
    return np.isin(np.arange(len(left.shares)), odd)


def _over(order: Floats, estimates: Floats, share: Floats) -> tuple[Floats, Floats]:
    """Design (n, 2) and values (n,) of a line through estimates over the session, of equal variances: see _order."""
    weight = np.sqrt(share)
    return np.column_stack([np.ones(len(order)), order]) * weight[:, None], estimates / weight


@dataclass(frozen=True)
class Unlike:
    """Runs (indices in the session) whose friction or wheel speeds differ from the others by the same amount.

    what: of SCATTER. change: relative, the median of these runs over that of all. of_command: whether the others are
    only those with the same command.
    """

    runs: tuple[int, ...]
    what: str
    change: float
    of_command: bool = False


def unlike_runs(left: Adequacy, runs: Sequence[int]) -> list[Unlike]:
    """Runs whose friction, left or right wheel speeds differ significantly from the others.

    They are reported but not excluded, because the scatter between runs includes them and the model explains them. An
    example is a wheel that is dirty for three runs. Without outliers, the runs may form two groups.
    """
    found = []
    for number, what in enumerate(SCATTER[:-1]):
        seen = left.shares[:, number] > LEAST_SHARE
        alike, which = left.random_effects[seen, number] / np.sqrt(left.shares[seen, number]), np.asarray(runs)[seen]
        probability = UNLIKE / (len(SCATTER) - 1)
        odd = _odd(alike, probability) or _smaller_group(alike, probability)
        if not odd:  # on open ground there are no random effects of friction and gains
            continue
        change = alike - np.delete(alike, odd).mean()
        for side in (1, -1):
            same = [k for k in sorted(odd) if side * change[k] > 0]
            if same:
                found.append(Unlike(tuple(which[same].tolist()), what, float(np.median(change[same]))))
    return found


def unlike_repeats(left: Adequacy, runs: Sequence[int], commands: Sequence[Hashable]) -> list[Unlike]:
    """Runs whose friction, left or right wheel speeds differ significantly from those of other runs of their command.

    Repetitions of a command share every error of the model, so that their differences are chance, and few of them
    suffice: a run of three with a mistyped command is visible, although the scatter of five runs includes it.
    commands: of every run of the fit.
    """
    found = []
    for number, what in enumerate(SCATTER[:-1]):
        seen = np.flatnonzero(left.shares[:, number] > LEAST_SHARE)
        values = left.random_effects[seen, number] / np.sqrt(left.shares[seen, number])
        numbers: dict[Hashable, int] = {}
        labels = np.array([numbers.setdefault(commands[run], len(numbers)) for run in seen.tolist()], dtype=np.int64)
        for k, change in _odd_repeats(values, labels, UNLIKE / (len(SCATTER) - 1)).items():
            found.append(Unlike((runs[seen[k]],), what, change, of_command=True))
    return found


def _odd_repeats(values: Floats, labels: NDArray[np.int64], probability: float) -> dict[int, float]:
    """Values that differ from the mean of the others with their label, and by how much.

    Each must have two others, and is tested against the scatter of all others within their labels. probability: of any
    false positive. Source: externally Studentized residuals, Cook & Weisberg (1982), Residuals and Influence.
    """
    odd: dict[int, float] = {}
    while True:
        rest = np.delete(np.arange(len(values)), list(odd))
        label, value = labels[rest], values[rest]
        size = np.bincount(label, minlength=labels.max(initial=0) + 1)
        off = value - (np.bincount(label, value, len(size)) / np.maximum(size, 1))[label]
        repeats = size[label]
        off, may = off * repeats / np.maximum(repeats - 1, 1), repeats > FEWEST_OTHERS  # from the mean of the others
        freedom = len(rest) - np.count_nonzero(size) - 1
        if freedom < FEWEST_OTHERS or not may.any():
            return odd
        own = off**2 * (repeats - 1) / repeats  # the share of each in the sum of squares
        within = np.sum(off**2 * ((repeats - 1) / repeats) ** 2)
        error = np.sqrt(np.maximum(within - own, 0.0) / freedom * repeats / np.maximum(repeats - 1, 1))
        p = 2 * len(values) * special.stdtr(freedom, -np.abs(off) / np.maximum(error, 1e-300))
        worst = int(np.argmin(np.where(may, p, np.inf)))
        if not p[worst] < probability:
            return odd
        odd[int(rest[worst])] = float(off[worst])


def _odd(values: Floats, probability: float) -> list[int]:
    """Indices of outliers from the normal distribution of the values, at most a quarter of them.

    probability: of any false positive. Several equal outliers do not mask each other.
    Source: the generalized extreme Studentized deviate, Rosner (1983), Technometrics 25, 165.
    """
    rest, taken, odd = list(range(len(values))), [], 0
    for number in range(len(values) // 4 if len(values) > FEWEST_FREEDOM else 0):
        part, count = values[rest], len(rest)
        far = np.abs(part - part.mean())
        worst = int(np.argmax(far))
        deviate = far[worst] / max(float(part.std(ddof=1)), 1e-300)
        square = count * (count - 2) * deviate**2 / max((count - 1) ** 2 - count * deviate**2, 1e-300)
        if 2 * count * special.stdtr(count - 2, -np.sqrt(square)) < probability:
            odd = number + 1
        taken.append(rest.pop(worst))
    return taken[:odd]


def _smaller_group(values: Floats, probability: float) -> list[int]:
    """Indices of the smaller of two groups of values (n,), the farther one from zero if they are equal; empty if none.

    The squares between both groups, over those within them, exceed those of normal values in the best two groups, with
    less than the probability by chance, and the gap is wider than either group, because an outlier and its neighbour
    are none. Three of eleven motors 3 % slower than the others are a group and no outliers.
    Source: Engelman & Hartigan (1969), J. Am. Stat. Assoc. 64, 1647.
    """
    if len(values) < 2 * FEWEST_OF_GROUP or not values.any():
        return []
    order = np.argsort(values)
    (ratio,), (below,) = _parted(values[order][None])
    groups = order[:below], order[below:]
    gap = values[groups[1][0]] - values[groups[0][-1]]
    if ratio < NORMAL_PARTED or gap <= max(np.ptp(values[group]) for group in groups):
        return []
    normal = np.sort(np.random.default_rng(0).standard_normal((DRAWS, len(values))))
    if np.mean(_parted(normal)[0] >= ratio) > probability:
        return []
    return sorted(int(k) for k in min(groups, key=lambda group: (len(group), -abs(float(values[group].mean())))))


def _parted(values: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Squares between over within the best two groups of rows of ascending values (m, n), and the size of the lower."""
    count = values.shape[1]
    below = np.arange(FEWEST_OF_GROUP, count - FEWEST_OF_GROUP + 1)
    values = values - values.mean(axis=1, keepdims=True)
    total = np.cumsum(values, axis=1)[:, below - 1]
    between = total**2 * count / (below * (count - below))
    best = np.argmax(between, axis=1)
    most = between[np.arange(len(values)), best]
    return most / np.maximum(np.sum(values**2, axis=1) - most, 1e-300), below[best]


def _order(random_effects: Floats, shares: Floats, data: Sequence[RunData], relevant: Floats) -> tuple[float, str]:
    """F test of each random effect against each known quantity of the runs: the smallest probability and its quantity.

    random_effects: (n, 4) in standard deviations of the scatter; shares: (n, 4), of the variance that the run
    determines. Estimates are shrunk by this share, and so is their variance; therefore they are divided by its square
    root, and the regressors are multiplied by it. relevant: (4,), size below which a dependence does not count.
    """
    tests = 0
    recordings = np.unique([recording_of(run.id) for run in data], return_inverse=True)[1]
    least, reason = 1.0, ""
    for by, columns in _known(data).items():
        for what, column, share, least_size in zip(SCATTER, random_effects.T, shares.T, relevant, strict=True):
            if by == "order" and what in OF_SESSION:
                continue
            p, size = dependence(column, share, columns, recordings)
            tests += np.isfinite(p)
            if p < least and size >= least_size:
                least, reason = p, f"{what.replace('_', ' ')} of the runs depends on {by}"
    return min(1.0, least * max(tests, 1)), reason


def dependence(
    random_effects: Floats, share: Floats, known: Floats, recordings: NDArray[np.int64] | None = None
) -> tuple[float, float]:
    """Probability of so strong a dependence of random effects (n,) on known columns (n, k) by chance, and its size.

    share: (n,), see _order. recordings: (n,), numbers of those of which the runs are parts; they share its clock, and a
    place, so that only differences within a recording count. All of one where there are no parts. size: half the range
    of the dependence. NaN, 0 for too few runs.
    """
    seen = share > LEAST_SHARE
    weight = np.sqrt(share[seen])
    whole = recordings is None or len(set(recordings)) == len(recordings)
    own = np.zeros(len(share)) if recordings is None or whole else recordings
    means = (own[seen, None] == np.unique(own[seen])).astype(np.float64)
    design = np.column_stack([means, known[seen]]) * weight[:, None]
    tested, freedom = known.shape[1], len(design) - design.shape[1]
    if freedom < FEWEST_FREEDOM or np.linalg.matrix_rank(design) < design.shape[1]:
        return float("nan"), 0.0
    values = random_effects[seen] / weight
    slopes = np.linalg.lstsq(design, values, rcond=None)[0][-tested:]
    without, rest = (_left(part, values) for part in (design[:, :-tested], design))
    p = float(special.fdtrc(tested, freedom, (without - rest) / tested / max(rest / freedom, 1e-30)))
    return p, float(np.ptp(known[seen] @ slopes)) / 2


def _left(design: Floats, values: Floats) -> float:
    """Residual sum of squares of a regression."""
    left = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
    return float(left @ left)


def _known(data: Sequence[RunData]) -> dict[str, Floats]:
    """Known quantities of every run: command, heading, position, order."""
    left = np.array([run.left_rpm for run in data])
    right = np.array([run.right_rpm for run in data])
    first, second = (np.array([_mean_place(run.marks_mm[:, mark]) for run in data]) for mark in ([0, 1], [2, 3]))
    angle = np.arctan2(*(first - second).T)
    direction, side = np.sign(left + right), np.sign(right - left)
    return {
        "direction": direction[:, None],
        "side": side[:, None],
        "direction and side together": (direction * side)[:, None],
        "speed": np.abs(left + right)[:, None],
        "the difference of the wheels": np.abs(right - left)[:, None],
        "heading": np.column_stack([np.cos(angle), np.sin(angle)]),
        "twice the heading": np.column_stack([np.cos(2 * angle), np.sin(2 * angle)]),
        "place": (first + second) / 2,
        "order": np.array([[run.order] for run in data], dtype=np.float64),
    }


def _mean_place(marks_mm: Floats) -> Floats:
    return np.asarray(np.nanmean(marks_mm, axis=0))
