"""Runs that the model explains with friction or wheel speeds that differ from the other runs, for diagnosis.json."""

from __future__ import annotations

from evaluator.diagnosis.assessment.adequacy import Adequacy, Unlike, unlike_repeats, unlike_runs
from evaluator.diagnosis.changes.session_changes import FrictionChange, friction_change, without_change
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.output.content import UnlikeRunsContent
from evaluator.diagnosis.output.effects_json import rounded
from evaluator.diagnosis.result import Diagnosis

WHEELS = {"left_gain": "the left wheels turn", "right_gain": "the right wheels turn"}


def unlike(diagnosis: Diagnosis) -> list[UnlikeRunsContent]:
    """One entry for runs with the same deviation from the others; of wheel speeds, if it is relevant."""
    if diagnosis.leftover is None or not diagnosis.follows or diagnosis.verdict not in ("none", "effect"):
        return []
    changed = friction_change(diagnosis.leftover, diagnosis.fit.runs, diagnosis.session.data)
    found = [] if changed is None else [_over_session(changed, diagnosis)]
    left = diagnosis.leftover
    if changed is not None:
        left = without_change(left, diagnosis.fit.runs, changed, diagnosis.session.data)
    for item in _all_unlike(left, diagnosis):
        percent = 100 * item.change
        if item.what in WHEELS and abs(percent) <= diagnosis.session.relevant.speed_percent:
            continue
        runs = [diagnosis.session.data[run].id for run in item.runs]
        if item.what in WHEELS:
            seen = f"{WHEELS[item.what]} {abs(percent):.2g} % {'faster' if percent > 0 else 'slower'}"
        else:
            seen = f"friction is {abs(percent):.2g} % {'higher' if percent > 0 else 'lower'}"
        found.append(
            {
                "runs": runs,
                "quantity": item.what,
                "relative_change": rounded(item.change),
                "sentence": f"{', '.join(runs)}: {seen} than in the other runs{' of its command' * item.of_command}",
            }
        )
    return found


def _all_unlike(left: Adequacy, diagnosis: Diagnosis) -> list[Unlike]:
    """Runs unlike all others, then those unlike the other runs of their command that are not among them."""
    runs = diagnosis.fit.runs
    found = unlike_runs(left, runs)
    known = {(run, item.what) for item in found for run in item.runs}
    robots = diagnosis.session.robots
    commands = [(*_command(diagnosis.session.data[run]), robots.index(robots[run])) for run in runs]
    return found + [item for item in unlike_repeats(left, runs, commands) if (item.runs[0], item.what) not in known]


def _command(run: RunData) -> tuple[object, ...]:
    """What a run must share with another to repeat it; a log of commands is repeated by no other run."""
    return (run.left_rpm, run.right_rpm) if run.log is None else (run.id,)


def _over_session(changed: FrictionChange, diagnosis: Diagnosis) -> UnlikeRunsContent:
    """The entry for a friction that changes over the session."""
    runs = [diagnosis.session.data[run].id for run in changed.runs]
    percent = 100 * changed.change
    if changed.once:
        way = "higher" if percent > 0 else "lower"
        sentence = f"from {runs[0]} on, friction is {abs(percent):.2g} % {way} than before: was the plate cleaned?"
    else:
        way = "rises" if percent > 0 else "falls"
        sentence = (
            f"friction {way} by {abs(percent):.2g} % over the session, from {runs[0]} to {runs[-1]}: "
            f"clean the plate and the wheels before each run"
        )
    return {
        "runs": runs,
        "quantity": "friction",
        "relative_change": rounded(changed.change),
        "sentence": sentence,
    }
