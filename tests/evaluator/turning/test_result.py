"""What a measured turn says of itself: a row of turning.csv, a line for people, and bounds under another scale."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.turning import Turning
from evaluator.turning.measure import _with_radii
from evaluator.turning.motion.curvature import Curvature
from evaluator.turning.path import PointPath
from evaluator.turning.phase_table import Phase
from evaluator.turning.result import only_mark
from evaluator.turning.sustained import Sustained

PHASE = Phase(0.5, 2.0, "turn", 5.0, 4.9, 5.2, -2.0, 90.0)
TURN = Turning(
    radius_mm=5.0,
    radius_low_mm=4.9,
    radius_high_mm=5.2,
    radius_systematic_mm=0.03,
    steady_radius_mm=8.0,
    steady_radius_low_mm=7.8,
    steady_radius_high_mm=8.3,
    speed_mm_s=-2.0,
    speed_sigma_mm_s=0.03,
    yaw_rate_deg_s=20.0,
    turned_deg=300.0,
    curvature_per_mm=-0.2,
    curvature_low_per_mm=-0.21,
    curvature_high_per_mm=-0.18,
    mark_speeds_mm_s={"green": 1.5, "yellow": -2.5},
    mark_radii_mm={"green": 3.5, "yellow": 7.0},
    other_wheels={"middle_left_slip_ratio": 0.1},
    phases=(PHASE,),
)


def test_unit_of_length_known_to_a_share_widens_each_bound_by_that_share_in_quadrature() -> None:
    wide = TURN.with_scale(0.02)
    radius, steady, curvature = (1.96 * 0.02 * value for value in (5.0, 8.0, 0.2))
    assert (wide.radius_low_mm, wide.radius_high_mm) == pytest.approx(
        (5.0 - np.hypot(0.1, radius), 5.0 + np.hypot(0.2, radius))
    )
    assert (wide.steady_radius_low_mm, wide.steady_radius_high_mm) == pytest.approx(
        (8.0 - np.hypot(0.2, steady), 8.0 + np.hypot(0.3, steady))
    )
    assert (wide.curvature_low_per_mm, wide.curvature_high_per_mm) == pytest.approx(
        (-0.2 - np.hypot(0.01, curvature), -0.2 + np.hypot(0.02, curvature))
    )
    assert wide.radius_systematic_mm == pytest.approx(np.hypot(0.03, 0.1))
    assert wide.speed_sigma_mm_s == pytest.approx(np.hypot(0.03, 0.04))
    assert (wide.radius_mm, wide.curvature_per_mm, wide.speed_mm_s) == (5.0, -0.2, -2.0)


def test_row_has_a_column_for_each_mark_and_wheel_and_what_is_a_table_by_itself_is_not_in_it() -> None:
    path = PointPath("varies", 3.5, 3.4, 3.7, 1.5, 250.0, 0.01)
    row = replace(TURN, paths={"green": path}).to_row()
    expected = {
        "green_speed_mm_s": 1.5,
        "yellow_speed_mm_s": -2.5,
        "green_radius_mm": 3.5,
        "yellow_radius_mm": 7.0,
        "green_radius_low_mm": 3.4,
        "green_radius_high_mm": 3.7,
        "green_turned_deg": 250.0,
        "green_radius_status": "varies",
        "middle_left_slip_ratio": 0.1,
        "speed_mm_s": -2.0,
    }
    assert {name: row[name] for name in expected} == expected
    assert not {"phases", "paths", "other_wheels", "mark_speeds_mm_s", "mark_radii_mm"} & set(row)
    assert TURN.phase_rows() == [vars(PHASE)]


def test_columns_of_marks_and_further_wheels_are_attributes_and_others_are_errors() -> None:
    assert (TURN.yellow_speed_mm_s, TURN.green_radius_mm, TURN.middle_left_slip_ratio) == (-2.5, 3.5, 0.1)
    for name in ("blue_speed_mm_s", "green_height_mm", "rear_slip_ratio"):
        with pytest.raises(AttributeError, match=name):
            getattr(TURN, name)


def test_summary_says_radius_with_bounds_turn_and_speed_and_whether_the_radius_varies() -> None:
    line = "radius 5.0000 mm, 95 % from 4.9000 to 5.2000; 300 degrees at -2 mm/s, 20 degrees/s"
    assert TURN.summary() == line
    assert repr(TURN) == f"Turning({line})"
    varying = replace(TURN, radius_status="varies: by 9 %", radius_varies=True)
    said = line.replace("5.2000;", "5.2000; varies, 8 mm on average;")
    assert varying.summary() == f"varies: by 9 %; {said}"
    assert Turning(radius_status="at rest").summary() == "at rest"
    assert "<tr><th>95 %</th><td>4.9000 to 5.2000 mm</td></tr>" in TURN._repr_html_()


def read(tightest: Curvature, *, varies: bool, by_places_mm: float = 0.0) -> Turning:
    """What is written of a fit of curvature -0.2 to half a turn whose tightest quarter turn is this."""
    mean = Curvature(-0.2, -0.21, -0.18, 0.005, 0.002)
    residual = np.array([[3.0, 4.0], [0.0, 0.0], [9.0, 9.0]])
    fit: Any = SimpleNamespace(
        curvature=lambda: mean,
        motion=SimpleNamespace(length_mm=2.0, turn_rad=np.pi, residual_mm=residual),
        used=np.array([True, True, False]),
        averaged=SimpleNamespace(mean=lambda: np.zeros(4), correlation=lambda: 0.3),
        centers_mm=lambda _: np.array([[1.0, 2.0]]),
        radius_by_places_mm=lambda: by_places_mm,
    )
    sustained = Sustained(tightest, mean, varies, 0.02, 1e-6, 1.0, 3.0, 0.1)
    return _with_radii(Turning(steady_start_s=0.5, steady_stop_s=9.0), fit, sustained)


def test_uncertainty_of_a_radius_is_its_square_times_that_of_the_curvature() -> None:
    found = read(Curvature(-0.25, -0.26, -0.24, 0.004, 0.003), varies=True)
    assert (found.radius_mm, found.radius_low_mm, found.radius_high_mm) == pytest.approx((4.0, 1 / 0.26, 1 / 0.24))
    assert (found.radius_random_mm, found.radius_systematic_mm) == pytest.approx((16 * 0.004, 16 * 0.003))
    steady = (found.steady_radius_mm, found.steady_radius_low_mm, found.steady_radius_high_mm)
    assert steady == pytest.approx((5.0, 1 / 0.21, 1 / 0.18))
    assert (found.curvature_per_mm, found.curvature_low_per_mm, found.curvature_high_per_mm) == (-0.2, -0.21, -0.18)
    assert (found.center_x_mm, found.center_y_mm, found.center_wander_mm) == (1.0, 2.0, 0.1)
    assert (found.turned_deg, found.noise_correlation) == pytest.approx((180.0, 0.3))
    assert found.residual_rms_mm == pytest.approx(2.5)  # of the frames used: 9, 16, 0 and 0


def test_the_places_of_the_marks_widen_every_interval_of_a_radius_by_one_length() -> None:
    tight, exact = (read(Curvature(-0.25, -0.26, -0.24, 0.004, 0.003), varies=True, by_places_mm=mm) for mm in (0.1, 0))
    assert (tight.radius_mm, tight.steady_radius_mm) == (exact.radius_mm, exact.steady_radius_mm)
    for name in ("radius", "steady_radius"):
        middle = getattr(tight, f"{name}_mm")
        for bound in (f"{name}_low_mm", f"{name}_high_mm"):
            reach = np.hypot(getattr(exact, bound) - middle, 1.96 * 0.1)
            assert abs(getattr(tight, bound) - middle) == pytest.approx(reach)
    assert tight.radius_systematic_mm == pytest.approx(np.hypot(16 * 0.003, 0.1))
    assert (tight.radius_random_mm, tight.radius_by_marks_mm) == (exact.radius_random_mm, 0.1)
    assert tight.curvature_low_per_mm == pytest.approx(-1 / (5 - np.hypot(5 - 1 / 0.21, 0.196)))
    assert tight.curvature_high_per_mm == pytest.approx(-1 / (5 + np.hypot(1 / 0.18 - 5, 0.196)))
    spot = read(Curvature(-20.0, -21.0, -19.0, 0.4, 0.3), varies=True, by_places_mm=0.1)  # a radius of 0.05 mm
    assert (spot.radius_low_mm, spot.radius_high_mm) == (pytest.approx(1e-6), pytest.approx(0.246, rel=0.01))
    straight = read(Curvature(-0.01, -0.02, 0.01, 0.004, 0.003), varies=False, by_places_mm=0.1)
    assert np.isnan(straight.radius_mm)


def test_a_radius_that_varies_says_by_how_much_and_when_it_was_tightest() -> None:
    tightest = Curvature(-0.25, -0.26, -0.24, 0.004)
    varying, single = (read(tightest, varies=varies) for varies in (True, False))
    assert varying.radius_status == "varies: the curvature scatters by 10 % from stretch to stretch"
    assert (varying.radius_variation, varying.sustained_from_s, varying.sustained_to_s) == pytest.approx(
        (0.1, 1.0, 3.0)
    )
    assert single.radius_status == "ok"
    assert (single.radius_variation, single.sustained_from_s, single.sustained_to_s) == (0.0, 0.5, 9.0)
    unsure = read(Curvature(-0.25, -0.6, 0.1, 0.18), varies=True)
    assert unsure.radius_status.endswith("; no stretch turns for certain")
    assert np.isnan(unsure.radius_mm)


def test_the_only_mark_of_a_row_is_that_whose_speed_is_known() -> None:
    """A table of several robots has the columns of all of them."""
    steady = {"radius_low_mm": 4.0, "steady_radius_low_mm": 4.0}
    assert only_mark({**steady, "front_radius_low_mm": 3.0, "front_speed_mm_s": 2.5}) == "front"
    assert only_mark({**steady, "front_radius_low_mm": float("nan"), "front_speed_mm_s": float("nan")}) == ""
    both = {"a_radius_low_mm": float("nan"), "a_speed_mm_s": float("nan"), "b_radius_low_mm": 3.0, "b_speed_mm_s": 2.0}
    assert only_mark(both) == "b"
    assert only_mark({**steady, "green_speed_mm_s": 2.0}) == ""  # of a robot with two marks
