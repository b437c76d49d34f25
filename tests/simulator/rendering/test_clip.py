"""Clips: truth, times, repeatability and noise."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pandas as pd
import pytest

from simulator.errors import SimulationError
from simulator.rendering import Scene, clip, render_clip, render_frames, set_stage, truth_of


def scene(**changes: object) -> Scene:
    content: dict[str, object] = {
        "format": 1,
        "seed": 5,
        "duration_s": 0.1,
        "camera": {"size_px": (320, 240), "focal_px": 1800.0, "distance_mm": 150.0},
        "motion": {
            "kind": "circle",
            "radius_mm": 6.0,
            "speed_mm_s": 20.0,
            "x_mm": 1.0,
            "heading_deg": 30.0,
            "start_s": -0.1,
        },
    }
    return Scene.model_validate(content | changes)


def test_same_seed_gives_the_same_frames_and_another_seed_other_noise() -> None:
    first, again, other = (next(render_frames(scene(seed=seed))).image for seed in (5, 5, 6))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_centroid_of_a_noiseless_mark_is_the_truth() -> None:
    quiet = scene(sensor={"full_well_e": 0}, optics={"vignetting": 0.0}, exposure={"time_s": 0.003})
    truth = truth_of(set_stage(quiet))
    for frame in render_frames(quiet):
        x, y = truth[["green_x_px", "green_y_px"]].iloc[frame.index]
        left, top = round(x) - 9, round(y) - 9
        patch = frame.image[top : top + 19, left : left + 19, 1].astype(float)
        rows, columns = np.indices(patch.shape)
        patch = np.where(np.hypot(rows - 9, columns - 9) < 10, patch - patch.min(), 0.0)
        found = np.array([(patch * columns).sum(), (patch * rows).sum()]) / patch.sum() + [left, top]
        assert np.abs(found - [x, y]).max() < 0.02


def test_presentation_times_in_the_file_are_exact(tmp_path: Path) -> None:
    rate = Fraction(60000, 1001)
    truth = render_clip(scene(frame_rate=str(rate), timing={"dropped": [2]}), tmp_path / "clip.mp4")
    with av.open(str(tmp_path / "clip.mp4")) as container:
        shown = [frame.pts * frame.time_base for frame in container.decode(video=0)]
    assert shown == [Fraction(slot) / rate for slot in (0, 1, 3, 4, 5)]
    assert truth["presentation_s"].to_numpy() == pytest.approx([float(time) for time in shown], abs=1e-12)


def test_lossless_file_holds_the_very_numbers(tmp_path: Path) -> None:
    clip = scene(encoding={"codec": "lossless"})
    render_clip(clip, tmp_path / "clip.mp4")
    with av.open(str(tmp_path / "clip.mp4")) as container:
        stored = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert all(np.array_equal(a, b.image) for a, b in zip(stored, render_frames(clip), strict=True))


def test_noise_has_the_variance_of_photons_and_read_out() -> None:
    frames = scene(duration_s=1.0, motion={"kind": "line", "speed_mm_s": 0.0}, sensor={"full_well_e": 2000.0})
    stack = np.stack([frame.image for frame in render_frames(frames)]).astype(float)
    mean, variance = stack.mean(axis=0) / 255 - 0.02, stack.var(axis=0, ddof=1) / 255**2
    expected = mean / 2000 + (20 / 2000) ** 2 + 1 / (12 * 255**2)
    assert (variance / expected).mean() == pytest.approx(1.0, abs=0.01)


def test_fields_of_an_interlaced_frame_are_half_a_frame_apart() -> None:
    truth: pd.DataFrame = truth_of(set_stage(scene(timing={"interlaced": "bottom_first"})))
    assert list(truth["field"][:2]) == ["bottom", "top"]
    assert truth["time_s"].diff().iloc[1:].to_numpy() == pytest.approx(1 / 120)


def test_odd_sizes_and_wrong_endings_are_refused_with_a_remedy(tmp_path: Path) -> None:
    with pytest.raises(SimulationError, match='chroma = "444"'):
        render_clip(scene(camera={"size_px": (161, 120)}), tmp_path / "clip.mp4")
    with pytest.raises(SimulationError, match="use that suffix"):
        render_clip(scene(encoding={"codec": "lossless"}), tmp_path / "clip.avi")


@pytest.mark.parametrize(
    ("effect", "why"),
    [
        ({"id": "rolling-shutter", "y_ms_per_mm": 0.3}, "exposes all rows of a frame at once"),
        (
            {"id": "free-form", "channel": "camera_x", "basis": "time", "coefficient": 0.01},
            "drifts with time cannot be rendered",
        ),
    ],
)
def test_errors_of_a_camera_that_are_not_drawn_are_refused(effect: dict[str, object], why: str) -> None:
    with pytest.raises(SimulationError, match=why):
        set_stage(scene(effect=[effect]))


def test_poses_of_an_exposure_lie_on_the_parabola_through_its_beginning_middle_and_end() -> None:
    """From the middle of its first part to that of its last one: marks are smeared as far as they move."""
    stage = set_stage(scene())
    middle, way, bend = np.array([1.0, 2.0, 0.3]), np.array([0.4, -0.2, 0.05]), np.array([0.02, 0.01, -0.01])
    shot = middle + np.outer([-1, 0, 1], way) + np.outer([1, 0, 1], bend)
    poses = clip._through(replace(stage, poses=shot[None]), 0)
    at = 2 * (np.arange(len(poses)) + 0.5) / len(poses) - 1
    assert len(poses) > 8
    np.testing.assert_allclose(poses, middle + np.outer(at, way) + np.outer(at**2, bend), atol=1e-12)
