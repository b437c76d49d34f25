"""What the first demo compiles ahead is what it needs."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from queue import Empty, Queue
from types import SimpleNamespace

import pytest

from calibration import compilation
from calibration.assignment import growth
from calibration.detection import noise_correlation
from evaluator.tracking.detection import color_kernels
from evaluator.tracking.refinement import kernels, occluded_pixels
from evaluator.tracking.uncertainty import rim
from evaluator.workflow import calibrate
from evaluator.workflow.execution import precompile
from evaluator.workflow.samples import sample_folder
from simulator.dynamics.motors import held_drive
from simulator.integrator.balance import newton
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


def test_what_a_calibration_calls_after_the_fit_of_dots_is_compiled_as_it_calls_it() -> None:
    later = (noise_correlation._rows_of, noise_correlation._lags, growth.grow)
    precompile.assign_dots()
    compiled = [kernel.signatures[:] for kernel in later]  # type: ignore[attr-defined, unused-ignore]
    samples = sample_folder()
    calibrate(sorted(samples.glob("gauge-*.png"))[:3], samples / "gauge.toml")
    assert all(compiled)
    assert [kernel.signatures for kernel in later] == compiled  # type: ignore[attr-defined, unused-ignore]


def test_a_demo_calibrates_before_it_imports_what_only_later_stages_need() -> None:
    code = "import sys, evaluator.workflow.demo; print('pandas' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=VIDEO.parents[1], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "False"


def test_a_steady_turn_leaves_the_kernels_of_the_report_ready() -> None:
    precompile.find_steady_turn()
    for kernel in (newton, held_drive):
        assert kernel.signatures  # type: ignore[attr-defined, unused-ignore]


@pytest.mark.parametrize(
    ("cores", "dealt"),
    [(1, [["a", "b", "c"]]), (2, [["a", "b", "c"]]), (3, [["a", "c"], ["b"]]), (16, [["a"], ["b"], ["c"]])],
)
def test_works_are_dealt_to_the_cores_that_are_left(
    cores: int, dealt: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[list[str]] = []

    def process(*, target: object, args: tuple[Callable[[], str], ...], daemon: bool) -> SimpleNamespace:
        assert (target, daemon) == (precompile._quietly, True)
        return SimpleNamespace(start=lambda: started.append([work() for work in args]))

    monkeypatch.setattr(precompile, "available_cores", lambda: cores)
    monkeypatch.setattr(precompile, "PROCESSES", SimpleNamespace(Process=process))
    precompile._start(*(lambda name=name: name for name in "abc"))  # type: ignore[misc]
    assert started == dealt


def test_trying_tracker_and_simulator_leaves_their_kernels_ready() -> None:
    precompile.measure_turn(VIDEO)
    precompile.simulate_run()
    for kernel in (kernels._fit_disc, integrate_some):
        assert kernel.signatures  # type: ignore[attr-defined, unused-ignore]


@pytest.mark.parametrize("kept", [True, False])
@pytest.mark.parametrize(
    ("start", "asked", "first"),
    [
        (lambda: precompile.precompile(VIDEO), integrate_some, precompile.assign_dots),
        (precompile.precompile_tracker, rim._rim_power, precompile.measure_mark),
    ],
    ids=["samples", "tracker"],
)
def test_processes_are_started_where_kernels_are_not_kept_and_nowhere_else(
    start: Callable[[], bool | None], asked: object, first: object, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: Queue[tuple[object, ...]] = Queue()
    monkeypatch.setattr(precompile, "_start", lambda *works: tried.put(works))
    monkeypatch.setattr(compilation, "is_cached", lambda kernel: kept and kernel is asked)
    assert start() is (None if asked is rim._rim_power else not kept)
    if kept:
        with pytest.raises(Empty):
            tried.get(timeout=0.05)  # a thread that was started puts it there at once
    else:
        assert tried.get(timeout=HANGS_S)[0] is first
