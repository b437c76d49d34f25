"""Recordings of poses whose clock differs from that of their command log by more than in the other runs.

Parts of such a recording contradict the model as the ground does, so that no comparison with it finds them: the whole
motion is compared with the whole log instead, without a model.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.motion import midpoint_and_heading
from evaluator.diagnosis.mistakes.recognised import Correction, Found
from evaluator.diagnosis.mistakes.start.late_start import LATE_S, LATE_SPREADS, SLOWEST_S
from evaluator.interchange.log_offset import LogOffset, log_offset
from evaluator.robust import robust_sigma
from evaluator.turning.clock import MOST_LATE_S

# Widest 95 % interval of an offset that is used, s. Of 12 recordings of robots of UTIAS of one to three minutes it was
# 0.02 to 0.22 s; offsets that were wrong had intervals of 0.4 s and more.
WIDEST_S = 0.2
FEWEST = 3  # runs of which one may be unlike the others


def clocks_off(data: Sequence[RunData]) -> list[Found]:
    """Runs whose motion follows their log at another offset than that of the others.

    The offset contains the lag of the drive, which all runs share. Of fewer than FEWEST runs, it is compared with what
    the slowest drives need.
    """
    known = {run.id: offset for run in data if (offset := _offset(run)) and offset.high_s - offset.low_s < WIDEST_S}
    values = [offset.value_s for offset in known.values()]
    if len(values) < FEWEST:
        usual_s, least_s = 0.0, SLOWEST_S
    else:
        usual_s, least_s = float(np.median(values)), max(LATE_S, LATE_SPREADS * robust_sigma(values))
    return [
        _told(run, offset.value_s - usual_s, "than in the other runs" if usual_s else "than it says")
        for run, offset in known.items()
        if offset.low_s > usual_s + least_s or offset.high_s < usual_s - least_s
    ]


def _offset(run: RunData) -> LogOffset | None:
    time_s, middle_mm, heading_rad = midpoint_and_heading(run)
    if run.log is None or len(time_s) < 2:
        return None
    pose, times = np.column_stack([middle_mm, heading_rad]), run.log.command.time_s
    return log_offset(time_s, pose, run.log.command.at, (float(times[0]), float(times[-1])), MOST_LATE_S)


def _told(run: str, later_s: float, than: str) -> Found:
    seen = f"its motion follows its command log {abs(later_s):.2f} s {'later' if later_s > 0 else 'earlier'} {than}"
    remedy = (
        f"{'add' if later_s > 0 else 'subtract'} {abs(later_s):.2f} s {'to' if later_s > 0 else 'from'} its start_s"
    )
    return Found(run, "late-start", seen, remedy, correction=Correction(later_s=round(later_s, 2)))
