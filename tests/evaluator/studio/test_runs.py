"""The Runs screen's answers: cells, faults, two tabs, undo, exact frames, a decoder that crashes."""

from __future__ import annotations

import os
import re
import signal
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from evaluator.errors import InputError
from evaluator.files import read_with
from evaluator.settings import load_experiment
from evaluator.workflow import run_of
from evaluator.workflow.editing.documents import read_document
from tests.evaluator.counted_clip import counted_clip, number_in
from tests.evaluator.studio.serving import Serving, serving

EXPERIMENT = """# what a person wrote
format = 1
name = "monday"
robot = "barrel"     # a shipped one
camera = "camera.json"

[[run]]
id = "r01"           # the first
left_rpm = 33.3      # measured
right_rpm = 14.4
start_s = 0.1
video = "r01.mp4"

[[run]]
id = "r02"
left_rpm = 30.0
right_rpm = 30.0
video = "gone.mp4"

# [known_to]
# start_common_s = 0.017
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "experiment.toml").write_text(EXPERIMENT)
    return tmp_path


def first(studio: Serving) -> tuple[str, dict[str, Any]]:
    path = f"/api/experiments/{studio.get('/api/home')['experiments'][0]['id']}"
    return path, studio.get(path)


def set_cell(row: int, key: str, value: object) -> dict[str, Any]:
    return {"kind": "set", "row": row, "key": key, "value": value}


def test_a_cell_is_written_and_comments_stay(studio: Serving, folder: Path) -> None:
    path, table = first(studio)
    studio.post(f"{path}/edit", {"version": table["version"], "edits": [set_cell(0, "left_rpm", 40)]})
    expected = EXPERIMENT.replace("left_rpm = 33.3 ", "left_rpm = 40 ")
    assert (folder / "experiment.toml").read_text().replace("  ", " ") == expected.replace("  ", " ")


def test_faults_stand_at_their_cells(studio: Serving) -> None:
    path, table = first(studio)
    assert {"row": 1, "key": "video", "sentence": "gone.mp4 does not exist"} in table["faults"]
    edits = [set_cell(1, "id", "no spaces please"), set_cell(0, "right_rpm", None)]
    table = studio.post(f"{path}/edit", {"version": table["version"], "edits": edits})
    places = {(fault["row"], fault["key"]) for fault in table["faults"]}
    assert {(1, "id"), (0, "right_rpm")} <= places


def test_a_robot_file_that_is_not_there_is_a_fault_of_the_table(studio: Serving, folder: Path) -> None:
    (folder / "experiment.toml").write_text(EXPERIMENT.replace('robot = "barrel"', 'robot = "robt.toml"'))
    _, table = first(studio)
    found = [fault["sentence"] for fault in table["faults"] if fault["key"] == "robot"]
    assert found == ["robt.toml does not exist: robot = must be a file or a shipped robot"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('format = 1\nname = "unclosed\n', "(at line 2, column 17)"),
        ("\ufeffformat = 1\n", "byte order mark; save it as UTF-8 without BOM"),
        ("format = 1\n[[run]]\nleft_rpm = 1,5\n", "line 3, column 13); numbers have a decimal point, not a comma"),
        ("format = 1\nname = 1, 5\n", "line 2, column 9)"),
    ],
)
def test_a_file_that_is_no_toml_is_said_in_the_words_of_every_command(folder: Path, text: str, said: str) -> None:
    (folder / "experiment.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as by_command:
        read_with(load_experiment, folder / "experiment.toml")
    with pytest.raises(InputError) as by_studio:
        read_document(folder / "experiment.toml")
    reason = str(by_command.value).split("not valid TOML")[1]
    assert reason.endswith(said)
    assert reason in str(by_studio.value)


def test_a_second_tab_does_not_overwrite_the_first(studio: Serving, folder: Path) -> None:
    path, table = first(studio)
    studio.post(f"{path}/edit", {"version": table["version"], "edits": [set_cell(0, "group", "first tab")]})
    second = {"version": table["version"], "edits": [set_cell(0, "group", "second tab")]}
    status, sentence = studio.refused(f"{path}/edit", second)
    assert status == 409
    assert "changed meanwhile" in sentence
    assert "first tab" in (folder / "experiment.toml").read_text()


def test_a_change_by_another_program_is_seen(studio: Serving, folder: Path) -> None:
    path, table = first(studio)
    (folder / "experiment.toml").write_text(EXPERIMENT.replace("monday", "tuesday"))
    edits = [set_cell(0, "group", "x")]
    assert studio.refused(f"{path}/edit", {"version": table["version"], "edits": edits})[0] == 409
    assert studio.refused(path.replace("experiments", "undo/runs"), {"way": "undo", "number": 1})[0] == 400
    assert "tuesday" in (folder / "experiment.toml").read_text()


def test_rows_are_pasted_removed_and_undone(studio: Serving, folder: Path) -> None:
    path, table = first(studio)
    edits = [
        {"kind": "add", "values": {"id": "r03", "left_rpm": 1.5, "right_rpm": -2}},
        {"kind": "remove", "row": 1},
    ]
    table = studio.post(f"{path}/edit", {"version": table["version"], "edits": edits})
    assert [row["id"] for row in table["rows"]] == ["r01", "r03"]
    assert "# start_common_s = 0.017" in (folder / "experiment.toml").read_text()
    identifier = path.split("/")[-1]
    assert studio.step("runs", identifier) == "2 changes of the table"
    assert (folder / "experiment.toml").read_text() == EXPERIMENT
    studio.step("runs", identifier, "redo")
    assert [row["id"] for row in studio.get(path)["rows"]] == ["r01", "r03"]


def test_undo_takes_back_no_change_of_another_tab_or_program(studio: Serving, folder: Path) -> None:
    path, table = first(studio)
    undo = path.replace("experiments", "undo/runs")
    table = studio.post(f"{path}/edit", {"version": table["version"], "edits": [set_cell(0, "group", "mine")]})
    mine = studio.get(undo)["undo"]
    studio.post(f"{path}/edit", {"version": table["version"], "edits": [set_cell(0, "group", "second tab")]})
    assert studio.refused(undo, {"way": "undo", "number": mine["number"]})[0] == 409
    assert "second tab" in (folder / "experiment.toml").read_text()
    text = (folder / "experiment.toml").read_text().replace("second tab", "an editor")
    (folder / "experiment.toml").write_text(text)
    status, sentence = studio.refused(undo, {"way": "undo", "number": studio.get(undo)["undo"]["number"]})
    assert (status, "by another program" in sentence) == (409, True)
    assert (folder / "experiment.toml").read_text() == text


@pytest.mark.parametrize("video", ["../outside.mp4", "/etc/passwd"])
def test_a_cell_names_no_file_outside_the_folder(studio: Serving, video: str) -> None:
    path, table = first(studio)
    edits = [set_cell(0, "video", video)]
    status, sentence = studio.refused(f"{path}/edit", {"version": table["version"], "edits": edits})
    assert (status, "outside the folder" in sentence) == (400, True)


def test_a_video_outside_the_folder_is_not_shown(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    counted_clip(tmp_path / "r01.mp4", 5, gop=5)
    (inner / "experiment.toml").write_text(EXPERIMENT.replace('"r01.mp4"', '"../r01.mp4"'))
    with serving(inner) as studio:
        path, _ = first(studio)
        status, _, body = studio.ask("GET", f"{path}/runs/r01/frame?index=0")
        assert (status, b"outside the folder" in body) == (400, True)
        assert studio.refused(f"{path}/jobs", {"kind": "analyse"})[0] == 400


def shown(studio: Serving, path: str) -> tuple[int, int]:
    status, headers, body = studio.ask("GET", path)
    assert status == 200, body
    return int(headers["x-frame"]), number_in(cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR))


def test_frames_are_exact_and_near_ones_are_key_frames(studio: Serving, folder: Path) -> None:
    counted_clip(folder / "r01.mp4", 60, gop=12, b_frames=2)
    run = f"{first(studio)[0]}/runs/r01"
    assert len(studio.get(f"{run}/contents")["time_s"]) == 60
    for index in (37, 3, 59, 36):
        assert shown(studio, f"{run}/frame?index={index}") == (index, index)
    assert shown(studio, f"{run}/frame?index=47&near=1") == (36, 36)
    status, _, body = studio.ask("GET", f"{run}/frame?index=60")
    assert (status, b"there is no frame 60" in body) == (400, True)


def test_stretches_of_frames_are_told_apart(studio: Serving, folder: Path) -> None:
    counted_clip(folder / "r01.mp4", 30, gop=12)
    _, _, body = studio.ask("GET", f"{first(studio)[0]}/runs/r01/frames?first=20&count=24")
    numbers, at = [], 0
    while at < len(body):
        index, length = int.from_bytes(body[at : at + 4], "big"), int.from_bytes(body[at + 4 : at + 8], "big")
        image = cv2.imdecode(np.frombuffer(body[at + 8 : at + 8 + length], np.uint8), cv2.IMREAD_COLOR)
        numbers.append((index, number_in(image)))
        at += 8 + length
    assert numbers == [(index, index) for index in range(20, 30)]


def test_a_decoder_that_dies_takes_nothing_with_it(folder: Path) -> None:
    from evaluator.errors import InputError
    from evaluator.workflow import Decoder, Wanted

    clip, decoder = counted_clip(folder / "r01.mp4", 30, gop=12), Decoder()
    decoder.start()
    assert decoder.process_id is not None
    os.kill(decoder.process_id, signal.SIGKILL)
    with suppress(InputError):  # it was seen to be gone, and started anew; or it went while it was asked
        decoder.frames(Wanted(clip, 3))
    assert decoder.frames(Wanted(clip, 4))[0][0] == 4
    decoder.close()


def test_a_file_that_is_no_video_is_a_sentence(studio: Serving, folder: Path) -> None:
    (folder / "r01.mp4").write_bytes(b"\x00\x01<script>" * 50)
    status, _, body = studio.ask("GET", f"{first(studio)[0]}/runs/r01/frame?index=0")
    assert status == 400
    assert b"not a video" in body


@pytest.mark.parametrize("place", [None, "."])
def test_a_new_experiment_keeps_the_hints_of_the_template_and_takes_runs(
    studio: Serving, folder: Path, place: str | None
) -> None:
    (folder / "a.mp4").write_bytes(b"")
    made = studio.post("/api/experiments", {"name": "tuesday", "robot": "barrel", "place": place})
    path = f"/api/experiments/{made['id']}"
    table = studio.get(path)
    assert [row["video"] for row in table["rows"]] == (["../a.mp4"] if place else [])
    added = {"kind": "add", "values": {"id": "r09", "left_rpm": 30, "right_rpm": 10, "marks": "r09.csv"}}
    table = studio.post(f"{path}/edit", {"version": table["version"], "edits": [added]})
    assert table["rows"][-1]["id"] == "r09"
    text = (folder / "tuesday" / "experiment.toml").read_text()
    for key in ("left_rpm", "stop_s", "commands", "poses", "group", "start_common_s"):
        assert len(re.findall(rf"^# {key} = .*#", text, re.MULTILINE)) == 1, key


def test_recordings_are_looked_at_before_their_commands_are_known(studio: Serving, folder: Path) -> None:
    counted_clip(folder / "a.mp4", 30, gop=12)
    made = studio.post("/api/experiments", {"name": "tuesday", "robot": "barrel", "place": "."})
    path = f"/api/experiments/{made['id']}"
    assert [fault["key"] for fault in studio.get(path)["faults"]][:2] == ["left_rpm", "right_rpm"]
    assert studio.get(f"{path}/state")["fault"].startswith("3 values are missing")  # and the camera
    run = f"{path}/runs/{studio.get(path)['rows'][0]['id']}"
    assert len(studio.get(f"{run}/contents")["time_s"]) == 30
    assert studio.get(f"{run}/curves")["poses"] == {}
    assert studio.get(f"{path}/results")["runs"] == []
    assert studio.get(f"{path}/tracking")["sought"].keys() == {"green", "yellow"}
    rows = [{"frame": 3, "mark": "green", "x": None}]
    assert studio.post(f"{run}/corrections", {"version": "", "rows": rows})["rows"][0]["frame"] == 3
    assert studio.get(f"/api/sandbox?experiment={made['id']}")["commands"] == []


def test_a_run_whose_id_is_a_path_is_none_of_the_experiment(folder: Path) -> None:
    (folder / "experiment.toml").write_text(EXPERIMENT.replace('"r01" ', '"../r01" '))
    with pytest.raises(InputError, match="no run"):
        run_of(folder / "experiment.toml", "../r01")
    assert run_of(folder / "experiment.toml", "r02").video == folder / "gone.mp4"
