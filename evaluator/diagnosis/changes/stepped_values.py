"""Values of the laboratory that change once within a session, and a session in which they may.

Marks are glued on anew, a camera is set up again, a plate is put back: the runs before and after have then other
positions of the marks, another scale or another level. With one value for all runs, the difference counts as noise,
which hides effects: with marks 0.1 mm elsewhere from the eighth of fourteen runs on, its floor was 13 and not 5 µm.

Whether a change is found follows from the linearization of a fit, without further simulation. The changed values are
then further quantities with a tolerance, which shift the marks of the later runs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.assessment.verdict import KEEP
from evaluator.diagnosis.changes.parted_session import CHANGE_PRIOR
from evaluator.diagnosis.changes.session_changes import DRIFT
from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.inference.fitted_model import Fit, prior_precision
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.inference.watch import Watch
from evaluator.diagnosis.likelihood.known_to import LATER, LEVEL, SCALE, Quantity, mark_keys
from evaluator.diagnosis.likelihood.linear.mixed_model import MixedModel, Reduced, at_scatter, solve_at
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.diagnosis.mistakes.repainted import FEWEST_OF_PART
from evaluator.diagnosis.search_input import prepared
from evaluator.diagnosis.search_runs import null_alone

Floats = NDArray[np.float64]

CHANGED_VARIANCES = 2.0  # of a change: both values are known to the same tolerance, independently


@dataclass(frozen=True)
class Step:
    """A change of some quantities within a session: the runs after it, by index, and its log odds."""

    quantities: tuple[Quantity, ...]
    runs: tuple[int, ...]
    odds: float


def with_changed_values(search: Search, fit: Fit, session: Session, watch: Watch) -> Session | None:
    """The session with values that changed within it free after the change; None if values of all runs explain it.

    search, fit: of all runs. The place of the change is found again at the noise of the session with it, because the
    change is in the noise before.
    """
    step = step_of_values(search, fit, session) or _step_for_drift(search, fit, session)
    if step is None:
        return None
    changed = with_step(session, step, search.problem, fit)
    try:
        part, again = null_alone(prepared(changed, watch, None))
    except FloatingPointError:  # a run cannot be simulated on the way
        return changed
    if again is None:
        return changed
    moved = step_of_values(part, _without_change(again, step), session, (step.quantities,))
    return changed if moved is None else with_step(session, moved, search.problem, fit)


def _step_for_drift(search: Search, fit: Fit, session: Session) -> Step | None:
    """A change of values that a drift of the speed in a fit approximates; None if it explains less than the drift.

    Beside the drift it explains little: with a scale 0.08 % larger from the ninth of sixteen runs on, its log odds are
    4, and 19 without the drift, which gains 12.
    """
    without = search.fits.get(fit.terms - {DRIFT}) if DRIFT in fit.terms else None
    step = None if without is None else step_of_values(search, without, session)
    if step is None or step.odds <= search.score(fit.terms) - search.score(fit.terms - {DRIFT}):
        return None
    return step


def step_of_values(
    search: Search, fit: Fit, session: Session, kinds: Sequence[tuple[Quantity, ...]] | None = None
) -> Step | None:
    """The most probable change of values within a session; None if values common to all runs explain it as well.

    search, fit: of all runs. kinds: quantities that may change together. With a prior that allows any place in the
    session and any kind of change, the evidence must grow by what an effect must gain, and not for single runs.
    """
    order = np.array([session.data[run].order for run in fit.runs])
    begins = np.sort(order)[FEWEST_OF_PART : len(order) - FEWEST_OF_PART + 1]
    kinds = _kinds(session) if kinds is None else kinds
    alone = MixedModel(fit.reduced, prior_precision(fit.columns, search.tolerance))
    before = alone.log_evidence(range(len(fit.columns)))
    found = None
    for kind in kinds:
        keys = [item.key for item in kind]
        at = [number for number, column in enumerate(fit.columns) if column.term is None and column.key in keys]
        for begin in begins if at else ():
            reduced, later = _with_later(fit.reduced, at, order >= begin), alone.prior[at] / CHANGED_VARIANCES
            evidence = MixedModel(reduced, np.append(alone.prior, later)).log_evidence(range(reduced.g.shape[1]))
            odds = evidence - before + math.log(CHANGE_PRIOR / (len(begins) * len(kinds)))
            if odds > (KEEP[1] if found is None else found.odds) and _is_of_many(fit, alone.prior, reduced, later):
                after = [run for run, item in enumerate(session.data) if item.order >= begin]
                found = Step(kind, tuple(after), odds)
    return found


def with_step(session: Session, step: Step, problem: Problem, fit: Fit) -> Session:
    """The session in which values may differ between the runs before and after a step; problem, fit: of all its runs.

    A change shifts the marks of the later runs as the fit with it says, by one standard deviation.
    """
    sigma = math.sqrt(CHANGED_VARIANCES)
    changes = tuple(
        Quantity(
            f"{item.key}{LATER}",
            f"change of {item.name}, from {session.data[step.runs[0]].id} on",
            item.unit,
            sigma * item.sigma,
            sigma * item.per_unit,
            session.data[step.runs[0]].id,
        )
        for item in step.quantities
    )
    data = list(session.data)
    here = dict(zip(step.runs, problem.forward.marks([fit.point.task(run) for run in step.runs]), strict=True))
    for item, change in zip(step.quantities, changes, strict=True):
        nominal = {**fit.point.nominal, item.key: fit.point.nominal.get(item.key, 0.0) + item.tolerance}
        moved = problem.forward.marks([replace(fit.point, nominal=nominal).task(run) for run in step.runs])
        for run, marks in zip(step.runs, moved, strict=True):
            shift = sigma * np.nan_to_num(marks - here[run])
            data[run] = replace(data[run], systematic={**data[run].systematic, change.key: shift})
    return replace(session, data=tuple(data), known=(*session.known, *changes))


def _is_of_many(fit: Fit, prior: Floats, reduced: Reduced, later: Floats) -> bool:
    """Whether a change also explains the runs better without those that it explains best, too few for a part.

    A change for the sake of one or two odd runs explains the others beside them worse. prior, later: precisions of the
    columns and of the changes; reduced: with these.
    """
    tau = fit.posterior.scatter
    misfits = []
    for part, precision in ((fit.reduced, prior), (reduced, np.append(prior, later))):
        theta = solve_at(part, precision, tau)
        s, g, G = at_scatter(part, tau)
        misfits.append(s - 2 * g @ theta + np.einsum("p,npq,q->n", theta, G, theta))
    gains = np.sort(misfits[0] - misfits[1])
    return bool(gains[: 1 - FEWEST_OF_PART].sum() > 0)


def _kinds(session: Session) -> list[tuple[Quantity, ...]]:
    """Quantities that change together: positions of the marks, the scale, the level; without those free to change."""
    changed = {item.key.removesuffix(LATER) for item in session.known if item.since}
    groups = (mark_keys(session.robots[0]), (SCALE,), LEVEL)
    kinds = [tuple(item for item in session.known if item.key in keys) for keys in groups]
    return [kind for kind in kinds if kind and not changed & {item.key for item in kind}]


def _without_change(fit: Fit, step: Step) -> Fit:
    """A fit without the columns of the values that changed, which are as before again."""
    changed = {f"{item.key}{LATER}" for item in step.quantities}
    keep = np.array([column.key not in changed for column in fit.columns])
    columns = tuple(column for column, is_kept in zip(fit.columns, keep, strict=True) if is_kept)
    return replace(fit, columns=columns, reduced=fit.reduced.of_columns(keep, np.zeros(len(keep))))


def _with_later(reduced: Reduced, columns: Sequence[int], later: NDArray[np.bool_]) -> Reduced:
    """Statistics with these columns once more, of the later runs only; later: (n,)."""
    mask = later.astype(np.float64)
    own = reduced.G[:, :, columns] * mask[:, None, None]
    return replace(
        reduced,
        g=np.concatenate([reduced.g, reduced.g[:, columns] * mask[:, None]], axis=1),
        G=np.concatenate(
            [
                np.concatenate([reduced.G, own], axis=2),
                np.concatenate([own.transpose(0, 2, 1), own[:, columns]], axis=2),
            ],
            axis=1,
        ),
        C=np.concatenate([reduced.C, reduced.C[:, :, columns] * mask[:, None, None]], axis=2),
    )
