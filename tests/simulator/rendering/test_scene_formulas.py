"""The parts of a rendered scene in closed form: motion, times, light, glare, wires, sheets, sensor and tags."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.special import ndtr

from calibration.camera import camera_above
from simulator.mark_layout import Mark
from simulator.rendering import Scene
from simulator.rendering.backdrop import _distance_px, _glare, _light_field, _wires, brushed_plate, overlay
from simulator.rendering.coverage import add_polygon, blur_kernel
from simulator.rendering.gauge_image import ink, pose_of
from simulator.rendering.motion import poses_at
from simulator.rendering.painter import box_about, clockwise_hull, distractor_disc, moments_of_exposure
from simulator.rendering.plane import camera_from, plane_map
from simulator.rendering.scene import GaugeScene
from simulator.rendering.sensor import digitised
from simulator.rendering.shots import clock_of, shots
from simulator.rendering.tables import Circle, Distractor, Glare, Lighting, Line, Optics, Plate, Sensor, Simulated, Wire
from simulator.rendering.tag import tag_number, tag_squares
from simulator.robot import load_robot

ROBOT = load_robot("barrel")
SIZE = (41, 21)


def test_line_and_circle_are_at_rest_outside_of_their_times_and_steady_within() -> None:
    times = np.array([-1.0, 1.0, 2.5, 4.0, 9.0])
    way = np.array([0.0, 0.0, 3.0, 6.0, 6.0])
    start: dict[str, Any] = {"x_mm": 1.0, "y_mm": -2.0, "heading_deg": 30.0, "start_s": 1.0, "stop_s": 4.0}
    line = poses_at(Line(kind="line", speed_mm_s=2.0, **start), ROBOT, times)
    cos, sin = math.cos(math.pi / 6), math.sin(math.pi / 6)
    np.testing.assert_allclose(line, np.column_stack([1 + way * cos, -2 + way * sin, np.full(5, math.pi / 6)]))
    for side, sign in (("left", 1), ("right", -1)):
        turn = poses_at(Circle(kind="circle", radius_mm=4.0, speed_mm_s=2.0, side=side, **start), ROBOT, times)
        np.testing.assert_allclose(turn[:, 2], math.pi / 6 + sign * way / 4)
        middle = np.array([1.0, -2.0]) + sign * 4.0 * np.array([-sin, cos])  # to the left of the robot
        np.testing.assert_allclose(np.hypot(*(turn[:, :2] - middle).T), 4.0)
        ahead = turn[2, :2] - turn[1, :2]
        assert ahead @ [cos, sin] > 0
    open_ended = poses_at(Line(kind="line", speed_mm_s=-2.0), ROBOT, np.array([3.0]))
    assert open_ended[0] == pytest.approx([-6.0, 0.0, 0.0])


def test_simulated_robot_starts_in_its_pose_and_stops_when_told_at_times_of_any_order() -> None:
    motion = Simulated(
        kind="simulate", left_rpm=30.0, right_rpm=30.0, start_s=0.5, stop_s=1.0, x_mm=2.0, heading_deg=90
    )
    poses = poses_at(motion, ROBOT, np.array([3.0, 0.4, -1.0, 2.0, 0.75]))
    assert poses[1] == pytest.approx([2.0, 0.0, math.pi / 2])
    assert poses[2] == pytest.approx([2.0, 0.0, math.pi / 2])
    assert poses[0] == pytest.approx(poses[3], abs=1e-6)
    assert 0.3 < poses[4, 1] / poses[0, 1] < 0.7


def scene(**said: Any) -> Scene:
    usual = {"format": 1, "duration_s": 0.5, "frame_rate": "10", "motion": {"kind": "line", "speed_mm_s": 0.0}}
    return Scene.model_validate(usual | said)


def planned(clock: Fraction = Fraction(1), seed: int = 0, **said: Any) -> list[tuple[Any, ...]]:
    plan = shots(scene(**said), np.random.default_rng(seed), clock)
    return [(shot.frame, shot.rows, float(shot.time_s), float(shot.shown_s), shot.seed) for shot in plan]


def test_frames_are_exposed_at_their_rate_but_for_those_lost_or_written_twice() -> None:
    assert planned() == [(k, "all", k / 10, k / 10, 2 * k) for k in range(5)]
    lost = planned(timing={"dropped": (1,)})
    assert lost == [(f, "all", k / 10, k / 10, 2 * k) for f, k in enumerate((0, 2, 3, 4))]
    twice = planned(timing={"repeated": (3,)})
    assert twice[3] == (3, "all", 0.2, 0.3, 4)
    fields = planned(timing={"interlaced": "bottom_first"}, exposure={"time_s": 0.01})
    assert fields[2:4] == [(1, "odd", 0.1, 0.1, 2), (1, "even", pytest.approx(0.15), 0.1, 3)]
    slow = shots(scene(), np.random.default_rng(0), Fraction(1001, 1000))
    assert [shot.shown_s for shot in slow] == [Fraction(k * 9009, 90000) for k in range(5)]
    assert clock_of(slow, Fraction(10)) == Fraction(1, 90000)
    assert clock_of(shots(scene(), np.random.default_rng(0)), Fraction(10)) == Fraction(1, 10)


def test_jitter_scatters_times_in_ticks_and_leaves_a_fifth_of_a_frame_between_neighbours() -> None:
    times = [shot.time_s for shot in shots(scene(duration_s=60.0, timing={"jitter_s": 0.01}), np.random.default_rng(1))]
    shift = np.array([float(time - Fraction(k, 10)) for k, time in enumerate(times)])
    assert shift[1:].std() == pytest.approx(0.01, rel=0.1)
    assert all((time * 90000).denominator == 1 for time in times)
    wild = planned(seed=1, duration_s=20.0, timing={"jitter_s": 0.5})
    assert np.diff([one[2] for one in wild]).min() == pytest.approx(0.02, abs=3e-5)
    assert wild[0][2] >= 0


def test_light_falls_off_to_the_corners_and_grows_toward_its_direction() -> None:
    even = _light_field(Optics(vignetting=0.2), Lighting(), SIZE)
    assert (even[10, 20], even[0, 0], even[20, 40]) == pytest.approx((1.0, 0.8, 0.8))
    assert even[10, 40] == pytest.approx(1 - 0.2 * 20**2 / (20**2 + 10**2))
    reach = math.hypot(20, 10)
    for degrees, place, along in ((0.0, (10, 40), 20), (90.0, (0, 20), 10), (180.0, (10, 0), 20)):
        field = _light_field(Optics(vignetting=0.0), Lighting(gradient=0.3, gradient_direction_deg=degrees), SIZE)
        assert field[place] == pytest.approx(1 + 0.3 * along / reach)


def test_glare_is_a_gaussian_of_its_radius() -> None:
    light = _glare((Glare(x_px=12.0, y_px=7.0, radius_px=3.0, strength=0.5),) * 2, SIZE)
    assert light[7, 12] == pytest.approx(1.0)
    assert light[7, 15] == pytest.approx(math.exp(-0.5))
    assert light[3, 12] == pytest.approx(math.exp(-16 / 18))


def test_wires_cover_what_is_within_half_their_width_softly_and_the_later_one_lies_above() -> None:
    wire = Wire(points_px=((5.0, 10.0), (20.0, 10.0), (20.0, 30.0)), width_px=4.0, color=(0.2, 0.4, 0.6))
    points = np.array([[1.0, 7.0], [12.0, 12.5], [23.0, 20.0], [20.0, 33.0]])
    assert _distance_px(wire, points) == pytest.approx([5.0, 2.5, 3.0, 3.0])
    covered, light = _wires((wire,), 1.0, SIZE)
    soft = math.sqrt(1 + 1 / 12)
    assert covered[10, 12] == pytest.approx(ndtr(2 / soft))
    assert covered[12, 12] == pytest.approx(0.5)
    assert light[12, 12] == pytest.approx([0.1, 0.2, 0.3])
    across = Wire(points_px=((12.0, 0.0), (12.0, 20.0)), width_px=6.0, color=(1.0, 1.0, 1.0))
    both, mixed = _wires((wire, across), 0.0, SIZE)
    assert both[10, 12] == pytest.approx(1.0)
    assert mixed[10, 12] == pytest.approx([1.0, 1.0, 1.0])
    whole = overlay(scene(wire=[wire.model_dump()], optics={"vignetting": 0.0, "blur_px": 1.0}), SIZE)
    assert whole.transmission[12, 12] == pytest.approx(0.5)
    lit = whole.applied(np.ones((21, 41, 3), np.float32))
    assert lit[12, 12] == pytest.approx([0.6, 0.7, 0.8])


def test_plate_has_its_brightness_and_contrast_and_its_marks_run_along_the_brush() -> None:
    camera = camera_above(size_px=(160, 120), focal_px=1500.0, distance_mm=150.0)  # 10 px a mm
    ground = plane_map(camera, 0.0, 4)
    optics = Optics(blur_px=0.0)
    plate = Plate(brightness=0.4, contrast=0.1, brush_direction_deg=0.0, sheen=0.0, grain_mm=0.4)
    light = brushed_plate(plate, optics, ground, np.random.default_rng(2))[..., 1]
    assert light.mean() == pytest.approx(0.4, rel=0.03)
    # Three layers add up as 0.5² + 0.35² + 0.3²; interpolation takes a part of the finest.
    assert light.std() / 0.4 == pytest.approx(0.1 * math.sqrt(0.25 + 0.1225 + 0.09), rel=0.3)
    assert np.abs(np.diff(light, axis=1)).mean() < 0.1 * np.abs(np.diff(light, axis=0)).mean()
    plain = Plate(brightness=0.4, contrast=0.0, brush_direction_deg=90.0, sheen=0.3)
    shine = brushed_plate(plain, optics, ground, np.random.default_rng(2))[60, :, 1] / 0.4
    width = 160 / 10
    across = (np.arange(160) - 79.5) / 10
    assert shine == pytest.approx(1 + 0.3 * (np.exp(-((across / (0.35 * width)) ** 2)) - 0.5), abs=2e-3)


@pytest.mark.parametrize(("blur", "parts"), [(0.0, 8), (0.9, 8), (1.1, 4), (2.9, 4), (3.1, 2)])
def test_filter_of_a_lens_has_the_variance_of_blur_and_pixel_less_that_of_a_part(blur: float, parts: int) -> None:
    kernel = blur_kernel(blur)
    assert (kernel.parts, len(kernel.weights)) == (parts, (2 * kernel.margin + 1) * parts)
    at = (np.arange(len(kernel.weights)) + 0.5) / parts - kernel.margin - 0.5
    assert kernel.weights.sum() == pytest.approx(1.0)
    assert kernel.weights @ at == pytest.approx(0.0, abs=1e-12)
    part = 1 / (12 * parts**2)
    # A box of parts has the variance of a pixel less that of a part, too: it is a sum of parts' middles.
    assert kernel.weights @ at**2 == pytest.approx(
        max(blur**2 - part, 0.0) + 1 / 12 - (part if blur == 0 else 0), rel=2e-3
    )


def test_polygon_is_whole_inside_half_at_its_edge_and_as_wide_as_its_sides() -> None:
    corners = np.array([[5.0, 4.0], [25.0, 4.0], [25.0, 16.0], [5.0, 16.0]])
    out = np.zeros((21, 41))
    add_polygon(corners, 1.0, (0, 0, 41, 21), 0.5, out)
    assert out[10, 15] == pytest.approx(0.5)
    assert (out[10, 5], out[10, 25], out[4, 15], out[16, 15]) == pytest.approx((0.25,) * 4)
    assert out[10, 6] == pytest.approx(0.5 * ndtr(1 / math.sqrt(1 + 1 / 12)))
    assert (out[10].sum(), out[:, 15].sum()) == pytest.approx((0.5 * 20, 0.5 * 12), rel=1e-4)
    part = np.zeros((6, 8))
    add_polygon(corners, 1.0, (3, 2, 11, 8), 0.5, part)
    np.testing.assert_allclose(part, out[2:8, 3:11])


def test_hulls_run_clockwise_and_boxes_hold_their_points_within_the_image() -> None:
    square = np.array([[0.0, 0.0], [0.0, 4.0], [4.0, 4.0], [4.0, 0.0], [2.0, 2.0]])
    for points in (square, square[::-1]):
        hull = clockwise_hull(points)
        along, on = np.diff(hull, axis=0), np.diff(np.roll(hull, -1, axis=0), axis=0)
        assert len(hull) == 4
        assert (along[:, 0] * on[:, 1] - along[:, 1] * on[:, 0] > 0).all()  # with y down
    assert box_about(np.array([[10.2, 5.7], [12.0, 9.1]]), 2, SIZE) == (8, 3, 15, 13)
    assert box_about(np.array([[1.0, 1.0], [39.5, 19.5]]), 5, SIZE) == (0, 0, 41, 21)
    assert box_about(np.array([[-9.0, 5.0], [-4.0, 8.0]]), 2, SIZE) is None
    assert box_about(np.array([[math.nan, 5.0]]), 2, SIZE) is None


def test_moments_of_an_exposure_are_the_middles_of_equal_parts_of_a_quarter_pixel() -> None:
    assert moments_of_exposure((1.0, 1.4), 0.0) == pytest.approx([1.2])
    assert moments_of_exposure((1.0, 1.4), 1.0) == pytest.approx([1.05, 1.15, 1.25, 1.35])
    assert len(moments_of_exposure((1.0, 1.4), 1.01)) == 5
    assert len(moments_of_exposure((1.0, 1.4), 900.0)) == 256


def test_distractor_moves_at_its_velocity_with_the_gain_of_the_exposure() -> None:
    table = Distractor(x_mm=1.0, y_mm=2.0, velocity_mm_s=(3.0, -4.0), color=(0.1, 0.2, 0.4))
    disc = distractor_disc(table, None, 0.5, 2.0)  # type: ignore[arg-type]
    assert disc.center_mm == pytest.approx((2.5, 0.0))
    assert disc.color == pytest.approx([0.2, 0.4, 0.8])


def test_sensor_rounds_light_above_its_black_and_scatters_as_photons_and_read_out() -> None:
    light = np.full((200, 200, 3), 0.3, np.float32)
    exact = Sensor(full_well_e=0.0, black_level=0.1, bits=12)
    assert (digitised(light, exact, level=0.5) == round(0.25 * 4095)).all()
    assert (digitised(light, exact, level=9.0) == 4095).all()
    noisy = Sensor(full_well_e=1000.0, read_noise_e=12.0, black_level=0.1, bits=16)
    numbers = digitised(light, noisy, level=2.0, key=5) / 65535
    assert numbers.mean() == pytest.approx(0.7, abs=5e-4)
    assert numbers.var() == pytest.approx(0.6 / 1000 + 0.012**2, rel=0.03)
    assert np.array_equal(digitised(light, noisy, key=5), digitised(light, noisy, key=5))
    other = digitised(light, noisy, level=2.0, key=6) / 65535
    assert abs(np.corrcoef(numbers.ravel(), other.ravel())[0, 1]) < 0.02
    shift = [np.corrcoef(numbers.ravel()[:-k], numbers.ravel()[k:])[0, 1] for k in (1, 2, 3, 4)]
    assert np.abs(shift).max() < 0.02
    colored = np.broadcast_to(np.array([0.2, 0.4, 0.8], np.float32), (4, 4, 3))
    grey = digitised(np.ascontiguousarray(colored), Sensor(full_well_e=0.0, black_level=0.0, color=False))
    assert (grey == round((0.299 * 0.2 + 0.587 * 0.4 + 0.114 * 0.8) * 255)).all()


def test_tag_stands_upright_with_the_cells_of_its_number_and_a_cell_of_white_around() -> None:
    mark = Mark(name="tag7", kind="aruco", x_mm=0.0, y_mm=0.0, diameter_mm=6.0)
    assert tag_number(mark) == 7
    assert tag_number(mark.model_copy(update={"id": 3})) == 3
    sheet, square, cells = tag_squares(mark)
    assert (np.ptp(sheet, axis=0), np.ptp(square, axis=0)) == (pytest.approx([8.0, 8.0]), pytest.approx([6.0, 6.0]))
    seen = np.zeros((6, 6), np.uint8)
    for cell in cells:
        x, y = cell.mean(axis=0)
        assert np.ptp(cell, axis=0) == pytest.approx([1.0, 1.0])
        seen[round(2.5 - y), round(x + 2.5)] = 255
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    np.testing.assert_array_equal(seen, cv2.aruco.generateImageMarker(dictionary, 7, 6))


def test_gauge_is_turned_then_leans_toward_its_azimuth_at_its_height() -> None:
    said = {"format": 1, "kind": "gauge", "gauge": "g", "x_mm": 1.0, "y_mm": 2.0, "height_mm": 3.0}
    gauge: Any = type("G", (), {"dots": type("D", (), {"height_mm": 0.5})})
    pose = pose_of(
        GaugeScene.model_validate(said | {"tilt_deg": 20.0, "tilt_azimuth_deg": 90.0, "turn_deg": 30.0}), gauge
    )
    rotation = cv2.Rodrigues(np.array(pose.rotation_rad))[0]
    tilt = math.radians(20)
    assert rotation[:, 2] == pytest.approx([0.0, math.sin(tilt), math.cos(tilt)], abs=1e-9)
    assert rotation[0, :2] == pytest.approx([math.cos(math.pi / 6), -math.sin(math.pi / 6)])  # across the azimuth
    assert pose.translation_mm == pytest.approx((1.0, 2.0, 3.5))
    assert ink("black") == pytest.approx([0.04] * 3)
    assert ink("#ff8000") == pytest.approx([1.0, 0.04 + 0.96 * (128 / 255) ** 2.2, 0.04])
    camera = camera_above(size_px=(160, 120), focal_px=1500.0, distance_mm=150.0, tilt_deg=5.0)
    place = np.array([4.0, -3.0, 1.0])
    moved = camera_from(camera, pose.rotation_rad, pose.translation_mm)
    assert moved.image_from_plate(place) == pytest.approx(
        camera.image_from_plate(rotation @ place + np.array(pose.translation_mm))
    )
