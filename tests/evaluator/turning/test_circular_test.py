"""Gradients of the steady-state circular test, from turns whose law is known."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from evaluator.errors import InputError
from evaluator.turning.circular_test import CircularTest, circular_test

WHEELBASE_MM, TRACK_MM, RADIUS_MM = 512.0, 570.0, 165.0
STEERING, GRADIENT = 1.8, 2e-7  # A, and K in s²/mm²


def turns(
    commands: list[tuple[float, float]], gradient: float = GRADIENT, noise: float = 0.0, seed: int = 0
) -> pd.DataFrame:
    """Turns that obey κc = A·κ + K·a_y, with noise relative to the curvature."""
    rng, rows = np.random.default_rng(seed), []
    for number, (left, right) in enumerate(commands):
        speed = 2 * np.pi / 60 * RADIUS_MM * (left + right) / 2
        commanded = 2 * (right - left) / (TRACK_MM * (right + left))
        curvature = commanded / (STEERING + gradient * speed**2) * (1 + noise * rng.normal())
        yaw, slip = np.degrees(speed * curvature), -np.sign(commanded) * (1 + 1e-3 * speed**2 * abs(curvature))
        rows.append((f"r{number}", left, right, speed, yaw, slip))
    names = ["run", "left_rpm", "right_rpm", "speed_mm_s", "yaw_rate_deg_s", "body_slip_angle_deg"]
    return pd.DataFrame(rows, columns=names)


def all_ways(levels: tuple[float, ...], ratio: float, repetitions: int = 3) -> list[tuple[float, float]]:
    pairs = [(level * ratio, level) for level in levels] + [(level, level * ratio) for level in levels]
    return [(way * left, way * right) for left, right in pairs for way in (1, -1)] * repetitions


def evaluated(table: pd.DataFrame) -> CircularTest:
    return circular_test(table, WHEELBASE_MM, TRACK_MM)


def test_gradient_and_steering_of_constant_commands_are_recovered() -> None:
    # κ = κc/(A + K·v²) is not a line in a_y = v²·κ for large K: here K·v² is a hundredth of A.
    found = evaluated(turns(all_ways((10.0, 15.0, 20.0, 25.0), 0.5)))
    assert [(item.method, item.direction, item.side) for item in found.series] == [
        ("constant command", direction, side) for side in ("left",) for direction in ("forward", "backward")
    ] + [("constant command", direction, "right") for direction in ("forward", "backward")]
    for series in found.series:
        assert series.held == pytest.approx(0.5)
        assert len(series.runs) == 12
        assert series.steering.value == pytest.approx(STEERING, rel=1e-3)
        assert series.understeer.value == pytest.approx(np.degrees(GRADIENT * WHEELBASE_MM) * 1e3, rel=1e-2)
        assert series.sideslip.value == pytest.approx(1.0, rel=1e-6)  # 1e-3 degrees per mm/s², out of the turn


def test_gradient_of_a_constant_radius_is_recovered() -> None:
    radius, commands = 3000.0, []
    for level in (20.0, 40.0, 60.0, 80.0):
        ratio = 1.0
        for _ in range(60):  # the command that keeps the radius
            speed = 2 * np.pi / 60 * RADIUS_MM * level * (1 + ratio) / 2
            commanded = STEERING / radius + GRADIENT * speed**2 / radius
            ratio = (2 - commanded * TRACK_MM) / (2 + commanded * TRACK_MM)
        commands.append((level * ratio, level))
    found = evaluated(turns(commands * 2, gradient=GRADIENT))
    (series,) = found.series
    assert series.method == "constant radius"
    assert series.held == pytest.approx(radius, rel=1e-6)
    assert series.steering.value == pytest.approx(STEERING, rel=1e-6)
    assert series.understeer.value == pytest.approx(np.degrees(GRADIENT * WHEELBASE_MM) * 1e3, rel=1e-6)


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    truth, held = np.degrees(GRADIENT * WHEELBASE_MM) * 1e3, []
    for seed in range(100):
        series = evaluated(turns(all_ways((10.0, 15.0, 20.0, 25.0), 0.5), noise=0.005, seed=seed)).series
        held += [item.understeer.low <= truth <= item.understeer.high for item in series]
    assert 0.92 <= np.mean(held) <= 0.98  # of 400 at 95 %: ± 2.7 standard deviations


def test_stated_noise_widens_an_interval_that_the_scatter_leaves_narrow() -> None:
    table = turns(all_ways((10.0, 15.0, 20.0), 0.5, repetitions=1))
    sure = evaluated(table).series[0].understeer
    table["yaw_rate_random_deg_s"] = 0.01 * table["yaw_rate_deg_s"].abs()
    unsure = evaluated(table).series[0].understeer
    assert unsure.high - unsure.low > 10 * (sure.high - sure.low)


def test_what_is_no_series_of_turns_is_left_out() -> None:
    table = turns([(20.0, 20.0), (10.0, 20.0), (20.0, 40.0), (30.0, 33.0)])
    found = evaluated(table)
    assert found.series == ()
    assert found.points["run"].tolist() == ["r1", "r2", "r3"]
    assert (found.points["series"] == -1).all()
    with pytest.raises(InputError, match="no turn among the runs"):
        evaluated(turns([(20.0, 20.0), (-30.0, -30.0)]))
    with pytest.raises(InputError, match="lacks speed_mm_s"):
        evaluated(table.drop(columns="speed_mm_s"))
