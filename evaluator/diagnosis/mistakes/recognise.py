"""Recognition of all mistakes of a session, in the order in which one can hide another."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from evaluator.diagnosis.candidates.coordinates import on_open_ground
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.disturbances import disturbed_runs, standing_runs, wrong_scale
from evaluator.diagnosis.mistakes.frame_times import runs_with_lost_frames, wrong_seconds
from evaluator.diagnosis.mistakes.misread.command_unit import share_a_factor
from evaluator.diagnosis.mistakes.misread.dead_band import beyond_a_dead_band
from evaluator.diagnosis.mistakes.misread.hypotheses import Misread, misread
from evaluator.diagnosis.mistakes.misread.judgement import OTHER_WAY
from evaluator.diagnosis.mistakes.misread.pose_freeze import frozen
from evaluator.diagnosis.mistakes.misread.pose_headings import in_another_convention
from evaluator.diagnosis.mistakes.misread.pose_leaps import leaping
from evaluator.diagnosis.mistakes.misread.pose_units import in_another_unit
from evaluator.diagnosis.mistakes.misread.turn_sense import turned_otherwise
from evaluator.diagnosis.mistakes.recognised import MOST, Found, Mistake, exchanged_commands, mistakes_of
from evaluator.diagnosis.mistakes.repainted import repainted_runs
from evaluator.diagnosis.mistakes.session.another_robot import of_another_robot
from evaluator.diagnosis.mistakes.session.copies import contradicting_copies, copies
from evaluator.diagnosis.mistakes.start.late_start import late_starts
from simulator.robot import Robot


def recognise(data: Sequence[RunData], robots: Sequence[Robot]) -> list[Mistake]:
    """Mistakes of the runs of a session, those of most runs together; at most one for each run.

    robots: one per run, from their files. The last mistake may be of no run, and say that most of hundreds disagree
    with their files and are not read wrongly. On open ground the ground displaces a single run from the model as far as
    a mistake does: there only mistakes of most runs are accepted from poses, and from marks those that need no model,
    or by which a run disagrees with it several times more than all others; exchanged sides by the sense of the turns.
    """
    reads: list[Misread] = []

    def misread_runs(data: Sequence[RunData], robots: Sequence[Robot]) -> list[Found]:
        reads.append(misread(data, robots))
        return reads[-1].found

    found = list(copies(data))
    found += _of_the_rest(wrong_seconds, data, robots, found)
    sure = list(found)  # without a model
    found += _of_the_rest(wrong_scale, data, robots, found)
    for of_poses in (leaping, frozen, in_another_unit, in_another_convention):  # a leap turns the way of its run
        read = _of_the_rest(of_poses, data, robots, found)
        found, sure = [*found, *read], [*sure, *read]
    found += _of_the_rest(repainted_runs, data, robots, found)
    found += _of_the_rest(runs_with_lost_frames, data, robots, found)
    still = standing = standing_runs(data, robots)  # because of a dead band: their commands cannot be checked
    if len(standing) >= MOST * len(data) and share_a_factor(data, robots):  # they move, but far less than commanded
        standing = set()
    moving = [(run, robot) for run, robot in zip(data, robots, strict=True) if run.id not in standing]
    able = [run for run, _ in moving], [robot for _, robot in moving]
    turning = sum(any(s.left_rpm != s.right_rpm for s in run.run_command.driven) for run in data)
    logs = {run.id for run in data if run.log is not None}
    if logs:  # wrong logs shift phases, which then look like pushes
        found += [item for item in _of_the_rest(misread_runs, *able, found) if item.run in logs]
    disturbed = _of_the_rest(disturbed_runs, data, robots, found)
    found += disturbed
    if disturbed or len(logs) < len(data):  # otherwise the same runs were tested already
        found += _of_the_rest(misread_runs, *able, found)
    found += _of_the_rest(late_starts, *able, found)
    found = beyond_a_dead_band(found, data, still)
    doubtful = contradicting_copies(data, found)
    found, sure = [*found, *doubtful], [*sure, *doubtful]
    if on_open_ground(robots, data):
        by_model = {(item.run, item.kind) for read in reads for item in read.found if item.run not in read.far}
        kinds, poses = [item.kind for item in found], {run.id for run in data if run.from_poses}
        found = [
            item
            for item in found
            if item in sure
            or not ((item.run, item.kind) in by_model or item.run in poses)
            or (kinds.count(item.kind) >= MOST * len(data) and item.kind not in OTHER_WAY)
        ]
        found += _of_the_rest(lambda runs, _: turned_otherwise(runs), *able, found)
    elif len({item.run for item in found}) < MOST * len(data):  # else a mistake of most runs explains them
        found += of_another_robot(data, robots)
    said = [
        Mistake((), "outlying", sentence, everywhere=True)
        for sentence in (read.unread for read in reads[-1:])
        if sentence
    ]
    found = exchanged_commands(found, {run.id: run.command for run in data if run.log is None})
    return [*mistakes_of(found, len(data), {"sides-swapped": turning}), *said]


def _of_the_rest(
    search: Callable[[Sequence[RunData], Sequence[Robot]], list[Found]],
    data: Sequence[RunData],
    robots: Sequence[Robot],
    found: Sequence[Found],
) -> list[Found]:
    """Findings of a search in the runs without findings so far."""
    known = {item.run for item in found}
    rest = [(run, robot) for run, robot in zip(data, robots, strict=True) if run.id not in known]
    return search([run for run, _ in rest], [robot for _, robot in rest]) if rest else []
