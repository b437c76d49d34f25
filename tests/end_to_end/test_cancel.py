"""Who asked for work can end it, and nothing half done stays."""

from __future__ import annotations

from pathlib import Path

import pytest

from evaluator.progress import Cancelled
from evaluator.workflow import analyze


def test_a_recording_is_cancelled_while_it_is_tracked(samples: Path, tmp_path: Path) -> None:
    text = (samples / "experiment.toml").read_text(encoding="utf-8").split("[[run]]")
    one = samples / "one.toml"
    one.write_text("[[run]]".join(text[:2]), encoding="utf-8")
    shares = []

    def cancel_half_way(stage: str, done: float, total: float = 1.0, /) -> None:
        del stage
        shares.append(done / total)
        if done > 0.5 * total:
            raise Cancelled

    with pytest.raises(Cancelled):
        analyze(one, tmp_path / "out", progress=cancel_half_way)
    assert 0.5 < shares[-1] < 0.7
    assert not [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
