from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from simulator.command import Command, Stretch
from simulator.errors import SimulationError
from simulator.robot import load_robot
from simulator.run import State
from simulator.simulation import moving_state, simulate
from simulator.units import plain_name

LOG = "time_s,left_rpm,right_rpm\n1,30,20\n2,30,20\n3,0,0\n4,-30,-20\n"


def written(folder: Path, text: str) -> Path:
    path = folder / "log.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_values_of_a_log_hold_until_the_next_and_motors_are_off_before_the_first(tmp_path: Path) -> None:
    command = Command.held(written(tmp_path, LOG))
    left, right = command.at([0.5, 1.0, 2.999, 3.0, 3.999, 4.0, 99.0])
    assert left.tolist() == [0, 30, 30, 0, 0, -30, -30]
    assert right.tolist() == [0, 20, 20, 0, 0, -20, -20]
    assert command.stretches() == (
        Stretch(-math.inf, 1.0, 0.0, 0.0),
        Stretch(1.0, 3.0, 30.0, 20.0),
        Stretch(3.0, 4.0, 0.0, 0.0),
        Stretch(4.0, math.inf, -30.0, -20.0),
    )


def test_a_robot_that_does_not_start_at_rest_did_before_the_log_what_its_first_row_says(tmp_path: Path) -> None:
    command = Command.held(written(tmp_path, LOG), starts_at_rest=False)
    assert command.at(0.0)[0] == 30
    assert command.stretches()[0] == Stretch(-math.inf, 3.0, 30.0, 20.0)


def test_semicolons_with_decimal_commas_are_read_after_a_line_for_spreadsheets(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("sep=;\ntime_s;left_rpm;right_rpm\n0,5;-1,25;2\n1;3;4\n")
    command = Command.held(log)
    assert command.knots.tolist() == [[0.5, 0.0, 0.0], [0.5, -1.25, 2.0], [1.0, -1.25, 2.0], [1.0, 3.0, 4.0]]
    log.write_text("sep=;\ntime_s;left_rpm;right_rpm\n0,5;-1,25;2\n1;;4\n")
    with pytest.raises(SimulationError, match="line 4 holds a value that is not a finite number"):
        Command.held(log)


def test_rad_per_second_are_read(tmp_path: Path) -> None:
    command = Command.held(written(tmp_path, "time_s,left_rad_s,right_rpm\n0,3.14159265358979,7\n"))
    assert command.at(1.0)[0] == pytest.approx(30.0)
    assert command.at(1.0)[1] == 7


@pytest.mark.parametrize(
    "text",
    [
        "seq,time_ns,left_m_s,right_m_s\n7,2000000000,0.9,1.1\n",
        "time_ms,left_mm_s,right_mm_s\n2000,900,1100\n",
        "yaw_rate_rad_s,forward_m_s,time_us\n0.5,1,2000000\n",
    ],
)
def test_speeds_of_wheels_and_velocities_are_read_with_the_wheels_of_the_controller(tmp_path: Path, text: str) -> None:
    log = written(tmp_path, text)
    command = Command.held(log, starts_at_rest=False, wheel_radius_m=0.1, track_m=0.4)
    assert command.time_s.tolist() == [2.0]
    assert command.left_rpm == pytest.approx(9.0 * 30 / math.pi)
    assert command.right_rpm == pytest.approx(11.0 * 30 / math.pi)
    with pytest.raises(SimulationError, match="needs wheel_radius_m"):
        Command.held(log)


def test_names_with_units_in_brackets_are_read(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("Time [ms],Left (rad/s),right [rad/s],Note (of mine)\n500,1,2,a\n900,0,0,b\n")
    found = Command.held(tmp_path / "log.csv")
    assert np.unique(found.time_s).tolist() == [0.5, 0.9]
    assert found.left_rpm.max() == pytest.approx(60 / (2 * math.pi))
    (tmp_path / "two.csv").write_text("Time [s],time_s,left_rpm,right_rpm\n9,0.5,1,2\n")
    assert Command.held(tmp_path / "two.csv").time_s[0] == 0.5  # a name as it should be comes first
    (tmp_path / "same.csv").write_text("time_s,Left [rpm],left (rpm),right_rpm\n0.5,1,2,3\n")
    with pytest.raises(
        SimulationError, match=r"lacks left_rpm; .*found: time_s, Left \[rpm\], left \(rpm\), right_rpm"
    ):
        Command.held(tmp_path / "same.csv")
    (tmp_path / "min.csv").write_text("Time [min],left_rpm,right_rpm\n9,1,2\n")
    with pytest.raises(SimulationError, match=r"lacks time_s; .*found: time_min, left_rpm, right_rpm"):
        Command.held(tmp_path / "min.csv")


@pytest.mark.parametrize(
    ("name", "plain"),
    [
        ("green x (mm)", "green_x_mm"),
        ("Heading (°)", "heading_deg"),
        ("Omega [1/min]", "omega_rpm"),
        (" x [mm] ", "x_mm"),
        ("Speed", "Speed"),
        ("[mm]", "[mm]"),
        ("x [mm", "x [mm"),
    ],
)
def test_only_units_in_brackets_change_a_name(name: str, plain: str) -> None:
    assert plain_name(name) == plain


def test_dates_with_times_are_seconds_since_1970_and_without_an_offset_utc(tmp_path: Path) -> None:
    (tmp_path / "dated.csv").write_text(
        "Time,left_rpm,right_rpm\n2026-03-29T00:59:50.5Z,10,20\n2026-03-29 02:00:00.25+01:00,30,40\n"
        "2026-03-29T01:00:01,0,0\n"
    )
    found = Command.held(tmp_path / "dated.csv")
    assert np.unique(found.time_s).tolist() == pytest.approx([1774745990.5, 1774746000.25, 1774746001.0], abs=1e-6)
    for clock, said in (
        ("09:30:01", "lacks time_s"),
        ("2026-13-01T00:00:00", "lacks time_s"),
        ("12.5", "lacks time_s"),
    ):
        (tmp_path / "none.csv").write_text(f"Time,left_rpm,right_rpm\n{clock},10,20\n")
        with pytest.raises(SimulationError, match=said):
            Command.held(tmp_path / "none.csv")


def test_a_command_within_a_time_is_the_same_there_and_holds_its_ends(tmp_path: Path) -> None:
    command = Command.held(written(tmp_path, LOG))
    part = command.within(2.0, 5.0)
    times = np.linspace(2.0, 5.0, 61)
    assert np.array_equal(part.at(times), command.at(times))
    assert [side.tolist() for side in part.at([-9.0, 99.0])] == [side.tolist() for side in command.at([2.0, 5.0])]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time_s,left_rpm\n0,1\n", "lacks right_rpm"),
        ("t,v_left,v_right\n0,1,1\n", "lacks time_s, left_rpm, right_rpm.*found: t, v_left, v_right"),
        ("time_s,left_rpm,right_rpm\n0,1,x\n", "line 2"),
        ("time_s,left_rpm,right_rpm\n1,1,1\n0,2,2\n", "must not decrease"),
        ("time_s,left_rpm,left_rad_s,right_rpm\n0,1,1,1\n", "both left_rpm and left_rad_s"),
        ("time_s,left_rpm,right_rpm\n", "no row"),
    ],
)
def test_a_log_that_is_none_is_refused_with_its_fault(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(SimulationError, match=said):
        Command.held(written(tmp_path, text))


def test_a_step_of_the_command_is_met_exactly_whatever_the_output_times(tmp_path: Path) -> None:
    command = Command.held(written(tmp_path, LOG))
    robot = load_robot("barrel")
    coarse = simulate(robot, command, [0.0, 6.0])
    fine = simulate(robot, command, np.linspace(0.0, 6.0, 1201))
    assert coarse.x_mm[-1] == pytest.approx(fine.x_mm[-1], abs=2e-6)
    assert coarse.heading_rad[-1] == pytest.approx(fine.heading_rad[-1], abs=2e-6)
    # rolling back as long as forward brings it back: 2 s forward from 1 to 3, 2 s backward from 4 to 6
    assert fine.x_mm[600] > 1.0
    assert abs(coarse.heading_rad[-1]) < 0.05 * abs(fine.heading_rad[600])


def test_a_moving_start_goes_on_as_the_run_before_it_went() -> None:
    robot, command = load_robot("barrel"), Command.always(33.3, 14.4)
    whole = simulate(robot, command, np.linspace(0.0, 4.0, 41))
    pose = State(float(whole.x_mm[20]), float(whole.y_mm[20]), float(whole.heading_rad[20]))
    later = simulate(robot, command, whole.time_s[20:], moving_state(robot, command, pose, 2.0))
    assert later.x_mm[-1] == pytest.approx(whole.x_mm[-1], abs=1e-5)
    assert later.heading_rad[-1] == pytest.approx(whole.heading_rad[-1], abs=1e-5)
    stands = simulate(robot, command, whole.time_s[20:], pose)
    assert abs(stands.heading_rad[1] - later.heading_rad[1]) > 1e-5


def test_a_geared_command_turns_either_side_by_its_factor_at_the_same_times() -> None:
    command = Command.steps([(0.5, 30, -20), (2.0, 0, 10)]).geared(1.1, 0.5)
    np.testing.assert_allclose(command.knots, [[0.5, 0, 0], [0.5, 33, -10], [2, 33, -10], [2, 0, 5]])


def test_motors_are_off_before_a_constant_command_and_after_it_and_it_ends_after_it_begins() -> None:
    left, right = Command.constant(30.0, -20.0, 0.5, 2.0).at(np.array([0.4, 0.5, 1.9, 2.0]))
    assert (left.tolist(), right.tolist()) == ([0.0, 30.0, 30.0, 0.0], [0.0, -20.0, -20.0, 0.0])
    for stop_s in (0.5, 0.4):
        with pytest.raises(SimulationError, match=f"stop_s = {stop_s} is not after start_s = 0.5"):
            Command.constant(30.0, -20.0, 0.5, stop_s)
