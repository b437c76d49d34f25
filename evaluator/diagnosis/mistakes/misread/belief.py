"""Which findings are believed: not those that physics or values within their tolerances explain as well."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evaluator.diagnosis.candidates.coordinates import on_open_ground
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.likelihood.within_tolerances import misfit_within_tolerances
from evaluator.diagnosis.mistakes.misread.judgement import (
    ALIKE,
    BETTER,
    FEWEST_SIMILAR,
    OTHER_WAY,
    SAME_SPEEDS,
    TURNING,
    Floats,
    Judgement,
    speeds_of_sides,
)
from evaluator.diagnosis.mistakes.recognised import MOST, Correction, Found
from simulator.robot import Robot

NEAR_S = 0.15  # offsets of logs that differ by less are equal: neighbours among the tried ones
# Runs whose values are varied, a twentieth of a second each: of a kind of mistake that most runs show, and of one that
# MANY runs of one command show, which are alike but for noise. Of more than MOST_VARIED odd runs none is.
TESTED, MANY, MOST_VARIED = 5, 20, 400
# Ratio of the misfits of the file and of a turn to the other side from which neither chance nor an effect explains it.
# In 36 sessions of the seventeenth world, 34 good runs bent by effects fitted a turn to the other side, or backward, at
# most 2.5 times better, and 12 of 13 that were exchanged or reversed more than 13 times.
SURELY = 10.0
# Predicted turn that has a sense, ten times what the marks err by, and a turn the other way that no disturbance makes.
LEAST_TURN_RAD, CLEAR_TURN_RAD = 0.1, 0.5


def one_rate_fits(judgements: Sequence[Judgement]) -> bool:
    """Whether one frame rate fits most runs several times better than their file, as if all share a wrong clock.

    Physics changes each command by another factor: a blocked wheel slowed turns by 17 to 50 %, straight runs hardly.
    """
    better: dict[str, int] = {}  # runs by the words of a rate
    for item in judgements:
        for way, value in zip(item.ways, item.misfits_mm, strict=True):
            if way.kind == "wrong-rate" and BETTER * value <= item.misfits_mm[0]:
                better[way.words] = better.get(way.words, 0) + 1
    return max(better.values(), default=0) >= MOST * len(judgements)


def late_alike(judgements: Sequence[Judgement]) -> set[str]:
    """Runs that fit their logs best with a delay, if most runs with a log have about the same delay."""
    best = {}
    for item in judgements:
        if item.ways[0].run.log is not None and np.isfinite(item.misfits_mm[0]):
            way = int(np.nanargmin(item.misfits_mm))
            better = item.misfits_mm[0] > ALIKE * item.misfits_mm[way]
            best[item.ways[0].run.id] = item.ways[way].later_s if better else 0.0
    common = float(np.median(list(best.values()))) if best else 0.0
    alike = {run for run, later in best.items() if later and abs(later - common) < NEAR_S}
    return alike if len(alike) > max(len(best) / 2, 2) else set()


def turned_away(judgements: Sequence[Judgement]) -> set[str]:
    """Runs that clearly turn the other way than stated, though runs with commands for wider turns turn as stated.

    No effect reverses a tight turn and lets wider ones to its side be. Such a run may be far from every simulation:
    where its friction decides how far a slow pivot turns, the exchanged sides fitted only 1.4 times better. At most a
    few runs: where many turn the other way, more than one run is wrong.
    """
    turning = [item for item in judgements if item.turn_rad[0] > LEAST_TURN_RAD and item.ways[0].run.log is None]
    away = [item for item in turning if item.turn_rad[1] < -CLEAR_TURN_RAD]
    if len(turning) - len(away) < MOST * len(turning):
        return set()
    found = set()
    for item in away:
        run, others = item.ways[0].run, [other for other in turning if other is not item]
        wider = [other for other in others if 0 < _tightness(other) / _tightness(item) <= 1]  # to the same side
        if wider and all(other.turn_rad[1] > 0 for other in wider):
            found.add(run.id)
    return found


def _tightness(item: Judgement) -> float:
    """How tight a turn is commanded, positive to the left: 0 for a straight run, 2 for a turn on the spot."""
    left, right = item.ways[0].run.command
    return (right - left) / max(abs(left), abs(right))


def beyond_the_others(found: Sequence[Found], judgements: Sequence[Judgement]) -> list[Found]:
    """The findings without those of runs whose misfit is only little larger than that of correct runs.

    An effect changes all runs, tight turns most, and one of a dozen other commands may fit a changed path by chance; a
    left wheel that is a third too slow turns a wide turn into one to the other side. If the recording belongs to
    another command, or turns the other way, its misfit is several times that of any effect in the other runs. Not so
    for runs that have exchanged their commands: chance does not fit each of them to the command of another. Nor for a
    turn to the other side that fits SURELY times better: a second wrong run, of an unknown kind, misses as much.
    """
    far = far_from_the_others(found, judgements)
    if far is None:
        return list(found)
    kept = far | _exchanged(found, judgements) | _surely_turned(found, judgements)
    certain = {"wrong-command": kept, **dict.fromkeys(OTHER_WAY, kept | turned_away(judgements))}
    return [item for item in found if item.kind not in certain or item.run in certain[item.kind]]


def far_from_the_others(found: Sequence[Found], judgements: Sequence[Judgement]) -> set[str] | None:
    """Runs whose misfit is several times that of any run without a mistake; None if too few of these are known.

    An effect displaces a run in proportion to its path; marks that were placed by hand, a stand that shakes and noise
    displace all runs alike, and are a third of a path that is short enough. What all runs have in common is therefore
    not scaled with the path.
    """
    wrong = {item.run for item in found}
    right = [item for item in judgements if item.ways[0].run.id not in wrong]
    misfits_mm = np.array([item.misfits_mm[0] for item in right])
    if len(right) < FEWEST_SIMILAR or not np.isfinite(misfits_mm).all():
        return None
    common_mm = min(ALIKE * float(misfits_mm.min()), float(misfits_mm.max()))
    share = max(_beyond(common_mm, mm) / max(item.extent_mm, 1e-9) for mm, item in zip(misfits_mm, right, strict=True))
    return {
        item.ways[0].run.id
        for item in judgements
        if item.misfits_mm[0] > BETTER * np.hypot(common_mm, share * item.extent_mm)
    }


def _beyond(common_mm: float, misfit_mm: float) -> float:
    """The part of a misfit, mm, that is not common to all runs."""
    return float(np.sqrt(max(misfit_mm**2 - common_mm**2, 0.0)))


def _surely_turned(found: Sequence[Found], judgements: Sequence[Judgement]) -> set[str]:
    """Runs that turn the other way and fit SURELY times better so."""
    kinds = {item.run: item.kind for item in found if item.kind in OTHER_WAY}
    turned = set()
    for item in judgements:
        run = item.ways[0].run.id
        fits = [value for way, value in zip(item.ways, item.misfits_mm, strict=True) if way.kind == kinds.get(run)]
        if run in kinds and SURELY * min(fits, default=np.inf) <= item.misfits_mm[0]:
            turned.add(run)
    return turned


def _exchanged(found: Sequence[Found], judgements: Sequence[Judgement]) -> set[str]:
    """Runs with wrong commands that have, among themselves, the commands of one another."""
    stated = {item.ways[0].run.id: _command_of(item.ways[0].run) for item in judgements}
    moved = {
        item.run: _command_of(item.correction) for item in found if item.kind == "wrong-command" and item.correction
    }
    while moved:
        given, followed = {stated[run] for run in moved}, set(moved.values())
        left = {run: way for run, way in moved.items() if way in given and stated[run] in followed}
        if left == moved:
            break
        moved = left
    return set(moved)


def _command_of(item: RunData | Correction) -> object:
    """Constant speeds or the log of a run, or those to which it is corrected, to compare."""
    return item.command if item.log is None else item.log.command.knots.tobytes()


def without_regimes(found: Sequence[Found], judgements: Sequence[Judgement]) -> list[Found]:
    """The findings without wrong commands that concern all runs of some wheel speeds, as a sticking wheel causes them.

    A command is mixed up in one run, not in every run of the same speeds, or of speeds in the same ratio: forward and
    backward, or to both sides too. In the ratio of 0.15, an ordinary error of the friction turned three turns on the
    spot into others.
    """
    mixed_up = {item.run for item in found if item.kind == "wrong-command"}
    regimes: dict[object, set[str]] = {}
    for judgement in judgements:
        run = judgement.ways[0].run
        alike: list[tuple[str, object]] = [("to both sides", judgement.speeds), ("to one side", speeds_of_sides(run))]
        if ratios := tuple(round(slower / faster, 2) for slower, faster in judgement.speeds if slower < faster):
            alike.append(("in one ratio", ratios))
        for regime in alike:
            regimes.setdefault(regime, set()).add(run.id)
    physical = set().union(*(runs for runs in regimes.values() if len(runs) > 1 and runs <= mixed_up))
    return [item for item in found if item.kind != "wrong-command" or item.run not in physical]


def without_shared_commands(found: Sequence[Found], judgements: Sequence[Judgement]) -> list[Found]:
    """The findings without wrong commands that runs here and there share with one other run.

    A program that stays at its command does so in runs that follow one another. Of runs apart, it is the plate that
    leads them to one path: a fence made a turn on the spot and a turn about a wheel the straight run of a third.
    """
    runs = [item.ways[0].run for item in judgements]
    sharing: dict[object, set[str]] = {}
    for item in found:
        if item.kind == "wrong-command" and item.correction is not None:
            sharing.setdefault(_command_of(item.correction), set()).add(item.run)
    physical = set[str]()
    for command, alike in sharing.items():
        given = {run.id for run in runs if _command_of(run) == command} - alike
        places = [k for k, run in enumerate(runs) if run.id in alike | given]
        if len(alike) > 1 and len(given) == 1 and places[-1] - places[0] >= len(places):
            physical |= alike
    return [item for item in found if item.kind != "wrong-command" or item.run not in physical]


def beyond_tolerances(found: Sequence[Found], judgements: Sequence[Judgement], robots: Sequence[Robot]) -> list[Found]:
    """The findings that hold with values within their tolerances.

    A few stand for all of a kind that most runs show, and for many runs of one command that have the same mistake.
    """
    place, away = {item.ways[0].run.id: k for k, item in enumerate(judgements)}, turned_away(judgements)

    def holds(item: Found) -> bool:
        surely = item.kind in TURNING and item.run in away
        return surely or is_beyond_tolerances(item, judgements[place[item.run]], robots[place[item.run]])

    def held(alike: Sequence[Found], many: int) -> list[Found]:
        """Those that hold; of many, all if most of a few do."""
        if len(alike) < many:
            return [item for item in alike if holds(item)]
        few = [alike[k] for k in np.linspace(0, len(alike) - 1, TESTED).astype(int)]
        return list(alike) if 2 * sum(map(holds, few)) > len(few) else []

    kept: list[Found] = []
    for kind in dict.fromkeys(item.kind for item in found):
        of_kind = [item for item in found if item.kind == kind]
        if len(of_kind) >= MOST * len(judgements):
            kept += held(of_kind, TESTED)
            continue
        groups: dict[object, list[Found]] = {}
        for item in of_kind:
            right = None if item.correction is None else _command_of(item.correction)
            groups.setdefault((_command_of(judgements[place[item.run]].ways[0].run), right), []).append(item)
        runs = {item.run for alike in groups.values() for item in held(alike, MANY)}
        kept += [item for item in of_kind if item.run in runs]
    return kept


def is_beyond_tolerances(found: Found, item: Judgement, robot: Robot) -> bool:
    """Whether a mistake fits its run several times better than the file also with values within their tolerances."""
    if on_open_ground([robot], [item.ways[0].run]):  # nobody knows the ground to a tolerance
        return True
    others = np.where([way.kind == found.kind for way in item.ways], item.misfits_mm, np.inf)
    mistaken = int(np.nanargmin(others))
    stated = misfit_within_tolerances(item.ways[0].run, robot)
    if stated >= BETTER * item.misfits_mm[mistaken]:  # values within tolerances make the mistake fit better still
        return True
    return stated >= BETTER * misfit_within_tolerances(item.ways[mistaken].run, robot)


def misfits_within_tolerances(
    judgements: Sequence[Judgement], robots: Sequence[Robot], odd: Sequence[bool]
) -> list[Floats]:
    """Misfits of all runs; of odd ones, those of the stated wheel speeds with values of the robot within tolerances.

    Otherwise a right hypothesis fits hardly better than others where such values bend the path. Hypotheses are tried,
    nearest first, as long as they then fit several times better than the file, which is tried last. Unchanged if more
    than half of the runs, or hundreds, are odd: that is physics, or a mistake of the session.
    """
    if (
        2 * sum(odd) > len(odd)
        or sum(odd) > MOST_VARIED
        or on_open_ground(robots, (item.ways[0].run for item in judgements))
    ):
        return [item.misfits_mm for item in judgements]
    found = []
    for item, robot, is_odd in zip(judgements, robots, odd, strict=True):
        misfits = item.misfits_mm.copy()
        rivals = [k for k, way in enumerate(item.ways) if is_odd and way.kind in SAME_SPEEDS]
        for k in sorted(rivals, key=lambda k: item.misfits_mm[k]):
            misfits[k] = min(misfits[k], misfit_within_tolerances(item.ways[k].run, robot))
            if not BETTER * misfits[k] <= item.misfits_mm[0]:
                break
        if rivals and BETTER * min(misfits[rivals]) <= misfits[0]:
            misfits[0] = min(misfits[0], misfit_within_tolerances(item.ways[0].run, robot))
        found.append(misfits)
    return found
