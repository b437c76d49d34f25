"""Numbers behind the figures, in closed form: what a reader takes from the page must be what was measured."""

from __future__ import annotations

import base64
from dataclasses import replace
from math import inf, nan, pi
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest

from evaluator.marks import columns_of
from evaluator.report.figures import agreement, gap, speed, wheel_states
from evaluator.report.figures import repetitions as repetitions_module
from evaluator.report.figures.agreement import radius_agreement
from evaluator.report.figures.gap import gap_before_after
from evaluator.report.figures.radius import radius_against_ratio
from evaluator.report.figures.repetitions import repetitions
from evaluator.report.figures.speed import straight_speed
from evaluator.report.figures.wheel_states import _on_page, wheel_states_figure
from evaluator.report.numbers import unit_for
from evaluator.report.pages.trends import _digits, _rounded
from evaluator.report.player import IMAGE_BUDGET_BYTES, _fitted
from evaluator.report.runs import RunView
from evaluator.report.summary import headline
from evaluator.workflow.results.outputs import Outputs
from simulator.robot import load_robot
from simulator.steady import steady_turn
from tests.evaluator.report.shown import Shown, shown, undrawn


def test_theory_of_a_straight_run_is_the_rim_of_a_wheel_that_does_not_slip(monkeypatch: pytest.MonkeyPatch) -> None:
    undrawn(monkeypatch, speed)
    runs = [
        shown("slow", 30.0, 30.0, green_speed_mm_s=1.5, yellow_speed_mm_s=1.6),
        shown("back", -60.0, -60.0, green_speed_mm_s=-3.1, yellow_speed_mm_s=-3.0),
        shown("turn", 30.0, 20.0, green_speed_mm_s=9.0, yellow_speed_mm_s=9.0),
        shown("rest", 0.0, 0.0, green_speed_mm_s=0.0, yellow_speed_mm_s=0.0),
    ]
    found = straight_speed(runs, 0.5)
    assert found is not None
    assert found.data["run"].tolist() == ["slow", "back"]
    assert found.data["theory_mm_s"].tolist() == pytest.approx([pi / 2, -pi])  # 30 rpm: half a turn of pi mm a second
    assert found.data["green_mm_s"].tolist() == [1.5, -3.1]
    assert found.data["yellow_mm_s"].tolist() == [1.6, -3.0]


def test_a_simulated_radius_is_set_against_the_interval_of_the_measured_one_in_percent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    undrawn(monkeypatch, agreement)

    def run(name: str, radius: float, off: float, low: float, high: float, turned: float = 90.0) -> Shown:
        compared = {"radius_difference_percent": off}
        bounds = {"radius_mm": radius, "radius_low_mm": low, "radius_high_mm": high, "turned_deg": turned}
        return shown(name, 30.0, 20.0, compared, **bounds)

    runs = [run("a", 10.0, -3.0, 9.5, 10.2), run("b", 4.0, 1.0, 3.0, inf), run("c", 9e3, 0, 1, 2, 0.5)]
    found = radius_agreement(runs)
    assert found is not None
    assert found.data["run"].tolist() == ["a", "b"]  # a turn of half a degree is none to the eye
    assert found.data["difference_percent"].tolist() == [-3.0, 1.0]
    assert found.data["measured_low_percent"].tolist() == pytest.approx([-5.0, -25.0])
    assert found.data["measured_high_percent"].tolist() == pytest.approx([2.0, inf])


def test_of_many_runs_those_that_disagree_most_are_shown_in_the_order_of_the_experiment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    undrawn(monkeypatch, agreement)
    bounds = {"radius_mm": 10.0, "radius_low_mm": 9.0, "radius_high_mm": 11.0, "turned_deg": 90.0}
    runs = [
        shown(f"r{k}", 30.0, 20.0, {"radius_difference_percent": (-1) ** k * (k % 21)}, **bounds) for k in range(1, 43)
    ]
    found = radius_agreement(runs)
    assert found is not None
    left_out = {"r21", "r42"}  # both agree exactly
    assert found.data["run"].tolist() == [run.id for run in runs if run.id not in left_out]


def test_the_gap_of_every_run_is_shown_in_micrometres_the_largest_first(monkeypatch: pytest.MonkeyPatch) -> None:
    undrawn(monkeypatch, gap)
    by_run = {
        "small": {"before": 0.02, "after": 0.004, "noise_floor": 0.005},
        "large": {"before": 0.4, "after": 0.006, "noise_floor": 0.005},
    }
    found = gap_before_after({"by_run": by_run, "held_out_runs": ["small"]}, ["large"], after="so", held_out="")
    assert found is not None
    assert found.data["run"].tolist() == ["large", "small"]
    assert found.data["before_um"].tolist() == pytest.approx([400.0, 20.0])
    assert found.data["after_um"].tolist() == pytest.approx([6.0, 4.0])
    assert found.data["noise_floor_um"].tolist() == pytest.approx([5.0, 5.0])
    assert found.data["kept_aside"].tolist() == [False, True]
    assert found.data["followed"].tolist() == [False, True]


def test_a_robot_of_a_metre_is_shown_in_metres_and_newtons_and_without_the_papers_words() -> None:
    robot = load_robot(Path(__file__).parents[2] / "driven_robot" / "husky.toml")
    figure = wheel_states_figure("a", "title", robot, steady_turn(robot, 30.0, 20.0))
    (drawing,) = figure.panels
    assert "over the ground" in figure.caption
    assert " m. Thick" in figure.caption
    assert "roll freely" not in figure.caption
    assert "10 N" in drawing
    unit = unit_for(robot.body.length_mm)
    assert (unit.text(1264.0), unit.small) == ("1.26 m", "mm")
    assert unit_for(load_robot("barrel").body.length_mm).text(12.64) == "12.6 mm"
    row = {"radius_mm": 1264.0, "radius_low_mm": 1200.0, "radius_high_mm": 1300.0, "turned_deg": 90.0}
    run = replace(shown("a", 30.0, 20.0, **row), unit=unit)
    assert run.length("radius_mm") == "1.264"
    assert headline([run])[0].value == "1.26 m"
    assert headline([run])[0].range.startswith("95 %: 1.20 to 1.30 m")
    for magnetic, said in ((False, False), (True, True)):
        ratio = radius_against_ratio([run], magnetic=magnetic)
        assert ratio is not None
        assert ("magnetic" in ratio.caption) == ("equation" in ratio.panels[0]) == said
        assert "radius, m<" in ratio.panels[0]
    found = gap_before_after(
        {"by_run": {"a": {"before": 400.0, "after": 80.0, "noise_floor": 50.0}}}, after="so", held_out=""
    )
    assert found is not None
    assert "marks, mm" in found.panels[0]


def test_poses_show_no_marks(tmp_path: Path) -> None:
    outputs = Outputs(tmp_path)
    run = RunView("a", "", {"left_rpm": 1.0, "right_rpm": 1.0}, {}, outputs)
    outputs.marks("a").parent.mkdir(parents=True)
    marks = pd.DataFrame({"time_s": [0.0, 0.1], **dict.fromkeys(columns_of(("green", "yellow")), 1.0)})
    marks.to_csv(outputs.marks("a"), index=False)
    assert run.mark_names == ("green", "yellow")
    assert replace(run, from_poses=True).mark_names == ()
    assert (run.id, replace(run, turning={**run.turning, "phase": 2.0}).id) == ("a", "a (2)")


def test_repetitions_lie_about_the_mean_of_their_command_in_percent(monkeypatch: pytest.MonkeyPatch) -> None:
    undrawn(monkeypatch, repetitions_module)
    pooled = pd.DataFrame(
        [{"group": "", "left_rpm": 30.0, "right_rpm": 20.0, "radius_mm": 8.0, "radius_between_mm": 0.4}]
    )
    more = {"turned_deg": 90.0, "radius_random_mm": 0.08}
    runs = [shown("a", 30.0, 20.0, radius_mm=8.4, **more), shown("b", 30.0, 20.0, radius_mm=7.6, **more)]
    other = shown("c", 20.0, 30.0, radius_mm=7.6, **more)  # of another command
    found = repetitions([*runs, other], pooled)
    assert found is not None
    assert found.data["run"].tolist() == ["a", "b"]
    assert found.data["off_percent"].tolist() == pytest.approx([5.0, -5.0])
    assert found.data["sigma_percent"].tolist() == pytest.approx([1.0, 1.0])
    assert found.data["between_percent"].tolist() == pytest.approx([5.0, 5.0])


def test_wheels_move_with_the_body_they_are_on_and_are_drawn_as_seen_from_above(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    undrawn(monkeypatch, wheel_states)
    robot = load_robot("barrel")  # wheels at ±2 mm
    forces = SimpleNamespace(
        slip_ratio=np.array([0.1, -0.1, 0.0, 0.0]), slip_angle_rad=np.full(4, pi / 6),
        longitudinal_force_mN=np.array([1.0, -1.0, 0.0, 0.0]), lateral_force_mN=np.ones(4),
    )  # fmt: skip
    turn: Any = SimpleNamespace(u_mm_s=3.0, v_mm_s=0.5, yaw_rate_rad_s=0.25, radius_mm=12.0, wheels=forces)
    table = wheel_states_figure("a", "title", robot, turn).data.set_index("wheel")
    assert table.loc["front_left", ["velocity_forward_mm_s", "velocity_left_mm_s"]].tolist() == [2.5, 1.0]
    assert table.loc["rear_right", ["velocity_forward_mm_s", "velocity_left_mm_s"]].tolist() == [3.5, 0.0]
    assert table["slip_angle_deg"].tolist() == pytest.approx([30.0] * 4)
    assert _on_page(1.0, 2.0) == (-2.0, 1.0)  # forward is up, left is left
    for ahead, way in ((0.5, "forward"), (-0.5, "backward")):
        turn.u_mm_s = ahead
        assert way in wheel_states_figure("a", "title", robot, turn).caption


@pytest.mark.parametrize(
    ("reach", "digits"), [(0.25, 2), (0.025, 3), (2.5, 1), (25.0, 0), (2500.0, 0), (nan, 3), (0.0, 3)]
)
def test_a_change_has_the_decimals_of_two_figures_of_its_half_interval(reach: float, digits: int) -> None:
    change: Any = SimpleNamespace(low=10.0 - reach, high=10.0 + reach)
    assert _digits(change) == digits
    assert _rounded(-1.23456, change) == f"−{1.23456:.{digits}f}"


def frames(count: int, size: int) -> list[dict[str, Any]]:
    """Thumbnails of so many bytes."""
    image = np.zeros((40, 60, 3), np.uint8)
    small = cv2.imencode(".jpg", image)[1].tobytes()
    jpeg = base64.b64encode(small + bytes(size - len(small))).decode()
    return [{"time_s": 0.1 * k, "jpeg": jpeg} for k in range(count)]


@pytest.mark.parametrize(
    ("budgets", "left", "width"),
    [
        (0.98, 12, 60),  # all of them
        (1.9, 6, 60),  # every second
        (3.1, 6, 45),  # and three quarters as wide
        (4.7, 4, 45),  # every third
        (9.0, 4, 30),  # and half as wide
        (15.0, 2, 30),  # every sixth
        (30.0, 1, 30),  # one
        (50.0, 1, 22),  # three eighths as wide
    ],
)
def test_frames_of_a_page_become_fewer_before_they_become_smaller(budgets: float, left: int, width: int) -> None:
    chosen = frames(12, round(budgets * IMAGE_BUDGET_BYTES / 12))
    (found,) = _fitted([chosen])
    assert len(found) == left
    assert [time for time, _ in found] == [round(item["time_s"], 3) for item in chosen[:: 12 // left]]
    image = cv2.imdecode(np.frombuffer(base64.b64decode(found[0][1]), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.shape[1] == width


def test_runs_share_the_frames_of_a_page_if_one_small_frame_of_each_is_too_much(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("evaluator.report.player.IMAGE_BUDGET_BYTES", 1000)
    found = _fitted([frames(12, 1000)] * 12)  # twelve frames of 208 bytes
    assert [len(run) for run in found] == [1, 0, 0] * 4


def test_numbers_to_carry_away_are_the_tightest_turn_and_medians_in_percent() -> None:
    def run(name: str, radius: float, off: float, share: float, spacing: float) -> Shown:
        bounds = {"radius_mm": radius, "radius_low_mm": radius - 0.1, "radius_high_mm": radius + 0.1}
        more = {"turned_deg": 90.0, "share_used": share, "mark_spacing_ratio": spacing}
        return shown(name, 30.0, 20.0, {"radius_difference_percent": off}, **bounds, **more)

    tightest, simulated, used, scale = headline(
        [run("a", 8.0, -6.0, 1.0, 1.01), run("b", 5.0, 2.0, 0.5, 1.02), run("c", 9.0, 4.0, 0.9, 1.04)]
    )
    assert "run b" in tightest.range
    assert tightest.value.startswith("5.0")
    assert (simulated.value, simulated.range) == ("4.0 % off", "median; worst 6.0 %, run a")
    assert (used.value, used.range) == ("90.0 %", "median; lowest 50.0 %")
    assert scale.value == "+2.00 %"
