"""A gauge that is longer one way than its file says: told from pixels that are not square, corrected, and counted."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibration.assessment.quality import assess
from calibration.camera import camera_above
from calibration.estimation import gauge_as_printed as module
from calibration.estimation.bundle_adjustment import solve
from calibration.estimation.calibrate import calibrate
from calibration.estimation.gauge_as_printed import excess_found, stretch, stretched
from tests.calibration.bundles import FREE, GAUGE, LOOSE, bundle
from tests.calibration.drawing import draw_gauge, gauge_of, random_poses


@pytest.mark.parametrize("excess", [0.0, 0.0004, 0.004, -0.004])
def test_stretch_of_a_gauge_is_measured_within_its_uncertainty(excess: float) -> None:
    views, state = bundle(4)
    # The file says that the gauge is shorter one way than it was when the views were taken.
    filed = stretched(GAUGE, -excess)
    places = np.column_stack([filed.positions_mm().reshape(-1, 2), np.zeros(88)])
    views = [replace(view, points_mm=places) for view in views]
    fit = solve(views, replace(state, free=(*FREE, "aspect")), LOOSE)
    found, sigma = stretch(views, fit, filed)
    assert abs(found - excess) < 3 * sigma
    assert sigma < 4e-4


def test_pixels_that_are_not_square_are_no_stretch() -> None:
    views, state = bundle(4)
    lens = state.lens.copy()
    lens[1] = 1.004
    squeezed = [replace(view, centers_px=(view.centers_px - lens[2:4]) * [1.0, 1.004] + lens[2:4]) for view in views]
    free = (*FREE, "aspect")
    found, sigma = stretch(squeezed, solve(squeezed, replace(state, lens=lens, free=free), LOOSE), GAUGE)
    assert abs(found) < 3 * sigma


@pytest.mark.parametrize(("columns", "rows"), [(9, 6), (6, 9), (8, 8)])
def test_stretch_moves_dots_as_its_derivative_says_however_the_array_lies(columns: int, rows: int) -> None:
    gauge = gauge_of(columns=columns, rows=rows)
    for excess in (1e-3, -1e-3):
        moved = stretched(gauge, excess).positions_mm() - gauge.positions_mm()
        along, down = np.ptp(moved.reshape(-1, 2), axis=0)[:: -1 if rows > columns else 1]
        assert (along, down) == pytest.approx((0.0015 * (columns - 1), 0.0015 * (rows - 1)))


def test_stretched_gauge_keeps_its_mean_pitch_and_counts_half_its_stretch_as_uncertainty() -> None:
    found = stretched(gauge_of(pitch_tolerance_percent=0.1), 0.004)
    assert found.pitch_mm == pytest.approx((3.006, 2.994))
    assert found.scale_sigma == pytest.approx(np.hypot(0.001, 0.002))


@pytest.mark.parametrize(("held_out", "is_stretched"), [(0.5, True), (1.0, False)])
def test_what_the_lens_had_taken_up_of_a_stretch_is_added_to_it(
    held_out: float, *, is_stretched: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A first look tells 0.4 %, and one at the gauge stretched by it 0.03 % more."""
    asked: list[Any] = []

    def trials(sightings: Any, gauge: Any, prior: Any) -> Any:
        del sightings, prior
        asked.append(gauge)
        return ["a view", "another"], [SimpleNamespace(held_out=1.0 if len(asked) == 1 else held_out, fit=gauge)]

    found = {id(GAUGE): 0.004}
    monkeypatch.setattr(module, "_trials", trials)
    monkeypatch.setattr(module, "_stretch", lambda _, __, ___, gauge: (found.get(id(gauge), 0.0003), 1e-5))
    monkeypatch.setattr(module, "chance", lambda *_: 0.1)
    gauge = module.as_printed([], GAUGE, LOOSE)[0]
    expected = stretched(GAUGE, 0.0043) if is_stretched else GAUGE
    np.testing.assert_allclose(gauge.positions_mm(), expected.positions_mm())


def test_gauge_of_a_calibration_is_recognised_in_its_file_and_another_one_is_not() -> None:
    stated = gauge_of(pitch_mm=3.1)
    assert excess_found(stated, stated) == 0.0
    for excess in (0.0123, -0.0004):
        assert excess_found(stretched(stated, excess), stated) == pytest.approx(excess)
    longer = gauge_of(pitch_mm=3.11)
    assert excess_found(longer, stated) is None  # another size
    assert excess_found(stretched(longer, 0.004), stated) is None
    assert excess_found(gauge_of(pitch_mm=(3.106, 3.094)), stated) is None  # stated by the user, not found
    assert excess_found(stretched(gauge_of(pitch_mm=3.1, diameter_mm=1.3), 0.004), stated) is None


def test_sheet_printed_too_long_one_way_gives_the_camera_as_it_is() -> None:
    camera = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120, tilt_deg=3, k1=-0.2)
    rng = np.random.default_rng(6)
    views = random_poses(camera, 4, rng, tilt_deg=25, shift_mm=2)
    printed = gauge_of(columns=12, pitch_mm=(3.006, 2.994))
    found = calibrate([draw_gauge(view, printed, rng=rng, snr=50) for view in views], gauge_of(columns=12))
    assert abs(found.excess - 0.004) < 3 * found.excess_sigma < 6e-4
    verdict = assess(found)
    assert verdict.level == "limited"
    assert any("longer along columns than rows" in reason for reason in verdict.reasons)
    points = np.stack(np.meshgrid(np.linspace(20, 380, 5), np.linspace(20, 280, 4)), axis=-1)
    error = found.camera.plate_from_image(points, 6.5) - camera.plate_from_image(points, 6.5)
    assert np.sqrt(np.mean(error**2)) < 0.002  # 0.02 where the file is believed
