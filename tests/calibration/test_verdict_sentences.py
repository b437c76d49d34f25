"""What a verdict on a camera, an image and a check say, word for word where a number or a direction stands in it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibration.assessment.camera_check import Check
from calibration.assessment.next_image import Advice, NextImage, image_notes
from calibration.assessment.quality import _flatness_notes, _focal_lengths, _misfit, _stretched, _wrong_size, assess
from calibration.errors import CalibrationError
from tests.calibration.test_verdict_limits import CAMERA, calibration, known


@pytest.mark.parametrize(
    ("flatness", "said"),
    [
        (None, "the gauge was taken as flat: a single image cannot distinguish bending from lens distortion"),
        (
            SimpleNamespace(low_mm=0.0, high_mm=0.0123, used=False),
            "the gauge is flat within the resolution of these images: peak to valley below 0.012 mm (95 %)",
        ),
        (  # of which a third is the height of the plate
            SimpleNamespace(low_mm=0.1, high_mm=0.2, used=True, peak_to_valley_mm=0.15, mean_square_mm2=0.0225),
            (
                "the shape of the gauge was estimated: peak to valley 0.15 mm (0.1 to 0.2 mm, 95 %); the points on "
                "which it rests are unknown, so the plate's height is known to 0.05 mm (1 sigma, included)"
            ),
        ),
    ],
)
def test_flatness_of_a_gauge_is_noted_as_it_is_known(flatness: Any, said: str) -> None:
    (note,) = _flatness_notes(calibration(flatness=flatness))
    assert note.startswith(said)


@pytest.mark.parametrize(
    ("excess", "said"),
    [
        (0.002, "longer along columns than rows: multiply pitch_mm by 1.002 along columns, or by 0.998 along rows"),
        (-0.002, "longer along rows than columns: multiply pitch_mm by 0.998 along columns, or by 1.002 along rows"),
    ],
)
def test_a_stretched_gauge_is_told_with_both_pitches_that_it_may_have(excess: float, said: str) -> None:
    sentence = _stretched(calibration(excess=excess))
    assert "0.2 % (± 0.02 %) " + said in sentence
    assert sentence.endswith("lengths are uncertain by 0.1 %")
    assert _stretched(calibration()) == ""


@pytest.mark.parametrize(("excess", "end"), [(0.0, "cropped an image"), (-0.002, "lengths are uncertain by 0.1 %")])
def test_images_of_different_focal_lengths_are_told_instead_of_a_stretched_gauge(excess: float, end: str) -> None:
    changed = calibration(known(focal_px=0.1), excess=excess, focal_difference=0.0131)
    sentence = _focal_lengths(changed)
    assert "differ between them by about 1 % explain it better" in sentence
    assert sentence.endswith(end)
    verdict = assess(changed)
    assert (verdict.level, verdict.reasons) == ("limited", (sentence,))
    assert len(verdict.next_steps) == 1
    assert verdict.next_steps[0].startswith("lock focus and zoom")
    assert _focal_lengths(calibration(excess=excess)) == ""


@pytest.mark.parametrize(
    ("rejected", "told"), [((1, 0, 9, 2, 0), True), ((4, 0, 9, 2, 3), False), ((0, 0, 4, 0, 0), False)]
)
def test_an_image_whose_dots_glare_may_have_moved_is_named_before_the_focus_is_blamed(
    rejected: tuple[int, ...], *, told: bool
) -> None:
    """One photograph with a spot of glare made "the focus or the zoom changed" of five good ones."""
    views = tuple(SimpleNamespace(name=f"g{k}.jpg", centers_px=np.zeros((91, 2))) for k in range(5))
    sentence = _focal_lengths(calibration(focal_difference=0.003, rejected=rejected, views=views))
    assert (", or glare or dirt moves the dots of g2.jpg, of which 9 of 100 were left out" in sentence) == told
    assert told or "glare" not in sentence


def test_numbers_of_a_misfit_and_of_a_wrong_size_are_those_of_the_images() -> None:
    fit = SimpleNamespace(variance=25.0, state=calibration().fit.state)
    assert _misfit(calibration(fit=fit, rms_px=0.31))[0].startswith("residuals of 0.31 px are 5 times the uncertainty")
    dots = SimpleNamespace(size_ratio=1.234, bloom=0.0)
    assert "diameter to pitch is 1.23 times that of the gauge file" in _wrong_size(calibration(sightings=(dots,)))[0]


def test_lengths_are_known_to_a_share_in_the_summary_before_every_reason() -> None:
    verdict = assess(calibration(known(focal_px=24.0)), 10.0)
    assert verdict.summary.startswith("ill-conditioned: lengths and turning radii at 10 mm are known to 2 % (1 sigma)")
    assert verdict.summary.endswith("; ".join(["", *verdict.reasons]))
    assert "a long lens (3.0 widths)" in verdict.reasons[0]
    assert len(verdict.next_steps) == 1  # more images, tilted, serve the height correction too


def test_marks_above_the_camera_are_not_in_its_view() -> None:
    with pytest.raises(CalibrationError, match=r"the plane 130 mm above the plate is not in view .* 120 mm above it"):
        assess(calibration(CAMERA), 130.0)


def check(**said: Any) -> str:
    usual: dict[str, Any] = {
        "outcome": "holds", "pose_sigma": 1.0, "lens_sigma": 0.5, "length_change": -0.0002, "tilt_deg": 0.012,
        "distance_mm": -0.034, "shift_mm": 1.0, "dots": 88, "rms_px": 0.03, "unseen": 0.0,
    }  # fmt: skip
    return Check(**usual | said).summary


@pytest.mark.parametrize(
    ("said", "sentence"),
    [
        ({}, ("the calibration holds: pose 1.0 sigma (0.012 degrees, −0.034 mm), lens 0.5 sigma, lengths by up to "
         "−0.020 %")),
        ({"outcome": "changed", "pose_sigma": 5.0}, ("the camera has moved, or the lens has changed slightly, but not "
         "significantly for lengths: pose 5.0 sigma")),
        ({"outcome": "no longer holds", "lens_sigma": 4.1}, ("the calibration no longer holds, the lens has changed "
         "(refocused, zoomed or another lens): pose 1.0 sigma")),
        ({"outcome": "no longer holds", "lens_sigma": 3.9}, "the calibration no longer holds, the camera has moved"),
    ],
)  # fmt: skip
def test_a_check_says_what_changed_and_by_how_much(said: dict[str, Any], sentence: str) -> None:
    assert check(**said).startswith(sentence)


@pytest.mark.parametrize(("unseen", "told"), [(0.00099, False), (0.0012, True)])
def test_a_check_says_what_refocusing_may_hide_from_a_thousandth_of_lengths_on(unseen: float, told: bool) -> None:
    assert ("lengths at mark height by up to 0.12 %" in check(unseen=unseen)) == told
    assert "hide" not in check(outcome="no longer holds", unseen=unseen)


def test_the_next_image_is_described_with_what_it_brings_in_micrometres() -> None:
    best = NextImage("upper left", "right edge", (0.0,) * 6, ((0.0, 0.0),) * 4, 0.0123, 0.0045)
    assert best.sentence == (
        "gauge in the upper left of the view, tilted by 30 degrees, its right edge nearer to the camera; positions at "
        "the height of the marks would be known to 4.5 µm instead of 12 µm (1 sigma, exact pitch)"
    )
    flat = NextImage("middle", "", (0.0,) * 6, ((0.0, 0.0),) * 4, 0.02, 0.01)
    assert flat.sentence.startswith("gauge in the middle of the view, untilted; positions")
    idle = image_notes(Advice((np.nan, 1.0, 1.0, 1.5), None), ["a", "b", "c", "d"])
    assert idle == ("b or c add nothing: the uncertainty is the same without each",)
