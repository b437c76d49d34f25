"""Every sentence on what a run's numbers are worth, on either side of the number that decides it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.pose import MarkGeometry
from evaluator.turning.motion.curvature import Curvature
from evaluator.turning.status import spacing_fault, straightness, variation
from evaluator.turning.sustained import Sustained

NOMINAL_MM = 4.0


def apart(ratio: float, low: float = -10.0, high: float = 10.0) -> Any:
    """Poses whose marks are this many times too far apart, at places from low to high; a missing frame is far away."""
    return SimpleNamespace(
        spacing_ratio=lambda: (ratio, 0.001),
        geometry=MarkGeometry((2.0, 0.0), (-2.0, 0.0)),
        x_mm=np.array([low, high, -1e6]),
        y_mm=np.array([low, high, 1e6]),
        measured=np.array([True, True, False]),
    )


@pytest.mark.parametrize("ratio", [1.0, 1.19, 1 / 1.19, np.nan])
def test_distance_within_a_fifth_can_be_right(ratio: float) -> None:
    assert spacing_fault(apart(ratio)) == ""


@pytest.mark.parametrize(
    ("ratio", "said"), [(1.21, "1.21 times too far apart"), (1 / 1.21, "1.21 times too near"), (3, "3 times too far")]
)
def test_distance_beyond_a_fifth_is_a_wrong_scale(ratio: float, said: str) -> None:
    fault = spacing_fault(apart(ratio))
    assert fault.startswith("wrong scale: the marks are ")
    assert f"the marks are {ratio * NOMINAL_MM:.4g} mm apart where robot.toml says 4 mm, " in fault
    assert said in fault


def test_without_geometry_no_distance_is_wrong() -> None:
    poses = apart(3.0)
    poses.geometry = None
    assert spacing_fault(poses) == ""


@pytest.mark.parametrize(("size_mm", "unit"), [(1000.0, "m"), (10.0, "cm"), (25.4, "inches")])
def test_unit_is_recognised_within_a_fifth_to_either_side(size_mm: float, unit: str) -> None:
    for off in (1.0, 1.19, 1 / 1.19):
        assert spacing_fault(apart(off / size_mm)).endswith(f"; lengths look like {unit}, not mm")
    for off in (1.21, 1 / 1.21):
        assert spacing_fault(apart(off / size_mm)).startswith("wrong scale")


@pytest.mark.parametrize(
    ("ratio", "low", "high", "px"),
    [(30, 0.0, 51.0, True), (30, 0.0, 49.0, False), (30, -0.1, 51.0, False), (0.5, 0.0, 51.0, False)],
)
def test_pixels_reach_far_and_are_not_negative(ratio: float, low: float, high: float, px: bool) -> None:
    assert spacing_fault(apart(ratio, low, high)).endswith("; lengths look like px, not mm") == px


def turn(low: float, value: float, high: float, turned_deg: float = 90.0, length_mm: float = 2.0) -> Any:
    """A fit of this curvature, 1/mm."""
    return SimpleNamespace(
        curvature=lambda: Curvature(value, low, high, 0.01),
        motion=SimpleNamespace(length_mm=length_mm, turn_rad=np.radians(turned_deg)),
    )


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize(("share", "straight"), [(0.51, False), (0.49, True)])
def test_turn_is_certain_where_its_interval_ends_at_half_its_curvature(
    sense: int, share: float, straight: bool
) -> None:
    ends = sorted((sense * share * 1e-3, sense * (2 - share) * 1e-3))
    assert (straightness(turn(ends[0], sense * 1e-3, ends[1])) != "") == straight


@pytest.mark.parametrize(("share", "straight"), [(0.51, False), (0.49, True)])
def test_on_the_spot_half_of_the_angle_counts_and_not_of_the_curvature(share: float, straight: bool) -> None:
    nearest = np.tan(share * np.arctan(2.0 * 5.0)) / 2.0  # of a curvature of 5/mm, at marks 2 mm apart
    assert (straightness(turn(nearest, 5.0, 1e9)) != "") == straight


def test_interval_that_holds_a_straight_path_is_said_in_1_per_m() -> None:
    assert straightness(turn(-1e-4, 2e-4, 5e-4)) == "straight: curvature 0.2 1/m, 95 % from -0.1 to 0.5 1/m"
    assert straightness(turn(9e-4, 1e-3, 1.1e-3)) == ""


@pytest.mark.parametrize("sense", [1, -1])
def test_interval_that_excludes_a_straight_path_is_not_called_straight(sense: int) -> None:
    """A turn by 1.6 degrees/s, of a command that turns, was "straight, curvature -23 1/m, 95 % from -37 to -7 1/m"."""
    low, high = sorted((sense * 7e-3, sense * 37e-3))
    assert straightness(turn(low, sense * 23e-3, high)).startswith(
        f"straight or hardly turning: curvature {sense * 23} 1/m, 95 %"
    )


@pytest.mark.parametrize(("turned_deg", "straight"), [(0.95, True), (1.05, False)])
def test_less_than_a_degree_is_no_turn_however_certain(turned_deg: float, straight: bool) -> None:
    said = straightness(turn(9e-4, 1e-3, 1.1e-3, turned_deg))
    little = f"turns too little: by {turned_deg:.2g} degrees; curvature 1.0"
    assert said.startswith(little) if straight else said == ""


def varying(spread: float, mean: float = -0.2, *, varies: bool = True) -> Sustained:
    curvature = Curvature(mean, mean, mean, 0.0)
    return Sustained(curvature, curvature, varies, spread, 1e-6, 0.0, 1.0)


@pytest.mark.parametrize(("share", "said"), [(0.049, ""), (0.051, "5 %"), (0.3, "30 %"), (20.0, "999 %")])
def test_variation_is_worth_a_sentence_from_a_twentieth_of_the_curvature_on(share: float, said: str) -> None:
    sentence = variation(varying(share * 0.2))
    assert sentence == (f"varies: the curvature scatters by {said} from stretch to stretch" if said else "")
    assert variation(varying(share * 0.2, varies=False)) == ""


def test_variation_about_a_straight_path_is_endless() -> None:
    assert "999 %" in variation(varying(1e-9, 0.0))
