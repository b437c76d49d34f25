"""diagnosis.json: the verdict with its evidence, in the keys of `content`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evaluator.diagnosis.assessment.knowledge import FINDING_SIGMAS
from evaluator.diagnosis.assessment.relevance import Changes
from evaluator.diagnosis.assessment.residuals.disagreeing_runs import NAMES, RunDisagreement, disagreeing_runs
from evaluator.diagnosis.assessment.residuals.disagreement import QUANTITIES, UNITS
from evaluator.diagnosis.assessment.sufficiency import not_driven
from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.likelihood.run_data import SHARED_UNIT, is_shared
from evaluator.diagnosis.mistakes.recognised import Mistake
from evaluator.diagnosis.output.alternatives_json import next_experiment, rivals
from evaluator.diagnosis.output.content import (
    ChangesContent,
    DiagnosisContent,
    DisagreesContent,
    GapContent,
    KnownToContent,
    KnownTogetherContent,
    MistakeContent,
    NegligibleContent,
    NoiseContent,
    NominalContent,
    Number,
    PairContent,
    WhereContent,
)
from evaluator.diagnosis.output.effects_json import effect_content, effects, rounded
from evaluator.diagnosis.output.scatter_json import run_to_run
from evaluator.diagnosis.output.unlike_runs import unlike
from evaluator.diagnosis.result import Diagnosis
from evaluator.diagnosis.search_ground import acts_on_drive
from evaluator.turning.motion.curvature import Z_975
from evaluator.wording import name_of_value
from simulator.effects.catalogue import BUILT_IN, EFFECTS

FRICTIONS = ("slip.longitudinal_friction", "slip.lateral_friction")
Floats = NDArray[np.float64]


def record(diagnosis: Diagnosis) -> DiagnosisContent:
    """The content of diagnosis.json."""
    found: DiagnosisContent = {
        "format": 1,
        "verdict": diagnosis.verdict,
        "reason": diagnosis.reason,
        "mistakes": [_mistake(item) for item in diagnosis.session.mistakes],
        "effects": [],
        "gap": None,
        "negligible": [],
        "known_to": [],
        "where": [],
        "disagrees": [],
        "rivals": [],
        "next_experiment": None,
        "skipped_runs": dict(diagnosis.session.skipped),
        "left_out_runs": dict(diagnosis.session.left_out),
    }
    if diagnosis.session.explained:
        found["explained_mistakes"] = [_mistake(item) for item in diagnosis.session.explained]
    if diagnosis.stopped:
        found["stopped"] = True
    if diagnosis.search is None:
        return found
    table = disagreement(diagnosis)
    apart = [] if table is None or table.empty else disagreeing_runs(table)
    return {
        **found,
        "effects": effects(diagnosis),
        "negligible": _negligible(diagnosis),
        "known_to": _known_to(diagnosis),
        "known_together": _together(diagnosis),
        "findings": [*(item.sentence for item in diagnosis.known if item.is_finding), *_far_nominal(diagnosis)],
        "gap": _gap(diagnosis),
        "where": _where(diagnosis, apart),
        "disagrees": _disagrees(apart),
        "rivals": rivals(diagnosis),
        "next_experiment": next_experiment(diagnosis),
        "constancy": {item.halves: rounded(item.probability) for item in diagnosis.constancy},
        "runs_not_followed": [diagnosis.session.data[run].id for run in diagnosis.outlying],
        "unlike_runs": unlike(diagnosis),
        "noise": _noise(diagnosis),
        "nominal": _nominal(diagnosis),
        "shared_errors_sigmas": _shared(diagnosis),
        "limits": [
            {"id": item.effect, "parameter": item.parameter, "low": rounded(item.low), "high": rounded(item.high)}
            for item in diagnosis.limits
        ],
        "not_tried": _not_tried(diagnosis.session),
        "not_driven": not_driven(
            [(item.left_rpm, item.right_rpm) for run in diagnosis.session.data for item in run.run_command.driven]
        ),
        "exact_frictions": _exact_frictions(diagnosis),
    }


def _mistake(item: Mistake) -> MistakeContent:
    return {
        "runs": list(item.runs),
        "kind": item.kind,
        "equivalent_kinds": list(item.equivalent_kinds),
        "sentence": item.sentence,
    }


def _negligible(diagnosis: Diagnosis) -> list[NegligibleContent]:
    return [
        {"id": item["id"], "parameters": item["parameters"], "changes": _changes(diagnosis.changes[effect])}
        for effect in sorted(diagnosis.negligible)
        for item in [effect_content(diagnosis, effect)]
    ]


def _known_to(diagnosis: Diagnosis) -> list[KnownToContent]:
    rows: list[KnownToContent] = []
    for item in diagnosis.known:
        row: KnownToContent = {
            "quantity": item.quantity.key,
            "name": item.quantity.name,
            "unit": item.quantity.unit,
            "taken": rounded(item.quantity.sigma),
            "found": rounded(item.found),
            "low": rounded(item.low),
            "high": rounded(item.high),
            "equivalent": list(item.equivalent),
        }
        if item.quantity.since:
            row["from_run"] = item.quantity.since
        rows.append(row)
    return rows


def _disagrees(apart: Sequence[RunDisagreement]) -> list[DisagreesContent]:
    return [
        {
            "run": item.run,
            "phase": item.phase,
            "quantity": item.quantity,
            "size": rounded(item.size),
            "sigmas": rounded(item.sigmas),
        }
        for item in apart
    ]


def _changes(found: Changes) -> ChangesContent:
    """The changes with three significant digits."""
    path, radius, speed = (float(f"{value:.3g}") for value in astuple(found))
    return {"path_noise_floors": path, "radius_percent": radius, "speed_percent": speed}


def _not_tried(session: Session) -> list[str]:
    """Effects that these runs cannot show: of the plate without a common frame, from run to run without repetitions."""
    asked = (*BUILT_IN, *session.own)
    hidden = {effect for effect in asked if EFFECTS[effect].of_plate and not session.one_frame}
    hidden |= {effect for effect in asked if EFFECTS[effect].varies_by_run and not session.commands_recur}
    return sorted(hidden)


def _exact_frictions(diagnosis: Diagnosis) -> list[str]:
    """Frictions without a tolerance, where an effect of the drive was found on open ground.

    Their ratio determines the yaw rate that a difference of the wheel speeds gives: a wrong one passes to the drive.
    """
    search = diagnosis.search
    if search is None or not search.problem.open_ground or not any(map(acts_on_drive, diagnosis.chosen)):
        return []
    return [key for key in FRICTIONS if key not in diagnosis.session.tolerance]


def _together(diagnosis: Diagnosis) -> KnownTogetherContent | None:
    found = diagnosis.known_together
    if found is None:
        return None
    return {
        "square": rounded(found.square),
        "freedom": found.freedom,
        "probability": rounded(found.probability),
        "sentence": found.sentence(diagnosis.session.known) if found.is_finding else None,
    }


def _where(diagnosis: Diagnosis, apart: Sequence[RunDisagreement]) -> list[WhereContent]:
    after = {(item.quantity, item.by, item.parity): item.sigmas for item in diagnosis.left}
    return [
        {
            "quantity": NAMES[item.quantity],
            "by": item.by,
            "depends_on": item.by,
            "parity": item.parity or None,
            "runs": list(dict.fromkeys(each.run for each in apart if each.quantity == NAMES[item.quantity])),
            "size": rounded(math.hypot(*(size for size, _, _ in item.sizes))),
            "unit": UNITS[item.quantity],
            "sigmas": rounded(item.sigmas),
            "after_sigmas": rounded(after.get((item.quantity, item.by, item.parity), math.nan)),
            "sentence": item.sentence,
        }
        for item in diagnosis.where
    ]


def disagreement(diagnosis: Diagnosis) -> pd.DataFrame | None:
    """The pieces of the runs with their residuals before and after (columns after_…); None if there are none."""
    if diagnosis.pieces is None or diagnosis.pieces_after is None:
        return None
    renamed = {name: f"after_{name}" for name in QUANTITIES}
    held = {diagnosis.session.data[run].id for run in diagnosis.held_out}
    both = pd.concat([diagnosis.pieces, diagnosis.pieces_after[list(QUANTITIES)].rename(columns=renamed)], axis=1)
    return both.assign(kept_aside=both["run"].isin(held))


def _gap(diagnosis: Diagnosis) -> GapContent:
    gap, search = diagnosis.gap, diagnosis.fit_search
    assert gap is not None
    assert search is not None
    ids = [run.id for run in diagnosis.session.data]
    held = diagnosis.held_out

    def pair(values: Floats) -> PairContent:
        return {"fit": rounded(gap.rms(values, search.runs)), "held_out": rounded(gap.rms(values, held))}

    everything = range(len(ids))
    return {
        "unit": "mm",
        "held_out_runs": [ids[run] for run in held],
        "before": pair(gap.before_mm),
        "after": pair(gap.after_mm),
        "predicted": {"before": pair(gap.predicted_before_mm), "after": pair(gap.predicted_after_mm)},
        "not_predicted": {ids[run]: reason for run, reason in sorted(gap.not_predicted.items())},
        "elsewhere": [ids[run] for run in gap.elsewhere],
        "diverging": [ids[run] for run in gap.diverging],
        "noise_floor": rounded(gap.rms(gap.floor_mm, everything)),
        "held_out_gain_sigmas": rounded(math.sqrt(max(2 * diagnosis.confirmation, 0.0)))
        if math.isfinite(diagnosis.confirmation)
        else None,
        "by_run": {
            run: {"before": rounded(b), "after": rounded(a), "noise_floor": rounded(f)}
            for run, b, a, f in zip(ids, gap.before_mm, gap.after_mm, gap.floor_mm, strict=True)
        },
    }


def _noise(diagnosis: Diagnosis) -> NoiseContent:
    problem = diagnosis.problem
    assert problem is not None
    parts = problem.noise
    common = problem.common_drift
    span_s = float(np.median([np.ptp(run.time_s) for run in problem.data]))
    # the midpoint of two marks with independent errors has half the variance of one of them; a common drift does not
    # average out
    independent = [math.sqrt(p[0].sigma_mm ** 2 - common.size_mm**2) for p in parts]
    return {
        "mark_sigma_mm": rounded(float(np.median(independent)) * math.sqrt(2)),
        "common_drift_mm": rounded(common.about_mean_mm(span_s)),
        "friction_in_10_mm": rounded(problem.friction_wander * math.sqrt(10.0)),
        "correlation_s": rounded(parts[0][0].correlation_s),
        "smoothed": problem.smoothed_over > 0,
        "smoothed_over_frames": problem.smoothed_over,
        "run_to_run": None if problem.open_ground else run_to_run(diagnosis),
    }


def _nominal(diagnosis: Diagnosis) -> dict[str, NominalContent]:
    """Adjustments of nominal values within their tolerances."""
    fit = diagnosis.fit
    spread = np.sqrt(np.diag(fit.posterior.covariance))
    return {
        column.key: {
            "relative_change": rounded(fit.point.value(column)),
            "sigma": rounded(float(spread[i])),
            "tolerance": diagnosis.session.tolerance[column.key],
        }
        for i, column in enumerate(fit.columns)
        if column.term is None and not is_shared(column.key)
    }


def _far_nominal(diagnosis: Diagnosis) -> list[str]:
    """Sentences on nominal values far beyond their relative tolerance, of a model that follows the runs."""
    told = {item.quantity.key for item in diagnosis.known}
    found = []
    for key, item in (_nominal(diagnosis) if diagnosis.follows else {}).items():
        change, tolerance, sigma = item["relative_change"] or 0.0, item["tolerance"], item["sigma"] or 0.0
        if key not in told and abs(change) > FINDING_SIGMAS * max(tolerance, sigma):
            half = Z_975 * sigma
            interval = f"[95 %: {100 * (change - half):.2g} to {100 * (change + half):.2g}]"
            found.append(
                f"{name_of_value(key)}: off by {100 * change:+.2g} % {interval}, tolerance {100 * tolerance:.2g} %"
            )
    return found


def _shared(diagnosis: Diagnosis) -> dict[str, Number] | None:
    """Fitted errors that runs share (of the camera), each over its sigma; None if there are none."""
    point = diagnosis.fit.point
    moved = {key: point.nominal.get(key, 0.0) / SHARED_UNIT for key in diagnosis.session.tolerance if is_shared(key)}
    return {key: rounded(value) for key, value in moved.items()} or None
