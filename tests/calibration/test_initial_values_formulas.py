"""Where the estimation of a camera begins: what is known of any lens, and the pose of a gauge in the middle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.camera import camera_above
from calibration.estimation.initial_values import _pose, _spread, rough_pose, rough_prior
from tests.calibration.bundles import bundle, seen
from tests.calibration.drawing import random_poses

SIZE = 400, 300


def test_of_any_lens_its_middle_is_known_to_a_twelfth_of_the_width_and_its_pixels_are_square() -> None:
    prior = rough_prior(SIZE)
    assert prior.mean == pytest.approx([600.0, 1.0, 199.5, 149.5, *[0.0] * 6])
    assert prior.sigma == pytest.approx([600.0, 0.002, 32.0, 32.0, 1.0, 2.0, 0.002, 0.002, 5.0, 5.0])
    assert prior.shortest_px == pytest.approx(0.2 * 400)


@pytest.mark.parametrize(("aspect", "outer_px"), [(1.0, 0.0), (1.02, 0.0), (1.0, 5.0)])
def test_pose_of_a_gauge_is_that_of_the_dots_in_the_middle(aspect: float, outer_px: float) -> None:
    """Without distortion it is exact, however far the outer half of the dots is moved."""
    camera = camera_above(size_px=SIZE, focal_px=1200, distance_mm=120, tilt_deg=3)
    lens = camera.lens_parameters.copy()
    lens[1], lens[4:] = aspect, 0.0
    rng = np.random.default_rng(2)
    for posed in random_poses(camera, 3, rng, tilt_deg=25, shift_mm=2):
        parameters = posed.parameters.copy()
        parameters[6:] = lens
        view = seen(parameters, rng, 0.0)
        out = view.centers_px - [199.5, 149.5]
        away = np.hypot(*out.T)
        moved = view.centers_px + outer_px * (away > np.median(away))[:, None] * out / away[:, None]
        assert _pose(replace(view, centers_px=moved), lens, SIZE) == pytest.approx(posed.pose, abs=1e-5)
        if aspect == 1.0 and not outer_px:
            assert rough_pose(view, camera) == pytest.approx(posed.pose, abs=1e-5)


def test_pose_of_dots_on_one_line_is_some_pose() -> None:
    view = bundle(1)[0][0].take(np.arange(88) < 11)
    line = replace(
        view, points_mm=view.points_mm * [1.0, 0.0, 1.0], centers_px=np.repeat(view.centers_px[:, :1], 2, axis=1)
    )
    assert _pose(line, rough_prior(SIZE).mean, SIZE).shape == (6,)


def test_eighty_dots_of_a_view_are_enough_to_begin_from_its_first_to_its_last() -> None:
    view = bundle(1)[0][0]
    few = _spread(view)
    assert len(few) == 80
    assert (few.site[0], few.site[-1]) == (0, 87)
    assert np.diff(few.site).max() == 2
    assert len(_spread(few)) == 80
