"""Marks that move while the shutter is open: what they look like, and where they are found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evaluator.recording import open_recording
from evaluator.tracking import track
from evaluator.tracking.refinement.disc import fit, make_disc
from evaluator.tracking.refinement.kernels import RESIDUAL, X, Y
from evaluator.tracking.uncertainty.exposure import exposed
from tests.evaluator.tracking.synthetic import coverage, draw, turning_marks, write_video

RADIUS, BLUR, AMPLITUDE, FINE = 8.0, 0.8, 120.0, 256.0
REST, MOVING = 14, 20
# Instants of an interval, and those at which the shutter is open.
INSTANTS, OPEN = 12, np.arange(-4, 5)


@pytest.mark.parametrize("length", [1.0, 3.0, 6.0, 11.0, 15.0])
def test_a_smeared_disc_is_the_mean_of_the_disc_over_its_path(length: float) -> None:
    level = FINE * AMPLITUDE, FINE * 40.0  # so fine that rounding is no error
    disc = make_disc(RADIUS, float(np.hypot(BLUR, 12**-0.5)), (0.0, 0.0), level, FINE**2)
    parts = (np.arange(48) + 0.5) / 48 - 0.5
    for angle, middle in ((0.3, (30.2, 30.7)), (1.9, (29.6, 30.1))):
        path = length * np.array([np.cos(angle), np.sin(angle)])
        share = np.mean([coverage((60, 60), tuple(middle + part * path), RADIUS, BLUR) for part in parts], axis=0)
        luma = np.rint(level[1] + level[0] * share).astype(np.uint16)
        found = fit(luma, (0, 1), (30.0, 30.5), disc, (float(path[0]), float(path[1])))
        assert np.hypot(found[X] - middle[0], found[Y] - middle[1]) < 0.005
        assert np.sqrt(found[RESIDUAL]) < 0.004 * AMPLITUDE


@pytest.fixture(scope="module")
def fast(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, np.ndarray]]:
    """Marks that set off from rest, 7 and 14 px a frame, each frame the mean of instants; truth at their middle."""
    rng = np.random.default_rng(4)
    paths = turning_marks((MOVING + 1) * INSTANTS, (130.0, 130.0), 70.0, 16.0, 0.14 / INSTANTS)
    middles = INSTANTS // 2 + INSTANTS * np.maximum(np.arange(REST + MOVING) - REST + 1, 0)
    images = []
    for k, middle in enumerate(middles):
        shown = middle + (OPEN if k >= REST else np.zeros(1, int))
        instants = [
            draw(rng, (260, 260), {name: tuple(points[one]) for name, points in paths.items()}, RADIUS, BLUR, 0.0)
            for one in shown
        ]
        image = np.mean(instants, axis=0) + rng.normal(0, 2.0, instants[0].shape)
        images.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
    video = write_video(tmp_path_factory.mktemp("clip") / "fast.mkv", images)
    return video, {name: points[middles] for name, points in paths.items()}


def test_marks_smeared_along_a_curve_are_found_within_their_uncertainty(
    fast: tuple[Path, dict[str, np.ndarray]],
) -> None:
    video, truth = fast
    table = track(open_recording(video))
    for name, points in truth.items():
        assert (table[f"{name}_status"] == "ok").all()
        # Where the mark sets off, nothing tells how long the shutter was open: two frames know it less well.
        error = (table[[f"{name}_x_px", f"{name}_y_px"]].to_numpy() - points)[REST + 2 :]
        normal = error / table[[f"{name}_x_sigma_px", f"{name}_y_sigma_px"]].to_numpy()[REST + 2 :]
        assert np.sqrt(np.mean(error**2)) < 0.025
        assert np.abs(normal).max() < 4.0


def test_the_first_and_the_last_image_of_a_turn_are_corrected_too() -> None:
    share, turn_rad = 0.72, 0.15
    phase = turn_rad * np.arange(40)
    centers = 100.0 * np.column_stack([np.sin(phase), np.cos(phase)])
    # The average over an arc lies inside of its middle.
    half = 0.5 * share * turn_rad
    shift, variance = exposed(np.arange(40) / 60, centers * np.sin(half) / half, np.full((40, 2), 1e-4), (share, 0.0))
    expected = centers * (np.sin(half) / half - 1.0)
    assert np.abs(shift - expected)[2:-2].max() < 0.02 * np.abs(expected).max()
    assert np.abs(shift - expected).max() < 0.35 * np.abs(expected).max()  # at the ends, that of two frames on
    assert np.sqrt(variance.max()) < 0.35 * np.abs(expected).max()
