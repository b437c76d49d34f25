"""Whether the shutter is a rolling one cannot be seen: where it matters, it is asked, once for an experiment."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.end_to_end.commands import turnscope

ASKED = "whether the camera has a rolling shutter is not stated"


@pytest.mark.parametrize(("readout", "asked"), [(None, 1), (0.0, 0)])
def test_of_fast_runs_the_shutter_is_asked_once_unless_it_is_stated(
    samples: Path, tmp_path: Path, readout: float | None, asked: int
) -> None:
    lines = [f'format = 1\nname = "fast"\nrobot = "barrel"\ncamera = "{samples / "camera.json"}"']
    if readout is not None:
        (tmp_path / "tracking.toml").write_text(f"format = 1\nreadout_ms = {readout}\n", encoding="utf-8")
        lines.append('tracking = "tracking.toml"')
    for name, rpm in (("first", -90), ("again", -90)):
        video = samples / "straight_speeds" / "90-backward.mp4"
        lines.append(f'[[run]]\nid = "{name}"\nleft_rpm = {rpm}\nright_rpm = {rpm}\nstart_s = 0.3\nvideo = "{video}"')
    (tmp_path / "experiment.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    done = turnscope("analyze", tmp_path / "experiment.toml", "-o", tmp_path / "out", "--workers", 1)
    assert done.returncode == 0
    assert done.stderr.count(ASKED) == asked
    assert "state readout_ms in tracking.toml" in done.stderr or not asked
    settings = ("--settings", tmp_path / "tracking.toml") if readout is not None else ()
    alone = turnscope("track", video, "-o", tmp_path / "a.csv", "--camera", samples / "camera.json", *settings)
    assert alone.stderr.count(ASKED) == asked
