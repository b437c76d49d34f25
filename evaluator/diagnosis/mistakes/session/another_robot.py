"""Sessions whose turns are those of another robot that comes with turnscope: its name was written in the experiment."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread.alternatives import Alternative, thinned
from evaluator.diagnosis.mistakes.misread.hypotheses import MISFIT_SHARE, judgements_of
from evaluator.diagnosis.mistakes.misread.judgement import BETTER
from evaluator.diagnosis.mistakes.recognised import MOST, Found
from simulator.robot import Robot, load_robot, shipped_robots

Floats = NDArray[np.float64]

FEWEST = 3  # turns that disagree: of fewer, each may have a mistake of its own
MOST_JUDGED = 100  # turns: more of a session of thousands tell the same
# Misfit of the right robot over the extent of the path, at most, for most of the turns: an effect that makes one robot
# turn as another in every command to a twentieth is not known. With the right file 0.01 to 0.05.
ALIKE_SHARE = 0.05


def of_another_robot(data: Sequence[RunData], robots: Sequence[Robot]) -> list[Found]:
    """All runs, if most of the turns disagree with their robot and agree with another shipped one.

    Marks are those of the stated file. Straight runs of two robots with equal wheels are alike, and tell nothing.
    """
    turns = [k for k, run in enumerate(data) if any(item.left_rpm != item.right_rpm for item in run.run_command.driven)]
    if len(turns) < FEWEST or len({id(robot) for robot in robots}) > 1:
        return []
    some = np.unique(np.linspace(0, len(turns) - 1, min(len(turns), MOST_JUDGED)).astype(int))
    stated, runs = robots[0], [thinned(data[turns[k]]) for k in some]

    def judged(robot: Robot) -> tuple[Floats, Floats]:
        """Misfits (n,) of the turns, mm, and their shares of the extent."""
        found = judgements_of([[Alternative(None, run)] for run in runs], [robot] * len(runs))
        return np.array([item.misfits_mm[0] for item in found]), np.array([item.share for item in found])

    off_mm, shares = judged(stated)
    odd = shares >= MISFIT_SHARE
    if odd.sum() < max(FEWEST, len(runs) / 2):
        return []
    marks = {"marks": stated.marks, "mark": stated.mark}
    for name in shipped_robots():
        misfits_mm, near = judged(load_robot(name).model_copy(update=marks))
        fits = (misfits_mm * BETTER <= off_mm) & (near <= ALIKE_SHARE)
        if (fits & odd).sum() >= MOST * odd.sum():
            stated_mm, named_mm = (float(np.median(values[odd])) for values in (off_mm, misfits_mm))
            seen = (
                f"turns as the robot {name}, not as its file says ({(fits & odd).sum()} of {len(runs)} turns; "
                f"distance of simulated and measured marks: {stated_mm:.2g} mm as stated in the file, "
                f"{named_mm:.2g} mm as {name})"
            )
            remedy = f'is it the file of this robot? For {name}, write robot = "{name}" in experiment.toml'
            return [Found(run.id, "wrong-robot", seen, remedy) for run in data]
    return []
