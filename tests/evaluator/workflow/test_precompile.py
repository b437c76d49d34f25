"""What the first demo compiles ahead is what it needs."""

from __future__ import annotations

from pathlib import Path
from queue import Empty, Queue

import pytest

from calibration import compilation
from evaluator.tracking.refinement import kernels
from evaluator.workflow.execution import precompile
from simulator.integrator.batch import integrate_some
from simulator.integrator.run_kernel import integrate_run
from tests.waiting import HANGS_S

VIDEO = Path(__file__).parents[3] / "sample_videos" / "turn-33-5.mp4"


def test_trying_tracker_and_simulator_leaves_their_kernels_ready() -> None:
    precompile.measure_turn(VIDEO)
    precompile.simulate_run()
    for kernel in (kernels._fit_disc, integrate_run, integrate_some):
        assert kernel.signatures  # type: ignore[attr-defined, unused-ignore]


@pytest.mark.parametrize("kept", [True, False])
def test_processes_are_started_where_kernels_are_not_kept_and_nowhere_else(
    kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: Queue[Path] = Queue()
    monkeypatch.setattr(precompile, "_start", tried.put)
    monkeypatch.setattr(compilation, "is_kept", lambda kernel: kept and kernel is integrate_some)
    precompile.precompile(VIDEO)
    if kept:
        with pytest.raises(Empty):
            tried.get(timeout=0.05)  # a thread that was started puts it there at once
    else:
        assert tried.get(timeout=HANGS_S) == VIDEO
