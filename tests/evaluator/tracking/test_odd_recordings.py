"""Recordings of unusual codecs, sample formats, clocks and containers are measured as well as usual ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evaluator.errors import InputError
from evaluator.recording import open_recording
from evaluator.tracking import track
from tests.evaluator.tracking.odd_recordings import KINDS, drawn, write
from tests.evaluator.tracking.plain_video import Clip

# Error in px: twice what was measured (tests/benchmarks/README.md), of lossless kinds and of lossy ones.
LOSSLESS_PX, LOSSY_PX = 0.012, 0.1
# Clocks of MKV and GIF count milliseconds and hundredths of a second: a time is off by half of that, two by all of it.
TICK_S = {"AV1": 1e-3, "GIF": 1e-2, "FFV1, RGB, 12 bits": 1e-3, "H.264, RGB": 1e-3}


@pytest.fixture(scope="module")
def clip() -> Clip:
    return drawn(3)


@pytest.mark.parametrize(
    ("name", "within_px"),
    [
        ("HEVC, 10 bits", LOSSY_PX),
        ("AV1", LOSSY_PX),
        ("ProRes 4444", LOSSLESS_PX),
        ("DNxHR HQ", LOSSLESS_PX),
        ("FFV1, RGB, 12 bits", LOSSLESS_PX),
        ("PNG images, 16 bits", LOSSLESS_PX),
        ("TIFF images, 16 bits", LOSSLESS_PX),
        ("Motion JPEG, AVI without index", 2 * LOSSLESS_PX),
        ("GIF", LOSSY_PX),
        ("H.264, RGB", LOSSY_PX),
        ("H.264, full range", LOSSY_PX),
        ("H.264, BT.709", LOSSY_PX),
        ("H.264, B-frames, edit list", LOSSY_PX),
        ("H.264, times that vary", LOSSY_PX),
        ("H.264, interlaced", LOSSY_PX),
    ],
)
def test_marks_and_times_are_right_in_every_kind_of_recording(
    tmp_path: Path, clip: Clip, name: str, within_px: float
) -> None:
    path, times, numbers = write(tmp_path, KINDS[name], clip.frames)
    table = track(open_recording(path, rate_hz=KINDS[name].rate_hz))
    late = table["time_s"].to_numpy() - times
    np.testing.assert_allclose(late, late[0], atol=1e-9 + TICK_S.get(name, 0.0))
    for mark, truth in clip.truth.items():
        error = table[[f"{mark}_x_px", f"{mark}_y_px"]].to_numpy(float) - truth[numbers]
        assert np.isfinite(error).all()
        assert np.sqrt(np.mean(error**2)) < within_px


def test_frames_that_a_screen_shows_twice_are_measured_once(tmp_path: Path, clip: Clip) -> None:
    path, times, _ = write(tmp_path, KINDS["screen, each frame twice"], clip.frames)
    table = track(open_recording(path))
    again = table["green_status"] == "repeated frame"
    assert not again[0::2].any()
    # The usual step is not known well where the recording begins and ends.
    assert again[1::2].mean() > 0.8
    assert len(table) == len(times)


def test_a_recording_without_colour_says_so(tmp_path: Path, clip: Clip) -> None:
    path, _, _ = write(tmp_path, KINDS["FFV1, grey, 12 bits"], clip.frames[:9])
    with pytest.raises(InputError, match="has no colour"):
        track(open_recording(path))
