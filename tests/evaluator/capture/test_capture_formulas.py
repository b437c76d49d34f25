"""When a light went on and what arrival times are worth, in closed form: brightness and delays that are chosen."""

from __future__ import annotations

from fractions import Fraction
from math import hypot, nan, pi, sqrt

import numpy as np
import pytest

from evaluator.capture import record, start
from evaluator.capture.clock import CaptureClock
from evaluator.capture.light import LightRegion, light_on
from evaluator.errors import InputError
from evaluator.recording import Frame

STEP_S, FRAMES, AT = 0.02, 20, 10
OF_A_LEVEL = sqrt(1 + pi / 10)  # a frame against the median of five
ROUNDED = sqrt(1 / 12) * OF_A_LEVEL  # noise of a frame whose levels are whole numbers, without any other


def lit(share: float, high: float = 120.0) -> tuple[np.ndarray, np.ndarray]:
    """Times and brightness of frames whose light goes on in frame AT, for a share of its exposure."""
    brightness = np.where(np.arange(FRAMES) < AT, 20.0, high)
    brightness[AT] = 20 + share * (high - 20)
    return STEP_S * np.arange(FRAMES), brightness


@pytest.mark.parametrize("share", [0.25, 0.5, 0.75])
def test_a_light_that_was_on_for_a_share_of_an_exposure_went_on_that_long_before_its_end(share: float) -> None:
    exposure = 0.008
    moment, sigma = light_on(*lit(share), exposure)
    assert moment == pytest.approx(AT * STEP_S + exposure / 2 - share * exposure)
    assert sigma == pytest.approx(ROUNDED / 100 * exposure)


def test_of_an_unknown_exposure_half_the_interval_is_taken_and_the_rest_is_in_the_uncertainty() -> None:
    moment, sigma = light_on(*lit(0.25))
    assert moment == pytest.approx(AT * STEP_S + 0.25 * STEP_S / 2)
    assert sigma == pytest.approx(hypot(ROUNDED / 100 * STEP_S / 2, 0.25 * STEP_S / sqrt(12)))


@pytest.mark.parametrize(("exposure", "gap"), [(0.008, 0.012 / sqrt(12)), (None, STEP_S / 6)])
def test_a_light_that_went_on_between_two_exposures_is_as_uncertain_as_the_time_between_them(
    exposure: float | None, gap: float
) -> None:
    moment, sigma = light_on(*lit(1.0), exposure)
    assert moment == pytest.approx((AT - 0.5) * STEP_S)
    unseen = 4 * ROUNDED / 100 * STEP_S / sqrt(3)  # a share of four sigmas is not told from none
    assert sigma == pytest.approx(hypot(gap, unseen))


@pytest.mark.parametrize(("level", "partly"), [(118.0, True), (119.0, False)])
def test_a_share_counts_from_four_sigmas_below_the_whole(level: float, *, partly: bool) -> None:
    time, brightness = lit(1.0)
    brightness[AT] = level  # four sigmas: 1.3 levels
    assert (light_on(time, brightness, 0.008)[0] > (AT - 0.5) * STEP_S) == partly


@pytest.mark.parametrize(("level", "partly"), [(22.0, True), (21.0, False)])
def test_a_share_counts_from_four_sigmas_above_none(level: float, *, partly: bool) -> None:
    time, brightness = lit(1.0)
    brightness[AT - 1] = level
    moment, _ = light_on(time, brightness, 0.008)
    late = (AT - 1) * STEP_S + (0.5 - (level - 20) / 100) * 0.008
    assert moment == pytest.approx(late if partly else (AT - 0.5) * STEP_S)


@pytest.mark.parametrize(("rise", "seen"), [(3.0, True), (2.0, False)])
def test_a_step_of_eight_times_the_noise_is_a_light(rise: float, *, seen: bool) -> None:
    time, brightness = lit(1.0, 20.0 + rise)  # eight times the noise: 2.65 levels
    if seen:
        assert light_on(time, brightness)[0] == pytest.approx((AT - 0.5) * STEP_S)
    else:
        with pytest.raises(InputError, match="no light switches on there: brightness steps by 2 levels"):
            light_on(time, brightness)


def test_noise_of_a_frame_is_that_of_differences_over_the_root_of_two() -> None:
    time, brightness = lit(1.0, 1020.0)
    brightness += np.where(np.arange(FRAMES) % 4 < 2, 3.0, -3.0)  # differences of 0 and 6
    differences = np.delete(np.diff(brightness), slice(AT - 6, AT + 4))
    noise = sqrt((differences**2).mean() / 2 + 1 / 12) * OF_A_LEVEL
    _, sigma = light_on(time, brightness, STEP_S)
    assert sigma == pytest.approx(4 * noise / 1000 * STEP_S / sqrt(3), rel=0.02)


@pytest.mark.parametrize("exposure", [0.0, 1.02 * STEP_S])
def test_an_exposure_that_does_not_fit_the_interval_is_refused(exposure: float) -> None:
    with pytest.raises(InputError, match=r"does not fit frames every 0\.02 s"):
        light_on(*lit(1.0), exposure)


def test_fifteen_frames_are_needed() -> None:
    with pytest.raises(InputError, match="14 frames; 15 are needed"):
        light_on(*(values[:14] for values in lit(1.0)))


def image(row_step: int = 1) -> Frame:
    """30 × 20 px whose luma is the column plus the row; a field has every second row."""
    y, x = np.mgrid[:20:row_step, :30]
    plane = (x + y).astype(np.uint8)
    return Frame(
        0, 0, Fraction(1, 60), plane, None, None, 8, full_range=True, matrix="bt601", row_origin=0, row_step=row_step,
        kind="", repeated=False, owner=None,
    )  # fmt: skip


@pytest.mark.parametrize("row_step", [1, 2])
def test_brightness_is_the_mean_of_the_square_about_the_light(row_step: int) -> None:
    assert LightRegion(10.0, 8.0).brightness(image(row_step)) == 18.0


@pytest.mark.parametrize(("x", "y"), [(4.0, 4.0), (25.0, 4.0), (4.0, 15.0), (25.0, 15.0)])
def test_a_light_may_reach_to_the_edge_of_the_image_and_no_farther(x: float, y: float) -> None:
    assert LightRegion(x, y).brightness(image()) == x + y
    for dx, dy in ((1.0 if x > 10 else -1.0, 0.0), (0.0, 1.0 if y > 10 else -1.0)):
        with pytest.raises(InputError, match="is not within the image of 30 × 20 px"):
            LightRegion(x + dx, y + dy).brightness(image())


def clock(stamps: list[float | None], arrivals: list[float]) -> CaptureClock:
    found = CaptureClock()
    for stamp, arrival in zip(stamps, arrivals, strict=True):
        found.add(stamp, arrival)
    return found


def test_a_frame_whose_time_is_not_after_the_one_before_is_left_out() -> None:
    found = CaptureClock()
    assert [found.add(stamp, 9.0) for stamp in (5.0, 5.02, 5.02, 5.01, None, 5.05)] == [
        0,
        20000,
        None,
        None,
        None,
        50000,
    ]
    assert found.stamped
    assert found.report().frames == 3


# Delays that differ from frame to frame by −2, −1, 0, 1 and 2 ms: the median of their sizes is 1 ms.
DELAYS_S = np.cumsum([0.010, -0.002, -0.001, 0.0, 0.001, 0.002])


def test_jitter_is_the_robust_scatter_of_one_delay_of_two_that_make_a_difference() -> None:
    stamps = [100 + STEP_S * k for k in range(6)]
    report = clock(list(stamps), list(stamps + DELAYS_S)).report()
    assert report.source == "camera"
    assert report.jitter_s == pytest.approx(1.4826 * 0.001 / sqrt(2))
    assert report.interval_s == pytest.approx(STEP_S)


def test_without_times_of_the_camera_jitter_is_that_of_arrivals_about_even_spacing() -> None:
    even = STEP_S * np.array([0, 1, 2, 3, 4, 7, 8])  # two frames are missing
    report = clock([None] * 7, list(even + np.append(DELAYS_S, DELAYS_S[-1]))).report()
    assert (report.source, report.dropped) == ("arrival", 2)
    assert report.interval_s == pytest.approx(STEP_S)
    assert report.jitter_s == pytest.approx(1.4826 * 0.001 / sqrt(2))


def test_a_moment_of_the_computer_is_later_by_the_least_delay_than_the_camera_says() -> None:
    stamps = [100 + STEP_S * k for k in range(6)]
    found = clock(list(stamps), list(stamps + DELAYS_S + 7000.0))
    least = DELAYS_S.min() + 7000.0
    moment, sigma = found.in_recording(7100.5)
    assert moment == pytest.approx(7100.5 - least - 100)
    assert sigma == pytest.approx(hypot(STEP_S, found.report().jitter_s))
    assert clock([None, None], [50.0, 50.02]).in_recording(50.5)[0] == pytest.approx(0.5)


def test_a_single_frame_has_no_interval() -> None:
    np.testing.assert_equal(
        [clock([1.0], [1.0]).report().interval_s, clock([1.0], [1.0]).report().jitter_s], [nan, nan]
    )


def test_a_signal_is_sent_once_and_its_moment_is_the_middle_of_the_time_that_this_takes() -> None:
    now, sent = [10.0], []

    def send() -> None:
        sent.append(now[0])
        now[0] += 0.4

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(start.time, "perf_counter", lambda: now[0])
        ready = start._once(send)
        assert ready.moment() is None
        ready.send()
        ready.send()
    assert sent == [10.0]
    assert ready.moment() == pytest.approx(10.2)


def test_what_is_seen_of_a_frame_is_said_from_the_next_one_on() -> None:
    asked: list[object] = []
    observer = record._Observer(lambda frame: asked.append(frame) or f"{len(asked)} marks")
    frame: Frame = object()  # type: ignore[assignment]
    assert observer.look(None) == ""
    assert observer.look(frame) == ""
    observer.close()  # waits for what is seen
    assert (observer.look(None), asked) == ("1 marks", [frame])
    assert record._Observer(None).look(frame) == ""
