"""Runs of a circular test, workers, budgets, scenes and single tables, beside stand-ins of what they call."""

from __future__ import annotations

import gc
import multiprocessing.connection
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from evaluator.errors import InputError
from evaluator.progress import Cancelled
from evaluator.workflow import rendering, turning_tables
from evaluator.workflow.circular import evaluate
from evaluator.workflow.circular import runs as circular
from evaluator.workflow.execution import answers, machine, precompile
from evaluator.workflow.execution.answers import answers_of
from evaluator.workflow.runs import budget
from evaluator.workflow.viewing import sandbox
from simulator.effects.entry import EffectEntry
from simulator.robot import load_robot

TRACK_MM = 4.0


def rolling(_robot: object, left: float, right: float) -> Any:
    """Steady turn of wheels that roll: curvature 2·(right - left) / (track · (right + left))."""
    curvature = 2 * (right - left) / (TRACK_MM * (right + left))
    return SimpleNamespace(curvature_per_mm=-curvature, radius_mm=1 / curvature, speed_mm_s=2.0, yaw_rate_rad_s=0.5)


@pytest.mark.parametrize("radius_mm", [2.001, 5.0, 990 * TRACK_MM])
def test_wheels_that_roll_keep_a_radius_by_their_ratio(radius_mm: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(circular, "steady_turn", rolling)
    runs = circular.circular_runs("barrel", rpm=(20.0, 40.0, 60.0), radius_mm=radius_mm, repetitions=1)
    slower, faster = np.sort(np.abs([(run.left_rpm, run.right_rpm) for run in runs]), axis=1).T
    ratio = (radius_mm - TRACK_MM / 2) / (radius_mm + TRACK_MM / 2)
    np.testing.assert_allclose(slower / faster, ratio, atol=1e-4)
    assert sorted(set(faster)) == [20.0, 40.0, 60.0]


@pytest.mark.parametrize("radius_mm", [1.99, 1010 * TRACK_MM])
def test_a_radius_below_half_the_track_or_of_a_thousand_tracks_is_refused(
    radius_mm: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(circular, "steady_turn", rolling)
    with pytest.raises(InputError, match=r"at 20 rpm; .* it turns with 2 mm or more"):
        circular.circular_runs("barrel", rpm=(20.0, 40.0, 60.0), radius_mm=radius_mm)


@pytest.mark.parametrize(("ready", "done"), [("pool", ["interrupted", ["parent"], "exit 1"]), ("parent", ["exit 1"])])
def test_a_worker_ends_its_job_with_its_pool_and_itself_with_its_parent(
    ready: str, done: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Any] = []

    def wait(ends: list[str]) -> list[str]:
        if len(ends) == 1:
            seen.append(ends)
        return [ready]

    monkeypatch.setattr(multiprocessing.connection, "wait", wait)
    monkeypatch.setattr(machine.os, "_exit", lambda code: seen.append(f"exit {code}"))
    monkeypatch.setattr(machine, "_interrupt_main", lambda: seen.append("interrupted"))
    monkeypatch.setattr(machine._Worker, "ending", False)
    machine._watch("pool", "parent")  # type: ignore[arg-type]
    assert seen == done
    assert machine._Worker.ending == (ready == "pool")


@pytest.mark.parametrize("ending", [False, True])
def test_a_job_is_done_unless_its_pool_has_ended(ending: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine._Worker, "ending", ending)
    busy: list[bool] = []

    def work(job: int) -> int:
        busy.append(machine._Worker.busy)
        machine._interrupted(2, None)  # of the terminal: the parent acts on it
        return 2 * job

    if ending:
        with pytest.raises(Cancelled):
            machine.interruptible(work, 3)
        machine._interrupted(2, None)  # between two jobs
    else:
        assert machine.interruptible(work, 3) == 6
    assert busy == [True] * (not ending)
    assert not machine._Worker.busy


def test_a_job_is_interrupted_while_it_runs_when_its_pool_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine._Worker, "ending", False)

    def work(_: int) -> None:
        machine._Worker.ending = True
        machine._interrupted(2, None)

    with pytest.raises(Cancelled):
        machine.interruptible(work, 3)
    assert not machine._Worker.busy


def test_what_compiles_ahead_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[Any] = []
    monkeypatch.setattr(precompile.os, "open", lambda *_: 9)
    monkeypatch.setattr(precompile.os, "dup2", lambda *said: done.append(said))
    precompile._quietly(lambda: done.append(1 / 0), lambda: done.append("worked"))
    assert done == [(9, 1), (9, 2), "worked"]


def _collecting() -> tuple[tuple[int, ...], int]:
    return gc.get_threshold(), gc.get_freeze_count()


def test_a_process_collects_garbage_as_seldom_as_its_parent_and_not_among_imports() -> None:
    before = gc.get_threshold()
    gc.set_threshold(54_321, 11, 12)
    try:
        with machine.worker_pool(1) as pool:
            threshold, frozen = pool.submit(_collecting).result()
    finally:
        gc.set_threshold(*before)
    assert threshold == (54_321, 11, 12)
    assert frozen > 100_000


def test_processes_are_prepared_by_starting_the_fork_server(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[str] = []
    monkeypatch.setattr("multiprocessing.forkserver.ensure_running", lambda: started.append("fork server"))
    monkeypatch.setattr(machine.sys, "platform", "linux")
    machine.prepare_processes()
    monkeypatch.setattr(machine.sys, "platform", "darwin")
    machine.prepare_processes()
    assert started == ["fork server"]


INTERRUPTED_AT_START = """
import os
from multiprocessing import forkserver
from evaluator.workflow.execution import machine
end, request = forkserver.connect_to_new_process([])
os.close(request)
assert forkserver.read_signed(end) > 1  # the number of the process
assert forkserver.read_signed(end) == 1  # and its exit status
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has a fork server here")
def test_a_process_whose_start_is_interrupted_says_nothing() -> None:
    command = [sys.executable, "-c", INTERRUPTED_AT_START]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_other_errors_of_the_fork_server_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    before = sys.excepthook
    try:
        from evaluator.workflow.execution import fork_server
    finally:
        sys.excepthook = before
    fork_server.hook(EOFError, EOFError(), None)
    assert capsys.readouterr().err == ""
    fork_server.hook(ValueError, ValueError("unexpected"), None)
    assert "unexpected" in capsys.readouterr().err


def test_a_run_may_have_a_robot_and_a_camera_of_its_own_in_its_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    known = SimpleNamespace(mark_position_mm=0.1, mark_height_mm=0.2)
    monkeypatch.setattr(budget, "read_with", lambda _, path: SimpleNamespace(path=str(path), known_to=known))
    monkeypatch.setattr(budget, "read_marks", lambda path: path.name)
    monkeypatch.setattr(budget, "MarkGeometry", SimpleNamespace(of_robot=lambda robot: robot.path))
    monkeypatch.setattr(budget, "uncertainty_budget", lambda *said, **more: asked.append((*said, more)))
    own = {"video": "v", "start_s": 0.5, "stop_s": 2.0}
    runs = [
        SimpleNamespace(id="a", robot=None, camera=None, **own),
        SimpleNamespace(id="b", robot="r.toml", camera="c.json", **own),
        SimpleNamespace(id="c", robot=None, camera="c.json", **{**own, "video": None}),
    ]
    day: Any = SimpleNamespace(robot="barrel", camera="usual.json", run=runs, known_to=SimpleNamespace(time_base=0.3))
    outputs: Any = SimpleNamespace(marks=lambda run: Path(f"{run}.csv"))
    for run in "abc":
        budget.budget_of(day, outputs, run)
    found = [(table, robot, camera and camera.path) for table, robot, camera, _ in asked]
    assert found == [("a.csv", "barrel", "usual.json"), ("b.csv", "r.toml", "c.json"), ("c.csv", "barrel", None)]
    told = asked[0][3]["known"]
    assert tuple(vars(told).values()) == (0.1, 0.2, 0.3)
    assert (asked[0][3]["start_s"], asked[0][3]["stop_s"]) == (0.5, 2.0)


@pytest.mark.parametrize("kind", ["gauge", "clip"])
def test_a_scene_is_rendered_with_its_truth_and_what_it_holds_is_counted(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Gauge(SimpleNamespace):
        pass

    dots = pd.DataFrame({"x_mm": [1 / 3, 2.0], "visible": [True, False]})
    frames = pd.DataFrame({"frame": [0, 1, 2], "x_mm": [1 / 3, 2.0, 3.0]})
    monkeypatch.setattr("simulator.rendering.GaugeScene", Gauge)
    monkeypatch.setattr("simulator.rendering.render_gauge", lambda _: ("image", dots))
    monkeypatch.setattr("simulator.rendering.check_container", lambda *_: None)
    monkeypatch.setattr("simulator.rendering.render_clip", lambda _, path, __: path.write_text("video") and frames)
    monkeypatch.setattr(rendering, "write_image", lambda image, path: path.write_text(image))
    scene: Any = Gauge() if kind == "gauge" else SimpleNamespace(encoding=None)
    order = rendering.SceneOrder(tmp_path / "s.toml", scene, tmp_path / "o", tmp_path / "t.csv")
    found = rendering.render_scene(order)
    assert (found.dots, found.frames) == ((1, 0) if kind == "gauge" else (0, 3))
    assert (tmp_path / "o").read_text(encoding="utf-8") == ("image" if kind == "gauge" else "video")
    assert "0.3333333" in (tmp_path / "t.csv").read_text(encoding="utf-8").replace("0.33333333", "")


@pytest.mark.parametrize(("sigma", "several"), [(0.0, False), (0.02, False), (0.0, True)])
def test_a_scale_that_is_not_exact_widens_a_turn_and_several_motions_are_told(
    sigma: float, several: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def turn(scale: float) -> Any:
        rows = [{"phase": 1}, {"phase": 2}]
        return SimpleNamespace(
            phases=(),
            phase_rows=lambda: rows,
            with_scale=turn,
            to_row=lambda: {"scale": scale},
            summary=lambda: "a turn",
            mark_spacing_ratio=1.19,
        )

    asked: list[Any] = []
    monkeypatch.setattr(turning_tables, "measure_turning", lambda *said, **more: asked.append((said, more)) or turn(0))
    monkeypatch.setattr(turning_tables, "several_motions", lambda *said: several and said == ((), 0.5, 2.0))
    monkeypatch.setattr(turning_tables, "spacing_fault", lambda _: "wrong unit" if several else "")
    monkeypatch.setattr(turning_tables, "spacing_note", lambda ratio: (f"{ratio} times as far apart",))
    monkeypatch.setattr(turning_tables, "_phase_line", lambda row: f"phase {row['phase']} of {row['run']}")
    request: Any = SimpleNamespace(start_s=0.5, stop_s=2.0, robot=None, left_rpm=3.0, right_rpm=4.0)
    found = turning_tables._measured({"run": "r"}, "poses", request, ["a line"], sigma)  # type: ignore[arg-type]
    assert asked == [(("poses", 0.5, 2.0), {"shape": None, "left_rpm": 3.0, "right_rpm": 4.0})]
    assert (found.row, found.phases) == (
        {"run": "r", "scale": sigma},
        ({"run": "r", "phase": 1}, {"run": "r", "phase": 2}),
    )
    doubt = () if several else ("1.19 times as far apart",)  # a fault of the unit is the summary
    assert found.lines == ("a turn", *doubt, "a line", *(("phase 1 of r", "phase 2 of r") if several else ()))


@pytest.mark.parametrize(("workers", "jobs"), [(1, [3, 4]), (4, [3])])
def test_a_single_worker_or_job_is_done_here_with_a_look_at_the_cancel_button_before_each(
    workers: int, jobs: list[int]
) -> None:
    done: list[Any] = []

    def work(job: int) -> int:
        done.append(job)
        return 2 * job

    doing = answers_of(work, jobs, when_killed=work, workers=workers, waiting=lambda: done.append("looked"))
    with doing as found:
        assert list(found) == [(number, 2 * job) for number, job in enumerate(jobs)]
    assert done == [step for job in jobs for step in ("looked", job)]


def test_other_processes_get_effects_of_ones_own_only_where_there_are_some(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[Any] = []

    def processes(work: Any, *_: Any, **__: Any) -> Any:
        given.append(work)
        yield from ()

    monkeypatch.setattr(answers, "in_processes", processes)
    for known in (answers.KnownEffects(), "others"):
        monkeypatch.setattr(answers.KnownEffects, "here", staticmethod(lambda known=known: known))
        with answers_of(abs, [1], when_killed=abs) as found:
            list(found)
    assert given[0] is abs
    assert (given[1].func, given[1].args) == (answers.with_effects, ("others", abs))


def test_an_effect_that_is_set_takes_the_place_of_that_of_the_robot_and_others_stay() -> None:
    entries = [{"id": "time-base", "factor": 1.1}, {"id": "plane-scale", "factor": 1.2}]
    robot = load_robot("barrel").model_copy(update={"effect": tuple(map(EffectEntry.model_validate, entries))})
    found = sandbox._changed(robot, {"wheels.track_mm": 5.0}, {"time-base": {"factor": 0.9}})
    assert [(entry.id, entry.given) for entry in found.effect] == [
        ("plane-scale", {"factor": 1.2}),
        ("time-base", {"factor": 0.9}),
    ]
    assert found.track_mm == 5.0


def test_turns_of_a_simulated_test_are_numbered_in_the_order_of_their_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = [SimpleNamespace(left_rpm=float(k), right_rpm=2.0 * k) for k in range(12)]
    monkeypatch.setattr(evaluate, "circular_runs", lambda *_, **said: runs if said["repetitions"] == 1 else None)
    monkeypatch.setattr(evaluate, "_simulated", lambda _, commands: commands)
    found: Any = evaluate.simulate_circular_test("barrel").simulated
    assert found["run"].tolist() == [f"s{k:02d}" for k in range(1, 13)]
    assert found["right_rpm"].tolist() == [2.0 * k for k in range(12)]
