"""What the first demo compiles ahead is what it needs."""

from __future__ import annotations

import multiprocessing
from pathlib import Path

from evaluator.tracking.refinement import kernels
from evaluator.workflow.execution import precompile
from simulator.integrator.batch import integrate_some
from simulator.integrator.run_kernel import integrate_run

VIDEO = Path(__file__).parents[3] / "sample_videos" / "turn-33-5.mp4"


def test_trying_tracker_and_simulator_leaves_their_kernels_ready() -> None:
    precompile.measure_turn(VIDEO)
    precompile.simulate_run()
    for kernel in (kernels._fit_disc, integrate_run, integrate_some):
        assert kernel.signatures  # type: ignore[attr-defined, unused-ignore]


def test_no_process_is_started_where_kernels_are_kept() -> None:
    precompile.simulate_run()
    before = set(multiprocessing.active_children())
    precompile.precompile(VIDEO)
    assert set(multiprocessing.active_children()) <= before
