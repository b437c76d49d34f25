"""One bad recording does not stop the rest: every run gets its numbers or its reason."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from tests.end_to_end.commands import turnscope
from tests.end_to_end.damage import DAMAGES, first_images

GOOD = [f"good-{number}" for number in range(8)]  # before the damaged ones and after them


@pytest.fixture(scope="module")
def batch(samples: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("batch")
    good = folder / "short.mp4"
    first_images(samples / "turn-33-5.mp4", good, 89)
    (folder / "camera.json").write_bytes((samples / "camera.json").read_bytes())
    lines = ['format = 1\nname = "batch"\nrobot = "barrel"\ncamera = "camera.json"']
    for name in (*GOOD[:4], *DAMAGES, *GOOD[4:]):
        if name in DAMAGES:
            DAMAGES[name][0](good, folder / f"{name}.mp4")
        else:
            (folder / f"{name}.mp4").write_bytes(good.read_bytes())
        lines.append(f'[[run]]\nid = "{name}"\nleft_rpm = 33.0\nright_rpm = 5.0\nstart_s = 0.5\nvideo = "{name}.mp4"')
    (folder / "experiment.toml").write_text("\n\n".join(lines) + "\n", encoding="utf-8")
    return folder


def test_every_damaged_recording_gives_its_reason_and_every_good_one_its_radius(batch: Path) -> None:
    done = turnscope("analyze", batch / "experiment.toml", "-o", batch / "out", "--workers", 2)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    reasons = dict(line.split(": ", 1) for line in done.stderr.strip().splitlines())
    assert "same marks as" in reasons.pop("note")  # the good ones are copies of one recording
    assert list(reasons) == list(DAMAGES)
    for name, (_, words) in DAMAGES.items():
        assert f"{name}.mp4" in reasons[name]
        assert words in reasons[name], reasons[name]
    table = pd.read_csv(batch / "out" / "turning.csv").set_index("run")
    assert table["radius_mm"].notna().sum() == len(GOOD)
    assert table.loc[GOOD, "radius_mm"].to_numpy() == pytest.approx(3.43, rel=0.01)
    for name in DAMAGES:
        assert not list((batch / "out").rglob(f"{name}.*"))


def test_a_stream_that_ends_before_the_motors_do_is_remarked_upon(batch: Path) -> None:
    first_images(batch / "short.mp4", batch / "stream.ts", None, "mpegts")
    text = (batch / "experiment.toml").read_text(encoding="utf-8").split("\n\n")[:2]
    text[1] = text[1].replace("good-0.mp4", "stream.ts") + "\nstop_s = 1.7"
    (batch / "short.toml").write_text("\n\n".join(text) + "\n", encoding="utf-8")
    done = turnscope("report", batch / "short.toml", "-o", batch / "short-out", "--workers", 1)
    assert done.returncode == 0
    assert "note: good-0: ends at 1.47 s, before the motors are commanded off at 1.7 s" in done.stderr
    assert "before the motors are commanded off" in (batch / "short-out" / "report.html").read_text(encoding="utf-8")
