"""Comparison of each run with simulations of its stated command and of the hypotheses of mistakes.

The start pose is unknown, so that only the shape of the path in time is compared: RMS distance of both marks after the
best rotation and shift. A mistake is accepted if the run fits it several times better than the file, also with values
within their tolerances, and the misfit of the file is large compared with the path and with the misfit of runs with the
same ratio of wheel speeds. Physical effects cause neither.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.features import channels_of, rms_apart
from evaluator.diagnosis.likelihood.run_data import RunData, Task, aligned_starts
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.diagnosis.mistakes.misread.alternatives import (
    REMEDIES,
    TURN_HEADINGS,
    Alternative,
    alternatives,
    correction_to,
    distinct_commands,
    thinned,
)
from evaluator.diagnosis.mistakes.misread.belief import (
    beyond_the_others,
    beyond_tolerances,
    far_from_the_others,
    late_alike,
    misfits_within_tolerances,
    one_rate_fits,
    turned_away,
    without_regimes,
    without_shared_commands,
)
from evaluator.diagnosis.mistakes.misread.command_unit import speed_factors
from evaluator.diagnosis.mistakes.misread.judgement import (
    ALIKE,
    BETTER,
    FEWEST_SIMILAR,
    LEAST_TURN,
    OTHER_WAY,
    SAME_SPEEDS,
    TURNING,
    Judgement,
    unsigned_speeds,
)
from evaluator.diagnosis.mistakes.recognised import MOST, Found, Kind
from simulator.robot import Robot

Floats = NDArray[np.float64]

# Misfit of the file, relative to the extent of the path, from which a mistake is looked for. The largest effects of the
# catalogue with which a robot is usable change a path by about a tenth.
MISFIT_SHARE = 0.15
MOST_AT_ONCE = 200  # runs whose hypotheses are simulated together: some 0.4 MB each, 7 MB with a hundred commands
SAME_INTERVAL = 0.04  # relative difference of frame intervals that is ignored
# Where nearly all of hundreds of runs disagree with their files, so many of them are compared with every hypothesis,
# and the others with those that explain most of these: a mistake of MOST runs is in more than half of a sample of 100
# but once in 10^10 (binomial). Every hypothesis on every run would take three times as long as all else.
SAMPLE = 100


@dataclass(frozen=True)
class Misread:
    """Runs that are read wrongly; unread: a sentence on those that disagree with their files for another reason.

    unread is empty unless only a sample of them was compared with every hypothesis. far: runs that agree with their
    file several times worse than any run that is read rightly.
    """

    found: list[Found]
    unread: str = ""
    far: frozenset[str] = frozenset()


def misread_runs(data: Sequence[RunData], robots: Sequence[Robot]) -> list[Found]:
    """Runs that fit another command, or another interpretation of marks or times, much better than the file."""
    return misread(data, robots).found


def misread(data: Sequence[RunData], robots: Sequence[Robot]) -> Misread:
    """The runs of misread_runs, and whether others were compared with their files alone."""
    thin = [thinned(run) for run in data]
    intervals = np.array([np.median(np.diff(run.time_s)) for run in data])
    ratios = intervals / np.median(intervals)
    same = bool(np.all(np.abs(ratios - 1) < SAME_INTERVAL))
    commands = distinct_commands(thin)
    factors = cache(lambda: speed_factors(data, robots))  # not asked for if all runs fit their files
    judgements = _judged_runs(
        *(thin, robots),
        lambda k: alternatives(thin[k], commands, None if same else float(ratios[k]), SAME_INTERVAL, factors()[k]),
    )
    least = _least_shares(judgements)
    odd = [item.share >= share for item, share in zip(judgements, least, strict=True)]
    within = misfits_within_tolerances(judgements, robots, odd)
    usual = _usual_kinds(judgements)
    good_mm, away = _worst_of_good(judgements, odd), turned_away(judgements)

    def judged(k: int) -> Found | None:
        said = judgements[k], usual, least[k], within[k], good_mm
        turns_away = judgements[k].ways[0].run.id in away
        return _judged(*said) or (_judged(*said, TURNING, ALIKE) if turns_away else None)

    found = [item for item in map(judged, range(len(data))) if item is not None]
    if same and not one_rate_fits(judgements):
        shown = {item.ways[0].run.id for item in judgements if any(w.own for w in item.ways if w.kind == "wrong-rate")}
        found = [item for item in found if item.kind != "wrong-rate" or item.run in shown]
    alike = late_alike(judgements)  # a lag of the motors or the clock is left to the diagnosis
    found = [item for item in found if item.kind != "late-start" or item.run not in alike]
    found = without_shared_commands(without_regimes(beyond_the_others(found, judgements), judgements), judgements)
    # runs that no common mistake can concern, as straight ones by exchanged sides, stay alone too, but not most
    alone = sum(len(item.ways) == 1 for item, is_odd in zip(judgements, odd, strict=True) if is_odd)
    unread = _unread(len(data), sum(odd)) if 2 * alone > max(sum(odd) - SAMPLE, 0) else ""
    far = frozenset(far_from_the_others(found, judgements) or ())
    return Misread(beyond_tolerances(found, judgements, robots), unread, far)


def _unread(runs: int, odd: int) -> str:
    return (
        f"{odd} of {runs} runs do not move as the robot file and their commands predict; {SAMPLE} of them, drawn "
        "at random, were compared with all usual mistakes, of which none explains most of them; is it the file of this "
        "robot?"
    )


def reading_of(run: RunData, others: Sequence[RunData], robot: Robot) -> Found | None:
    """The mistake that a run fits, for a run known to disagree with a robot that explains all others; None if none."""
    thin = thinned(run)
    (judgement,) = judgements_of([alternatives(thin, distinct_commands([thin, *others]), None, SAME_INTERVAL)], [robot])
    return _judged(judgement, {"wrong-rate"}, least_share=0.0)


def _relative(speeds: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    """The wheel speeds of a run relative to its fastest wheel.

    Runs with equal ones follow the same path, each at its own pace, because slip depends on ratios of speeds only.
    """
    fastest = max((faster for _, faster in speeds), default=0.0) or 1.0
    return tuple((round(slower / fastest, 2), round(faster / fastest, 2)) for slower, faster in speeds)


def _judged_runs(
    data: Sequence[RunData], robots: Sequence[Robot], ways_of: Callable[[int], list[Alternative]]
) -> list[Judgement]:
    """Judgements of all runs: of those that fit their file, that of the file alone; ways_of: hypotheses on the kth run.

    The delays of all logs are compared (late_alike), so that runs with a log are judged by every hypothesis.
    """
    judgements = judgements_of([[Alternative(None, run)] for run in data], robots)
    least = _least_shares(judgements)

    def judge(runs: Sequence[int], kinds: Collection[Kind] | None = None) -> None:
        """Judge runs by all hypotheses, or by those of some kinds."""
        for first in range(0, len(runs), MOST_AT_ONCE):
            some = runs[first : first + MOST_AT_ONCE]
            ways = [[way for way in ways_of(k) if not kinds or way.kind in (None, *kinds)] for k in some]
            for k, judgement in zip(some, judgements_of(ways, [robots[k] for k in some]), strict=True):
                judgements[k] = judgement

    odd = [k for k in range(len(data)) if not judgements[k].share < least[k]]
    judge([k for k in range(len(data)) if data[k].log is not None])
    asked = [k for k in odd if data[k].log is None]
    if len(asked) <= MOST_AT_ONCE or len(odd) < MOST * len(data):
        judge(asked)
        return judgements
    # at random, because commands often recur after so many runs; with one seed, so that a check says the same again
    sample = sorted(np.random.default_rng(0).choice(asked, SAMPLE, replace=False).tolist())
    judge(sample)
    if common := _common_kinds([judgements[k] for k in sample], [least[k] for k in sample]):
        judge([k for k in asked if k not in set(sample)], common)
    return judgements


def _common_kinds(judgements: Sequence[Judgement], least: Sequence[float]) -> set[Kind]:
    """Kinds of mistake that more than half of the runs fit, alone or as well as others."""
    usual = _usual_kinds(judgements)
    found = [_judged(item, usual, share) for item, share in zip(judgements, least, strict=True)]
    counts = Counter(kind for item in found if item is not None for kind in (item.kind, *item.equivalent))
    return {kind for kind, count in counts.items() if 2 * count > len(judgements)}


def judgements_of(ways: Sequence[list[Alternative]], robots: Sequence[Robot]) -> list[Judgement]:
    """Simulate all hypotheses on all runs in one batch.

    Each begins where its marks are: effects of the robot file that are fixed in the plate, such as a spring to an
    anchor, depend on place and heading.
    """
    flat = [way.run for of_run in ways for way in of_run]
    owners = [robot for robot, of_run in zip(robots, ways, strict=True) for _ in of_run]
    forward = Simulated(owners, flat, {})
    starts = np.nan_to_num(aligned_starts(flat, forward))
    predicted = forward.marks([Task(k, tuple(start)) for k, start in enumerate(starts)])
    judgements, k = [], 0
    for of_run in ways:
        seen = predicted[k : k + len(of_run)]
        possible = [(way, marks) for way, marks in zip(of_run, seen, strict=True) if not _turns_otherwise(way, marks)]
        parts = np.array([_misfit(way.run.marks_mm, marks) for way, marks in possible])
        run = of_run[0].run
        held = [way for way, _ in possible]
        turn_rad = _largest_turn(run, predicted[k])
        judgements.append(Judgement(held, parts, _extent(predicted[k], run.marks_mm), unsigned_speeds(run), turn_rad))
        k += len(of_run)
    return judgements


def _turns_otherwise(way: Alternative, predicted: Floats) -> bool:
    """Whether the turn of a run refutes a hypothesis by which it turns the other way than stated."""
    if way.kind not in OTHER_WAY:
        return False
    expected_rad, turned_rad = _largest_turn(way.run, predicted)
    return turned_rad < LEAST_TURN * expected_rad


def _largest_turn(run: RunData, predicted: Floats) -> tuple[float, float]:
    """The largest predicted turn of a run, rad, and how far it has turned then the same way; NaN if unknown."""
    both = np.isfinite(predicted).all(axis=1) & np.isfinite(run.marks_mm).all(axis=1)
    if not both.any():
        return float("nan"), float("nan")
    expected, turned = (_turned(marks[both]) for marks in (predicted, run.marks_mm))
    if np.abs(np.diff(expected)).max(initial=0.0) > np.pi / 2:  # too fast to know the way from frame to frame
        return float("nan"), float("nan")
    most = int(np.argmax(np.abs(expected)))
    return float(abs(expected[most])), float(turned[most] * np.sign(expected[most]))


def _turned(marks: Floats) -> Floats:
    """How far the line through both marks (n, 4) has turned since the first frame, rad, (n,)."""
    angle = np.unwrap(channels_of(marks)[:, 2])
    return np.asarray(angle - angle[0])


def _least_shares(judgements: Sequence[Judgement]) -> list[float]:
    """For every run, the misfit of the file over the extent above which mistakes are considered."""
    alike: dict[object, list[int]] = {}
    for k, item in enumerate(judgements):
        alike.setdefault(_relative(item.speeds), []).append(k)
    found = [MISFIT_SHARE] * len(judgements)
    for members in alike.values():
        if len(members) <= FEWEST_SIMILAR:
            continue
        shares = np.array([judgements[k].share for k in members])
        unknown, largest = np.count_nonzero(~np.isfinite(shares)), np.sort(np.where(np.isfinite(shares), shares, 0.0))
        for k, share in zip(members, shares, strict=True):
            if unknown == (not np.isfinite(share)):  # that of every other run is known
                of_others = largest[-2] if share == largest[-1] else largest[-1]
                found[k] = min(MISFIT_SHARE, BETTER * float(of_others))
    return found


def _usual_kinds(judgements: Sequence[Judgement]) -> set[Kind]:
    """Kinds of mistake that explain most of the runs; a single straight run does not distinguish some of them."""
    counts: dict[Kind, int] = {}
    for item in judgements:
        if item.share < MISFIT_SHARE:
            continue
        best = float(np.nanmin(item.misfits_mm))
        pairs = zip(item.ways, item.misfits_mm, strict=True)
        for kind in {way.kind for way, value in pairs if value < ALIKE * best and way.kind}:
            counts[kind] = counts.get(kind, 0) + 1
    return {kind for kind, count in counts.items() if count > len(judgements) / 2}


def _worst_of_good(judgements: Sequence[Judgement], odd: Sequence[bool]) -> float:
    """Largest misfit, mm, of the runs that fit their files; infinite if they are no majority."""
    good = [item.misfits_mm[0] for item, is_odd in zip(judgements, odd, strict=True) if not is_odd]
    return float(np.nanmax(good)) if 2 * np.count_nonzero(np.isfinite(good)) > len(odd) else np.inf


def _judged(
    item: Judgement,
    usual: set[Kind],
    least_share: float = MISFIT_SHARE,
    misfits_mm: Floats | None = None,
    good_mm: float = np.inf,
    among: Collection[Kind] = (),
    better: float = BETTER,
) -> Found | None:
    """The mistake that a run fits, if any; misfits_mm: to compare, by default those of the judgement.

    good_mm: misfit of runs that fit their files. A mistake that fits several times better than the file, but worse than
    these, is told as the nearest, and corrects nothing; a slip of the keyboard may fit ALIKE, because the digits of the
    file are evidence too, and one run in a dozen that is read rightly fits worse than the others. among: the kinds of
    mistake; by default all. better: by which factor it must fit better than the file.
    """
    ways, stated, misfits = item.ways, float(item.misfits_mm[0]), item.misfits_mm if misfits_mm is None else misfits_mm
    if any(way.kind == "wrong-unit" for way in ways) and not np.isfinite(stated):
        stated = np.inf  # thousands of rpm that no simulation follows
    if np.isnan(stated) or item.share < least_share:
        return None
    # with the frame interval of all other runs, a single run has no other frame rate
    refused = [way.kind == "wrong-rate" and not way.own and "wrong-rate" not in usual for way in ways]
    if 0 < least_share <= item.share < MISFIT_SHARE:
        refused = [way.kind not in SAME_SPEEDS for way in ways]
    if among:
        refused = [way.kind not in among for way in ways]
    misfits = np.where(refused, np.inf, misfits)
    if not np.isfinite(misfits[1:]).any():
        return None
    best = float(np.nanmin(misfits[1:]))
    if min(stated, np.nan_to_num(misfits[0], nan=np.inf)) < better * best:
        return None
    as_good = max(ALIKE * best, 0.02 * stated)
    near: dict[Kind, tuple[float, Alternative]] = {}  # the best alternative of each kind, frequent kinds first
    for way, value in zip(ways[1:], misfits[1:], strict=True):
        # specific evidence, such as another frame interval, outweighs a fit that is a little better
        limit = max(as_good, BETTER * best) if way.own else as_good
        if way.kind is not None and value <= limit and value < near.get(way.kind, (np.inf,))[0]:
            near[way.kind] = (float(value), way)
    supported = [kind for kind in near if kind in usual] or [kind for kind in near if near[kind][1].own]
    kind = next(iter(supported), next(iter(near)))
    others = tuple(other for other in near if other != kind)
    words = ", or ".join(near[one][1].words for one in (kind, *others))
    apart = f"distance of simulated and measured marks: {stated:.2g} mm as stated in the file, {best:.2g} mm when "
    if best > good_mm * (ALIKE if near[kind][1].slip else 1.0):
        evidence = f"{words} ({apart}corrected, at most {good_mm:.2g} mm in the other runs)"
        seen = f"contradicts its file, and no usual mistake fits; the nearest: {evidence}"
        return Found(ways[0].run.id, kind, seen, "check what was commanded, and inspect the recording", others)
    seen, correction = f"{words} ({apart}corrected)", correction_to(near[kind][1], ways[0])
    remedies = REMEDIES | ({"marks-swapped": TURN_HEADINGS} if ways[0].run.from_poses else {})
    remedy = "; or ".join(remedies[one] for one in (kind, *others))
    return Found(ways[0].run.id, kind, seen, remedy, others, correction)


def _extent(marks: Floats, measured: Floats) -> float:
    """RMS distance of a path from its mean, mm: the larger one of simulated and measured path."""
    return max(float(np.sqrt(np.sum(np.var(part[:, :2], axis=0)))) for part in (marks, measured))


def _misfit(measured: Floats, predicted: Floats) -> float:
    """RMS distance of marks (n, 4) from predicted ones after the best rotation and shift; NaN if not simulated."""
    if not np.isfinite(predicted).all():
        return float("nan")
    return rms_apart(*((part[:, ::2] + 1j * part[:, 1::2]).ravel() for part in (measured, predicted)))
