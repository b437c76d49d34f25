"""What the workflow does with cameras, recordings and laboratories, which are made up: no process and no video."""

from __future__ import annotations

from pathlib import Path
from statistics import NormalDist
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from calibration.assignment import array_in_image
from evaluator.errors import InputError
from evaluator.recording.layout import Layout
from evaluator.tracking import TrackingSettings
from evaluator.tracking.observation import UNLIKE
from evaluator.workflow import rendering, tracking
from evaluator.workflow.frames import decoder, live
from evaluator.workflow.frames.live import LiveCamera, LiveSource
from evaluator.workflow.selftest import laboratory
from evaluator.workflow.selftest.claims import CLAIMS
from evaluator.workflow.viewing import cameras

FIRST, OTHER = LiveSource("0"), LiveSource("1")


def test_one_camera_is_open_at_a_time_and_opened_anew_after_it_was_released(monkeypatch: pytest.MonkeyPatch) -> None:
    done = list[Any]()

    def child(_answers: Any, asked: Any, wait_s: float, slow: str, died: str, idle_s: float) -> Any:
        name = asked[0].name
        assert (wait_s, idle_s, slow.startswith(name), died.startswith(name)) == (60.0, 10.0, True, True)
        done.append(f"open {name}")
        return SimpleNamespace(ask=lambda *said: (name, *said), close=lambda: done.append(f"close {name}"))

    monkeypatch.setattr(live, "Child", child)
    camera: Any = LiveCamera()
    camera.close()  # there is none yet
    assert [camera.look(source) for source in (FIRST, LiveSource("0"), OTHER)] == [
        ("0", "look"),
        ("0", "look"),
        ("1", "look"),
    ]
    camera.take(OTHER, Path("a.png"))
    camera.close()
    camera.look(OTHER)
    assert done == ["open 0", "close 0", "open 1", "close 1", "open 1"]


def image(number: int, time: float | None = None) -> Any:
    return SimpleNamespace(pts=number, time=time, time_base=1, number=number)


def bench(images: list[Any], monkeypatch: pytest.MonkeyPatch, name: str = "0") -> Any:
    """A camera that has delivered all its frames."""
    one: Any = live._Bench(LiveSource(name))
    made = list[int]()

    def layout(first: Any) -> Any:
        made.append(first.number)
        frame = lambda shown, *_: SimpleNamespace(to_rgb=lambda: np.full((4, 6, 3), [shown.number, 1, 2], np.uint8))  # noqa: E731
        return SimpleNamespace(fits=lambda other: other.number < 5, frame=frame)

    monkeypatch.setattr(Layout, "of", layout)
    one._follow([SimpleNamespace(frames=images[:2]), SimpleNamespace(frames=images[2:])])
    one.layouts = made
    one._thread = "there"
    return one


def test_a_preview_shows_the_latest_frame_with_the_gauge_found_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decoder, "jpeg", lambda shown, most: (shown[0, 0].tolist(), most))
    monkeypatch.setattr(live, "_gauge_of", lambda frame: {"centers_px": int(frame.to_rgb()[0, 0, 0])})
    one = bench([image(k) for k in (1, 2, 3)], monkeypatch)
    assert one.layouts == [1]
    shown, told = one.answer("look")
    assert shown == ([2, 1, 3], 1280)  # blue, green, red
    assert told == {"centers_px": 3, "size_px": [6, 4], "late": False}
    written = list[Any]()
    monkeypatch.setattr("evaluator.files.write_image", lambda rgb, path: written.append((rgb[0, 0].tolist(), path)))
    one.answer("take", "a.png")
    assert written == [([3, 1, 2], "a.png")]
    assert bench([image(k) for k in (1, 9, 9)], monkeypatch).layouts == [1, 9, 9]  # another format in mid stream


def test_a_preview_goes_on_without_dots_while_they_are_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decoder, "jpeg", lambda *_: b"")
    one = bench([image(1)], monkeypatch)
    one._finding, over = SimpleNamespace(result=lambda: {"light": "dark"}), list[Any]()
    monkeypatch.setattr(live, "wait", lambda _, timeout: SimpleNamespace(done=over) if timeout == 1.0 else None)
    one._looked_at = one._latest
    assert one._look()[1] == live.NOTHING | {"size_px": [6, 4], "late": True}
    over.append(one._finding)
    assert one._look()[1] == {"light": "dark", "size_px": [6, 4], "late": False}
    assert one._finding is None
    with pytest.raises(InputError, match="0: delivers no frames"):
        bench([], monkeypatch)._look()


def test_a_file_in_place_of_a_camera_is_read_in_real_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock, slept = iter([100.0, 100.0, 100.25, 101.0]), list[float]()
    monkeypatch.setattr(live, "time", SimpleNamespace(perf_counter=lambda: next(clock), sleep=slept.append))
    (tmp_path / "a.mp4").touch()
    bench([image(1, 5.0), image(2, 5.5), image(3, 5.75), image(4)], monkeypatch, str(tmp_path / "a.mp4"))
    assert slept == [0.0, 0.25, 0.0]  # the third is late, the fourth has no time
    bench([image(1, 5.0)], monkeypatch)  # a camera takes its time itself
    assert len(slept) == 3


def test_the_gauge_of_a_preview_is_told_by_the_medians_of_its_dots(monkeypatch: pytest.MonkeyPatch) -> None:
    class Dots(SimpleNamespace):
        def __len__(self) -> int:
            return 4

    dots = Dots(
        centers_px=np.array([[1.004, 2.006], [3.0, 4.0], [5.0, 6.0], [7.0, 8.0]]),
        covariance_px2=np.array([0.01, 0.04, 0.09, 9.0])[:, None, None] * np.diag([1.5, 0.5]),
        blur_px=np.array([1.0, 2.0, 4.0, 99.0]),
        diameter_px=np.array([10.0, 20.0, 40.0, 99.0]),
    )
    found = {"array": np.array([0, 1, 2])}
    monkeypatch.setattr(array_in_image, "find_array", lambda _: (dots, SimpleNamespace(dot=found["array"])))
    told = cameras.gauge_in(np.full((20, 30, 3), 200, np.uint8))
    assert told["centers_px"][0] == [1.0, 2.01]
    assert told["of_array"] == [True, True, True, False]
    assert told["size_px"] == [30, 20]
    assert (told["sigma_px"], told["blur_px"], told["diameter_px"]) == (pytest.approx(0.2), 2.0, 20.0)
    found["array"] = np.array([], int)
    told = cameras.gauge_in(np.full((20, 30), 200, np.uint8))
    assert [told[name] for name in ("sigma_px", "blur_px", "diameter_px")] == [None] * 3


def test_a_hidden_effect_has_runs_both_ways_that_begin_late_and_one_of_exchanged_sides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driven = list[Any]()
    marks = pd.DataFrame({"time_s": [0.0], "green_x_mm": [1.0]})
    monkeypatch.setattr(laboratory, "_marks", lambda _robot, rpm, _rng: driven.append(rpm) or marks)
    hidden = laboratory.write_hidden_effect(tmp_path, 1)
    from evaluator.settings import load_experiment

    runs = load_experiment(hidden.experiment).run
    assert [run.id for run in runs] == [f"h{k:02d}" for k in range(12)]
    stated = [(run.left_rpm, run.right_rpm) for run in runs]
    assert [k for k in range(12) if stated[k] != driven[k]] == [3]
    assert (stated[3], hidden.swapped) == (driven[3][::-1], "h03")
    assert [run.start_s for run in runs] == pytest.approx([0.315] * 12)
    assert sorted(driven) == sorted((-left, -right) for left, right in driven)  # forward and backward
    turns = [rpm for rpm in driven if rpm[0] != rpm[1]]
    assert {rpm[::-1] for rpm in turns if max(map(abs, rpm)) < 50} <= set(turns)  # to either side


def test_a_run_of_the_laboratory_has_its_effect_its_scatter_and_its_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    from simulator import observation, simulation
    from simulator.command import Command
    from simulator.robot import load_robot

    seen = list[Any]()
    table = pd.DataFrame({"time_s": np.arange(150) / 30, "green_x_mm": 0.0, "green_y_mm": 0.0})
    monkeypatch.setattr(simulation, "simulate", lambda *said: seen.append(said))
    monkeypatch.setattr(observation, "marks_of_run", lambda *_: table.copy())
    rng = np.random.default_rng(3)
    noise = [laboratory._marks(load_robot("barrel"), (30.0, 20.0), rng) for _ in range(40)]
    places = np.concatenate([one[["green_x_mm", "green_y_mm"]].to_numpy().ravel() for one in noise])
    assert places.std() == pytest.approx(0.004, rel=0.02)
    np.testing.assert_array_equal(noise[0]["time_s"], table["time_s"])
    given = [{entry.id: next(iter(entry.given.values())) for entry in robot.effect} for robot, *_ in seen]
    assert {one["axle-compliance"] for one in given} == {1.1}
    for effect, sigma in (("friction-level", 0.01), ("drive-speed-scale", 0.003)):
        values = np.array([one[effect] for one in given])
        assert values.mean() == pytest.approx(1.0, abs=4 * sigma / 40**0.5)
        assert values.std() == pytest.approx(sigma, rel=0.3)
    _, command, times_s, _ = seen[0]
    assert (len(times_s), times_s[30]) == (150, 1.0)
    assert repr(command) == repr(Command.constant(30.0, 20.0, 0.3))
    poses = np.array([(pose.x_mm, pose.y_mm, pose.heading_rad) for *_, pose in seen])
    assert (np.abs(poses) <= [6.0, 6.0, np.pi]).all()
    assert (poses.min(axis=0) < [-4.0, -4.0, -2.0]).all()
    assert (poses.max(axis=0) > [4.0, 4.0, 2.0]).all()


@pytest.mark.parametrize(
    ("seen", "said"),
    [
        ({}, None),
        ({"green": 0}, None),  # the other one is enough
        ({"moved": SimpleNamespace(note="the plate moves")}, None),
        ({"readout": SimpleNamespace(note="the shutter is not stated")}, None),
        ({"readout": SimpleNamespace(note="the shutter is not stated"), "stated": True}, None),
        ({"green": 0, "yellow": 0}, "state color, diameter_px and region_px in a tracking.toml"),
        ({"green": 0, "yellow": 0, "why": UNLIKE}, "objects of their colours never move"),
        ({"green": 0, "yellow": 0, "grey": True}, "the recording has no colour"),
        ({"green": 0, "yellow": 0, "grey": True, "live": True}, "state color"),
        ({"green": 0, "yellow": 0, "changed": True}, "a.mp4: "),
    ],
)
def test_a_recording_without_any_mark_is_refused_with_the_reason(
    seen: dict[str, Any], said: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    marks = pd.DataFrame({"frame": range(4)})
    for name in ("green", "yellow"):
        marks[f"{name}_x_px"] = [float("nan")] * 3 + [1.0 if seen.get(name, 1) else float("nan")]
        marks[f"{name}_status"] = [seen.get("why", "not seen")] + ["not seen"] * 3
    looked, written, placed, tracked_in = list[Any](), list[Any](), list[Any](), list[Any]()

    class Video(list[Any]):
        live = seen.get("live", False)
        size_px = 640, 480

        def report(self) -> Any:
            return SimpleNamespace(notes=["a note"])

    video = Video([SimpleNamespace(colourless=seen.get("grey", False))])
    monkeypatch.setattr(tracking, "open_recording", lambda *_, **__: video)
    monkeypatch.setattr(tracking, "precompile_tracker", lambda: None)
    monkeypatch.setattr(
        tracking, "WithPlate", lambda frames: SimpleNamespace(read=frames, found=lambda *_: seen.get("moved"))
    )
    monkeypatch.setattr(tracking, "track", lambda frames, *_: tracked_in.append(frames.read) or marks)
    monkeypatch.setattr(tracking, "of_common_readouts", lambda *told: seen.get("readout") if told[-1] == 480 else None)
    stated = TrackingSettings(readout_ms=0.0)
    monkeypatch.setattr(tracking, "read_with", lambda load, _: stated if load is tracking.load_settings else "camera")
    monkeypatch.setattr(tracking, "AsCalibrated", lambda *_: "undistorted")

    def place(table: Any, camera: Any, height: float) -> Any:
        placed.append((camera, height))
        nowhere = dict.fromkeys(("yellow_x_mm", "green_y_mm", "yellow_y_mm"), np.nan)
        return table.assign(green_x_mm=np.nan if height > 100 else 1.0, **nowhere)

    monkeypatch.setattr(tracking, "place_on_plate", place)
    monkeypatch.setattr(tracking, "write_marks", lambda table, path: written.append((len(table), path)))
    now = SimpleNamespace(changed=lambda: seen.get("changed", False))
    monkeypatch.setattr(tracking, "AsFound", SimpleNamespace(of=lambda _: now))
    options: Any = {"camera": Path("camera.json"), "output": "b.csv"} if seen else {}
    options |= {"settings": Path("tracking.toml")} if seen.get("stated") else {}

    def tracked() -> Any:
        return tracking.track_recording("a.mp4", looked_at=lambda *told: looked.append(len(told)), **options)

    if said is not None:
        with pytest.raises(InputError) as caught:
            tracked()
        assert said in str(caught.value)
        assert looked == [3] * (not seen.get("changed", False))
        assert tracked_in == ["undistorted"]
        return
    found = tracked()
    assert found.shares == {"green": 0.25 * seen.get("green", 1), "yellow": 0.25}
    assert repr(found) == f"Tracked(4 frames, green in {found.shares['green']:.1%}, yellow in 25.0%)"
    told = [seen[one].note for one in ("moved", "readout") if one in seen and not seen.get("stated")]
    assert (found.notes, found.names, looked) == (("a note", *told), ("green", "yellow"), [3])
    assert tracked_in == ["undistorted" if options else video]
    assert written == [(4, Path("b.csv"))] * bool(options)
    assert [camera for camera, _ in placed] == ["camera"] * bool(options)
    if options:
        assert placed[0][1] == found.geometry.height_mm > 0
        options["height_mm"] = 9.0
        tracked()
        assert placed[1][1] == 9.0
        options["height_mm"] = 390.0
        told = tracked().notes[-1]
        assert told.startswith("the camera does not see the plane 390 mm above the plate, so that no mark is placed")


def test_scenes_are_answered_in_their_order_however_they_end(monkeypatch: pytest.MonkeyPatch) -> None:
    orders: list[Any] = [SimpleNamespace(path=k, output="a.mp4", truth="a.csv") for k in range(3)]
    told = list[Any]()

    class Answers:
        def __init__(self, attempt: Any, jobs: Any, *, when_killed: Any, waiting: Any, **_: Any) -> None:
            waiting()
            self.answers = [(2, when_killed(jobs[2])), (0, attempt(jobs[0])), (1, attempt(jobs[1]))]

        def __enter__(self) -> Any:
            return iter(self.answers)

        def __exit__(self, *_: object) -> None:
            return None

    def render(order: Any) -> Any:
        if order.path:
            raise InputError("no robot")
        return rendering.Rendered(order.path, order.output, order.truth, frames=9)

    monkeypatch.setattr(rendering, "answers_of", Answers)
    monkeypatch.setattr(rendering, "render_scene", render)
    found = rendering.render_scenes(orders, progress=lambda *said: told.append(said))
    assert [(one.path, one.frames, one.fault) for one in found] == [
        (0, 9, None), (1, 0, "no robot"), (2, 0, "its process was killed (out of memory?)"),
    ]  # fmt: skip
    assert told == [("scenes", done, 3) for done in (0, 0, 1, 2, 3)]


def test_limits_of_a_self_test_are_two_to_five_times_what_a_sound_machine_shows() -> None:
    """Of figures in their reasons; two intervals in three hundred draws, and what has to be so."""
    usual = {"residual_px": 0.0018, "marks_um": 2.3, "radius_percent": 0.02}
    limits = {claim.id: (claim.low, claim.high) for claim in CLAIMS}
    assert [limits.pop(name)[1] / value for name, value in usual.items()] == pytest.approx([2.8, 2.2, 5.0], abs=0.1)
    beyond = {"radius_intervals": 1.5, "size_intervals": 1.5, "simulated_um": 0.01}
    assert limits == {name: (-np.inf, value) for name, value in beyond.items()} | dict.fromkeys(
        ("frames", "named", "swapped"), (1.0, 1.0)
    )
    assert 2 * NormalDist().cdf(-1.96 * 1.5) == pytest.approx(1 / 300, rel=0.05)
