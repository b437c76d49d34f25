"""The gap between simulation and measurement in millimetres, on fitted runs and on runs held out.

Refitted: the RMS distance of a run between the measured and the simulated midpoint of the marks, the run placed where
that is least (Problem.of_tracking). After: parameters come from the fitted runs alone; start pose and random effects
(friction, gains and start) are fitted within the run-to-run scatter. Before: the robot file as it is, for the same
random effects and the start pose that suits it best. The floor is what noise alone leaves (of marks, camera and plate),
and never less than two programs of the same model differ by.
Predicted: the RMS distance of the robot's centre where a robot file is simulated from the start pose alone, as
`turnscope compare` does it; nothing of the run is fitted. What the fitted runs say of the session as a whole (start of
motion, clock, scale, level, places of the marks; session_as_found) holds in it, before and after alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special

from evaluator.comparison import simulated_poses, trajectory_gap
from evaluator.diagnosis.likelihood.features import MODEL_FLOOR_MM
from evaluator.diagnosis.likelihood.problem import Point, Problem
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.marks import columns_of
from evaluator.pose import poses_from_marks
from evaluator.robot_geometry import mark_geometry, reference_pair
from simulator.errors import SimulationError
from simulator.robot import Robot

Floats = NDArray[np.float64]

GROWN = 0.025  # probability, by chance, of so many runs with a larger gap: one side of a 95 % interval of the median
# Whatever the evidences say, a model that misses the marks of a run by so many times the noise floor does not follow
# it. Where the verdict was right the gap lay between 0.9 and 1.12 floors; fits that had not settled left 50 and more.
# Some runs may be outlying (dust, a snagged tether, the edge between two steady states): they are named.
MISSED = 2.5
OF_WANDER = 4.0  # standard deviations of what is one Gaussian number in a run: beyond, once in 16,000 runs
CHANGED_FLOORS = 0.5  # of the noise floor: what is relevant of a path by default


@dataclass(frozen=True)
class Gap:
    """RMS gap by run, mm, before and after the effect is added, refitted and predicted; noise floor of each run.

    not_predicted: why a run could not be simulated from its start pose, before or after; its predicted gap is then NaN.
    """

    before_mm: Floats
    after_mm: Floats
    floor_mm: Floats
    predicted_before_mm: Floats
    predicted_after_mm: Floats
    not_predicted: Mapping[int, str] = field(default_factory=dict)

    def answered(self, *, added: bool) -> Gap:
        """The gap that goes with an answer: where nothing is added and refitting is no nearer, that of the file.

        added: whether the answer adds anything to the model. Nominal values and all that is known to a tolerance may
        end farther from the marks than they began where no fit follows the runs: such values are not proposed.
        """
        if added or not not_shrunk(self):
            return self
        return replace(self, after_mm=self.before_mm, predicted_after_mm=self.predicted_before_mm)


def grown_gap(gap: Gap, held_out: Sequence[int] = ()) -> str:
    """Why a gap speaks against what was added to the model; empty where neither gap does.

    Refitted, the RMS over all runs must shrink: the fit had the freedom to. Of runs held out it had not, so that there
    it must not grow by what would be relevant: an effect that is there follows them to the noise, and what was only
    bent to the runs fitted does not. Predicted, an error of the start heading grows with the way, is the same before
    and after, and may rule the RMS over runs. So what is asked is the typical run, of all and of those held out: of the
    runs whose gap changes by more than half the noise floor, no more may grow than chance allows if growing and
    shrinking were as likely (sign test).
    """
    if reason := not_shrunk(gap):
        return reason
    before, after, floor = (rms(values, held_out) for values in (gap.before_mm, gap.after_mm, gap.floor_mm))
    if after > before + CHANGED_FLOORS * floor:
        return f"with it, the gap of held-out runs grows ({before:.3g} to {after:.3g} mm)"
    change = gap.predicted_after_mm - gap.predicted_before_mm
    changes = np.abs(change) > CHANGED_FLOORS * gap.floor_mm  # not a number, not simulated, is no change
    aside = np.isin(np.arange(len(change)), held_out)
    for asked, what in ((changes, "runs"), (changes & aside, "held-out runs")):
        larger, count = int(np.count_nonzero(change[asked] > 0)), int(asked.sum())
        if larger and special.bdtrc(larger - 1, count, 0.5) < GROWN:
            return (
                f"the gap predicted from the start pose alone grows in {larger} of {count} {what} in which it changes"
            )
    return ""


def not_shrunk(gap: Gap, held_out: Sequence[int] = ()) -> str:
    """Why a gap after refitting speaks against what was added; empty where it shrinks, as it had the freedom to.

    On runs held out it must shrink where the robot file does not follow them: elsewhere there is nothing to explain.
    """
    everything = range(len(gap.after_mm))
    before, after = rms(gap.before_mm, everything), rms(gap.after_mm, everything)
    if not after < before:
        return f"the gap after refitting does not shrink ({before:.3g} to {after:.3g} mm)"
    before, after, floor = (rms(values, held_out) for values in (gap.before_mm, gap.after_mm, gap.floor_mm))
    if before > MISSED * floor and after >= before:
        return f"the gap of held-out runs does not shrink ({before:.3g} to {after:.3g} mm)"
    return ""


def counting_data(problem: Problem) -> tuple[RunData, ...]:
    """The runs without the marks of frames that do not count in a fit either: a robot taken away at the end is one."""
    counts = [np.isfinite(item).all(axis=1, keepdims=True) for item in problem.channels]
    return tuple(
        replace(run, marks_mm=np.where(seen, run.marks_mm, np.nan))
        for run, seen in zip(problem.data, counts, strict=True)
    )


def predicted_gaps(
    data: Sequence[RunData], robots: Sequence[Robot], measured_by: Sequence[Robot]
) -> tuple[Floats, dict[int, str]]:
    """RMS distance of the centre by run, mm, of robots simulated from the start pose; NaN where that cannot be done.

    measured_by: the robots whose marks turn measured marks into poses. Returns the distances, and why a run has none.
    """
    found, reasons = np.full(len(data), np.nan), {}
    for number, (run, robot, by) in enumerate(zip(data, robots, measured_by, strict=True)):
        try:
            found[number] = _predicted_gap(run, robot, by)
        except SimulationError as error:
            reasons[number] = str(error)
    return found, reasons


def _predicted_gap(run: RunData, robot: Robot, measured_by: Robot) -> float:
    pair = reference_pair(measured_by) or ()
    table = pd.DataFrame(np.column_stack([run.time_s, run.marks_mm]), columns=["time_s", *columns_of(pair)])
    poses = poses_from_marks(table, mark_geometry(measured_by).only(pair))
    _, seen = simulated_poses(robot, run.run_command, poses, run.order)
    return trajectory_gap(poses, seen)["gap_rms_mm"]


def run_gaps(problem: Problem, placed: Point, runs: Sequence[int]) -> Floats:
    """RMS distance of the midpoint by run, mm, at a point."""
    residuals = problem.residuals([placed.task(run) for run in runs])
    return np.array([np.sqrt(np.nanmean(np.sum(item[:, :2] ** 2, axis=1))) for item in residuals])


def farthest_followed(problem: Problem, runs: Sequence[int]) -> Floats:
    """Gap by run, mm, beyond which a model does not follow the marks.

    Tracking noise is an average over hundreds of frames. Of friction that wanders one mode holds three fifths, so that
    its part of a single run scatters like one Gaussian number.
    """
    wander = _wander(problem, runs)
    return np.asarray(np.hypot(MISSED * np.sqrt(noise_floor(problem, runs) ** 2 - wander**2), OF_WANDER * wander))


def _wander(problem: Problem, runs: Sequence[int]) -> Floats:
    return np.array([problem.compressions[run].wander_mm for run in runs])


def noise_floor(problem: Problem, runs: Sequence[int]) -> Floats:
    """RMS distance of the midpoint that noise of tracking and ground and the model's precision make, by run, mm."""
    # on ground, what drifts is by its definition what is left about the best start pose
    spans_s = [0.0 if problem.open_ground else float(np.ptp(problem.data[run].time_s)) for run in runs]
    noise = np.array(
        [
            [part.about_mean_mm(span) if span else part.sigma_mm for part in problem.noise[run][:2]]
            for run, span in zip(runs, spans_s, strict=True)
        ]
    )
    wander = _wander(problem, runs)
    return np.asarray(np.sqrt(np.sum(noise**2, axis=1) + wander**2 + (problem.length * MODEL_FLOOR_MM) ** 2))


def rms(values: Floats, runs: Sequence[int]) -> float:
    """RMS over some runs; NaN over none."""
    chosen = values[list(runs)]
    return float(np.sqrt(np.nanmean(chosen**2))) if np.isfinite(chosen).any() else float("nan")
