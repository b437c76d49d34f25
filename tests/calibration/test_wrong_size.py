"""Dots of another size than the file's: the pitch may be as wrong."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from calibration.assessment.quality import _wrong_size


@pytest.mark.parametrize(("ratio", "told"), [(0.75, True), (0.85, False), (1.0, False), (1.08, False), (1.2, True)])
def test_a_wrong_pitch_or_diameter_is_told(ratio: float, told: bool) -> None:
    seen = SimpleNamespace(sightings=[SimpleNamespace(size_ratio=ratio * share) for share in (0.99, 1.0, 1.01)])
    sentences = _wrong_size(seen)  # type: ignore[arg-type]
    assert bool(sentences) == told
    assert all("pitch_mm or diameter_mm is wrong" in sentence for sentence in sentences)
