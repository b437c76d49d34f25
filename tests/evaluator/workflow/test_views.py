"""What a front end is shown of a folder: summaries, results, sliders, motions, lines of tables, and their numbers."""

from __future__ import annotations

import base64
import json
from math import inf, nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest

from evaluator.errors import InputError
from evaluator.workflow import turning_tables
from evaluator.workflow.runs import job
from evaluator.workflow.selftest.claims import CLAIMS, at_most, exactly
from evaluator.workflow.viewing import marks, overview, results, sandbox
from evaluator.workflow.viewing.cameras import image_jpeg
from simulator.effects.catalogue import EFFECTS
from simulator.effects.parameter import Parameter
from simulator.robot import load_robot
from simulator.steady import steady_turn

EXPERIMENT = """format = 1
name = "two"
robot = "barrel"
[[run]]
id = "a"
left_rpm = 1.0
right_rpm = 2.0
marks = "a.csv"
[[run]]
id = "b"
left_rpm = 3.0
right_rpm = 4.0
video = "b.mp4"
camera = "camera.json"
"""


def test_experiments_and_cameras_are_told_from_other_files(tmp_path: Path) -> None:
    camera = {"kind": "camera", "verdict": {"level": "sound", "summary": "so", "scale_sigma": 0.1}}
    files = {
        "experiment.toml": EXPERIMENT, "robot.toml": 'name = "x"\n', "more.toml": '[[run]]\nvideo = "v"\n',
        "experiment-2.toml": "this is = not toml =", "notes.toml": "neither = is = this", "empty/experiment.toml": "",
        "camera.json": json.dumps(camera), "other.json": json.dumps({**camera, "kind": "other"}), "list.json": "[1]",
        "bad.json": "{", "half.json": '{"kind": "camera"}',
    }  # fmt: skip
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    found = overview.experiments_among(tmp_path / name for name in files)
    told = {(str(item.path.relative_to(tmp_path)), item.name, item.runs, item.videos) for item in found}
    assert told == {
        ("experiment.toml", "two", 2, 1), ("more.toml", "more", 1, 1), ("empty/experiment.toml", "experiment", 0, 0),
        ("experiment-2.toml", tmp_path.name, 0, 0),
    }  # fmt: skip
    assert [item.path.name for item in found if item.fault] == ["experiment-2.toml"]
    (seen,) = overview.cameras_among(tmp_path / name for name in files)
    assert (seen.path.name, seen.level, seen.summary, seen.scale_sigma) == ("camera.json", "sound", "so", 0.1)
    large = tmp_path / "experiment-3.toml"
    large.write_text("#" * (overview.MOST_BYTES + 1))
    large.with_suffix(".json").write_text(" " * (overview.MOST_BYTES + 1))
    assert overview.experiments_among([large]) == overview.cameras_among([large.with_suffix(".json")]) == []
    assert overview.out_folder(tmp_path / "experiment.toml") == tmp_path / "out"
    assert overview.out_folder(tmp_path / "monday.toml") == tmp_path / "out-monday"


def test_results_have_the_rows_of_both_tables_and_the_gap_of_all_runs(tmp_path: Path) -> None:
    (tmp_path / "experiment.toml").write_text(EXPERIMENT)
    for name in ("a.csv", "b.mp4", "camera.json"):
        (tmp_path / name).touch()
    out = tmp_path / "out"
    for folder in ("poses", "simulated"):
        (out / folder).mkdir(parents=True)
    pd.DataFrame({"run": ["a", "b"], "radius_mm": [5.0, nan], "radius_status": ["ok", "short"]}).to_csv(
        out / "turning.csv"
    )
    gaps = {"run": ["a", "b"], "gap_rms_mm": [0.3, 0.4], "simulated_radius_mm": [5.1, nan]}
    pd.DataFrame(gaps).to_csv(out / "comparison.csv")
    path = pd.DataFrame({"time_s": np.arange(401) / 60, "x_mm": 1.23456, "y_mm": np.arange(401.0), "heading_deg": 0.0})
    path.loc[400, "x_mm"] = nan
    for run in "ab":
        path.to_csv(out / "poses" / f"{run}.csv")
    path.to_csv(out / "simulated" / "a.csv")
    view = results.results_view(tmp_path / "experiment.toml")
    first, second = view.runs
    assert (view.name, view.gap_mm) == ("two", pytest.approx(np.sqrt((0.09 + 0.16) / 2)))
    assert (first["id"], first["right_rpm"], first["has_video"], first["radius_mm"]) == ("a", 2.0, False, 5.0)
    assert (first["simulated_radius_mm"], second["radius_mm"], second["has_video"]) == (5.1, None, True)
    assert (second["simulated"], first["simulated"]["x_mm"][0]) == (None, 1.2346)
    assert first["path"]["y_mm"][:2] == [0.0, 2.0]  # every second of 400
    assert (len(first["path"]["y_mm"]), first["path"]["y_mm"][-1]) == (201, 399.0)
    (out / "comparison.csv").unlink()
    (out / "poses" / "b.csv").unlink()
    fewer = results.results_view(tmp_path / "experiment.toml")
    assert [run["id"] for run in fewer.runs] == ["a"]
    assert np.isnan(fewer.gap_mm)
    assert results.diagnosis_view(tmp_path / "experiment.toml").content is None


def test_an_image_is_shown_no_wider_than_asked_for_and_in_eight_bits(tmp_path: Path) -> None:
    image = np.full((30, 60), 65535, np.uint16)
    image[:, :30] = 0
    cv2.imwrite(str(tmp_path / "a.png"), image)
    shown = cv2.imdecode(np.frombuffer(image_jpeg(tmp_path / "a.png", 30), np.uint8), cv2.IMREAD_COLOR)
    assert shown is not None
    assert shown.shape[:2] == (15, 30)
    assert shown[:, :10].max() < 5
    assert shown[:, -10:].min() > 250
    whole = cv2.imdecode(np.frombuffer(image_jpeg(tmp_path / "a.png"), np.uint8), cv2.IMREAD_COLOR)
    assert whole is not None
    assert whole.shape[:2] == (30, 60)
    for depth, grey in ((np.uint16, 25700), (np.uint8, 100)):  # 100/255 of either range, in colour
        cv2.imwrite(str(tmp_path / "a.png"), np.full((30, 60, 3), grey, depth))
        shown = cv2.imdecode(np.frombuffer(image_jpeg(tmp_path / "a.png"), np.uint8), cv2.IMREAD_COLOR)
        assert shown is not None
        assert np.abs(shown.astype(int) - 100).max() <= 2


def test_changed_settings_replace_those_of_a_document_and_leave_the_others() -> None:
    document: dict[str, Any] = {
        "format": 1,
        "mark": {"green": {"color": "green", "diameter_px": 9}, "gone": {}},
        "old": 1,
    }
    kept = document["mark"]["green"]
    marks._merge(
        document, {"format": 1, "mark": {"green": {"color": "red", "diameter_px": 9}, "new": {"kind": "light"}}}
    )
    assert document == {
        "format": 1,
        "mark": {"green": {"color": "red", "diameter_px": 9}, "new": {"kind": "light"}},
    }
    assert document["mark"]["green"] is kept  # with the comments of a document


def test_a_slider_of_an_effect_reaches_to_either_side_of_none_within_its_bounds() -> None:
    wide = sandbox._slider(Parameter("wide_angle_deg", "deg", absent=2.0, step=0.1))
    assert (wide.words, wide.unit, wide.value, wide.low, wide.high) == ("wide angle", "°", 2.0, -2.0, 6.0)
    for effect in EFFECTS.values():
        for item in effect.parameters:
            slider = sandbox._slider(item)
            reach = max(2 * abs(item.shown_value - item.absent), 40 * item.step)
            assert slider.low == max(item.low, item.at_least, item.absent - reach)
            assert slider.high == min(item.high, item.absent + reach)
            assert slider.step == pytest.approx((slider.high - slider.low) / 200)
            assert "_" not in slider.words


def test_a_motion_of_the_sandbox_is_that_of_the_changed_robot_when_it_has_settled() -> None:
    robot = load_robot("barrel")
    turn, straight = sandbox.sandbox_motions(
        "barrel", [(30.0, 20.0), (30.0, 30.0)], nominal={}, effects={}, duration_s=2.0
    )
    steady = steady_turn(robot, 30.0, 20.0)
    assert turn["radius_mm"] == pytest.approx(abs(steady.radius_mm), rel=1e-3)
    assert turn["yaw_rate_deg_s"] == pytest.approx(np.degrees(steady.yaw_rate_rad_s), rel=1e-3)
    assert turn["speed_mm_s"] == pytest.approx(np.hypot(steady.u_mm_s, steady.v_mm_s), rel=1e-3)
    assert (straight["radius_mm"], len(straight["x_mm"])) == (None, 41)
    assert straight["x_mm"][-1] == pytest.approx(np.pi * robot.driving_radius_mm * 2, rel=1e-2)
    faster = {"effects": {"drive-speed-scale": {"factor": 1.1}}, "nominal": {"wheels.track_mm": 5.0}}
    (changed,) = sandbox.sandbox_motions("barrel", [(30.0, 30.0)], duration_s=2.0, **faster)  # type: ignore[arg-type]
    assert changed["speed_mm_s"] == pytest.approx(1.1 * straight["speed_mm_s"], rel=1e-3)
    for wrong in ({"duration_s": 0.0}, {"duration_s": 60.1}, {"duration_s": 1.0, "nominal": {"wheels.wide": 1.0}}):
        with pytest.raises(InputError):
            sandbox.sandbox_motions("barrel", [(1.0, 1.0)], **{"nominal": {}, "effects": {}, **wrong})  # type: ignore[arg-type]
    with pytest.raises(InputError, match="at most 60 runs of 60 s"):
        sandbox.sandbox_motions("barrel", [(1.0, 1.0)] * 61, nominal={}, effects={}, duration_s=1.0)


def test_corrections_are_written_in_the_order_of_frames_and_read_as_they_were(tmp_path: Path) -> None:
    file = tmp_path / "experiment.toml"
    file.write_text(EXPERIMENT)
    rows = [{"frame": 7, "mark": "green", "x": 1.23456, "y": 2.0}, {"frame": 3, "mark": "yellow", "x": None, "y": None}]
    version = marks.write_corrections(file, "b", "", rows)
    text = (tmp_path / "b-corrections.csv").read_text()
    assert text == "frame,mark,x,y\n3,yellow,absent,\n7,green,1.235,2.000\n"
    assert 'corrections = "b-corrections.csv"' in file.read_text().partition('id = "b"')[2]
    assert file.read_text().count("corrections =") == 1
    found, same = marks.corrections_of(file, "b")
    assert same == version
    assert found == [
        {"frame": 3, "mark": "yellow", "x": None, "y": None}, {"frame": 7, "mark": "green", "x": 1.235, "y": 2.0},
    ]  # fmt: skip
    assert marks.corrections_of(file, "a") == ([], "")
    mask = cv2.imdecode(
        np.frombuffer(base64.b64decode(marks._png(np.eye(3, dtype=bool))), np.uint8), cv2.IMREAD_GRAYSCALE
    )
    assert mask is not None
    np.testing.assert_array_equal(mask, 255 * np.eye(3))


def test_a_phase_is_one_line_with_its_time_kind_radius_and_speed() -> None:
    phase = {"start_s": 1.234, "stop_s": 5.0, "kind": "turn", "turned_deg": -90.4, "speed_mm_s": 1.2345,
             "radius_mm": 5.93, "radius_low_mm": 5.9, "radius_high_mm": 6.0}  # fmt: skip
    said = turning_tables._phase_line(phase)
    assert said == "1.23 to 5.00 s: turn, radius 5.93 mm, 95 % from 5.90 to 6.00, -90 degrees, 1.23 mm/s"
    rest = turning_tables._phase_line(
        {**phase, "radius_mm": nan, "speed_mm_s": nan, "turned_deg": -0.1, "kind": "rest"}
    )
    assert rest == "1.23 to 5.00 s: rest, 0 degrees"


def test_tables_are_pooled_where_they_are_repetitions_of_one_turn() -> None:
    row = {"run": "a", "radius_mm": 8.0, "radius_random_mm": 0.001, "radius_systematic_mm": 0.1, "turned_deg": 90.0,
           "left_rpm": None, "right_rpm": None, "speed_mm_s": 1.0, "yaw_rate_deg_s": 5.0}  # fmt: skip
    said = turning_tables.together([row, {**row, "radius_mm": 8.1}, {**row, "radius_mm": nan}])
    # Student's 12.706 times the error of the mean, 0.05, and 1.96 times the camera's 0.1, which both runs share.
    assert said.startswith("2 repetitions: radius 8.0500 mm, 95 % from 7.3851 to 8.7149; ")
    assert "scatter from run to run 0.07" in said
    assert said.endswith("of a single measurement 0.001 mm")
    assert turning_tables.together([row, {**row, "radius_mm": nan}]) == ""
    assert turning_tables.together([{"run": "a"}, {"run": "b"}]) == ""


def test_columns_of_our_own_tables_are_kept_and_others_are_made_from_the_points(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program, path = ["turnscope"], tmp_path / "a.csv"
    path.write_text("time_s,a_x_mm,a_y_mm,a_status\n0,1,2,ok\n0.1,1,2,ok\n", encoding="utf-8")
    monkeypatch.setattr("evaluator.interchange.tracks.program_of", lambda _: program[0])
    points = {"a": np.full((2, 2), 7.0)}

    def made(**more: Any) -> pd.DataFrame:
        request: Any = SimpleNamespace(tracks=SimpleNamespace(**{"unit": None, **more}))
        return turning_tables._table(path, np.array([0.0, 0.1]), points, request)

    assert "a_status" in made()
    assert "a_status" in made(unit="mm")
    assert made(unit="cm")["a_x_mm"].tolist() == [7.0, 7.0]
    points["b"] = points["a"]
    assert list(made()) == ["time_s", "a_x_mm", "a_y_mm", "b_x_mm", "b_y_mm"]
    points.pop("b")
    program[0] = "plain"
    assert "a_status" not in made()


def test_marks_alone_have_paths_of_their_own_and_equal_columns_are_told() -> None:
    time = np.arange(60) / 10
    circle = np.stack([10 * np.cos(time), 10 * np.sin(time)], axis=1)
    request: Any = SimpleNamespace(robot=None, start_s=None, stop_s=None)
    points = {"front": circle, "rear": circle.copy(), "lost": np.full((60, 2), nan)}
    row, lines = turning_tables._each_mark(Path("a.csv"), time, points, "px", 0.0, request)
    assert row["front_radius_px"] == pytest.approx(10.0, rel=1e-3)
    assert row["rear_speed_px_s"] == pytest.approx(10.0, rel=1e-2)
    assert "lost_radius_px" not in row
    assert lines[2] == "front and rear are at the same places in every frame; is one mark in both columns?"
    assert row["radius_status"].startswith("no robot.toml: paths of marks")
    request.robot = object()
    row, lines = turning_tables._each_mark(Path("a.csv"), time, {"front": circle}, "mm", 0.0, request)
    assert lines[-1].startswith("a single mark")
    assert len(lines) == 2
    with pytest.raises(InputError, match="no mark is in any frame"):
        turning_tables._each_mark(Path("a.csv"), time, {"lost": points["lost"]}, "mm", 0.0, request)


def test_a_pixel_is_as_large_as_the_distance_of_the_marks_says() -> None:
    geometry: Any = SimpleNamespace(farthest_pair=lambda: ("a", "b"), spacing_mm=5.0)
    places = {"a_x_mm": [0.0, 0.0, nan], "a_y_mm": 0.0, "b_x_mm": [3.0, 3.0, 9.0], "b_y_mm": 4.0}
    assert turning_tables._mm_per_px(Path("a.csv"), pd.DataFrame(places), geometry) == 1.0
    for same in (0.0, nan):
        with pytest.raises(InputError, match="both marks are at one position"):
            turning_tables._mm_per_px(Path("a.csv"), pd.DataFrame({**places, "b_x_mm": same, "b_y_mm": 0.0}), geometry)


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (InputError("a.csv: empty"), "a.csv: empty"),
        (FileNotFoundError(2, "No Such File", "a.csv"), "a.csv: no such file"),
        (OSError("odd"), "unexpected OSError"),
        (KeyError("x"), "unexpected KeyError in test_views.py, line "),
    ],
)
def test_why_a_run_failed_is_one_sentence(error: Exception, reason: str) -> None:
    with pytest.raises(type(error)) as raised:
        raise error
    assert job._reason(raised.value).startswith(reason)


@pytest.mark.parametrize(
    ("video", "given", "said"), [("v", None, "track"), (None, "m", "read marks"), (None, None, "read poses")]
)
def test_a_step_is_named_for_what_it_reads(video: str | None, given: str | None, said: str) -> None:
    work: Any = SimpleNamespace(run=SimpleNamespace(video=video, marks=given))
    assert job.step_of(work, "track") == said
    assert job.step_of(work, "turn") == "turn"


def test_a_claim_holds_within_its_limits_and_says_them() -> None:
    small, exact = at_most("a", "track", "error", 5.0, "µm", ""), exactly("b", "track", "share", 1.0, "")
    assert [small.holds(value) for value in (-9.0, 5.0, 5.1, nan)] == [True, True, False, False]
    assert [exact.holds(value) for value in (1.0, 0.99, nan)] == [True, False, False]
    assert (small.expected, exact.expected) == ("at most 5 µm", "1")
    assert (small.low, small.high) == (-inf, 5.0)
    assert len({claim.id for claim in CLAIMS}) == len(CLAIMS)
