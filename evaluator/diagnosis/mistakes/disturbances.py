"""Disturbances of single runs: stuck, held or pushed robot, moved camera, wrong unit."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.intervals import (
    FEWEST_FRAMES,
    HELD_S,
    interrupts,
    lasting_change,
    longest,
    phases_of,
    stretches,
    unlike,
)
from evaluator.diagnosis.mistakes.jump import frames_ahead, jump
from evaluator.diagnosis.mistakes.motion import (
    WINDOW_S,
    Motion,
    arm_mm,
    displacement_in_gap,
    displacement_over,
    motion_of,
    onset,
)
from evaluator.diagnosis.mistakes.outrun import BRIEF_S, PUSHED_SHARE, outruns_its_wheels, rolls_mm_s
from evaluator.diagnosis.mistakes.recognised import Correction, Found, Kind
from evaluator.diagnosis.mistakes.spacing import CHANGED_SHARE, Spacing, by_keystone, keystone_of, spacing
from evaluator.interchange.commands import unsigned_rpm
from evaluator.robot_geometry import stated_distances_mm
from evaluator.robust import robust_sigma
from evaluator.turning.status import SPACING_SHARE
from evaluator.wording import MM_PER
from simulator.robot import Robot

# Deviation of the distance of the marks in one run from that in the others. Marks that are painted anew for each run
# err by some hundredths of a few millimetres, 1 to 2 %: four standard deviations, because any of two dozen runs may be
# outlying, and three after correction for a keystone at its position. Where other runs at these places agree, the
# marks are the same, and twice what another calibration changes (spacing.CHANGED_SHARE) is another robot. Six
# standard deviations of the others lie between: they are known from few runs.
ALONE_SHARE, SAME_SHARE, AFTER_KEYSTONE = 0.08, 2 * CHANGED_SHARE, 0.75
OTHERS_SIGMAS, FEWEST_ALIKE = 6.0, 4
UNITS = {unit.replace("um", "µm"): 1 / size_mm for unit, size_mm in MM_PER.items() if unit != "mm"}  # per mm
UNIT_SHARE = 0.06  # relative tolerance of the distance of the marks in another unit
PX_RATIO = 3.0  # a distance larger by this factor, and by none of a unit of length, is in pixels
STANDS_SHARE = 0.05  # of the path of wheels that roll without slip: a shorter one is a run that does not move
HELD_SHARE = 0.4  # of the usual speed of the run: physical effects cause no such brief changes
CREEPS_SHARE = 0.2  # of that speed: a faster robot is moving
SHOWS_USUAL_S = 3 * HELD_S  # of motion: twice as much as a disturbance is of the usual kind
MOST_CHANGED = 0.25  # of the runs: failing motors and commands that nobody noted do not gather
SETTLED_S = 0.5  # time after the start in which the motors reach their speed
# Time after the start from which a disturbance is sought: motors that lag by 0.1 s are within a twelfth of their speed,
# and what still changes counts as a change of velocity. After SETTLED_S, pushes 0.6 s after the start of runs of 1.1 s
# were not seen, and gave the verdict "unknown".
STEADY_S = 0.25


def wrong_scale(data: Sequence[RunData], robots: Sequence[Robot]) -> list[Found]:
    """Runs whose marks have another distance than in the robot file: another unit, or another robot.

    Misplaced marks have the same wrong distance in all runs, and a tilted camera changes it with the position on the
    plate; both are effects, left to the diagnosis.
    """
    if not data:
        return []
    stated_mm = stated_distances_mm(robots)
    spacings = [spacing(run.marks_mm, stated) for run, stated in zip(data, stated_mm, strict=True)]
    ratios = [float(np.median(item.ratio)) for item in spacings]
    common, without = _common(ratios), list[float]()
    found = []
    for number, (run, ratio, stated) in enumerate(zip(data, ratios, stated_mm, strict=True)):
        if abs(ratio / common - 1) < SAME_SHARE:
            continue
        if not without:  # of all runs without the keystone that they show
            keystone = keystone_of(spacings)
            without = [float(np.median(item.without(keystone).ratio)) for item in spacings]
        others = [item for k, item in enumerate(spacings) if k != number]
        least = _least_share(without) if _is_among(spacings[number], others) else ALONE_SHARE
        if abs(ratio / common - 1) < least:
            continue
        straight = ratio - by_keystone(spacings[number], others)
        if abs(straight / _common(without) - 1) < AFTER_KEYSTONE * least:
            continue
        words = f"its marks are {ratio * stated:.4g} mm apart, in the robot file {stated:.4g} mm"
        unit = next((name for name, factor in UNITS.items() if abs(ratio / factor - 1) < UNIT_SHARE), None)
        if unit is None and ratio > PX_RATIO:
            unit = "px"
        if unit is not None:
            seem, to_do = unit, "place them with a camera" if unit == "px" else "convert them to mm"
            if unit == "px" and abs(ratio * UNITS["cm"] - 1) < UNIT_SHARE:  # so many px per mm are usual, too
                seem, to_do = "px, or in mm in columns named _cm", f"{to_do}, or name the columns after their unit"
            remedy = f"they seem to be in {seem}: {to_do}"
            factor = None if unit == "px" else 1 / UNITS[unit]
            correction = None if factor is None else Correction(marks_times=(factor, factor))
            found.append(Found(run.id, "wrong-unit", words, remedy, correction=correction))
        else:
            remedy = "is it the file of this robot? Measure its marks"
            found.append(Found(run.id, "wrong-robot", words, remedy))
    return found


def _least_share(ratios: Sequence[float]) -> float:
    """Least deviation of the distance of the marks that is another robot, from the distances in all runs."""
    seen = np.array(ratios)[np.isfinite(ratios)]
    if len(seen) < FEWEST_ALIKE:
        return ALONE_SHARE
    return float(np.clip(OTHERS_SIGMAS * robust_sigma(seen), SAME_SHARE, ALONE_SHARE))


def _is_among(run: Spacing, others: Sequence[Spacing]) -> bool:
    """Whether a run is driven at places where others are, too: a lens errs with the distance from the middle."""
    mine, theirs = run.middle_mm, np.concatenate([item.middle_mm for item in others] or [np.full((1, 2), np.nan)])
    center = np.median(theirs, axis=0)
    return bool(np.hypot(*(np.median(mine, axis=0) - center)) <= np.hypot(*(theirs - center).T).max())


def _common(ratios: Sequence[float]) -> float:
    """The ratio that most runs have; 1 if it is no error of the places of marks."""
    usual = float(np.nanmedian(ratios))
    return usual if abs(np.log(usual)) < np.log1p(SPACING_SHARE) else 1.0


def disturbed_runs(data: Sequence[RunData], robots: Sequence[Robot]) -> list[Found]:
    """Runs that stand still, are briefly held or pushed, or whose camera moved; at most one of these for each run."""
    phases = [(phase, robot) for run, robot in zip(data, robots, strict=True) for phase in phases_of(run)]
    since = {id(phase): _stands_since(phase, robot) for phase, robot in phases}
    standing = {phase for phase, begins in since.items() if begins is not None}
    counts = Counter((unsigned_rpm(phase.left_rpm, phase.right_rpm), id(phase) in standing) for phase, _ in phases)
    of_run: dict[str, list[RunData]] = {}
    for phase, _ in phases:
        of_run.setdefault(phase.id, []).append(phase)
    found, changed = list[Found](), list[Found]()
    for run, robot in zip(data, robots, strict=True):
        mine = of_run.get(run.id, [])
        wrongly = [phase for phase in mine if id(phase) in standing and not _others_stand_too(phase, counts)]
        if wrongly:
            begins = since[id(wrongly[0])]
            whole = len(wrongly) == len(mine) and begins == wrongly[0].start_s
            if whole and (way_mm := _way_mm(run)) > 2 * arm_mm(run):  # what is held gets nowhere
                seen = f"gets {way_mm:.2g} mm far, less than a twentieth of what its wheels would roll at its command"
                found.append(
                    Found(run.id, "wrong-command", seen, "is a digit of its command wrong, or the robot held?")
                )
                continue
            when = "" if whole else f" from {begins:.2f} s on"
            remedy = "inspect the recording: is the robot held, or a motor off?"
            faster = unsigned_rpm(wrongly[0].left_rpm, wrongly[0].right_rpm)[1]
            slower = any(not stands and 0 < speeds[1] <= faster for speeds, stands in counts)
            than = "though runs of slower wheels do" if slower else "and no run of slower wheels does"
            found.append(Found(run.id, "stuck", f"hardly moves{when}, {than}", remedy))
            continue
        if all(id(phase) in standing for phase in mine):
            continue
        moved = jump(run)
        if moved is not None:
            found.append(_jumping(run, *moved))
            continue
        moving = [(phase, _usual_motion(phase)) for phase in mine if id(phase) not in standing]
        by_phase = (_disturbance(*phase) or _carried_off(phase[0]) for phase in moving)
        first = outruns_its_wheels(run, robot) or next((item for item in by_phase if item is not None), None)
        if first is not None:
            found.append(first)
        elif run.log is None and (item := _changed(moving[0][0])) is not None:
            changed.append(item)
    accidents = len(changed) <= MOST_CHANGED * len(data)  # many runs change by their physics
    return found + changed * accidents


def _changed(run: RunData) -> Found | None:
    """A run at one command whose speed changes at once and for good: a motor that fails, or another command.

    Not a turn on the spot, whose centre may leave one motion for another by itself.
    """
    motion = _usual_motion(run, SETTLED_S)
    changed = None if motion is None or run.left_rpm * run.right_rpm < 0 else lasting_change(motion)
    if changed is None:
        return None
    before, after = (f"{speed:.3g} mm/s".replace("-", "−") for speed in changed[1:])
    seen = f"drives at {before} until {changed[0]:.2f} s and at {after} from there on, though its command stays"
    remedy = (
        "was it commanded anew, did a motor fail, or does something hold it? Name its command log (commands), or end it"
        " there (stop_s)"
    )
    return Found(run.id, "wrong-command", seen, remedy)


def _jumping(run: RunData, at_s: float, size_mm: float) -> Found:
    """A jump of both marks; ahead along the path it may be that of lost frames."""
    frames = frames_ahead(run, at_s)
    if frames:
        seen = f"both marks jump ahead by {size_mm:.2f} mm at {at_s:.2f} s, as far as it drives in {frames} frames"
        remedy = "were frames lost though the times count on, was the camera moved, or the robot pushed?"
        return Found(run.id, "wrong-rate", seen, remedy, ("camera-moved", "pushed"))
    seen = f"both marks jump by {size_mm:.2f} mm at {at_s:.2f} s"
    return Found(run.id, "camera-moved", seen, "was the camera moved, or the robot displaced?", ("pushed",))


def standing_runs(data: Sequence[RunData], robots: Sequence[Robot]) -> set[str]:
    """Ids of the runs that hardly move compared with the path that their wheels would roll, at any command."""
    found = set()
    for run, robot in zip(data, robots, strict=True):
        phases = phases_of(run)
        if phases and all(_stands_since(phase, robot) is not None for phase in phases):
            found.add(run.id)
    return found


def _stands_since(run: RunData, robot: Robot) -> float | None:
    """Time, s, from which a run with its motors on hardly moves compared with the path that its wheels would roll.

    From the start, or from when its motors have reached their speed to the end: it got caught at once. Else None.
    """
    if way_over_rolled(run, robot) < STANDS_SHARE:
        return run.start_s
    begin, end = _span(run, SETTLED_S)
    before, after = _part(run, run.start_s, begin), _part(run, begin, end)
    if before is None or after is None or end < begin + 2 * HELD_S:
        return None
    moved, moves = way_over_rolled(before, robot), way_over_rolled(after, robot)
    return begin if moves < min(STANDS_SHARE, CREEPS_SHARE * moved) else None


def _part(run: RunData, begin: float, end: float) -> RunData | None:
    """The run between two times, s; None with fewer than FEWEST_FRAMES."""
    inside = (run.time_s >= begin) & (run.time_s <= end)
    if np.count_nonzero(np.isfinite(run.marks_mm[inside]).all(axis=1)) < FEWEST_FRAMES:
        return None
    return replace(
        run, start_s=begin, stop_s=end, time_s=run.time_s[inside], marks_mm=run.marks_mm[inside], systematic={}
    )


def way_over_rolled(run: RunData, robot: Robot) -> float:
    """How far a run gets from its first place, over the path that its faster wheels would roll; infinite at rest."""
    end = float(run.time_s[-1]) if run.stop_s is None else min(run.stop_s, float(run.time_s[-1]))
    seconds = end - max(run.start_s, float(run.time_s[0]))
    rolled = rolls_mm_s(run.left_rpm, run.right_rpm, robot) * seconds
    if seconds <= 0 or not rolled:
        return np.inf
    return _way_mm(run) / rolled


def _way_mm(run: RunData) -> float:
    """How far the marks of a run get from their first places, mm: 95 % of the frames."""
    seen = run.marks_mm[np.isfinite(run.marks_mm).all(axis=1)]
    off = seen - seen[0]
    return float(np.percentile(np.hypot(off[:, [0, 2]], off[:, [1, 3]]), 95))


def _others_stand_too(phase: RunData, counts: Mapping[tuple[tuple[float, float], bool], int]) -> bool:
    """Whether all other phases of this command, in either direction and side, or all of no faster ones, stand as well.

    counts: phases by the speeds of their slower and faster wheel and whether they stand, as this one does. That all
    stand indicates a dead band or a drag: a robot whose slower wheel stands may hold still, and accidents do not gather
    in one command.
    """
    speeds = unsigned_rpm(phase.left_rpm, phase.right_rpm)
    alike = {key: count for key, count in counts.items() if key[0] == speeds}
    slower = {key: count for key, count in counts.items() if 0 < key[0][1] <= speeds[1]}
    return any(sum(kind.values()) > 1 and all(stands for _, stands in kind) for kind in (alike, slower))


def _span(run: RunData, after_s: float = STEADY_S) -> tuple[float, float]:
    """Interval, s, in which a run moves at its command: some time after its start, until its motors stop.

    If the recording shows the robot at rest before, it begins where motion does: a late start is no hold.
    """
    end = float(run.time_s[-1]) if run.stop_s is None else min(run.stop_s, float(run.time_s[-1]))
    begins = onset(run) if run.time_s[0] < run.start_s else None
    start = max(run.start_s, float(run.time_s[0]), -np.inf if begins is None else begins.time_s)
    return start + after_s, end


def _carried_off(run: RunData) -> Found | None:
    """An interval without frames during which the run, or its camera, was displaced."""
    moved = displacement_in_gap(run, _span(run))
    if moved is None:
        return None
    # frames may be missing or set aside: those around a jump are
    seen = f"is {moved[2]:.2f} mm off its path after {moved[0]:.2f} to {moved[1]:.2f} s, of which no frame is used"
    remedy = "inspect the recording: was the robot pushed, or the camera moved?"
    return Found(run.id, "pushed", seen, remedy, ("camera-moved",))


def _usual_motion(run: RunData, after_s: float = STEADY_S) -> Motion | None:
    """The motion of a run at its command, if it lasts long enough to show what is usual."""
    begin, end = _span(run, after_s)
    return motion_of(run, (begin, end)) if end > begin + SHOWS_USUAL_S else None


def _disturbance(run: RunData, motion: Motion | None) -> Found | None:
    """An interval in which the run is held or pushed, compared with its usual motion."""
    if motion is None:
        return None
    usual = float(np.median(motion.along))
    turning = float(np.median(motion.yaw))
    size = max(abs(usual), 0.5 * abs(turning))  # a turn on the spot has no speed: lever of half a millimetre
    speed = np.hypot(motion.along, motion.across)
    # a run that stops early is at rest for most of its time: usual speeds of its quarters are used, too
    quarters = np.array_split(motion.along, 4)
    driven = max(abs(usual), *(abs(float(np.median(quarter))) for quarter in quarters))
    held = longest(speed < HELD_SHARE * driven, motion)
    if held is not None and driven > 0 and _is_stop(motion, held, driven):
        seen = f"stands still from {held[0]:.2f} to {held[1]:.2f} s with its motors on"
        return Found(run.id, "stuck", seen, "inspect the recording: is the robot caught on something?")
    odd = (speed > PUSHED_SHARE * size) | (np.abs(motion.across - np.median(motion.across)) > 0.6 * size)
    odd |= np.abs(motion.yaw - turning) > 0.6 * max(abs(turning), size)
    odd |= np.abs(motion.along - usual) > PUSHED_SHARE * size  # back against its wheels
    strange = unlike(motion)
    pushed = longest(odd & strange, motion)
    if pushed is not None and interrupts(pushed, odd, motion):
        return Found(run.id, "pushed", _unlike_from(pushed), "inspect the recording: was the robot pushed or pulled?")
    pushed = _brief_push(run, strange, motion)
    if pushed is None:
        return None
    # the velocity of the windows beside a jump deviates, too
    at_once: tuple[Kind, ...] = ("camera-moved",) if pushed[1] - pushed[0] <= 2.1 * WINDOW_S else ()
    remedy = f"inspect the recording: was the robot pushed{', or the camera moved' * len(at_once)}?"
    return Found(run.id, "pushed", _unlike_from(pushed), remedy, at_once)


def _unlike_from(stretch: tuple[float, float]) -> str:
    return f"moves unlike the rest of the run from {stretch[0]:.2f} to {stretch[1]:.2f} s"


def _brief_push(run: RunData, strange: np.ndarray, motion: Motion) -> tuple[float, float] | None:
    """Begin and end, s, of a brief displacement or rotation of a run off its path.

    A tracking error in a frame also disturbs the velocity, but afterwards the robot is on its path.
    """
    span = _span(run)
    for begin, end in stretches(strange, motion):
        stretch = begin - WINDOW_S / 2, end + WINDOW_S / 2  # frames of the windows with deviating velocities
        if end - begin < BRIEF_S and displacement_over(run, stretch, span) > 0:
            return stretch
    return None


def _is_stop(motion: Motion, held: tuple[float, float], driven: float) -> bool:
    """Whether the robot nearly stands still in an interval, also in yaw; driven: its usual speed, mm/s."""
    inside = (motion.time_s >= held[0]) & (motion.time_s <= held[1])
    usual = float(np.median(np.abs(motion.yaw)))
    # with a spring or on a slope a robot may creep on: single velocities are noisy, their median is not
    creeps = np.hypot(np.median(motion.along[inside]), np.median(motion.across[inside])) > CREEPS_SHARE * driven
    return bool(not creeps and np.median(np.abs(motion.yaw[inside])) < max(0.5 * usual, 0.05))
