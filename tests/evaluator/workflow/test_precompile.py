"""What the first demo compiles ahead is what it needs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from queue import Empty, Queue

import pytest

from calibration import compilation
from evaluator.tracking.detection import color_kernels
from evaluator.tracking.refinement import kernels, occluded_pixels
from evaluator.tracking.uncertainty import rim
from evaluator.workflow.execution import precompile
from simulator.integrator.batch import integrate_some
from tests.waiting import HANGS_S

VIDEO = Path(__file__).parents[3] / "sample_videos" / "turn-33-5.mp4"


def test_what_the_tracker_calls_after_a_fit_is_compiled_as_the_tracker_calls_it() -> None:
    later = (kernels._interior_slope, occluded_pixels.model, rim._rim_power, color_kernels.color_window)
    precompile.measure_mark()
    compiled = [kernel.signatures[:] for kernel in later]  # type: ignore[attr-defined, unused-ignore]
    precompile.measure_turn(VIDEO)
    assert all(compiled)
    assert [kernel.signatures for kernel in later] == compiled  # type: ignore[attr-defined, unused-ignore]


def test_trying_tracker_and_simulator_leaves_their_kernels_ready() -> None:
    precompile.measure_turn(VIDEO)
    precompile.simulate_run()
    for kernel in (kernels._fit_disc, integrate_some):
        assert kernel.signatures  # type: ignore[attr-defined, unused-ignore]


@pytest.mark.parametrize("kept", [True, False])
@pytest.mark.parametrize(
    ("start", "asked", "first"),
    [
        (lambda: precompile.precompile(VIDEO), integrate_some, precompile.simulate_run),
        (precompile.precompile_tracker, rim._rim_power, precompile.measure_mark),
    ],
    ids=["samples", "tracker"],
)
def test_processes_are_started_where_kernels_are_not_kept_and_nowhere_else(
    start: Callable[[], None], asked: object, first: object, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: Queue[tuple[object, ...]] = Queue()
    monkeypatch.setattr(precompile, "_start", lambda *works: tried.put(works))
    monkeypatch.setattr(compilation, "is_cached", lambda kernel: kept and kernel is asked)
    start()
    if kept:
        with pytest.raises(Empty):
            tried.get(timeout=0.05)  # a thread that was started puts it there at once
    else:
        assert tried.get(timeout=HANGS_S)[0] is first
