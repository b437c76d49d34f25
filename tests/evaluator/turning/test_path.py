"""The path of one point, whose heading nobody knows: circles and lines in closed form."""

from __future__ import annotations

import re

import numpy as np
import pytest

from evaluator.turning import path
from evaluator.turning.motion.curvature import Curvature
from evaluator.turning.path import (
    PointPath,
    _along,
    _circle,
    _distance,
    _first_guess,
    _longer_leg,
    _noise,
    _spread,
    measure_path,
)

FRAME_S = 1 / 50


def on_circle(
    radius: float, turned_deg: float, frames: int = 300, sigma: float = 0.0, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Times and places counter-clockwise about (3, -2); clockwise for a negative radius."""
    angle = np.radians(np.linspace(20, 20 + turned_deg, frames)) * np.sign(radius)
    places = np.column_stack([3 + abs(radius) * np.cos(angle), -2 + abs(radius) * np.sin(angle)])
    return FRAME_S * np.arange(frames), places + sigma * np.random.default_rng(seed).normal(size=places.shape)


@pytest.mark.parametrize("radius", [5.0, -5.0, 80.0])
@pytest.mark.parametrize("turned_deg", [60, 350, 800])
def test_exact_circle_has_its_radius_speed_and_turn(radius: float, turned_deg: float) -> None:
    path = measure_path(*on_circle(radius, turned_deg))
    assert path.status == "ok"
    assert path.radius == pytest.approx(abs(radius), rel=1e-6)
    assert path.turned_deg == pytest.approx(turned_deg, rel=1e-6)
    assert path.speed == pytest.approx(abs(radius) * np.radians(turned_deg) / (299 * FRAME_S), rel=1e-6)
    assert path.scatter == pytest.approx(0.0, abs=1e-6)


def test_noisy_circles_hold_their_radius_in_their_bounds() -> None:
    paths = [measure_path(*on_circle(5.0, 300, 200, 0.02, seed)) for seed in range(20)]
    assert sum(path.low < 5.0 < path.high for path in paths) >= 17
    assert np.mean([path.radius for path in paths]) == pytest.approx(5.0, rel=1e-3)
    assert np.mean([path.scatter for path in paths]) == pytest.approx(0.02, rel=0.05)


def test_unit_of_length_known_to_a_share_widens_the_bounds_by_that_share() -> None:
    plain, wide = (measure_path(*on_circle(5.0, 300, 200, 0.001), scale_sigma=share) for share in (0.0, 0.02))
    assert 1 / wide.low - 1 / wide.radius == pytest.approx(1.96 * 0.02 / 5.0, rel=0.01)
    assert plain.high - plain.low < 0.1 * (wide.high - wide.low)


def test_line_has_a_speed_and_no_radius() -> None:
    time = FRAME_S * np.arange(200)
    places = np.column_stack([3 * time, 4 * time]) + 0.01 * np.random.default_rng(1).normal(size=(200, 2))
    path = measure_path(time, places)
    assert path.status.startswith("straight: curvature")
    assert np.isnan([path.radius, path.low, path.high]).all()
    assert path.speed == pytest.approx(5.0, rel=0.01)
    assert path.summary("mm").startswith(f"{path.status} 1/mm; ")


@pytest.mark.parametrize("unit", [1e-5, 1e4])
def test_a_path_is_the_same_in_any_unit_of_length(unit: float) -> None:
    time, places = on_circle(5.0, 300, sigma=0.01)
    one, other = measure_path(time, places), measure_path(time, unit * places)
    for name in ("radius", "low", "high", "speed", "scatter"):
        assert getattr(other, name) == pytest.approx(unit * getattr(one, name), rel=1e-6), name
    assert other.turned_deg == pytest.approx(one.turned_deg, rel=1e-6)


def test_a_path_at_a_tenth_of_the_frame_rate_differs_in_its_speed_alone() -> None:
    """Noise is correlated from frame to frame, whatever their interval."""
    time, places = on_circle(5.0, 300, sigma=0.01)
    one, other = measure_path(time, places), measure_path(10 * time, places)
    assert other.speed == pytest.approx(one.speed / 10, rel=1e-6)
    assert (other.radius, other.low, other.high) == pytest.approx((one.radius, one.low, one.high), rel=1e-6)


@pytest.mark.parametrize(("turned_deg", "straight"), [(0.95, True), (1.05, False)])
def test_an_arc_of_less_than_a_degree_is_straight(turned_deg: float, straight: bool) -> None:
    assert measure_path(*on_circle(500.0, turned_deg)).status.startswith("straight") == straight


@pytest.mark.parametrize(
    ("back", "said"),
    [(0.0, "straight:"), (0.018, "straight:"), (0.022, "straight, out and back:"), (0.3, "straight, out and back:")],
)
def test_a_mark_that_turns_back_on_its_line_is_said_to(back: float, said: str) -> None:
    there = np.concatenate([np.linspace(0.0, 50.0, 200), np.linspace(50.0, 50.0 * (1 - back), 60)])
    places = np.outer(there, [0.8, 0.6]) + 0.02 * np.random.default_rng(3).normal(size=(260, 2))
    path = measure_path(FRAME_S * np.arange(260), places)
    assert path.summary("px").startswith(said)
    assert path.speed == pytest.approx(50.0 / (200 * FRAME_S), rel=0.02)


def test_places_that_jump_are_rejected() -> None:
    time, places = on_circle(5.0, 300, 300, 0.01)
    places[100:104] += 1.0
    assert measure_path(time, places).radius == pytest.approx(5.0, rel=1e-3)


@pytest.mark.parametrize(("sigmas", "counts"), [(9.0, False), (4.5, True)])
def test_places_beyond_six_sigmas_are_no_part_of_the_circle(sigmas: float, counts: bool) -> None:
    time, places = on_circle(5.0, 200, 300, 0.01)
    jumping = np.arange(300) % 60 == 30
    exact = on_circle(5.0, 200, 300)[1]
    outward = (exact - [3.0, -2.0]) / 5.0
    places[jumping] = exact[jumping] + 0.01 * sigmas * outward[jumping]
    with_all, without = _circle(time, places)[0].value, _circle(time[~jumping], places[~jumping])[0].value
    assert (abs(with_all / without - 1) > 1e-5) == counts


def test_radius_that_changes_is_said_to_vary_with_its_size() -> None:
    curvature = np.repeat([0.18, 0.22], 300)
    heading = np.cumsum(curvature * 0.1)
    places = np.cumsum(0.1 * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    places += 0.002 * np.random.default_rng(2).normal(size=places.shape)
    path = measure_path(FRAME_S * np.arange(600), places)
    # Two quarters of 0.18 and two of 0.22: a standard deviation of 0.0231, 11.5 % of 0.2.
    assert path.status.startswith("varies: the curvature scatters by 1")
    assert path.low < 1 / 0.22
    assert path.high > 1 / 0.18
    assert path.summary("px").startswith("varies")


@pytest.mark.parametrize(("frames", "said"), [(15, "15 frames with the mark; 16 are needed"), (16, "")])
def test_sixteen_frames_are_needed(frames: int, said: str) -> None:
    path = measure_path(*on_circle(5.0, 200, frames))
    assert path.status == said if said else np.isfinite(path.radius)


def test_missing_frames_are_left_out() -> None:
    time, places = on_circle(5.0, 300)
    places[50:120] = np.nan
    assert measure_path(time, places).radius == pytest.approx(5.0, rel=1e-6)


def test_rest_is_no_path() -> None:
    rest = np.tile([3.0, 4.0], (100, 1)) + 0.01 * np.random.default_rng(3).normal(size=(100, 2))
    assert measure_path(FRAME_S * np.arange(100), rest).status.startswith("at rest")


def test_noise_is_that_of_a_coordinate_whatever_the_path() -> None:
    _, places = on_circle(5.0, 300, 4000, 0.02)
    assert _noise(places) == pytest.approx(0.02, rel=0.05)


def test_summary_says_radius_bounds_turn_and_speed() -> None:
    said = PointPath("ok", 5.0, 4.9, 5.1, 2.5, 300.4, 0.01).summary("mm")
    assert said == "path radius 5.00 mm, 95 % from 4.90 to 5.10; 300 degrees at 2.5 mm/s"


def test_summary_of_a_straight_path_has_units_and_says_how_far_the_places_lie_from_it() -> None:
    said = measure_path(*on_circle(500.0, 0.5)).summary("px")
    straight = r"straight: curvature \S+, 95 % from \S+ to \S+ 1/px; \S+ px RMS from its line, at \S+ px/s"
    assert re.fullmatch(straight, said)


def test_path_that_turns_one_way_and_then_the_other_has_no_single_radius_and_no_curvature() -> None:
    turns = np.radians(np.repeat([0.0, 3.0, 0.0, 3.0], 60))
    heading = np.cumsum(turns)
    places = np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    said = measure_path(FRAME_S * np.arange(240), places).summary("mm")
    assert re.fullmatch(
        r"varies: the curvature scatters by \d+ % from quarter to quarter; no single radius; \S+ mm/s", said
    )


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("from_deg", [0, 100, -140])
def test_fit_of_a_circle_begins_with_it_and_that_of_a_line_with_the_line(sense: int, from_deg: float) -> None:
    """The anchor lies 1.5 outside of a circle of 4; counter-clockwise is to the left."""
    angle = np.radians(np.linspace(from_deg, from_deg + sense * 80, 60))
    center = np.array([5.5 * np.cos(0.4), 5.5 * np.sin(0.4)])
    places = center + 4 * np.column_stack([np.cos(angle), np.sin(angle)])
    guess = _first_guess(places)
    np.testing.assert_allclose(_distance(places, guess), 0.0, atol=1e-9)
    assert guess[2] == pytest.approx(0.25)
    assert guess[0] == pytest.approx(1.5)
    line = np.linspace(-3, 5, 40)[:, None] * [np.cos(0.4), np.sin(0.4)]
    flat = _first_guess(line)
    np.testing.assert_allclose(_distance(line, flat), 0.0, atol=1e-9)
    assert abs(flat[2]) < 1e-9


def test_distance_from_a_circle_is_signed_and_that_from_a_line_too() -> None:
    """Of radius 4 about (0, 4), driven along +x at the anchor: inside is to the left and positive."""
    q = np.array([[0.0, 1.0], [0.0, -1.0], [4.0, 4.0], [0.0, 8.5]])
    np.testing.assert_allclose(_distance(q, np.array([0.0, 0.0, 0.25])), [1.0, -1.0, 0.0, -0.5], atol=1e-12)
    np.testing.assert_allclose(_distance(q, np.array([0.5, 0.0, 0.0])), [0.5, -1.5, 3.5, 8.0], atol=1e-12)
    np.testing.assert_allclose(_distance(q, np.array([0.0, np.pi / 2, 0.0])), [0.0, 0.0, -4.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("curvature", [0.25, -0.25, 0.0])
def test_length_of_path_grows_along_the_way(curvature: float) -> None:
    length = np.linspace(-20, 22, 200)
    turned = curvature * length
    chord = length * np.sinc(turned / 2 / np.pi)
    q = np.column_stack([chord * np.cos(turned / 2), chord * np.sin(turned / 2)])
    found = _along(q, np.array([0.0, 0.0, curvature]))
    np.testing.assert_allclose(found - found[0], length - length[0], atol=1e-9)


def test_spread_between_quarters_is_their_scatter_less_twice_the_noise() -> None:
    curvature = np.repeat([0.18, 0.22], 300)
    heading = np.cumsum(curvature * 0.1)
    places = np.cumsum(0.1 * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    time = FRAME_S * np.arange(600)
    exact = np.std([0.18, 0.18, 0.22, 0.22], ddof=1) / 0.2
    assert _spread(time, places) == pytest.approx(exact, rel=0.01)
    assert _spread(time[:60], places[:60]) == 0.0  # fifteen frames a quarter


def test_noise_of_four_quarters_is_taken_twice_off_their_scatter(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [
        (Curvature(k, k, k, sigma), np.arange(2.0), np.zeros(1))
        for k, sigma in zip((0.18, 0.18, 0.22, 0.22), (0.01, 0.01, 0.0, 0.0), strict=True)
    ]  # variances of 1e-4 and 0: 5e-5 in the mean
    for values, spread in ((found, np.sqrt(0.02**2 * 4 / 3 - 1e-4) / 0.2), (found[:1] * 4, 0.0)):
        quarters = iter(values)
        monkeypatch.setattr(path, "_circle", lambda *_, quarters=quarters: next(quarters))
        assert _spread(np.arange(64.0), np.zeros((64, 2))) == pytest.approx(spread)


@pytest.mark.parametrize("radius", [5.0, -5.0])
def test_quarters_of_a_noisy_arc_bend_to_one_side_whichever_way_their_fits_begin(radius: float) -> None:
    """Where a quarter began with a line that ran against the motion, clean turns of 25 degrees had no single radius."""
    arcs = [on_circle(radius, 25.0, 94, 0.002, seed) for seed in range(20)]
    assert max(_spread(*arc) for arc in arcs) < 0.7
    assert sum(np.isfinite(measure_path(*arc).radius) for arc in arcs) == 20


@pytest.mark.parametrize(
    ("along", "leg"),
    [
        ([0, 1, 2, 3, 2], [0, 1, 2, 3]),
        ([0, -1, -2, -3, -2], [0, -1, -2, -3]),
        ([0, 2, 4, 3, 2, 1], [4, 3, 2, 1]),
        ([5, 6, 7, 6], [5, 6, 7]),  # as far as back: the way there
    ],
)
def test_speed_out_and_back_is_that_of_the_longer_way_and_of_the_place_where_it_turns(
    along: list[float], leg: list[float]
) -> None:
    assert np.array(along)[_longer_leg(np.array(along))].tolist() == leg
