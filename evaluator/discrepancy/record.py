"""diagnosis.json: the verdict for programs, in the fields of the file contract, with words for people beside them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evaluator.discrepancy.diagnosis import Diagnosis
from evaluator.discrepancy.fit import place_runs
from evaluator.discrepancy.forward import SHARED_UNIT, is_shared
from evaluator.discrepancy.free import FreeTerm
from evaluator.discrepancy.gap import rms
from evaluator.discrepancy.next_runs import MOST_RUNS
from evaluator.discrepancy.rivals import SAME_SIGMAS, Set, is_free
from evaluator.discrepancy.terms import Parameters, Term
from evaluator.discrepancy.where import QUANTITIES, Interval, pieces, root_mean_squares
from simulator.effects.catalogue import EFFECTS

Floats = NDArray[np.float64]
Json = dict[str, Any]

DRAWS = 4000
DRAW_SEED = 20120612  # intervals of directions and anchors are read from draws; the same input gives the same output
RIVALS_LISTED = 8


def record(diagnosis: Diagnosis) -> Json:
    """The content of diagnosis.json."""
    found: Json = {"format": 1, "verdict": diagnosis.verdict, "reason": diagnosis.reason}
    if diagnosis.search is None:
        return found | {
            "effects": [],
            "gap": None,
            "where": [],
            "rivals": [],
            "next_experiment": None,
            "skipped_runs": dict(diagnosis.session.skipped),
        }
    return found | {
        "effects": _effects(diagnosis),
        "gap": _gap(diagnosis),
        "where": [
            {
                "quantity": item.quantity,
                "by": item.by,
                "parity": item.parity or None,
                "sigmas": _rounded(item.sigmas),
                "sentence": item.sentence,
            }
            for item in diagnosis.where
        ],
        "rivals": _rivals(diagnosis),
        "next_experiment": _next(diagnosis),
        "constancy": {item.halves: _rounded(item.probability) for item in diagnosis.constancy},
        "runs_not_followed": [diagnosis.session.data[run].id for run in diagnosis.astray],
        "noise": _noise(diagnosis),
        "nominal": _nominal(diagnosis),
        "shared_errors_sigmas": _shared(diagnosis),
        "skipped_runs": dict(diagnosis.session.skipped),
    }


def disagreement(diagnosis: Diagnosis) -> pd.DataFrame | None:
    """The pieces of the runs with what the model misses before and after (columns after_…); None where none."""
    if diagnosis.pieces is None or diagnosis.problem is None:
        return None
    fit, runs = diagnosis.fit, range(len(diagnosis.session.data))
    after = pieces(diagnosis.problem, place_runs(diagnosis.problem, fit.point, runs, fit.posterior.scatter))
    renamed = {name: f"after_{name}" for name in QUANTITIES}
    held = {diagnosis.session.data[run].id for run in diagnosis.held_out}
    both = pd.concat([diagnosis.pieces, after[list(QUANTITIES)].rename(columns=renamed)], axis=1)
    return both.assign(kept_aside=both["run"].isin(held))


def _effects(diagnosis: Diagnosis) -> list[Json]:
    """What was chosen; where nothing that could be fitted follows the marks, the disagreement itself."""
    explained = diagnosis.chosen and diagnosis.follows
    if explained or diagnosis.verdict != "unknown" or diagnosis.pieces is None or diagnosis.pieces.empty:
        return [_effect(diagnosis, effect) for effect in sorted(diagnosis.chosen)]
    sizes = root_mean_squares(diagnosis.pieces)
    return [
        {
            "id": "free-form",
            "name": "an error of the robot's speed" + "".join(f"; {s}" for s in _strongest(diagnosis)),
            "parameters": {f"rms_{name}": _bounded(values) for name, values in sizes.items()},
            "equivalent": [],
            "probability": 1.0,
            "fitted": False,
            "terms": [
                {
                    "channel": item.quantity,
                    "basis": item.by,
                    "parity": item.parity or None,
                    "coefficients": [_bounded(values) for values in item.sizes],
                }
                for item in diagnosis.where
            ],
        }
    ]


def _strongest(diagnosis: Diagnosis) -> list[str]:
    return [item.sentence for item in diagnosis.where[:1]]


def _bounded(values: Interval) -> Json:
    value, low, high = values
    return {"value": _rounded(value), "low": _rounded(low), "high": _rounded(high)}


def _effect(diagnosis: Diagnosis, effect: str) -> Json:
    assert diagnosis.terms is not None
    assert diagnosis.standing is not None
    term = diagnosis.terms[effect]
    probability = diagnosis.standing.containing(effect)
    shown: Json = {
        "id": "free-form" if is_free(effect) else effect,
        "name": term.describe() if isinstance(term, FreeTerm) else EFFECTS[effect].name,
        "parameters": parameters(diagnosis, term),
        "equivalent": equivalents(diagnosis, effect),
        "probability": round(probability, 4),
    }
    if isinstance(term, FreeTerm):
        shown["terms"] = [
            {"channel": item.channel, "basis": item.basis, "pattern": item.pattern} for item in term.items
        ]
    return shown


def equivalents(diagnosis: Diagnosis, effect: str) -> list[str]:
    """Effects that these runs cannot tell from a named one, the nearest first."""
    apart = dict((diagnosis.separation or {}).get(effect, {}))
    apart.pop("", None)
    near = sorted((distance, other) for other, distance in apart.items() if distance < SAME_SIGMAS)
    return [other for _, other in near]


def parameters(diagnosis: Diagnosis, term: Term) -> Json:
    """Value and 95 % interval of every physical parameter of a term of the chosen set."""
    fit = diagnosis.fit
    values = fit.point.terms[term.id]
    if term.leaps:
        return _leap(term, values)
    own = [i for i, column in enumerate(fit.columns) if column.key == term.id]
    covariance = fit.posterior.covariance[np.ix_(own, own)]
    # the scatter is estimated from few runs: the spread over its grid is in the covariance, Student's tail is not
    # nor is a covariance that rounding has made a little uneven (effects that all but stand for each other) an error
    draws = np.random.default_rng(DRAW_SEED).multivariate_normal(
        values, covariance, DRAWS, check_valid="ignore", method="svd"
    )
    physical = [term.physical(term.clipped(tuple(row))) for row in draws]
    best = term.physical(values)
    return {name: _interval(name, best, [item[name] for item in physical]) for name in best}


def _interval(name: str, best: Parameters, draws: Sequence[float]) -> Json:
    value = best[name]
    if name.endswith(("azimuth_deg", "phase_deg", "direction_deg")):
        period = 180.0 if name == "direction_deg" else 360.0
        turned = (np.array(draws) - value + period / 2) % period - period / 2
        low, high = value + np.percentile(turned, [2.5, 97.5])
    else:
        low, high = np.percentile(draws, [2.5, 97.5])
    return _bounded((value, float(low), float(high)))


def _leap(term: Term, values: Sequence[float]) -> Json:
    """A dead band lies anywhere between two commands that were given."""
    low, high = next(edges for edges in term.between if edges[0] <= values[0] <= edges[1])
    return {"rpm": {"value": _rounded(values[0]), "low": _rounded(low), "high": _rounded(high)}}


def _gap(diagnosis: Diagnosis) -> Json:
    gap, search = diagnosis.gap, diagnosis.fit_search
    assert gap is not None
    assert search is not None
    ids = [run.id for run in diagnosis.session.data]
    held = diagnosis.held_out

    def pair(values: Floats) -> Json:
        return {"fit": _rounded(rms(values, search.runs)), "held_out": _rounded(rms(values, held))}

    everything = range(len(ids))
    return {
        "unit": "mm",
        "held_out_runs": [ids[run] for run in held],
        "before": pair(gap.before_mm),
        "after": pair(gap.after_mm),
        "noise_floor": _rounded(rms(gap.floor_mm, everything)),
        "held_out_gain_sigmas": _rounded(math.sqrt(max(2 * diagnosis.confirmation, 0.0)))
        if math.isfinite(diagnosis.confirmation)
        else None,
        "by_run": {
            effect: {"before": _rounded(b), "after": _rounded(a), "noise_floor": _rounded(f)}
            for effect, b, a, f in zip(ids, gap.before_mm, gap.after_mm, gap.floor_mm, strict=True)
        },
    }


def _rivals(diagnosis: Diagnosis) -> list[Json]:
    table = diagnosis.standing
    assert table is not None
    best = table.of(diagnosis.chosen)
    rivals: list[Json] = []
    for ids, score, probability in zip(table.sets, table.scores, table.probability, strict=True):
        if ids != diagnosis.chosen and len(rivals) < RIVALS_LISTED:
            rivals.append(
                {
                    "effects": names(ids),
                    "probability": round(float(probability), 4),
                    "log_odds": _rounded(float(score) - best),
                    "reason": _reason(diagnosis, ids, float(score) - best),
                }
            )
    return rivals


def names(ids: Set) -> list[str]:
    """Effect ids of a set, sorted; free-form terms keep their grammar."""
    return sorted(ids)


def _reason(diagnosis: Diagnosis, ids: Set, odds: float) -> str:
    chosen = diagnosis.chosen
    if not ids:
        return f"without any effect the runs are {_times(odds)} less probable"
    if ids < chosen:
        return f"leaving out {', '.join(sorted(chosen - ids))} makes the runs {_times(odds)} less probable"
    if ids > chosen:
        return f"adding {', '.join(sorted(ids - chosen))} does not pay for its parameters"
    return f"makes the runs {_times(odds)} less probable" if odds < 0 else "an effect in it does not pay for itself"


def _times(odds: float) -> str:
    """A factor for people, from the logarithm of its inverse."""
    if -odds > math.log(1e4):
        return f"10^{-odds / math.log(10):.0f} times"
    return f"{math.exp(-odds):.{1 if -odds < math.log(10) else 0}f} times"


def _next(diagnosis: Diagnosis) -> Json | None:
    """Runs to make, each with how many times, what they would separate, and what no runs would."""
    following = diagnosis.next_runs
    if following is None:
        return None
    times = Counter(following.runs)
    return {
        "runs": [
            {
                "left_rpm": run.left_rpm,
                "right_rpm": run.right_rpm,
                "x_mm": run.x_mm,
                "y_mm": run.y_mm,
                "heading_deg": run.heading_deg,
                "duration_s": run.duration_s,
                "times": count,
            }
            for run, count in times.items()
        ],
        "separation_sigmas": {name: _rounded(value) for name, value in following.sigmas.items()},
        "most_runs": MOST_RUNS,
        "inseparable_sigmas": {name: _rounded(value) for name, value in following.inseparable.items()},
    }


def _noise(diagnosis: Diagnosis) -> Json:
    problem = diagnosis.problem
    assert problem is not None
    parts = problem.noise
    tau = diagnosis.fit.posterior.scatter
    return {
        "mark_sigma_mm": _rounded(float(np.median([p[0].sigma_mm for p in parts])) * math.sqrt(2)),
        "correlation_s": _rounded(parts[0][0].correlation_s),
        "run_to_run": {"friction": _rounded(float(tau[0])), "wheel_speed": _rounded(float(tau[1]))},
    }


def _nominal(diagnosis: Diagnosis) -> Json:
    """Where nominal values went within their tolerances."""
    fit = diagnosis.fit
    spread = np.sqrt(np.diag(fit.posterior.covariance))
    return {
        column.key: {
            "relative_change": _rounded(fit.point.value(column)),
            "sigma": _rounded(float(spread[i])),
            "tolerance": diagnosis.session.tolerance[column.key],
        }
        for i, column in enumerate(fit.columns)
        if column.term is None and not is_shared(column.key)
    }


def _shared(diagnosis: Diagnosis) -> Json | None:
    """How far the errors that runs share (of the camera) were moved, each in its sigmas; None where there are none."""
    point = diagnosis.fit.point
    moved = {key: point.nominal.get(key, 0.0) / SHARED_UNIT for key in diagnosis.session.tolerance if is_shared(key)}
    return {key: _rounded(value) for key, value in moved.items()} or None


def _rounded(value: float) -> float | None:
    """Six significant digits; None for what JSON cannot say."""
    return float(f"{value:.6g}") if math.isfinite(value) else None
