from __future__ import annotations

import cv2
import numpy as np
import pytest

from evaluator.tracking import track
from evaluator.tracking.refinement.disc import fit, make_disc
from evaluator.tracking.refinement.kernels import VAR_X, VAR_Y, X, Y
from evaluator.tracking.uncertainty.exposure import exposed
from evaluator.tracking.uncertainty.rim import Rim, rim_power
from tests.evaluator.tracking.synthetic import coverage, draw, frames_in_memory, turning_marks

SIZE, RADIUS, NOISE = (40, 40), 7.8, 2.0
DISC = make_disc(RADIUS, np.hypot(0.8, 12**-0.5), (0.0, 0.0), (120.0, 40.0), NOISE**2)
SOFTNESS = 5.0


def seen(rng: np.random.Generator, cut_px: float) -> tuple[np.ndarray, float, np.ndarray]:
    """Fit of a mark from which a dark edge cuts a segment of a depth; its rim's power, and its error, px."""
    center = 20 + rng.uniform(-0.5, 0.5, 2)
    angle = rng.uniform(0, 2 * np.pi)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    along = (x - center[0]) * np.cos(angle) + (y - center[1]) * np.sin(angle)
    share = coverage(SIZE, tuple(center), RADIUS, 0.8) * np.clip(RADIUS - cut_px - along + 0.5, 0, 1)
    image = np.clip(np.rint(40 + 120 * share + rng.normal(0, NOISE, share.shape)), 0, 255).astype(np.uint8)
    result = fit(image, (0, 1), (20.0, 20.0), DISC)
    result[-2:] = 0.0  # no slopes
    power, _ = rim_power(image, 0, 1, result, DISC.numbers(), DISC.table, np.array([DISC.noise, SOFTNESS]))
    return result, float(power), result[[X, Y]] - center


def test_the_rim_of_a_whole_mark_shows_the_variance_of_its_centre() -> None:
    rng = np.random.default_rng(4)
    images = [seen(rng, -5.0) for _ in range(300)]
    stated = np.mean([result[[VAR_X, VAR_Y]] for result, _, _ in images])
    assert np.mean([power for _, power, _ in images]) == pytest.approx(stated, rel=0.15)


@pytest.mark.parametrize("cut_px", [0.5, 1.0])
def test_the_rim_of_a_mark_that_is_cut_shows_how_far_its_centre_is_off_to_a_factor_of_two(cut_px: float) -> None:
    rng = np.random.default_rng(5)
    _, power, error = zip(*[seen(rng, cut_px) for _ in range(40)], strict=True)
    assert 0.5 < np.sqrt(np.mean(np.square(error)) / np.mean(power)) < 2.0


def test_a_pixel_of_the_rim_pulls_half_as_far_as_it_is_off_at_the_softness_and_less_beyond() -> None:
    """Pulls of 15, 30 and 60 levels at a softness of three sigmas of 10: r/(1 + (r/30)⁴) each, squared in the power."""
    whole = np.rint(40 + 120 * coverage(SIZE, (20.0, 20.0), RADIUS, 0.8))
    result = fit(whole.astype(np.uint8), (0, 1), (20.0, 20.0), DISC)
    result[-2:] = 0.0
    power = []
    for off in (15, 30, 60):
        image = whole.copy()
        image[20, 28] += off
        noise = np.array([100.0, 3.0])
        power.append(rim_power(image.astype(np.uint8), 0, 1, result, DISC.numbers(), DISC.table, noise)[0])
    pulls = np.array([15 / (1 + 0.5**4), 30 / 2, 60 / (1 + 2**4)])
    assert np.sqrt(np.array(power) / power[1]) == pytest.approx(pulls / pulls[1], abs=0.1)


def test_the_shape_of_a_mark_that_a_wire_cuts_from_the_start_is_learnt_from_its_partner() -> None:
    rng = np.random.default_rng(7)
    truth = turning_marks(50, (118.0, 100.0), 36.0, 16.0, 0.004)
    images = []
    for k in range(50):
        still = {name: tuple(points[max(k - 30, 0)]) for name, points in truth.items()}
        image = draw(rng, (240, 200), still, 8.0, 0.8, 6.0)
        # The wire lies where it lies: it covers 1.4 px of the green mark's rim until that moves away.
        beside = np.arange(240) - truth["green"][0, 0] - 8.0
        wire = (
            np.clip(beside + 1.9, 0, 1) * (beside < 6.0) * (np.abs(np.arange(200) - truth["green"][0, 1]) < 20)[:, None]
        )
        images.append(np.rint(image * (1 - wire[..., None]) + 22.0 * wire[..., None]))
    table = track(frames_in_memory(images))
    course = truth["green"][np.maximum(np.arange(50) - 30, 0)]
    error = table[["green_x_px", "green_y_px"]].to_numpy() - course
    assert np.abs(error[:30]).max() < 0.15  # a disc that is learnt from what is left of it lies off by 0.3


def test_the_corners_of_a_square_mark_widen_nothing_and_a_cut_of_one_of_them_does() -> None:
    """What has a centre of symmetry has even harmonics alone, which shift nothing."""
    fine, side = 8, 14.0
    y, x = (np.mgrid[: SIZE[1] * fine, : SIZE[0] * fine] + 0.5) / fine - 0.5 - 20.0
    extra = []
    for cut in (0.0, 5.0):
        rim = Rim()
        for angle in np.linspace(0, 0.7, 12):
            along, across = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
            inside = (np.maximum(np.abs(along), np.abs(across)) < side / 2) & (along + across < side - cut)
            share = cv2.GaussianBlur(inside.astype(float), (0, 0), 0.7 * fine)
            image = np.rint(40 + 120 * share.reshape(SIZE[1], fine, SIZE[0], fine).mean(axis=(1, 3))).astype(np.uint8)
            result = fit(image, (0, 1), (20.0, 20.0), DISC)
            result[-2:] = 0.0  # no slopes
            where = image, 0, 1, result, DISC.numbers(), DISC.table, np.array([400.0, SOFTNESS])
            rim.note(rim_power(*where), 1e-4)
        extra.append(rim.extra_px2)
    assert extra[0] < 1e-4
    assert extra[1] > 100 * 1e-4


def test_noise_alone_widens_nothing() -> None:
    rng, rim, widened = np.random.default_rng(6), Rim(), []
    for power in rng.chisquare(6, 3000) / 6:
        rim.note((float(power), float(power)), 1.0)
        widened.append(rim.extra_px2)
    assert np.mean(widened) < 0.08  # 4 % of sigma


def test_an_exposure_on_a_curve_or_over_a_jump_of_speed_is_brought_to_its_middle() -> None:
    time_s, share = np.arange(40) / 60.0, 0.7
    t = time_s[:, None] + share / 60.0 * np.linspace(-0.5, 0.5, 401)

    def course(t: np.ndarray) -> np.ndarray:
        jump = np.maximum(t - time_s[20] - 0.001, 0.0)
        return np.stack([4000.0 * t**2, 300.0 * jump], axis=-1)

    middle, average = course(time_s), course(t).mean(axis=1)
    shift, variance = exposed(time_s, average, np.full((40, 2), 1e-4), (share, 0.0))
    error = average - shift - middle
    assert np.abs(error[2:-2, 0]).max() < 5e-4  # of 0.045 px
    assert abs(error[20, 1]) > 0.2
    assert abs(error[20, 1]) < 4.0 * np.sqrt(variance[20, 1])
    assert variance[[10, 30]].max() < 1e-12


def test_an_exposure_beside_a_lost_frame_is_brought_to_its_middle() -> None:
    time_s, share = np.delete(np.arange(20) / 60.0, [9, 10]), 0.7
    t = time_s[:, None] + share / 60.0 * np.linspace(-0.5, 0.5, 401)
    middle, average = 4000.0 * time_s**2, (4000.0 * t**2).mean(axis=1)
    centers = np.stack([average, np.zeros_like(average)], axis=1)
    shift, _ = exposed(time_s, centers, np.full((18, 2), 1e-4), (share, 0.0))
    assert np.abs(average - shift[:, 0] - middle).max() < 5e-4  # of 0.045 px; 0.09 would be taken off beside the gap
