"""Runs that were taken for mistakes before an effect was known, and that are none with that effect.

Mistakes are recognised by a model without effects. A strong effect may move a run as another command would: a robot
that turned on the spot was pulled by a spring onto the path of a wide turn, and moves as its file says with the spring.
Or it leads a run so near to a change from one turn to the other that no model tells which, and a mistake fits no better
than the file any more. Such a run is no mistake; it is not fitted, but reported with this reason.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from evaluator.diagnosis.assessment.gap import OF_WANDER
from evaluator.diagnosis.assessment.sole_run import is_near
from evaluator.diagnosis.likelihood.known_to import predicted_sigmas
from evaluator.diagnosis.likelihood.linear.random_effects import place_runs
from evaluator.diagnosis.likelihood.preparation import build_problem, with_noise_of
from evaluator.diagnosis.likelihood.run_data import START_POSE
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.diagnosis.mistakes.misread.hypotheses import misread_runs
from evaluator.diagnosis.mistakes.misread.judgement import TURNING
from evaluator.diagnosis.mistakes.recognised import Kind
from evaluator.diagnosis.output.effect_tables import corrected_robot
from evaluator.diagnosis.result import Diagnosis

# Mistakes that are recognised by what a model predicts; the others show in the marks or in the files.
BY_MODEL: tuple[Kind, ...] = (
    "late-start",
    "stuck",
    "wrong-rate",
    "mirrored",
    "reversed",
    "sides-swapped",
    "wrong-command",
)
READ: tuple[Kind, ...] = ("wrong-rate", "marks-swapped", *TURNING, "wrong-command")  # from the shape of the path


def without_explained_mistakes(found: Diagnosis) -> Diagnosis:
    """The diagnosis without mistakes of single runs that its effects explain; these runs are listed as left out."""
    if found.verdict != "effect" or not found.follows or found.search is None or found.search.problem.open_ground:
        return found
    session = found.session
    single = [item for item in session.mistakes if len(item.runs) == 1 and not item.everywhere]
    moving = {item.runs[0] for item in single if item.kind in BY_MODEL and _is_explained(found, item.runs[0])}
    asked = {item.runs[0] for item in single if item.kind in READ} - moving
    unread = asked - _read_so(found, asked) if asked else set()
    if not moving | unread:
        return found
    explained = tuple(item for item in single if item.runs[0] in moving | unread)
    with_them = f"at first; with {' and '.join(sorted(found.chosen))}"
    as_file, neither = "it moves as its file says", "that fits it no better than its file, and neither shows anything"
    reasons = {
        item.runs[0]: f"taken for {item.kind} {with_them} {as_file if item.runs[0] in moving else neither}"
        for item in explained
    }
    kept = tuple(item for item in session.mistakes if item not in explained)
    session = replace(session, mistakes=kept, explained=explained)
    return replace(found, session=replace(session, left_out={**session.left_out, **reasons}))


def _read_so(found: Diagnosis, names: Collection[str]) -> set[str]:
    """Those of some runs that were set aside which the model with the effects found takes for mistakes as well."""
    assert found.terms is not None
    aside = [(run, robot) for run, robot in found.session.aside if run.id in names]
    used = [*aside, *zip(found.session.data, found.session.robots, strict=True)]
    robots = [corrected_robot(robot, found.terms, found.fit.point) for _, robot in used]
    lost = set(names) - {run.id for run, _ in aside}  # not kept, so that nothing new is known of them
    return lost | {item.run for item in misread_runs([run for run, _ in used], robots)}


def _is_explained(found: Diagnosis, name: str) -> bool:
    """Whether a run that was set aside moves as its file says, by the fitted model, within noise.

    Its friction, gains and start must be those of the other runs: with others, gains of 0.4, the model even follows a
    run whose sides are exchanged.
    """
    session, search, terms = found.session, found.search, found.terms
    assert search is not None
    assert terms is not None
    aside = [(run, robot) for run, robot in session.aside if run.id == name]
    if not aside:
        return False
    (run, robot), fit = aside[0], found.fit
    try:
        forward = Simulated([robot], [run], terms, predicted_sigmas(session.known), session.start_sigma_s)
        problem, start = build_problem([run], forward, change_sigma_s=session.start_sigma_s)
        drifting = replace(
            problem, common_drift=search.problem.common_drift, friction_wander=search.problem.friction_wander
        )
        point = replace(fit.point, per_run=start.per_run)
        problem = with_noise_of(drifting, point).of_tracking
        placed = place_runs(problem, point, [0], fit.posterior.scatter)
        usual = np.abs(placed.per_run[0, START_POSE:]) <= OF_WANDER * fit.posterior.scatter
        return bool(usual.all()) and is_near(problem, placed, 0)
    except FloatingPointError:  # it cannot be simulated
        return False
