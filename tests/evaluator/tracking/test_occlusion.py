from __future__ import annotations

import cv2
import numpy as np
import pytest

from evaluator.tracking import track
from evaluator.tracking.detection.appearance import learn_shape
from evaluator.tracking.refinement.disc import Disc, fit, make_disc
from evaluator.tracking.refinement.kernels import RESULTS, VAR_X, X, Y
from evaluator.tracking.refinement.learn_shape import cut_patch, finished
from evaluator.tracking.refinement.occluded_pixels import CORE
from evaluator.tracking.refinement.occlusion import NOTABLE, _window, fit_uncovered
from evaluator.tracking.refinement.slow_path import SlowPath
from tests.evaluator.tracking.synthetic import draw, frames_in_memory, turning_marks

SIZE, FINE, BLUR, NOISE = 48, 6, 0.8, 2.5
AMPLITUDE_LEVELS, BASE_LEVELS, SOFTNESS = 140.0, 25.0, 5.0


def wire_share(shape: tuple[int, int], place: tuple[float, float], angle: float, off_px: float, width_px: float,
               fine: int = FINE) -> np.ndarray:  # fmt: skip
    """Share of (parts of) pixels that a straight wire covers; off_px: from place to its middle."""
    row, column = [(np.arange(count * fine) + 0.5) / fine - 0.5 for count in shape]
    x, y = np.meshgrid(column - place[0], row - place[1])
    away = np.abs(x * np.cos(angle) + y * np.sin(angle) - off_px)
    return np.clip((width_px / 2 - away) * fine + 0.5, 0, 1)


def seen(
    rng: np.random.Generator, radius: float, wires: list[tuple[float, float, float]], level: float = 15.0
) -> tuple[np.ndarray, np.ndarray]:
    """A mark behind wires (angle, distance of the middle over the radius, width px), and its centre."""
    center = SIZE / 2 + rng.uniform(-0.5, 0.5, 2)
    x, y = np.meshgrid(*[(np.arange(SIZE * FINE) + 0.5) / FINE - 0.5 - at for at in center])
    image = BASE_LEVELS + AMPLITUDE_LEVELS * np.clip((radius - np.hypot(x, y)) * FINE + 0.5, 0, 1)
    for angle, off, width in wires:
        share = wire_share((SIZE, SIZE), tuple(center), angle, off * radius, width)
        image = image * (1 - share) + level * share
    soft = cv2.GaussianBlur(image, (0, 0), BLUR * FINE).reshape(SIZE, FINE, SIZE, FINE).mean(axis=(1, 3))
    return np.clip(np.rint(soft + rng.normal(0, NOISE, soft.shape)), 0, 255).astype(np.uint8), center


def disc_of(radius: float) -> Disc:
    return make_disc(radius, np.hypot(BLUR, 12**-0.5), (0.0, 0.0), (AMPLITUDE_LEVELS, BASE_LEVELS), NOISE**2)


def fits(image: np.ndarray, disc: Disc) -> tuple[np.ndarray, np.ndarray, float]:
    """The plain fit, that of what nothing covers, and the share that is covered."""
    plain = fit(image, (0, 1), (SIZE / 2, SIZE / 2), disc)
    result = plain.copy()
    shape = disc.numbers(), disc.table, np.array([disc.noise, SOFTNESS])
    _, share = fit_uncovered(image, 0.0, 1.0, plain, *shape, result, None, CORE, NOTABLE)
    return plain, result, share


@pytest.mark.parametrize("radius", [4.5, 8.0, 14.0])
@pytest.mark.parametrize(("width", "level"), [(1.0, 15.0), (2.5, 15.0), (2.5, 230.0)])
def test_a_wire_pulls_a_mark_no_more_and_its_uncertainty_tells_what_is_left(
    radius: float, width: float, level: float
) -> None:
    rng, disc = np.random.default_rng(3), disc_of(radius)
    errors, plain_errors, normal = [], [], []
    for _ in range(40):
        image, center = seen(rng, radius, [(rng.uniform(0, 7), rng.uniform(0.5, 1.0), width)], level)
        plain, result, share = fits(image, disc)
        if 0.0 < share < 0.6:
            errors.append(result[[X, Y]] - center)
            plain_errors.append(plain[[X, Y]] - center)
            normal.append(errors[-1] / np.sqrt(result[[VAR_X, VAR_X + 1]]))
    assert len(errors) > 15  # a wide wire hides more than half of the smallest mark
    assert np.abs(normal).max() < 4.5
    assert 0.5 < np.std(normal) < 1.3
    assert np.sqrt(np.mean(np.square(errors))) < 0.7 * np.sqrt(np.mean(np.square(plain_errors)))


def test_noise_covers_nothing() -> None:
    rng, disc = np.random.default_rng(4), disc_of(8.0)
    assert np.mean([fits(seen(rng, 8.0, [])[0], disc)[2] > 0.0 for _ in range(100)]) < 0.03


def test_two_wires_that_cross_over_a_mark_leave_it_measured() -> None:
    rng, disc = np.random.default_rng(5), disc_of(10.0)
    for _ in range(20):
        angle = rng.uniform(0, 7)
        image, center = seen(rng, 10.0, [(angle, 0.7, 2.0), (angle + 1.4, -0.3, 1.2)])
        _, result, share = fits(image, disc)
        assert 0.1 < share < 0.7
        assert (np.abs(result[[X, Y]] - center) < 4.5 * np.sqrt(result[[VAR_X, VAR_X + 1]])).all()


def test_a_slope_of_light_is_told_from_a_wire() -> None:
    rng, disc = np.random.default_rng(6), disc_of(8.0)
    across = np.linspace(-30.0, 30.0, SIZE)[None, :]
    wire = [(0.4, 0.8, 2.0)]
    for image, covered in ((seen(rng, 8.0, [])[0] + across, False), (seen(rng, 8.0, wire)[0], True)):
        slow_path = SlowPath(disc.numbers(), disc.table, np.array([disc.noise, SOFTNESS]), np.zeros(RESULTS), 5.9, disc)
        frame = next(frames_in_memory([np.repeat(np.clip(image, 0, 255)[..., None], 3, axis=2)]))
        slow_path.fit(frame, np.array([SIZE / 2, SIZE / 2, AMPLITUDE_LEVELS, BASE_LEVELS]))
        assert slow_path.refit(frame, suspicious=True)
        assert slow_path.occluded == covered


def test_the_shape_of_a_mark_is_learnt_beside_a_wire_that_always_lies_across_it() -> None:
    rng = np.random.default_rng(7)
    patches = [
        cut_patch(seen(rng, 8.0, [(0.4, 0.95, 2.5)])[0], (0, 1), (SIZE / 2, SIZE / 2), 1.3 * 8.0 + 4.0)
        for _ in range(6)
    ]  # fmt: skip
    disc = finished(learn_shape(patches, 8.0))
    assert disc is not None
    assert disc.radius_px == pytest.approx(8.0, abs=0.04)
    assert np.hypot(disc.e1, disc.e2) < 0.006
    assert 0.1 < disc.occluded < 0.5


@pytest.mark.parametrize(("off", "width_px", "radius"), [(0.75, 2.0, 7.0), (0.85, 8.0, 9.2), (0.15, 7.0, 9.2)])
def test_a_wire_that_the_robot_drags_across_a_mark_from_the_start_makes_no_silent_error(
    off: float, width_px: float, radius: float
) -> None:
    """A wide wire leaves the mark oblong, or in two, in all frames from which its shape is learnt."""
    rng = np.random.default_rng(8)
    truth = turning_marks(60, (118.0, 100.0), 36.0, 2 * radius, 0.02)
    images = []
    for k in range(60):
        step = max(k - 20, 0)
        here = {name: tuple(points[step]) for name, points in truth.items()}
        image = draw(rng, (240, 200), here, radius, BLUR, NOISE).astype(float)
        share = wire_share((200, 240), here["green"], 0.5 - 0.02 * step, off * radius, width_px, 4)
        share = cv2.GaussianBlur(share, (0, 0), 4 * BLUR).reshape(200, 4, 240, 4).mean(axis=(1, 3))[..., None]
        images.append(image * (1 - share) + np.array([40.0, 30.0, 25.0]) * share)
    table = track(frames_in_memory(images))
    for name, points in truth.items():
        error = table[[f"{name}_x_px", f"{name}_y_px"]].to_numpy() - points[np.maximum(np.arange(60) - 20, 0)]
        assert (table[f"{name}_status"] == "ok").mean() > 0.95
        assert np.sqrt(np.nanmean(error**2)) < 0.03
        normal = error / table[[f"{name}_x_sigma_px", f"{name}_y_sigma_px"]].to_numpy()
        assert np.nanmax(np.abs(normal)) < 4.5


def test_errors_that_a_codec_shares_among_neighbours_cover_nothing() -> None:
    rng, disc, blocks = np.random.default_rng(9), disc_of(14.0), 3 * SIZE // 8
    image = seen(rng, 14.0, [])[0].astype(float)
    steep = cv2.GaussianBlur(np.abs(cv2.Laplacian(cv2.GaussianBlur(image, (0, 0), 1.5), cv2.CV_64F)), (0, 0), 1.0)
    for _ in range(20):
        shared = cv2.resize(rng.normal(0.0, 1.0, (blocks, blocks)), (SIZE, SIZE), interpolation=cv2.INTER_NEAREST)
        coded = np.clip(np.rint(image + 6.0 * shared * steep / steep.max()), 0, 255).astype(np.uint8)
        assert fits(coded, disc)[2] == 0.0


def test_pixels_of_a_mark_in_a_field_are_those_of_its_rows() -> None:
    """A disc that reaches 6 px: rows 17 to 23 of the field lie 35 to 47 px down; one more on either side."""
    fitted, numbers = np.zeros(RESULTS), np.array([0.0, 0.0, 0.0, 0.0, 6.0])
    fitted[[X, Y]] = 30.0, 41.0
    assert _window((50, 80), 1, 2, fitted, numbers) == (16, 25, 23, 38)
    assert _window((50, 80), 0, 1, fitted, numbers) == (34, 49, 23, 38)
    assert _window((44, 34), 0, 1, fitted, numbers) == (34, 44, 23, 34)  # no more than there are
