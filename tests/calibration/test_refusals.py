"""When a set of images is refused as that of another gauge or camera: both limits from either side."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibration.errors import ImageError
from calibration.estimation.calibrate import FEWEST_DOTS, _check_left_out, _check_pitch


class Dots:
    """A view of so many dots in a square of a pitch of 20 px."""

    name = "image.png"

    def __init__(self, count: int) -> None:
        rows, columns = np.divmod(np.arange(count), 10)
        self.centers_px = 20.0 * np.column_stack([columns, rows])

    def __len__(self) -> int:
        return len(self.centers_px)


@pytest.mark.parametrize(("rms_px", "refused"), [(0.39, False), (0.41, True)])
def test_dots_a_fiftieth_of_their_pitch_off_are_of_another_gauge(rms_px: float, refused: bool) -> None:
    fit: Any = SimpleNamespace(residual_px=[np.full((100, 2), 0.0), rms_px * np.resize([1.0, -1.0], (100, 2))])
    views: Any = [Dots(100), Dots(100)]
    gauge: Any = SimpleNamespace(name="mine")
    if not refused:
        _check_pitch(fit, views, gauge)
        return
    with pytest.raises(ImageError, match=r"the dots lie 0\.4 px RMS \(2 % of their distance\).*pitch_mm and layout"):
        _check_pitch(fit, views, gauge)


@pytest.mark.parametrize(
    ("count", "used", "refused"),
    [
        *((300, 201, False), (300, 199, True), (300, 200, False)),
        *((FEWEST_DOTS // 2 + 1, FEWEST_DOTS // 2, False), (FEWEST_DOTS // 2, FEWEST_DOTS // 2 - 1, True)),
    ],
)
def test_an_image_of_which_a_third_of_the_dots_contradict_the_rest_is_refused(
    count: int, used: int, refused: bool
) -> None:
    views: Any = [Dots(100), Dots(count)]
    parts: Any = [Dots(100), Dots(used)]
    if not refused:
        _check_left_out(views, parts)
        return
    with pytest.raises(ImageError, match=f"{count - used} of {count} dots contradict the other images"):
        _check_left_out(views, parts)
    with pytest.raises(ImageError, match="contradict any camera"):
        _check_left_out(views[1:], parts[1:])
