"""What figures of a report draw: lines, bars and words have the coordinates and the units of the data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, pi
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from evaluator.report.figures import agreement, effects, gap, repetitions, speed, trajectory, wheel_states
from evaluator.report.numbers import METRES
from evaluator.report.pages.colors import INK, SOFT, VERMILLION
from simulator.robot import load_robot
from tests.evaluator.report.shown import Shown, labels, limits, lines, shown, turned, undrawn

WORDS = {"after": "with values adjusted", "held_out": "adjusted without them"}


@dataclass(frozen=True)
class Seen(Shown):
    """A run with curves."""

    marks: Any = None
    poses: Any = None
    simulated: Any = None


def seen(name: str, left: float, right: float, poses: pd.DataFrame, **values: Any) -> Seen:
    """A run whose marks are 1 mm to the left and right of its centre, and whose simulation is 0.1 mm off."""
    shifts = {"green": {"x": 0.0, "y": 1.0}, "yellow": {"x": 0.0, "y": -1.0}}
    places = {(mark, axis): poses[f"{axis}_mm"] + shift[axis] for mark, shift in shifts.items() for axis in "xy"}
    marks = pd.DataFrame({f"{mark}_{axis}_mm": place for (mark, axis), place in places.items()})
    run = shown(name, left, right, **values)
    return Seen(
        *(run.run, run.group, run.turning, run.comparison, run.outputs),
        marks=marks, poses=poses, simulated=poses + 0.1,
    )  # fmt: skip


def path(x: list[float], y: list[float]) -> pd.DataFrame:
    return pd.DataFrame({"time_s": 0.5 * np.arange(len(x)), "x_mm": x, "y_mm": y, "heading_deg": 0.0})


def test_a_panel_shows_marks_centre_simulation_start_and_circle(monkeypatch: pytest.MonkeyPatch) -> None:
    axes = undrawn(monkeypatch, trajectory)
    turn = {"radius_mm": 2.0, "turned_deg": 90.0, "center_x_mm": 3.0, "center_y_mm": 4.0}
    poses = path([np.nan, 1.0, 2.0, 5.0], [np.nan, 6.0, 7.0, 9.0])
    figure = trajectory.trajectories([seen("a", 30.0, 20.0, poses, **turn)])
    assert figure is not None
    (panel,) = axes
    x, y = poses["x_mm"].tolist(), poses["y_mm"].to_numpy()
    wanted = [
        *((x, y + 1), (x, y - 1), (x, y)),
        (poses["x_mm"] + 0.1, y + 0.1),
        ([1.0], [6.0]),  # the first pose that is known
        ([3.0], [4.0]),
    ]
    assert len(lines(panel)) == len(wanted)
    for found, line in zip(lines(panel), wanted, strict=True):
        np.testing.assert_allclose(found, line)
    (circle,) = panel.add_patch.call_args.args
    assert (circle.center, circle.radius, circle.get_edgecolor()[:3]) == (
        (3.0, 4.0),
        2.0,
        (0.0, 0x72 / 255, 0xB2 / 255),
    )
    panel.set_title.assert_called_once_with("a: 30 / 20 rpm\nradius 2.00 mm")
    assert labels(panel) == ("x, mm", "y, mm")
    # x from 1 to 5, y from 2 to 10: a square of 8 mm and 4 % on either side
    np.testing.assert_allclose(limits(panel), ((3 - 4.32, 3 + 4.32), (6 - 4.32, 6 + 4.32)))
    assert figure.data.iloc[1].tolist() == ["a", 0.5, 1.0, 6.0, 0.0, 1.0, 7.0, 1.0, 5.0, 1.1, pytest.approx(6.1)]


def test_a_circle_larger_than_the_path_is_cut_off_and_a_straight_run_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    axes = undrawn(monkeypatch, trajectory)
    poses = path([0.0, 4.0], [0.0, 1.0])
    wide = {"radius_mm": 60.0, "turned_deg": 20.0, "center_x_mm": 0.0, "center_y_mm": -60.0}
    runs = [
        seen("wide", 30.0, 29.0, poses, **wide),
        seen("straight", 30.0, 30.0, poses, **{**wide, "turned_deg": 0.5}),
        replace(seen("large", 30.0, 20.0, 1000 * poses, **{**wide, "radius_mm": 2000.0}), unit=METRES),
    ]
    trajectory.trajectories(runs)
    for panel in (axes[0], axes[2]):  # turning runs first
        np.testing.assert_allclose(np.diff(limits(panel)[0]), np.diff(limits(panel)[1]))
    np.testing.assert_allclose(limits(axes[0])[0], (2 - 2.16, 2 + 2.16))
    np.testing.assert_allclose(limits(axes[0])[1], (0.5 - 2.16, 0.5 + 2.16))
    assert axes[2].set_title.call_args.args[0] == "straight: 30 / 30 rpm"
    assert not axes[2].add_patch.called
    assert axes[1].set_title.call_args.args[0] == "large: 30 / 20 rpm\nradius 2.00 m"
    assert labels(axes[1]) == ("x, m", "y, m")
    assert axes[1].xaxis.set_major_formatter.call_args.args[0](2000.0, 0) == "2"
    assert axes[1].yaxis.set_major_formatter.call_args.args[0](-500.0, 0) == "−0.5"


def test_one_run_of_a_command_is_shown_and_both_ways_stand_side_by_side() -> None:
    commands = {
        "straight": (30.0, 30.0), "a": (33.0, 14.0), "again": (33.0, 14.0), "b": (14.0, 33.0), "back": (-33.0, -14.0),
        "tight": (33.0, 5.0),
    }  # fmt: skip
    runs = [turned(name, 9.0, turned_deg=0.0 if name == "straight" else 90.0) for name in commands]
    for run in runs:
        run.turning["left_rpm"], run.turning["right_rpm"] = commands[run.run]
    assert [run.run for run in trajectory.representative(runs, 9)] == ["a", "back", "b", "tight", "straight"]
    assert [run.run for run in trajectory.representative(runs, 2)] == ["a", "back"]


@pytest.mark.parametrize(
    ("count", "most", "rows"),
    [(10, 4, [0, 3, 6, 9]), (9, 4, [0, 3, 6, 8]), (4, 4, [0, 1, 2, 3]), (1, 4, [0]), (8, 4, [0, 2, 4, 6, 7])],
)
def test_a_curve_is_thinned_to_equal_steps_and_its_end(count: int, most: int, rows: list[int]) -> None:
    assert trajectory.thinned(pd.DataFrame({"row": range(count)}), most)["row"].tolist() == rows


def test_the_line_of_theory_leads_through_the_origin_a_little_beyond_the_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    axes = undrawn(monkeypatch, speed)
    runs = [
        shown("slow", 30.0, 30.0, green_speed_mm_s=1.5, yellow_speed_mm_s=1.6),
        shown("back", -60.0, -60.0, green_speed_mm_s=-3.1, yellow_speed_mm_s=-3.0),
    ]
    speed.straight_speed(runs, 0.5)
    theory, green, yellow = lines(axes[0])
    np.testing.assert_allclose(theory, ([-64.8, 32.4], [-64.8 * pi / 60, 32.4 * pi / 60]))
    assert (green, yellow) == (([30.0, -60.0], [1.5, -3.1]), ([30.0, -60.0], [1.6, -3.0]))
    names = [call.kwargs["label"] for call in axes[0].plot.call_args_list]
    assert names == ["theory: no slip", "green mark", "yellow mark"]
    assert [call.kwargs.get("marker") for call in axes[0].plot.call_args_list] == [None, "o", "x"]
    assert labels(axes[0]) == ("rotational frequency, rpm (negative: backward)", "speed of the mark, mm/s")
    speed.straight_speed(runs[:1], 0.5)
    assert lines(axes[1])[0][0] == pytest.approx([0.0, 32.4])
    assert speed.straight_speed([shown("rest", 0.0, 0.0), shown("turn", 3.0, 2.0)], 0.5) is None


def test_deviations_are_drawn_from_nought_in_the_rows_of_their_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    axes = undrawn(monkeypatch, agreement)
    agreement.radius_agreement(
        [turned("a", 10.0, -3.0, radius_high_mm=inf), turned("b", 10.0, 1.0), turned("c", 1.0, 9.0, turned_deg=0.1)]
    )
    (deviation, bars) = (call.args for call in axes[0].hlines.call_args_list)
    assert [np.asarray(part).tolist() for part in deviation] == [[1, 0], [-3.0, 0.0], [0.0, 1.0]]
    rows, below, above = (np.asarray(part) for part in bars)
    np.testing.assert_allclose((below, above), ([-1.0, -1.0], [0.0, 1.0]), atol=1e-9)  # an open end is drawn to 0
    assert lines(axes[0]) == [([-3.0, 1.0], [1, 0])]
    assert rows.tolist() == axes[0].set_yticks.call_args.args[0].tolist() == [1, 0]
    assert axes[0].set_yticks.call_args.args[1] == ["a", "b"]
    axes[0].set_ylim.assert_called_once_with(-0.7, pytest.approx(1.7))
    axes[0].set_xlabel.assert_called_once_with("simulated against measured radius, %")
    assert agreement.radius_agreement([turned("c", 1.0, 9.0, turned_deg=0.1)]) is None


def test_gaps_are_drawn_in_rows_held_out_runs_are_shaded_and_those_not_followed_are_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    axes = undrawn(monkeypatch, gap)
    each = {"a": (0.1, 0.01), "b": (0.3, 0.02), "c": (0.2, 0.2)}
    by_run = {run: {"before": before, "after": after, "noise_floor": 0.005} for run, (before, after) in each.items()}
    content = {"by_run": by_run, "held_out_runs": ["c"]}
    figure = gap.gap_before_after(content, ["c"], **WORDS)
    assert figure is not None
    assert lines(axes[0]) == [([0.3, 0.2, 0.1], [2, 1, 0]), ([0.02, 0.2, 0.01], [2, 1, 0]), ([0.005] * 3, [2, 1, 0])]
    bars = [np.asarray(part).tolist() for part in axes[0].hlines.call_args.args]
    assert bars == [[2, 1, 0], [0.02, 0.2, 0.01], [0.3, 0.2, 0.1]]
    assert axes[0].axhspan.call_args.args == (0.5, 1.5)
    assert axes[0].set_yticks.call_args.args[1] == ["b", "c (held out, not followed)", "a"]
    axes[0].set_xscale.assert_called_once_with("log")
    axes[0].set_xlabel.assert_called_once_with("RMS distance of simulated and measured marks, µm")
    assert axes[0].xaxis.set_major_formatter.call_args.args[0](0.02, 0) == "20"
    assert "The 40" not in figure.caption
    assert "dots: with values adjusted. Strokes" in figure.caption
    assert figure.caption.endswith("Shaded runs were held out: adjusted without them.")
    open_ended = gap.gap_before_after(content, ["c"], **{**WORDS, "after": ""})
    assert open_ended is not None
    assert open_ended.title == "The gap"
    assert "dots" not in open_ended.caption
    assert len(lines(axes[1])) == 2
    assert [np.asarray(part).tolist() for part in axes[1].hlines.call_args.args][1] == [0.005] * 3
    assert axes[1].set_yticks.call_args.args[1] == ["b", "c (held out)", "a"]
    many = gap.gap_before_after({"by_run": {f"r{k}": by_run["a"] for k in range(41)}}, **WORDS)
    assert many is not None
    assert (len(many.data), "The 40 runs with the largest gap of 41." in many.caption) == (40, True)
    large = {"by_run": {"a": {"before": 1.0, "after": 0.5, "noise_floor": 0.5}}}
    gap.gap_before_after(large, **WORDS)
    axes[3].set_xlabel.assert_called_once_with("RMS distance of simulated and measured marks, mm")
    assert gap.gap_before_after({}, **WORDS) is None


def test_repetitions_stand_in_the_band_of_their_scatter_the_widest_first(monkeypatch: pytest.MonkeyPatch) -> None:
    axes = undrawn(monkeypatch, repetitions)
    row = {"group": "", "left_rpm": 30.0, "right_rpm": 20.0, "radius_mm": 8.0, "radius_between_mm": 0.08}
    wild = {**row, "group": "B", "radius_between_mm": 0.4}
    alone = {**row, "left_rpm": 9.0}
    runs = [turned(name, radius, radius_random_mm=0.04) for name, radius in (("a", 8.08), ("b", 7.92), ("c", 8.8))]
    runs += [replace(run, group="B", run=f"{run.run}-wild") for run in runs[:2]]
    runs.append(shown("single", 9.0, 20.0, radius_mm=8.0, turned_deg=90.0))
    found = repetitions.repetitions(runs, pd.DataFrame([row, wild, alone]))
    assert found is not None
    assert found.data["run"].tolist() == ["a-wild", "b-wild", "a", "b", "c"]
    assert found.data["off_percent"].tolist() == pytest.approx([1.0, -1.0, 1.0, -1.0, 10.0])
    patches = [call.args[0] for call in axes[0].add_patch.call_args_list]
    corners = [(*patch.get_xy(), patch.get_width(), patch.get_height()) for patch in patches]
    np.testing.assert_allclose(corners, [(-5, 0.68, 10, 0.64), (-1, -0.32, 2, 0.64)])
    (first, second) = axes[0].errorbar.call_args_list
    np.testing.assert_allclose(first.args, ([1, -1], [0.8, 1.2]))
    np.testing.assert_allclose(first.kwargs["xerr"], [1.96 * 0.5] * 2, rtol=1e-4)
    np.testing.assert_allclose(second.args, ([1, -1, 10], [-0.2, 0, 0.2]), atol=1e-12)
    assert list(axes[0].set_yticks.call_args.args[0]) == [1, 0]
    assert axes[0].set_yticks.call_args.args[1] == ["30 / 20 B", "30 / 20"]
    assert repetitions.repetitions(runs[-1:], pd.DataFrame([row, alone])) is None


def test_arrows_of_a_wheel_begin_at_it_and_have_the_scale_of_the_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    """The robot turns left about (−2, 12) mm; of the largest force, 5 mN, the arrow is 2.4 mm long."""
    axes = undrawn(monkeypatch, wheel_states)
    robot = load_robot("barrel")
    place = robot.wheel_positions_mm()
    forces = SimpleNamespace(
        slip_ratio=np.array([0.1, -0.1, 0.0, 0.0]), slip_angle_rad=np.radians([30.0, -1.0, 2.0, 0.0]),
        longitudinal_force_mN=np.array([3.0, -1.0, 0.0, 0.0]), lateral_force_mN=np.array([4.0, 1.0, -2.0, 0.0]),
    )  # fmt: skip
    turn: Any = SimpleNamespace(u_mm_s=3.0, v_mm_s=0.5, yaw_rate_rad_s=0.25, radius_mm=12.0, wheels=forces)
    wheel_states.wheel_states_figure("a", "title", robot, turn)
    arrows = [call.args[0] for call in axes[0].add_patch.call_args_list if hasattr(call.args[0], "_posA_posB")]
    blue, thick = arrows[0::2][:3], arrows[1::2][:3]
    drawn = 5.0 / max(robot.body.length_mm, robot.body.width_mm)
    velocity = np.stack([3.0 - 0.25 * place[:, 1], 0.5 + 0.25 * place[:, 0]], axis=1)
    velocity *= 1.6 / np.hypot(*velocity.T).max()
    force = np.array([[3.0, 4.0], [-1.0, 1.0], [0.0, -2.0]]) * 2.4 / 5.0
    for number in range(3):
        x, y = drawn * place[number]
        for arrow, (along, across) in ((blue[number], velocity[number]), (thick[number], force[number])):
            assert arrow._posA_posB[0] == pytest.approx((-y, x))
            assert arrow._posA_posB[1] == pytest.approx((-y - across, x + along))
    assert len(arrows) == 7  # a wheel without friction has no arrow of it
    words = [call.args for call in axes[0].text.call_args_list]
    assert words[1][2] == "1:  s = +0.100, α = +30.0°\n$F_x$ = +3.00, $F_y$ = +4.00 mN"
    assert words[2][2] == "2:  s = −0.100, α = −1.0°\n$F_x$ = −1.00, $F_y$ = +1.00 mN"
    assert words[1][:2] == (-4.3, 4.6)  # front left, as seen from above
    assert words[4][:2] == (4.3, -4.6)
    assert words[-1][2] == "1 mN"
    bar = axes[0].plot.call_args_list[-1].args[0]
    assert bar == pytest.approx([-0.24, 0.24])
    cross = next(call for call in axes[0].plot.call_args_list if call.kwargs.get("marker") == "x")
    assert cross.args == pytest.approx((-drawn * 12.0, -drawn * 2.0))
    rays = [call.args for call in axes[0].plot.call_args_list if call.kwargs.get("ls") == ":"]
    np.testing.assert_allclose([ray[0][1] for ray in rays], -drawn * place[:, 1])
    np.testing.assert_allclose([ray[1][1] for ray in rays], drawn * place[:, 0])
    boxes = [call.args[0] for call in axes[0].add_patch.call_args_list if hasattr(call.args[0], "get_xy")]
    (body,) = (box for box in boxes if box.get_width() > 2)
    wheels = [np.add(box.get_xy(), (box.get_width() / 2, box.get_height() / 2)) for box in boxes if box is not body]
    np.testing.assert_allclose(wheels, drawn * np.stack([-place[:, 1], place[:, 0]], axis=1), atol=1e-12)
    assert body.get_xy() == pytest.approx((-drawn * robot.body.width_mm / 2, -drawn * robot.body.length_mm / 2))


def test_an_effect_is_drawn_with_a_dot_every_second_and_its_distance_at_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    axes = undrawn(monkeypatch, effects)
    table = pd.DataFrame({"time_s": np.arange(5) / 2, "x_mm": np.arange(5.0), "y_mm": 0.0})
    table = table.assign(with_x_mm=table["x_mm"] + 3, with_y_mm=-4.0)
    figure = effects.effect_figure("tilt", "angle = 1", table)
    assert (figure.name, figure.title) == ("effect-tilt", "angle = 1")
    assert figure.caption == "A dot every second of measured time; at the end the paths are 5 mm apart."
    assert lines(axes[0]) == [
        *(([0.0, 1.0, 2.0, 3.0, 4.0], [0.0] * 5), ([0.0, 2.0, 4.0], [0.0] * 3)),
        *(([3.0, 4.0, 5.0, 6.0, 7.0], [-4.0] * 5), ([3.0, 5.0, 7.0], [-4.0] * 3)),
        ([0], [0]),
    ]
    colors = [call.kwargs["color"] for call in axes[0].plot.call_args_list]
    assert colors == [SOFT, SOFT, VERMILLION, VERMILLION, INK]
    assert labels(axes[0]) == ("x, mm", "y, mm")


def test_every_run_whose_log_holds_no_speed_is_a_command_of_its_own() -> None:
    runs = [turned(name, 9.0, turned_deg=90.0) for name in ("ramp", "turn", "spiral")]
    for run, rpm in zip(runs, (np.nan, 33.0, np.nan), strict=True):
        run.turning["left_rpm"] = run.turning["right_rpm"] = rpm
    assert [run.run for run in trajectory.representative(runs, 9)] == ["ramp", "turn", "spiral"]
