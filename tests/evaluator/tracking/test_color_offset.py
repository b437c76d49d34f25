"""What the centre of its colour tells of the errors of a disc, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.tracking.uncertainty.color_offset import AROUND, ColorOffsets

COUNT, SAMPLE_PX, NOISE_PX = 400, 2.0, 0.2
TIME_S = np.arange(COUNT) / 60


def noted(offset_px: np.ndarray, *, step_px: float = 1.5, area: float = 1.0, noise_px: float = NOISE_PX) -> np.ndarray:
    """Variances of a mark whose colour is off its disc by an offset (n, 2) and noise; area: relative to the usual."""
    rng, offsets = np.random.default_rng(3), ColorOffsets()
    for k, off in enumerate(offset_px + noise_px * rng.normal(size=(COUNT, 2))):
        x, y = step_px * k, 100.0
        offsets.note(TIME_S[k], (x, y), np.array([area * 80.0, x + off[0], y + off[1], 0.0, 0.0]), 80.0, SAMPLE_PX)
    return offsets.variance(TIME_S)


def test_half_of_a_lasting_offset_is_the_error_of_the_disc() -> None:
    variance = noted(np.tile([0.8, -0.6], (COUNT, 1)))
    expected = 0.5**2 * (1.0 / 2 - (0.07 * SAMPLE_PX) ** 2)  # of an offset of 1 px, the mean of both axes
    assert np.sqrt(variance) == pytest.approx(np.full(COUNT, np.sqrt(expected)), rel=0.2)


def test_noise_of_chroma_is_no_error_of_the_disc() -> None:
    assert np.sqrt(noted(np.zeros((COUNT, 2))).max()) < 0.2 * NOISE_PX


def test_offset_counts_where_it_lasts_only() -> None:
    over = (np.arange(COUNT) >= 200)[:, None] & (np.arange(COUNT) < 300)[:, None]
    variance = noted(np.where(over, [0.8, 0.8], 0.0))
    assert variance[: 200 - AROUND - 1].max() < 0.02
    assert variance[200 + AROUND : 300 - AROUND].min() > 0.1


@pytest.mark.parametrize("wrong", [{"step_px": 0.0}, {"area": 1.6}, {"area": 0.4}])
def test_mark_at_rest_and_colour_of_another_object_show_nothing(wrong: dict[str, float]) -> None:
    """At rest, the place of the mark between the chroma samples remains the same, and so does the noise."""
    assert noted(np.tile([0.8, -0.6], (COUNT, 1)), **wrong).max() == 0.0


def test_offset_that_changes_its_sign_in_every_frame_does_not_last() -> None:
    assert noted(np.outer((-1.0) ** np.arange(COUNT), [0.8, 0.8]), noise_px=0.0).max() == 0.0


@pytest.mark.parametrize(("samples", "told"), [(0.068, False), (0.072, True)])
def test_an_offset_of_less_than_a_fourteenth_of_a_sample_is_that_of_the_colour_itself(
    samples: float, told: bool
) -> None:
    offset = samples * SAMPLE_PX  # along either axis
    assert (noted(np.full((COUNT, 2), offset), noise_px=0.0).max() > 0.0) == told
