"""The uncertainty budget: sources of known size give what geometry says they give, and sum to the stated interval.

A camera looks straight down from 106.5 mm on marks 6.5 mm above the plate. Its focal length is known to a thousandth,
the gauge's pitch to two, and every source has its closed form.
"""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from calibration.camera import PARAMETERS, Camera, camera_above
from evaluator.mark_geometry import MarkGeometry
from evaluator.pose import poses_from_marks
from evaluator.pose_systematic import COMMON_PX, COMMON_SHARE, IMAGE_SHARE
from evaluator.turning.budget import Budget, Contribution, Knowledge, uncertainty_budget
from simulator.robot import Robot, shipped_robot_text
from tests.evaluator.synthetic import circling_marks

RADIUS_MM, SPEED_MM_S, SPACING_MM, SIGMA_MM = 6.0, 8.0, 3.66, 0.002
ABOVE_PLATE_MM, ABOVE_MARKS_MM, PX_PER_MM = 106.5, 100.0, 20.0
FOCAL, PITCH = 1e-3, 2e-3  # relative
PLACE_MM, HEIGHT_MM, CLOCK = 0.05, 0.1, 0.01
PLACES = {"green": (-1.55, 1.83), "yellow": (-1.55, -1.83)}
KNOWN = Knowledge(PLACE_MM, HEIGHT_MM, CLOCK)
UNSTATED = MarkGeometry(PLACES, height_mm=6.5)
GEOMETRY = UNSTATED.with_sigmas(PLACE_MM, HEIGHT_MM)


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


@pytest.mark.parametrize("mark", PLACES)
@pytest.mark.parametrize("axis", [0, 1])
def test_a_mark_elsewhere_on_the_robot_moves_centre_and_heading_as_measuring_again_says(mark: str, axis: int) -> None:
    place = list(PLACES[mark])
    place[axis] -= PLACE_MM  # the mark is farther than the file says
    moved = poses_from_marks(tracked(), MarkGeometry(PLACES | {mark: tuple(place)}, height_mm=6.5))
    here = poses_from_marks(tracked(), GEOMETRY)
    dx, dy, turn = moved.x_mm - here.x_mm, moved.y_mm - here.y_mm, moved.heading_rad - here.heading_rad
    cos, sin = np.cos(here.heading_rad), np.sin(here.heading_rad)
    shift = np.median([cos * dx + sin * dy, cos * dy - sin * dx, turn], axis=1)
    expected = GEOMETRY.pose_shifts()[2 * list(PLACES).index(mark) + axis]
    assert shift == pytest.approx(expected, abs=0.02 * PLACE_MM)


def test_the_corners_of_a_tag_are_displaced_together_and_a_single_mark_has_no_heading() -> None:
    tag = {f"tag_corner{number}": place for number, place in enumerate([(1, 1), (1, -1), (-1, -1), (-1, 1)], start=1)}
    assert MarkGeometry(tag, place_sigma_mm=0.1).pose_shifts() == pytest.approx(np.diag([0.1, 0.1, 0.0])[:2])
    assert MarkGeometry({"one": (3.0, 4.0)}, place_sigma_mm=0.1).pose_shifts() == pytest.approx(np.eye(3)[:2] / 10)
    assert MarkGeometry(PLACES).pose_shifts().shape == (0, 3)


@pytest.mark.parametrize(
    ("source", "scale"),
    [
        ("lens and plane", FOCAL),
        # A pitch moves the lens away from the plate; the marks stay as high above it as they are.
        ("pitch of the gauge", PITCH * ABOVE_PLATE_MM / ABOVE_MARKS_MM),
        ("height of the marks", HEIGHT_MM / ABOVE_MARKS_MM),
    ],
)
def test_error_of_scale_is_the_same_share_of_radius_and_speed_and_turns_nothing(
    budget: Budget, source: str, scale: float
) -> None:
    found = of(budget, source)
    assert found.radius_mm == pytest.approx(RADIUS_MM * scale, rel=0.01)
    assert found.speed_mm_s == pytest.approx(SPEED_MM_S * scale, rel=0.01)
    assert found.heading_deg == pytest.approx(0.0, abs=1e-6)
    assert found.measured


def test_marks_off_along_both_axes_give_what_geometry_says(budget: Budget) -> None:
    """A mark off along x turns the heading by sigma / spacing, and the centre, 1.55 mm ahead of the marks, moves
    sideways by 1.55 mm times that; one off along y moves the middle of both by half of it. There are two of each.
    """
    places, sigma = of(budget, "positions"), PLACE_MM
    turned = sigma * np.sqrt(2) / SPACING_MM
    assert places.heading_deg == pytest.approx(np.degrees(turned), rel=0.03)
    assert places.radius_mm == pytest.approx(np.hypot(1.55 * turned, sigma / np.sqrt(2)), rel=0.03)
    assert places.measured


def test_the_clock_concerns_speed_alone(budget: Budget) -> None:
    clock = of(budget, "clock")
    assert clock.speed_mm_s == pytest.approx(CLOCK * SPEED_MM_S, rel=1e-3)
    assert (clock.radius_mm, clock.heading_deg, clock.measured) == (0.0, 0.0, False)


@pytest.mark.parametrize("geometry", [GEOMETRY, UNSTATED])
def test_the_interval_holds_what_is_measured_and_what_the_robot_file_states(geometry: MarkGeometry) -> None:
    budget = uncertainty_budget(tracked(), geometry, rig(), known=KNOWN)
    turning, inside, every = budget.turning, budget.combined(measured_only=True), budget.combined(measured_only=False)
    assert inside.radius_mm == pytest.approx(np.hypot(turning.radius_random_mm, turning.radius_systematic_mm))
    half = (turning.radius_high_mm - turning.radius_low_mm) / 2
    assert 1.96 * inside.radius_mm == pytest.approx(half, rel=0.02)
    for name in ("radius_mm", "speed_mm_s", "heading_deg"):
        squares = [getattr(item, name) ** 2 for item in budget.contributions]
        assert getattr(every, name) == pytest.approx(np.sqrt(sum(squares)))
    stated = [of(budget, part).measured for part in ("positions", "height", "clock")]
    assert stated == ([True, True, False] if geometry is GEOMETRY else [False, False, False])
    assert (every.radius_mm > 1.5 * inside.radius_mm) == (geometry is UNSTATED)


@pytest.mark.parametrize(("states", "sigmas"), [("", (0.0, 0.0)), ("mark_position_mm = 0.02", (0.02, 0.0))])
def test_an_interval_takes_marks_to_be_exact_where_the_robot_file_states_nothing(
    states: str, sigmas: tuple[float, float]
) -> None:
    said = tomllib.loads(shipped_robot_text("barrel") + f"\n[known_to]\n{states}\n")
    geometry = MarkGeometry.of_robot(Robot.model_validate(said))
    assert (geometry.place_sigma_mm, geometry.height_sigma_mm) == pytest.approx(sigmas)
    assert geometry.only(["green"]).place_sigma_mm == geometry.place_sigma_mm


def test_without_a_camera_its_sources_are_left_out() -> None:
    marks = circling_marks(RADIUS_MM, seconds=2.0)
    sources = [item.source for item in uncertainty_budget(marks, GEOMETRY, known=KNOWN).contributions]
    assert [source.split()[0] for source in sources] == ["noise", "positions", "clock"]
