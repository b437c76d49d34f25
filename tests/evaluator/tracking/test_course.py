from __future__ import annotations

import numpy as np
import pytest

from evaluator.tracking.following.pair import Body
from evaluator.tracking.following.repeated_frames import repeated_frames
from evaluator.tracking.uncertainty.codec import hidden_variance
from evaluator.tracking.uncertainty.course import steady_times
from tests.evaluator.tracking.synthetic import turning_marks

FRAMES, OWN = 400, 0.005


def course() -> np.ndarray:
    return turning_marks(FRAMES, (200.0, 150.0), 60.0, 10.0, 0.02)["green"]


@pytest.mark.parametrize("gaps", [0.0, 0.25])
@pytest.mark.parametrize("jitter_s", [0.0, 0.004])
def test_errors_of_the_codec_are_found_across_gaps_and_on_any_clock(gaps: float, jitter_s: float) -> None:
    rng = np.random.default_rng(5)
    time_s = np.arange(FRAMES) / 60 + rng.uniform(-jitter_s, jitter_s, FRAMES)
    phase = time_s * 60 * 0.02
    centers = 60 * np.column_stack([np.sin(phase), np.cos(phase)]) + rng.normal(0, 0.05, (FRAMES, 2))
    variances = np.full(FRAMES, OWN**2)
    centers[rng.random(FRAMES) < gaps] = np.nan
    variances[np.isnan(centers[:, 0])] = np.nan
    found = np.median(hidden_variance(time_s, centers, variances, np.full(FRAMES, "P")))
    assert np.sqrt(found + OWN**2) == pytest.approx(0.05, rel=0.12)


def test_images_whose_variance_is_stated_too_large_do_not_hide_the_error_of_the_codec() -> None:
    rng = np.random.default_rng(5)
    centers = course() + rng.normal(0, 0.03, (FRAMES, 2))
    widened = np.arange(FRAMES) < 0.45 * FRAMES
    variances = np.where(widened, 2.9, 1.0) * 0.02**2
    found = hidden_variance(np.arange(FRAMES) / 60, centers, variances, np.full(FRAMES, "P"))
    assert np.sqrt(np.median((found + variances)[~widened])) == pytest.approx(0.03, rel=0.1)


def test_an_image_far_off_its_course_is_less_certain_than_the_others() -> None:
    rng = np.random.default_rng(5)
    centers = course() + rng.normal(0, 0.02, (FRAMES, 2))
    centers[200] += 0.15
    found = hidden_variance(np.arange(FRAMES) / 60, centers, np.full(FRAMES, OWN**2), np.full(FRAMES, "P"))
    assert 4 * np.sqrt(found[200]) > 0.15
    assert found[100] < 0.3 * found[200]


def test_times_rounded_to_milliseconds_become_even_and_truly_uneven_ones_stay() -> None:
    exact = np.delete(np.arange(200), [20, 21, 90]) / 59.94
    assert np.abs(steady_times(np.round(exact, 3)) - exact).max() < 2e-4
    uneven = exact + np.random.default_rng(1).uniform(-0.004, 0.004, len(exact))
    assert steady_times(uneven) is uneven


def test_an_image_stored_again_is_told_from_a_rest() -> None:
    moving = course()
    moving[100:102] = moving[99] + 0.02
    rest = np.full((FRAMES, 2), 50.0)
    again, still = repeated_frames([moving, rest])
    assert set(np.flatnonzero(again)) == {100, 101}
    assert not still.any()
    # The recording ends before the mark makes up for it: shown again, as before, or at rest for longer than ever.
    assert set(np.flatnonzero(repeated_frames([moving[:102]])[0])) == set()
    for last, shown in ((2, True), (3, False)):
        ended = moving.copy()
        ended[FRAMES - last :] = moving[FRAMES - last - 1] + 0.02
        assert repeated_frames([ended])[0][FRAMES - last :].all() == shown
    stopped = course()
    stopped[200:] = stopped[200]
    assert not repeated_frames([stopped])[0].any()
    started = 10 * course()
    started[:200] = started[200]  # the last frame at rest stands still before a step as large as the usual one
    assert not repeated_frames([started])[0].any()


def test_places_of_a_lost_mark_are_those_at_the_distance_of_its_partner() -> None:
    body = Body()
    assert body.fits((0.0, 0.0), (500.0, 0.0))
    for k in range(10):
        body.note((10.0 * k, 0.0), (10.0 * k + 40.0, 1.0))
    assert body.paired([(100.0, 0.0), (142.0, 3.0)], [(185.0, 0.0)]) == [(142.0, 3.0)]
