"""Tags drawn apart from the product's renderer: errors, stated uncertainties, and what a grainy floor costs."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from evaluator.recording import open_recording
from evaluator.tracking import track
from evaluator.tracking.uncertainty.tag_shape import widen_by_shape
from tests.evaluator.tracking.drawn_tags import tag_clip
from tests.evaluator.tracking.plain_video import Clip, Encoding

LOSSLESS = Encoding(options={"qp": "0"})


def errors(clip: Clip, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Errors of centre and corners (5, n, 2), px, and the same over their stated uncertainties."""
    table = track(open_recording(clip.write(folder)), clip.settings)
    off = [table[[f"{name}_x_px", f"{name}_y_px"]].to_numpy() - truth for name, truth in clip.truth.items()]
    sigma = [table[[f"{name}_x_sigma_px", f"{name}_y_sigma_px"]].to_numpy() for name in clip.truth]
    return np.array(off), np.array(off) / np.array(sigma)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize(("kind", "options"), [("apriltag", {"crf": "18"}), ("aruco", {"crf": "26"})])
def test_a_tag_in_h264_has_an_uncertainty_that_holds(tmp_path: Path, kind: str, options: dict[str, str]) -> None:
    _, normal = errors(tag_clip(np.random.default_rng(2), kind, Encoding(options=options)), tmp_path)
    assert 0.6 < rms(normal[0]) < 1.4
    assert 0.6 < rms(normal[1:]) < 1.4


def test_cells_of_a_small_tag_do_not_pull_its_borders(tmp_path: Path) -> None:
    off, _ = errors(tag_clip(np.random.default_rng(2), "apriltag", LOSSLESS, side_px=30.0, step=0.1), tmp_path)
    assert rms(off[0]) < 0.015
    assert rms(off[1:]) < 0.04  # 0.057 px where all that rises within reach counts as the edge


def test_changes_of_a_rigid_shape_count_as_error_and_perspective_does_not() -> None:
    rng, turn = np.random.default_rng(1), np.linspace(0, 6, 200)
    square = 30 * np.array([1, 1j, -1, -1j])
    place = 200 + 200j + 90 * np.exp(1j * turn)
    seen = place + square[:, None] * np.exp(1j * turn)
    slanted = seen.real + 0.9j * seen.imag
    slanted = 400 * slanted / (400 + 0.2 * slanted.imag)

    def ratio(error_px: float, stated_px: float) -> float:
        noise = rng.normal(0, error_px, (2, 4, 200))
        points = slanted + noise[0] + 1j * noise[1]
        stated = np.full((3, 200), stated_px**2) * np.array([[1.0], [1.0], [0.0]])
        numbers = {f"k{k}": np.vstack([points[k].real, points[k].imag, stated]).T.copy() for k in range(4)}
        numbers["tag"] = numbers["k0"].copy()
        widen_by_shape(numbers, [f"k{k}" for k in range(4)], "tag")
        return float(np.sqrt(numbers["tag"][0, 2])) / stated_px

    assert ratio(0.02, 0.03) == 1.0
    # Errors of the corners that are independent are half shape, not the share that those of straight lines are.
    assert 2.2 < ratio(0.09, 0.03) < 3.2


def test_the_grain_of_a_floor_costs_no_search_for_tags(tmp_path: Path) -> None:
    def cost_s(strength: float) -> float:
        clip = tag_clip(np.random.default_rng(2), frames=4, strength=strength)
        recording = list(open_recording(clip.write(tmp_path)))
        track(recording, clip.settings)
        start = time.process_time()
        track(recording, clip.settings)
        return time.process_time() - start

    assert cost_s(12.0) < 10 * cost_s(0.5)  # 100 times where specks of some px are read as tags
