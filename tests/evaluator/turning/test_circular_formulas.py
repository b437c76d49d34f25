"""Gradients of a circular test in closed form, from turns that are made by hand, and which turns make a series."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
import pytest
from scipy.stats import linregress
from scipy.stats import t as student

from evaluator.turning.circular_test import CircularTest, _line, circular_test

WHEELBASE_MM, TRACK_MM = 4.0, 5.0
ACCELERATIONS = np.array([20.0, 80.0, 180.0, 320.0])  # mm/s²


def turns(
    commanded: Sequence[float] | np.ndarray,
    curvature: Sequence[float] | np.ndarray,
    acceleration: Sequence[float] | np.ndarray = ACCELERATIONS,
    sideslip_deg: Sequence[float] | np.ndarray | float = 0.0,
    *,
    direction: int = 1,
    side: int = 1,
) -> pd.DataFrame:
    """Turns of given curvatures, 1/mm, and lateral accelerations; side: 1 to the left, direction: 1 forward."""
    curvature, acceleration = np.asarray(curvature), np.asarray(acceleration)
    half = np.asarray(commanded) * TRACK_MM / 2  # of (right − left) over (right + left)
    speed, yaw = np.sqrt(acceleration / curvature), np.sqrt(acceleration * curvature)
    mean = direction * speed * 10
    return pd.DataFrame(
        {
            "run": [f"r{k}" for k in range(len(speed))],
            "left_rpm": mean * (1 - side * half),
            "right_rpm": mean * (1 + side * half),
            "speed_mm_s": direction * speed,
            "yaw_rate_deg_s": np.degrees(direction * side * yaw),
            "body_slip_angle_deg": sideslip_deg,
        }
    )


def evaluated(*tables: pd.DataFrame) -> CircularTest:
    return circular_test(pd.concat(tables, ignore_index=True), WHEELBASE_MM, TRACK_MM)


@pytest.mark.parametrize(("direction", "side"), [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_at_a_constant_command_a_path_that_widens_with_speed_is_understeer(direction: int, side: int) -> None:
    command, slow, widens = 0.1, 0.08, 5e-5  # curvatures, 1/mm, and what a mm/s² takes off
    (series,) = evaluated(turns([command] * 4, slow - widens * ACCELERATIONS, direction=direction, side=side)).series
    assert (series.method, series.direction, series.side) == (
        "constant command", "forward" if direction > 0 else "backward", "left" if side > 0 else "right",
    )  # fmt: skip
    assert series.held == pytest.approx((1 - 0.25) / (1 + 0.25))  # slower over faster
    assert series.steering.value == pytest.approx(command / slow)
    assert series.curvature_per_mm == pytest.approx(slow)
    assert series.understeer.value == pytest.approx(np.degrees(widens * command / slow * WHEELBASE_MM) * 1000)


def test_at_a_constant_radius_a_command_that_must_bend_more_with_speed_is_understeer() -> None:
    curvature, steering, more = 0.08, 1.25, 5e-5
    (series,) = evaluated(turns(steering * curvature + more * ACCELERATIONS, [curvature] * 4)).series
    assert series.method == "constant radius"
    assert series.held == pytest.approx(1 / curvature)
    assert series.curvature_per_mm == pytest.approx(curvature)
    assert series.steering.value == pytest.approx(steering)
    assert series.understeer.value == pytest.approx(np.degrees(more * WHEELBASE_MM) * 1000)


@pytest.mark.parametrize("side", [1, -1])
def test_gradient_of_the_sideslip_is_positive_out_of_the_turn_with_the_interval_of_its_line(side: int) -> None:
    slip = np.array([0.3, 0.8, 1.1, 2.4])  # degrees, toward the outside
    (series,) = evaluated(turns([0.1] * 4, [0.08] * 4, sideslip_deg=-side * slip, side=side)).series
    line = linregress(ACCELERATIONS, slip)
    half = student.ppf(0.975, 2) * line.stderr
    found = series.sideslip
    assert found.value == pytest.approx(1000 * line.slope)
    assert (found.low, found.high) == pytest.approx((1000 * (line.slope - half), 1000 * (line.slope + half)))


def test_intervals_of_the_steering_are_those_of_the_line_at_rest() -> None:
    curvature = np.array([0.0790, 0.0772, 0.0725, 0.0640])
    (series,) = evaluated(turns([0.1] * 4, curvature)).series
    line = linregress(ACCELERATIONS, curvature)
    half = student.ppf(0.975, 2) * line.intercept_stderr
    assert series.steering.value == pytest.approx(0.1 / line.intercept)
    width = (series.steering.high - series.steering.low) / 2
    assert width == pytest.approx(0.1 / line.intercept**2 * half, rel=1e-3)  # to first order


@pytest.mark.parametrize(("off", "methods"), [(0.9e-3, ["constant command"]), (1.1e-3, ["constant radius"])])
def test_ratios_within_a_thousandth_are_one_command(off: float, methods: list[str]) -> None:
    ratio = np.array([0.6, 0.6, 0.6 - off])
    commanded = 2 / TRACK_MM * (1 - ratio) / (1 + ratio)
    found = evaluated(turns(commanded, [0.08] * 3, ACCELERATIONS[:3])).series
    assert [series.method for series in found] == methods


@pytest.mark.parametrize(("off", "count"), [(0.14, 1), (0.16, 0)])
def test_radii_within_fifteen_percent_of_the_middle_one_are_one_radius(off: float, count: int) -> None:
    radius = 12.0 * np.array([1.0, 1.0, 1.0 + off])
    commanded = np.array([0.09, 0.10, 0.11])
    assert len(evaluated(turns(commanded, 1 / radius, ACCELERATIONS[:3])).series) == count


@pytest.mark.parametrize(("speeds", "count"), [(3, 1), (2, 0)])
def test_a_gradient_needs_three_speeds(speeds: int, count: int) -> None:
    accelerations = np.resize(ACCELERATIONS[:speeds], 4)
    assert len(evaluated(turns([0.1] * 4, [0.08] * 4, accelerations)).series) == count


def test_straight_runs_and_turns_on_the_spot_are_left_out() -> None:
    straight = turns([0.1], [0.08], [20.0]).assign(run="straight", left_rpm=30.0, right_rpm=30.0)
    spot = turns([0.1], [0.08], [20.0]).assign(run="spot", left_rpm=-30.0, right_rpm=30.0)
    found = evaluated(turns([0.1] * 4, [0.08] * 4), straight, spot)
    assert found.points["run"].tolist() == ["r0", "r1", "r2", "r3"]
    assert found.points["series"].tolist() == [0] * 4


def test_value_at_no_acceleration_and_slope_of_a_line_vary_against_each_other() -> None:
    x, y = ACCELERATIONS, np.array([0.081, 0.074, 0.072, 0.062])
    line = _line(x, y, 0.0)
    values, covariance = np.polyfit(x, y, 1, cov=True)
    assert (line.slope, line.at_zero) == pytest.approx(tuple(values))
    np.testing.assert_allclose(line.covariance, covariance[::-1, ::-1])
    assert _line(x, y, 1.0).covariance[0, 1] == pytest.approx(-x.mean() / ((x - x.mean()) ** 2).sum())
