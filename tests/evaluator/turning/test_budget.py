"""The uncertainty budget: sources of known size give what geometry says they give, and sum to the stated interval.

A camera looks straight down from 106.5 mm on marks 6.5 mm above the plate. Its focal length is known to a thousandth,
the gauge's pitch to two, and every source has its closed form.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from calibration.camera import PARAMETERS, Camera, camera_above
from evaluator.mark_geometry import MarkGeometry
from evaluator.pose_systematic import COMMON_PX, COMMON_SHARE, IMAGE_SHARE
from evaluator.turning.budget import Budget, Contribution, Knowledge, uncertainty_budget
from tests.evaluator.synthetic import circling_marks

RADIUS_MM, SPEED_MM_S, SPACING_MM, SIGMA_MM = 6.0, 8.0, 3.66, 0.002
ABOVE_PLATE_MM, ABOVE_MARKS_MM, PX_PER_MM = 106.5, 100.0, 20.0
FOCAL, PITCH = 1e-3, 2e-3  # relative
KNOWN = Knowledge(mark_position_mm=0.05, mark_height_mm=0.1, time_base=0.01)
GEOMETRY = MarkGeometry({"green": (-1.55, 1.83), "yellow": (-1.55, -1.83)}, height_mm=6.5)


def rig() -> Camera:
    focal, pitch = np.zeros(len(PARAMETERS)), np.zeros(len(PARAMETERS))
    focal[PARAMETERS.index("focal_px")] = FOCAL * 2000.0
    pitch[PARAMETERS.index("translation_z_mm")] = PITCH * ABOVE_PLATE_MM
    exact = camera_above(size_px=(800, 600), focal_px=2000.0, distance_mm=ABOVE_PLATE_MM)
    return replace(exact, covariance=np.outer(focal, focal) + np.outer(pitch, pitch), pitch_error=pitch)


def tracked() -> pd.DataFrame:
    """Two thirds of a circle, with the places of the marks in the image and their uncertainty."""
    marks, camera = circling_marks(RADIUS_MM, speed_mm_s=SPEED_MM_S, seconds=3.0, sigma_mm=SIGMA_MM, seed=6), rig()
    for name in ("green", "yellow"):
        points = marks[[f"{name}_x_mm", f"{name}_y_mm"]].to_numpy()
        seen = camera.image_from_plate(np.column_stack([points, np.full(len(points), 6.5)]))
        marks[f"{name}_x_px"], marks[f"{name}_y_px"] = seen.T
        marks[f"{name}_x_sigma_mm"] = marks[f"{name}_y_sigma_mm"] = SIGMA_MM
    return marks


@pytest.fixture(scope="module")
def budget() -> Budget:
    return uncertainty_budget(tracked(), GEOMETRY, rig(), known=KNOWN)


def of(budget: Budget, source: str) -> Contribution:
    (found,) = [item for item in budget.contributions if item.source.startswith(source)]
    return found


def test_noise_of_a_frame_turns_the_line_through_the_marks(budget: Budget) -> None:
    noise = of(budget, "noise")
    assert noise.heading_deg == pytest.approx(np.degrees(np.sqrt(2) * SIGMA_MM / SPACING_MM), rel=1e-3)
    assert noise.radius_mm == budget.turning.radius_random_mm
    assert noise.speed_mm_s == budget.turning.speed_random_mm_s


def test_what_a_tracker_gets_wrong_in_all_frames_turns_the_heading_and_shifts_the_centre(budget: Budget) -> None:
    """Of either mark, fixed to the body and fixed to the image: across the line of the marks each turns it.

    The centre then seems to be elsewhere on the body, which turns at the same rate.
    """
    alike = of(budget, "marks, common")
    on_body = np.hypot(COMMON_SHARE * SIGMA_MM, COMMON_PX / PX_PER_MM)
    turned = np.sqrt(2) * np.hypot(on_body, IMAGE_SHARE * SIGMA_MM) / SPACING_MM
    assert alike.heading_deg == pytest.approx(np.degrees(turned), rel=1e-3)
    assert alike.speed_mm_s == pytest.approx(alike.radius_mm * SPEED_MM_S / RADIUS_MM, rel=1e-3)
    assert alike.measured


def test_positions_of_the_marks_move_the_centre_as_their_closed_form_says(budget: Budget) -> None:
    """The report states this for every turn, without measuring it again with each mark elsewhere."""
    towards = np.radians(90.0 + budget.turning.body_slip_angle_deg)
    expected = GEOMETRY.center_sigma_mm(float(towards), KNOWN.mark_position_mm)
    assert of(budget, "positions").radius_mm == pytest.approx(expected, rel=0.02)
    assert GEOMETRY.center_sigma_mm(0.0, 0.05) == pytest.approx(0.05 / np.sqrt(2))  # ahead: the mean of two marks
    turns = 1.55 / (SPACING_MM / np.sqrt(2))
    assert GEOMETRY.center_sigma_mm(np.pi / 2, 0.05) == pytest.approx(0.05 * np.hypot(1 / np.sqrt(2), turns))
    assert MarkGeometry({"one": (3.0, 4.0)}).center_sigma_mm(0.3, 0.05) == 0.05


@pytest.mark.parametrize(
    ("source", "scale"),
    [
        ("lens and plane", FOCAL),
        # A pitch moves the lens away from the plate; the marks stay as high above it as they are.
        ("pitch of the gauge", PITCH * ABOVE_PLATE_MM / ABOVE_MARKS_MM),
        ("height of the marks", KNOWN.mark_height_mm / ABOVE_MARKS_MM),
    ],
)
def test_error_of_scale_is_the_same_share_of_radius_and_speed_and_turns_nothing(
    budget: Budget, source: str, scale: float
) -> None:
    found = of(budget, source)
    assert found.radius_mm == pytest.approx(RADIUS_MM * scale, rel=0.01)
    assert found.speed_mm_s == pytest.approx(SPEED_MM_S * scale, rel=0.01)
    assert found.heading_deg == pytest.approx(0.0, abs=1e-6)
    assert found.measured == (not source.startswith("height"))


def test_marks_off_along_both_axes_give_what_geometry_says(budget: Budget) -> None:
    """A mark off along x turns the heading by sigma / spacing, and the centre, 1.55 mm ahead of the marks, moves
    sideways by 1.55 mm times that; one off along y moves the middle of both by half of it. There are two of each.
    """
    places, sigma = of(budget, "positions"), KNOWN.mark_position_mm
    turned = sigma * np.sqrt(2) / SPACING_MM
    assert places.heading_deg == pytest.approx(np.degrees(turned), rel=0.03)
    assert places.radius_mm == pytest.approx(np.hypot(1.55 * turned, sigma / np.sqrt(2)), rel=0.03)
    assert not places.measured


def test_the_clock_concerns_speed_alone(budget: Budget) -> None:
    clock = of(budget, "clock")
    assert clock.speed_mm_s == pytest.approx(KNOWN.time_base * SPEED_MM_S, rel=1e-3)
    assert (clock.radius_mm, clock.heading_deg, clock.measured) == (0.0, 0.0, False)


def test_measurement_alone_is_the_interval_and_all_together_is_more(budget: Budget) -> None:
    turning, measured, every = budget.turning, budget.combined(measured_only=True), budget.combined(measured_only=False)
    assert measured.radius_mm == pytest.approx(np.hypot(turning.radius_random_mm, turning.radius_systematic_mm))
    half = (turning.radius_high_mm - turning.radius_low_mm) / 2
    assert 1.96 * measured.radius_mm == pytest.approx(half, rel=0.02)
    for name in ("radius_mm", "speed_mm_s", "heading_deg"):
        squares = [getattr(item, name) ** 2 for item in budget.contributions]
        assert getattr(every, name) == pytest.approx(np.sqrt(sum(squares)))
    assert every.radius_mm > 1.5 * measured.radius_mm


def test_without_a_camera_its_sources_are_left_out() -> None:
    marks = circling_marks(RADIUS_MM, seconds=2.0)
    sources = [item.source for item in uncertainty_budget(marks, GEOMETRY, known=KNOWN).contributions]
    assert [source.split()[0] for source in sources] == ["noise", "positions", "clock"]
