"""The slip law of one wheel: limits in closed form, signs, derivatives, and the bend against the library."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simulator.robot import load_robot
from simulator.slip.curves import normalized_forces, slip_curves
from simulator.slip.law import REST_SPEED_MM_S
from tests.simulator.plain import plain

REST = 1e-4
# grip along, across, steepness along, across, ratio of stiffnesses, shape along, across, decrease
LAW = (3.0, 5.0, 4.0, 2.5, 0.8, 1.2, 0.9, 0.25)
GENTLE = 1e-6  # a slip so small that friction is proportional to it


def force(u: float, v: float, slip: float, law: tuple[float, ...] = LAW) -> np.ndarray:
    return np.array(plain("law").wheel_force(u, v, slip, *law, REST))


@pytest.mark.parametrize(
    ("u", "surface", "slip"),
    [
        *((2.0, 0.0, 1.0), (2.0, 1.0, 0.5), (1.0, 2.0, -0.5), (2.0, 2.0, 0.0), (2.0, -1.0, 1.5)),
        *((-2.0, -1.0, -0.5), (-1.0, -2.0, 0.5), (0.0, 3.0, -1.0), (0.0, -3.0, 1.0), (0.0, 0.0, 0.0)),
    ],
)
def test_slip_ratio_is_the_difference_over_the_larger_speed(u: float, surface: float, slip: float) -> None:
    assert plain("law").slip_ratio(u, surface, REST) == pytest.approx(slip, abs=1e-8)
    assert plain("law").slip_ratio(REST, 0.0, REST) == pytest.approx(1 / math.sqrt(2))  # rest is rounded


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_wheel_that_only_slides_sideways_is_pushed_back_with_its_lateral_law(way: float) -> None:
    """Across its rolling direction sigma is 1: grip · sin(a·atan b) · (1 - decrease)."""
    expected = 5.0 * math.sin(0.9 * math.atan(2.5)) * 0.75
    assert force(0.0, 3.0 * way, 0.0) == pytest.approx([0.0, -expected * way], abs=1e-4)


@pytest.mark.parametrize("slip", [-1.0, -0.3, 0.3, 1.0])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_wheel_that_rolls_straight_is_braked_or_driven_with_its_longitudinal_law(slip: float, way: float) -> None:
    """Sigma is the slip ratio times the ratio of stiffnesses, whichever way it rolls."""
    sigma = 0.8 * abs(slip)
    expected = 3.0 * math.sin(1.2 * math.atan(4.0 * sigma)) * (1 - 0.25 * sigma)
    assert force(2.0 * way, 0.0, slip) == pytest.approx([-math.copysign(expected, slip), 0.0], abs=1e-7)


def test_small_slips_are_opposed_in_proportion_to_both_stiffnesses() -> None:
    along, across = force(2.0, 2.0 * GENTLE, 3 * GENTLE) / GENTLE
    assert across == pytest.approx(-5.0 * 2.5 * 0.9, rel=1e-4)
    assert along == pytest.approx(-3 * 0.8 * 3.0 * 4.0 * 1.2, rel=1e-4)


def test_a_wheel_that_rolls_true_has_no_friction() -> None:
    assert force(2.0, 0.0, 0.0).tolist() == [0.0, 0.0]
    slopes = plain("law").wheel_slopes(2.0, 0.0, 2.0, 1.0, *LAW, 0.0)
    assert np.isfinite(slopes).all()
    assert slopes[:2] == pytest.approx([0.0, 0.0])


def test_curves_run_over_braking_slips_and_over_driving_ones_where_these_are_asked_for() -> None:
    slip = load_robot("barrel").slip
    for driving, lowest in ((False, 0.0), (True, -1.0)):
        panel = slip_curves(slip, (0.0, 30.0), driving).query("panel == 'a'")
        assert (panel["slip_ratio"].min(), panel["slip_ratio"].max()) == (lowest, 1.0)
        assert np.diff(panel["slip_ratio"].unique()) == pytest.approx(0.01)


def test_curves_are_drawn_at_the_slip_angles_of_section_3_and_at_fifths_of_the_slip_ratio() -> None:
    table = slip_curves(load_robot("barrel").slip)
    first, second = (table.query(f"panel == '{panel}'") for panel in "ab")
    assert first["slip_angle_deg"].unique().tolist() == [0.0, 7.5, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0]
    assert second["slip_ratio"].unique().tolist() == [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    angles = second["slip_angle_deg"].unique()
    assert (angles[0], angles[1], angles[-1]) == (0.0, 0.5, 90.0)


def test_friction_shares_itself_out_by_the_components_of_the_slide() -> None:
    """At a slip angle of 30° and half slip: components cos 30°·0.8·0.5 and sin 30°, of one sigma."""
    slide, aside = 0.4 * math.sqrt(0.75), 0.5
    sigma = math.hypot(slide, aside)
    level = 1 - 0.25 * sigma
    expected = [
        -slide / sigma * level * 3.0 * math.sin(1.2 * math.atan(4.0 * sigma)),
        -aside / sigma * level * 5.0 * math.sin(0.9 * math.atan(2.5 * sigma)),
    ]
    assert force(math.sqrt(3.0), 1.0, 0.5) == pytest.approx(expected, rel=1e-6)
    assert force(-math.sqrt(3.0), 1.0, 0.5) == pytest.approx(expected, rel=1e-6)


def test_curves_of_the_bench_are_the_law_without_any_rounding_of_rest() -> None:
    """Braking at half slip and 30°, both forces positive: sigma of 0.4·cos 30° and sin 30°, as above."""
    slide, aside = 0.4 * math.sqrt(0.75), 0.5
    sigma = math.hypot(slide, aside)
    level = (1 - 0.25 * sigma) / sigma
    expected = [
        slide * level * 0.3 * math.sin(1.2 * math.atan(2.0 / 0.3 * sigma)),
        aside * level * 0.5 * math.sin(0.9 * math.atan(2.0 / 0.5 * sigma)),
    ]
    parameters = [0.3, 0.5, 0.25, 1.2, 0.9, 1.6, 2.0]  # stiffness along 0.8 of that across
    assert np.array(normalized_forces(parameters, 0.5, math.radians(30.0))) == pytest.approx(expected, rel=1e-9)


def test_friction_falls_to_nothing_and_never_pushes() -> None:
    weak = (*LAW[:7], 1.6)
    assert force(0.0, 1.0, 0.0, weak) == pytest.approx([0.0, 0.0])
    assert plain("law").wheel_slopes(0.0, 1.0, 0.0, 1.0, *weak, REST)[1] == 0.0


@pytest.mark.parametrize("driving", [1.0, 0.0])
@pytest.mark.parametrize(
    ("u", "v", "surface"),
    [
        *((2.0, 0.5, 1.0), (1.3, 0.5, 2.0), (0.7, -0.5, -2.0), (-2.0, 0.4, -1.0), (-1.3, -0.4, -3.0)),
        *((-0.7, 0.7, 3.0), (0.3, 2.0, 0.1), (2e-5, 3e-5, 1e-5)),
    ],
)
def test_slopes_are_the_derivatives_of_the_force(u: float, v: float, surface: float, driving: float) -> None:
    law = plain("law")

    def at(u: float, v: float, surface: float) -> np.ndarray:
        return force(u, v, driving * law.slip_ratio(u, surface, REST))

    found = np.array(law.wheel_slopes(u, v, surface, driving, *LAW, REST))
    assert found[:2] == pytest.approx(at(u, v, surface), rel=1e-9, abs=1e-12)
    step = 1e-5 * math.hypot(u, v)
    by = [
        (at(u + step * a, v + step * b, surface + step * c) - at(u - step * a, v - step * b, surface - step * c))
        / (2 * step)
        for a, b, c in np.eye(3)
    ]
    derivatives = np.array([by[0][0], by[1][0], by[0][1], by[1][1], by[2][0], by[2][1]])
    assert found[2:] == pytest.approx(derivatives, rel=1e-5, abs=1e-6 * np.abs(derivatives).max())


def test_slopes_vanish_where_friction_has_fallen_to_nothing() -> None:
    weak = (*LAW[:7], 1.6)
    assert np.array(plain("law").wheel_slopes(0.1, 3.0, 0.2, 1.0, *weak, REST)) == pytest.approx(np.zeros(8), abs=1e-12)


@pytest.mark.parametrize("shape", [0.3, 1.0, 1.9])
def test_plain_bend_is_that_of_the_library(shape: float) -> None:
    magic, x = plain("magic_formula"), np.concatenate([[0.0, 1.0, 2.4143], 10.0 ** np.linspace(-12, 5, 120)])
    found = np.array([(magic.sine_of_atan(value, shape), *magic.sine_and_cosine_of_atan(value, shape)) for value in x])
    angle = shape * np.arctan(x)
    np.testing.assert_allclose(found[:, 0], np.sin(angle), rtol=4e-15)
    np.testing.assert_allclose(found[:, 1], np.sin(angle), rtol=4e-15)
    np.testing.assert_allclose(found[:, 2], np.cos(angle), atol=1e-15)


def test_rest_is_rounded_far_below_the_slowest_wheel_in_use() -> None:
    """3 rpm of a wheel of 0.5 mm: 0.157 mm/s; a ten-thousandth of that changes no slip by more than 1e-6."""
    slowest = 2 * math.pi * 0.5 * 3 / 60
    slip = plain("law").slip_ratio(slowest, 0.5 * slowest, REST_SPEED_MM_S)
    assert slip == pytest.approx(0.5, abs=1e-6)
    assert pytest.approx(slowest / 1571, rel=1e-3) == REST_SPEED_MM_S


@pytest.mark.parametrize("driving", [1.0, 0.0])
@pytest.mark.parametrize(
    ("u", "v", "surface"),
    [(2.0, 0.5, 1.0), (1.3, 0.5, 2.0), (0.7, -0.5, -2.0), (-2.0, 0.4, -1.0), (-1.3, -0.4, -3.0), (0.3, 2.0, 0.1)],
)
def test_slopes_of_sliding_friction_are_its_derivatives(u: float, v: float, surface: float, driving: float) -> None:
    law = plain("law")

    def at(u: float, v: float, surface: float) -> np.ndarray:
        return np.array(law.sliding_slopes(u, v, surface, driving, *LAW, REST))

    step, found = 1e-6, at(u, v, surface)
    by = [
        (at(u + step * a, v + step * b, surface + step * c) - at(u - step * a, v - step * b, surface - step * c))[:2]
        / (2 * step)
        for a, b, c in np.eye(3)
    ]
    derivatives = np.array([by[0][0], by[1][0], by[0][1], by[1][1], by[2][0], by[2][1]])
    assert found[2:] == pytest.approx(derivatives, rel=1e-5, abs=1e-6 * np.abs(derivatives).max())


def test_friction_of_a_spinning_wheel_that_moves_aside_opposes_its_sliding() -> None:
    """Isotropic: along (u - r·phi', v). The law of slip angles pushes such a wheel aside alone."""
    law, same = plain("law"), (0.4, 0.4, 5.0, 5.0, 1.0, 1.0, 1.0, 0.0)
    f_x, f_y = law.sliding_slopes(0.0, 0.6, 1.0, 1.0, *same, REST)[:2]
    assert f_x / f_y == pytest.approx(-1.0 / 0.6)
    assert f_x > 0
    assert abs(law.wheel_slopes(0.0, 0.6, 1.0, 1.0, *same, REST)[0]) < 1e-3
    rolling = [at(1.0, 0.3, 1.0, 0.0, *same, REST)[:2] for at in (law.sliding_slopes, law.wheel_slopes)]
    assert rolling[0] == pytest.approx(rolling[1])
