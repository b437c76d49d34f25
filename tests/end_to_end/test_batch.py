"""One bad recording does not stop the rest: every run gets its numbers or its reason."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from tests.end_to_end.commands import turnscope
from tests.end_to_end.damage import DAMAGES


@pytest.fixture(scope="module")
def batch(samples: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("batch")
    good = samples / "turn-33-5.mp4"
    (folder / "good.mp4").write_bytes(good.read_bytes())
    (folder / "camera.json").write_bytes((samples / "camera.json").read_bytes())
    lines = ['format = 1\nname = "batch"\nrobot = "barrel"\ncamera = "camera.json"']
    for name in ("good", *DAMAGES):
        if name in DAMAGES:
            DAMAGES[name][0](good, folder / f"{name}.mp4")
        lines.append(f'[[run]]\nid = "{name}"\nleft_rpm = 33.0\nright_rpm = 5.0\nstart_s = 0.5\nvideo = "{name}.mp4"')
    (folder / "experiment.toml").write_text("\n\n".join(lines) + "\n", encoding="utf-8")
    return folder


def test_ten_damaged_recordings_give_ten_reasons_and_the_good_one_its_radius(batch: Path) -> None:
    done = turnscope("analyze", batch / "experiment.toml", "-o", batch / "out", "--workers", 2)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    reasons = dict(line.split(": ", 1) for line in done.stderr.strip().splitlines())
    assert list(reasons) == list(DAMAGES)
    for name, (_, words) in DAMAGES.items():
        assert f"{name}.mp4" in reasons[name]
        assert words in reasons[name], reasons[name]
    table = pd.read_csv(batch / "out" / "turning.csv").set_index("run")
    assert table["radius_mm"].notna().sum() == 1
    assert table.loc["good", "radius_mm"] == pytest.approx(3.43, rel=0.01)
    for name in DAMAGES:
        assert not list((batch / "out").rglob(f"{name}.*"))
