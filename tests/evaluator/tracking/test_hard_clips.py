from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evaluator.recording import open_recording
from evaluator.tracking import TrackingSettings, track
from evaluator.tracking.refinement.disc import fit
from evaluator.tracking.refinement.kernels import VAR_X, VAR_Y, X, Y
from evaluator.tracking.refinement.learn_shape import cut_patch, finished, learn_disc
from tests.evaluator.tracking.synthetic import GREEN, YELLOW, coverage, draw, turning_marks, write_video

SIZE = (240, 200)
FRAMES = 60
Paint = Callable[[np.ndarray, int], None]


def tracked(
    path: Path, paint: Paint, *, repeat: int | None = None, seed: int = 2
) -> tuple[pd.DataFrame, dict[str, np.ndarray]]:
    """Track a lossless clip that `paint` has disturbed; its truth."""
    rng = np.random.default_rng(seed)
    truth = turning_marks(FRAMES, (118.0, 100.0), 36.0, 10.0, 0.02)
    images = []
    for k in range(FRAMES):
        image = draw(rng, SIZE, {name: tuple(points[k]) for name, points in truth.items()}, 5.0, 0.8, 2.5)
        paint(image, k)
        images.append(images[repeat - 1] if k == repeat else image)
    video = write_video(path / "clip.mkv", images, pixels="yuv420p")
    return track(open_recording(video)), truth


def errors(table: pd.DataFrame, truth: dict[str, np.ndarray], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Error and error over its stated uncertainty."""
    error = table[[f"{name}_x_px", f"{name}_y_px"]].to_numpy() - truth[name]
    return error, error / table[[f"{name}_x_sigma_px", f"{name}_y_sigma_px"]].to_numpy()


def blend(image: np.ndarray, share: np.ndarray, color: tuple[int, int, int]) -> None:
    image[:] = np.rint(image * (1 - share[..., None]) + share[..., None] * np.array(color))


def untouched(image: np.ndarray, k: int) -> None:
    del image, k


def test_a_wire_across_a_mark_never_makes_a_silent_error(tmp_path: Path) -> None:
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))

    def wire(image: np.ndarray, k: int) -> None:
        away = np.abs((x - 60 - 1.5 * k) * np.cos(0.3) + (y - 100) * np.sin(0.3))
        blend(image, np.clip(2.0 - away, 0, 1), (20, 20, 22))

    table, truth = tracked(tmp_path, wire)
    for name in truth:
        _, normal = errors(table, truth, name)
        assert (np.abs(normal[np.isfinite(normal)]) < 5).all()
        assert (table[f"{name}_status"] == "ok").mean() > 0.8


def test_a_mark_that_vanishes_is_absent_and_is_found_again_within_two_images(tmp_path: Path) -> None:
    def cover(image: np.ndarray, k: int) -> None:
        if 25 <= k < 35:
            image[:] = 120

    table, truth = tracked(tmp_path, cover)
    for name in truth:
        status = table[f"{name}_status"].to_numpy()
        assert (status[25:35] != "ok").all()
        assert table[f"{name}_x_px"][25:35].isna().all()
        assert (status[37:] == "ok").all()
        assert np.nanmax(np.abs(errors(table, truth, name)[0])) < 0.06


def test_other_green_things_are_not_taken_for_the_mark(tmp_path: Path) -> None:
    def distract(image: np.ndarray, k: int) -> None:
        for place, radius in (((20.0, 20.0), 9.0), ((30.0 + 3.0 * k, 188.0), 5.0)):
            blend(image, coverage(SIZE, place, radius, 0.8), GREEN)

    table, truth = tracked(tmp_path, distract)
    assert np.nanmax(np.abs(errors(table, truth, "green")[0])) < 0.1
    assert (table["green_status"] == "ok").all()


def test_marks_on_a_board_of_their_own_hue_are_found(tmp_path: Path) -> None:
    def board(image: np.ndarray, k: int) -> None:
        del k
        image[image.max(axis=2) < 70] = (18, 66, 30)

    table, truth = tracked(tmp_path, board)
    for name in truth:
        assert (table[f"{name}_status"] == "ok").all()
        assert np.abs(errors(table, truth, name)[0]).max() < 0.1


def test_a_hidden_mark_is_not_taken_for_its_like_elsewhere(tmp_path: Path) -> None:
    truth = turning_marks(FRAMES, (118.0, 100.0), 36.0, 10.0, 0.02)["yellow"]

    def hide(image: np.ndarray, k: int) -> None:
        blend(image, coverage(SIZE, (25.0, 30.0), 5.0, 0.8), YELLOW)
        if 25 <= k < 40:
            blend(image, coverage(SIZE, tuple(truth[k]), 8.0, 0.8), (25, 25, 27))

    table, _ = tracked(tmp_path, hide)
    assert (table["yellow_status"][25:40] != "ok").all()
    assert (table["yellow_status"].drop(range(25, 42)) == "ok").all()
    assert (table["green_status"] == "ok").all()


def test_marks_stay_found_when_the_lights_change(tmp_path: Path) -> None:
    def lights(image: np.ndarray, k: int) -> None:
        image[:] = np.rint(image * (0.4 if k < 20 else 1.0 if k < 40 else 0.55))

    table, truth = tracked(tmp_path, lights)
    for name in truth:
        assert (table[f"{name}_status"] == "ok").all()
        assert np.sqrt(np.mean(errors(table, truth, name)[0] ** 2)) < 0.03


def test_a_repeated_image_is_no_measurement_of_a_moving_mark(tmp_path: Path) -> None:
    table, _ = tracked(tmp_path, untouched, repeat=30)
    assert table["green_status"][30] == "repeated frame"
    assert (table["green_status"].drop(30) == "ok").all()


@pytest.mark.parametrize(("radius", "blur", "snr"), [(3.0, 0.5, 20.0), (5.0, 0.8, 30.0), (10.0, 1.5, 60.0)])
def test_centres_reach_the_cramer_rao_bound_and_state_their_error(radius: float, blur: float, snr: float) -> None:
    rng = np.random.default_rng(11)
    side = int(2 * radius + 24)
    centers = side / 2 + rng.uniform(-0.5, 0.5, (80, 2))
    images = [
        np.clip(np.rint(40 + 120 * coverage((side, side), tuple(center), radius, blur) + rng.normal(0, 120 / snr, (side,
        side))), 0, 255) for center in centers
    ]  # fmt: skip
    images = [image.astype(np.uint8) for image in images]
    patches = [cut_patch(image, (0, 1), (side / 2, side / 2), radius + 6) for image in images[:12]]
    disc = finished(learn_disc(patches, 1.15 * radius))
    fits = np.array([fit(image, (0, 1), (side / 2, side / 2), disc) for image in images])
    error = fits[:, [X, Y]] - centers
    # The lens blur and the pixel together, at the true number of pixels: the bound of issue and textbook.
    edge = np.hypot(blur, np.sqrt(1 / 12))
    bound = np.sqrt(2 * np.sqrt(np.pi) * edge / (np.pi * radius)) / snr
    assert np.sqrt(np.mean(error**2)) < 1.2 * bound
    assert 0.85 < np.std(error / np.sqrt(fits[:, [VAR_X, VAR_Y]])) < 1.15


def test_a_glare_that_was_there_from_the_start_does_not_pull_a_mark(tmp_path: Path) -> None:
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    start = turning_marks(1, (118.0, 100.0), 36.0, 10.0, 0.02)["green"][0]
    light = 90.0 * np.exp(-0.5 * ((x - start[0] - 16.0) ** 2 + (y - start[1]) ** 2) / 9.0**2)

    def glare(image: np.ndarray, k: int) -> None:
        del k
        image[:] = np.clip(image + light[..., None], 0, 255)

    table, truth = tracked(tmp_path, glare)
    normal = errors(table, truth, "green")[1]
    assert (np.abs(normal[np.isfinite(normal)]) < 5).all()


def test_settings_refuse_what_they_do_not_know() -> None:
    with pytest.raises(ValueError, match="diametre"):
        TrackingSettings.model_validate({"mark": {"green": {"diametre": 3}}})
