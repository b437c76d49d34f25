"""A recording as one image: where its marks were, and not what compression or tints change."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from evaluator.recording import Frame
from evaluator.recording.long_exposure import EVERY, long_exposure


def frame_with_mark(column: int, tint: int = 0) -> Frame:
    """A grey frame of 60 by 20 pixels with a green mark four pixels wide; tint: of the plate, in levels."""
    luma, u, v = np.full((20, 60), 90, np.uint8), np.full((10, 30), 128, np.uint8), np.full((10, 30), 128, np.uint8)
    u += np.uint8(tint)
    luma[8:12, column : column + 4] = 150
    u[4:6, column // 2 : column // 2 + 2], v[4:6, column // 2 : column // 2 + 2] = 70, 60
    return Frame(0, 0, Fraction(1, 60), luma, u, v, 8, False, "bt601", 0, 1, "", False, None)


def test_a_mark_is_seen_wherever_it_was_and_a_tint_of_the_plate_is_not() -> None:
    frames = [frame_with_mark(6 if k == 0 else 30 if k == EVERY else 50, tint=k) for k in range(EVERY + 2)]
    image = long_exposure(frames).astype(int)
    green = image[9, :, 1] > image[9, :, 0] + 60
    assert np.flatnonzero(green).tolist() == [6, 7, 8, 9, 30, 31, 32, 33]  # frames between are not taken
    np.testing.assert_array_equal(image[0], frames[0].to_rgb()[0])
    assert (image[9, 30] == image[9, 6]).all()


def test_of_a_grey_recording_the_first_frame_is_shown() -> None:
    frames = [replace(frame_with_mark(column), u=None, v=None) for column in (6, 30)]
    np.testing.assert_array_equal(long_exposure(frames), frames[0].to_rgb())
