"""Forward stepwise regression with BIC over the effects of the catalogue, with turnscope's own simulator.

Marks are regressed, whitened as the diagnosis whitens them, with every start pose projected out and all that is known
to within a tolerance fitted beside the effects, as a ridge. The effect that lowers the linearised BIC most is added,
all is fitted again by Gauss-Newton, and the effect stays where the BIC of that fit is lower, too. A run has nothing of
its own but its start pose; friction and gains of each run are what the mixed model of the diagnosis adds.
Sources: Efroymson (1960); Schwarz (1978), Ann. Statist. 6, 461.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from evaluator.diagnosis.assessment.gap import predicted_gaps, run_gaps
from evaluator.diagnosis.assessment.session_as_found import as_driven, with_session
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized
from evaluator.diagnosis.likelihood.linear.random_effects import place_starts
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.output.effect_tables import corrected_robot
from simulator.effects.coordinates import Candidate
from tests.benchmarks.discrepancy_peers.inputs import Floats, Inputs

# Settings: fixed on other experiments, before the bank was drawn.
PIECES_PER_RUN = 3.0  # independent ones that a run counts for in the BIC; its hundreds of frames are not
MOST_EFFECTS = 5
STEPS = 6
MOST_TOLERANCES = 4.0
CHANGED = 1e-3  # of the squares left, below which a fit has arrived


@dataclass(frozen=True)
class Fitted:
    """A point, and the squares left there beside the ridge."""

    point: Point
    squares: float
    variance: float  # of a feature


@dataclass(frozen=True)
class Regression:
    """What stays the same while effects are added."""

    inputs: Inputs
    tolerance: Mapping[str, float]

    def columns(self, effects: Sequence[str]) -> list[Column]:
        """Tolerances, then coordinates of effects."""
        terms = [self.inputs.terms[effect] for effect in effects]
        smooth = [Column(t.id, k, t) for t in terms if not t.stepwise for k in range(t.size)]
        return [Column(key) for key in self.tolerance] + smooth

    def bic(self, squares: float, parameters: int) -> float:
        """BIC of what is left, of so many parameters."""
        count = PIECES_PER_RUN * len(self.inputs.fitted)
        return count * np.log(squares) + parameters * np.log(count)


def stepwise(inputs: Inputs) -> dict[str, object]:
    """Select, fit, name, gaps on the held-out runs."""
    tolerance = {key: value for key, value in inputs.session.tolerance.items() if value > 0}
    regression = Regression(inputs, tolerance)
    chosen: list[str] = []
    start = place_starts(inputs.problem, inputs.nominal, range(len(inputs.session.data)))
    fitted = _refit(regression, start, chosen)
    while len(chosen) < MOST_EFFECTS:
        best, begin = _most_promising(regression, fitted, chosen)
        if begin is None:
            break
        more = [*chosen, best]
        found = _refit(regression, begin, more)
        before, after = (_bic_of(regression, fit, names) for fit, names in ((fitted, chosen), (found, more)))
        if after >= before:
            break
        chosen, fitted = more, found
    return {"named": chosen, "alarm": bool(chosen), "gap": _gaps(inputs, fitted.point)}


def _bic_of(regression: Regression, fit: Fitted, effects: Sequence[str]) -> float:
    return regression.bic(fit.squares, sum(regression.inputs.terms[effect].size for effect in effects))


def _most_promising(regression: Regression, fit: Fitted, chosen: Sequence[str]) -> tuple[str, Point | None]:
    """The effect whose linear fit lowers the BIC most, and where its fit begins; no point where none lowers it."""
    base = regression.columns(chosen)
    offers = _offers(regression.inputs.terms, chosen)
    columns = [*base, *(column for _, group in offers for column in group)]
    views = [item for item in regression.inputs.problem.attempted(fit.point, columns, regression.inputs.fitted) if item]
    response, common = _stacked(views)
    ridge = _ridge(base, regression.tolerance, fit.variance)
    usual = sum(regression.inputs.terms[effect].size for effect in chosen)
    least, found = regression.bic(_squares(response, common[:, : len(base)], ridge)[0], usual), ("", None)
    first = len(base)
    for effect, group in offers:
        mine = [*range(len(base)), *range(first, first + len(group))]
        first += len(group)
        squares, values = _squares(response, common[:, mine], np.pad(ridge, (0, len(group))))
        term, column = regression.inputs.terms[effect], group[0]
        if column.to is not None and not 0.5 < values[-1] < 1.5:
            continue  # half of a stopped motor does not exist
        score = regression.bic(squares, usual + term.size)
        if score < least:
            begin = replace(fit.point, terms={**fit.point.terms, effect: _beginning(term, column, values)})
            least, found = score, (effect, begin)
    return found


def _beginning(term: Candidate, column: Column, values: Floats) -> tuple[float, ...]:
    """Coordinates at which the fit of an effect begins."""
    if column.to is not None:
        return column.to
    if column.start is not None:
        moved = list(column.start)
        moved[0] += float(values[-1])
        return term.clipped(tuple(moved))
    return term.absent


def _offers(terms: Mapping[str, Candidate], chosen: Sequence[str]) -> list[tuple[str, list[Column]]]:
    """Columns of every effect that is not chosen yet; one offer for each place at which it may begin."""
    found: list[tuple[str, list[Column]]] = []
    for effect, term in terms.items():
        if effect in chosen:
            continue
        if term.stepwise:
            found += [(effect, [Column(effect, 0, term, to=start)]) for start in term.starts]
        elif term.starts:
            found += [(effect, [Column(effect, 0, term, start)]) for start in term.starts]
        else:
            found.append((effect, [Column(effect, k, term) for k in range(term.size)]))
    return found


def _refit(regression: Regression, begin: Point, effects: Sequence[str]) -> Fitted:
    """Gauss-Newton from a point, start poses along; the best point met."""
    inputs, columns = regression.inputs, regression.columns(effects)
    point, best = begin, None
    for _ in range(STEPS):
        views = [item for item in inputs.problem.attempted(point, columns, inputs.fitted) if item]
        if len(views) < len(inputs.fitted):
            break
        response, common = _stacked(views)
        at = np.array([point.value(column) for column in columns])
        left = response - common @ at
        variance = float(left @ left) / len(left)
        ridge = _ridge(columns, regression.tolerance, best.variance if best else variance)
        squares = float(left @ left + np.sum((ridge * at) ** 2))
        arrived = best is not None and best.squares - squares < CHANGED * best.squares
        if best is None or squares < best.squares:
            best = Fitted(point, squares, variance)
        if arrived:
            break
        goal = _squares(response, common, ridge, _bounds(columns, regression.tolerance))[1]
        point = place_starts(inputs.problem, best.point.at(columns, goal), inputs.fitted)
    if best is None:  # cannot be simulated: as bad as can be
        return Fitted(begin, np.inf, np.inf)
    return best


def _stacked(views: Sequence[Linearized]) -> tuple[Floats, Floats]:
    """Responses (n,) and common columns (n, p) of all runs, start poses projected out."""
    rows = []
    for view in views:
        basis = np.linalg.qr(view.start)[0]
        block = np.column_stack([view.response, view.common])
        rows.append(block - basis @ (basis.T @ block))
    every = np.concatenate(rows)
    return every[:, 0], every[:, 1:]


def _ridge(columns: Sequence[Column], tolerance: Mapping[str, float], variance: float) -> Floats:
    return np.array([np.sqrt(variance) / tolerance[c.key] if c.term is None else 0.0 for c in columns])


def _bounds(columns: Sequence[Column], tolerance: Mapping[str, float]) -> tuple[Floats, Floats]:
    """How far parameters may go from where they change nothing."""
    pairs = []
    for column in columns:
        if column.term is None:
            most = MOST_TOLERANCES * tolerance[column.key]
            pairs.append((-most, most))
        else:
            held = column.term.coordinates[column.coordinate]
            pairs.append((held.low - held.absent, held.high - held.absent))
    low, high = np.array(pairs).T
    return low, high


def _squares(
    response: Floats, common: Floats, ridge: Floats, bounds: tuple[Floats, Floats] | None = None
) -> tuple[float, Floats]:
    """Least squares with a ridge: the squares left, and the parameters."""
    a, b = np.vstack([common, np.diag(ridge)]), np.concatenate([response, np.zeros(len(ridge))])
    scale = np.linalg.norm(a, axis=0) + 1e-300
    q, r = np.linalg.qr(np.column_stack([a / scale, b]))
    del q
    a, b, rest = r[:-1, :-1], r[:-1, -1], r[-1, -1]
    if bounds is None:
        values = np.linalg.lstsq(a, b, rcond=1e-10)[0]
    else:
        low, high = (side * scale for side in bounds)
        values = lsq_linear(a, b, (low, high)).x
    left = b - a @ values
    return float(left @ left + rest**2), values / scale


def _gaps(inputs: Inputs, point: Point) -> dict[str, float]:
    """The gaps of inputs.gaps_mm, of robots that the simulator can simulate."""
    session, aside = inputs.session, list(inputs.aside)
    placed = place_starts(inputs.problem, replace(point, per_run=inputs.nominal.per_run), aside)
    robots = [
        with_session(corrected_robot(robot, inputs.terms, point), session.known, point) for robot in session.robots
    ]
    predicted, _ = predicted_gaps(as_driven(session.data, session.known, point), robots, session.robots)
    found = {"pose": run_gaps(inputs.problem, placed, aside), "predicted": predicted[aside]}
    return {name: float(np.sqrt(np.mean(values**2))) for name, values in found.items()}
