from __future__ import annotations

from pathlib import Path

import av
import cv2
import numpy as np
import pandas as pd
from click.testing import CliRunner

from evaluator.cli.measurement.track import track
from evaluator.recording import open_recording
from evaluator.report.overlay import why_doubtful
from tests.evaluator.tracking.synthetic import draw, turning_marks, write_video


def small_clip(folder: Path, frames: int = 30) -> Path:
    rng = np.random.default_rng(3)
    truth = turning_marks(frames, (100.0, 80.0), 20.0, 9.0, 0.03)
    images = [draw(rng, (201, 160), {n: tuple(p[k]) for n, p in truth.items()}, 4.5, 0.8, 2.0) for k in range(frames)]
    return write_video(folder / "clip.mkv", images)


def test_the_command_writes_marks_overlay_and_sheet(tmp_path: Path) -> None:
    video, marks, overlay, sheet = small_clip(tmp_path), tmp_path / "m.csv", tmp_path / "o.mp4", tmp_path / "s.png"
    fixes = tmp_path / "c.csv"
    fixes.write_text("frame,mark,x,y\n5,green,absent,\n")
    arguments = [
        str(video),
        "-o",
        str(marks),
        "--overlay",
        str(overlay),
        "--sheet",
        str(sheet),
        "--corrections",
        str(fixes),
    ]
    result = CliRunner().invoke(track, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    table = pd.read_csv(marks)
    assert table["green_status"][5] == "absent by hand"
    assert table["green_x_px"].notna().sum() == len(table) - 1
    assert [frame.time for frame in open_recording(overlay)] == [frame.time for frame in open_recording(video)]
    with av.open(str(overlay)) as container:
        drawn = next(container.decode(video=0)).to_ndarray(format="rgb24")
    assert drawn.shape == (160, 200, 3)
    assert cv2.imread(str(sheet)).shape[0] == 240


def test_nothing_is_written_where_no_mark_is_in_view(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    video = write_video(tmp_path / "e.mkv", [draw(rng, (120, 90), {}, 4.0, 0.8, 2.0) for _ in range(3)])
    marks = tmp_path / "m.csv"
    result = CliRunner().invoke(track, [str(video), "-o", str(marks)])
    assert result.exit_code != 0
    assert "no mark was found" in str(result.exception)
    assert not marks.exists()


def test_a_grey_recording_is_refused_in_one_sentence(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    images = [draw(rng, (120, 90), {}, 4.0, 0.8, 2.0)] * 3
    video = write_video(tmp_path / "grey.mkv", images, pixels="gray")
    result = CliRunner().invoke(track, [str(video), "-o", str(tmp_path / "m.csv")])
    assert "grey.mkv has no colour" in str(result.exception)


def test_numbers_agree_with_their_nouns_and_a_doubtful_frame_says_why(tmp_path: Path) -> None:
    one = small_clip(tmp_path, frames=1)
    result = CliRunner().invoke(track, [str(one), "-o", str(tmp_path / "m.csv")], catch_exceptions=False)
    assert ": 1 frame; green" in result.output
    table = pd.DataFrame({"frame": [0, 1, 2], "time_s": [0.0, 0.1, 0.2], "green_status": ["ok", "ok", "not seen"]})
    for axis in "xy":
        table[f"green_{axis}_sigma_px"] = [0.03, 0.3, np.nan]
    assert why_doubtful(table, "green", 1) == "sigma 0.42 px, usually 0.23"
    assert why_doubtful(table, "green", 2) == "not seen"
