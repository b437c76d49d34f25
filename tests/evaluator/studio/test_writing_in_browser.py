"""What the studio writes and takes back, in a real browser: own effects, images of a live camera, marks, the robot."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tests.evaluator.browser import OpenPage, needs_browser
from tests.evaluator.studio.live_camera import camera_file
from tests.evaluator.studio.recordings import finished
from tests.evaluator.studio.serving import Serving
from tests.waiting import HANGS_S

pytestmark = needs_browser()


NEXT = {"left_rpm": 30.0, "right_rpm": 10.0, "x_mm": 1.0, "y_mm": -2.0, "heading_deg": 90.0, "duration_s": 5.0}


def test_the_form_of_an_unknown_verdict_becomes_an_effect_by_keyboard_and_is_undone_and_the_next_runs_are_written(
    studio: Serving, tmp_path: Path, open_page: OpenPage
) -> None:
    from simulator.own_effects.template import template

    out = tmp_path / "folder" / "out"
    out.mkdir()
    (out / "own_effect.toml").write_text(template("found-by-diagnosis"))
    empty: dict[str, Any] = {name: [] for name in ("effects", "negligible", "known_to", "where", "rivals", "mistakes")}
    told = {"format": 1, "verdict": "unknown", "reason": "no known effect explains the runs", "gap": None}
    rest: dict[str, Any] = {"findings": [], "skipped_runs": {}, "runs_not_followed": []}
    rest["next_experiment"] = {"runs": [{**NEXT, "times": 2}], "separation_sigmas": {}, "inseparable_sigmas": {}}
    (out / "diagnosis.json").write_text(json.dumps({**told, **empty, **rest}))
    identifier = studio.get("/api/home")["experiments"][0]["id"]
    file = tmp_path / "folder" / "effects" / "mixed-drive.toml"
    with open_page(studio.link) as page:
        page.goto(f"{studio.origin}/#/x/{identifier}/diagnosis")
        page.get_by_role("button", name="Add this as your effect").focus()
        page.keyboard.press("Enter")
        page.keyboard.type("Mixed Drive")
        page.keyboard.press("Enter")
        page.locator("form [role=alert]", has_text="lower-case letters").wait_for()
        page.keyboard.press("Control+a")
        page.keyboard.type("mixed-drive")
        page.get_by_label("to, term 2").focus()
        page.keyboard.press("Control+a")
        page.keyboard.type("0,5")
        page.get_by_label("what it depends on, term 1").select_option("left_command")
        assert page.get_by_label("coefficient, term 1").input_value() == "left_drive_by_left_command"
        page.get_by_label("coefficient, term 1").focus()
        page.keyboard.press("Enter")
        finished(page, "Written to effects/mixed-drive.toml")
        terms = tomllib.loads(file.read_text())["term"]
        assert [(one["depends_on"], one["high"]) for one in terms] == [("left_command", 1.5), ("left_command", 0.5)]
        page.locator("h1").click()
        page.keyboard.press("Control+z")
        finished(page, "Undone: the effect mixed-drive")
        assert not file.exists()
        page.get_by_label("The next runs on the plate").wait_for()
        page.get_by_role("button", name="Write it out").press("Enter")
        page.get_by_label("notes, run n02").wait_for()
        assert page.get_by_label("right, rpm, run n02").input_value() == "10"


def test_a_form_in_which_somebody_types_stays_when_a_job_ends(
    studio: Serving, tmp_path: Path, open_page: OpenPage
) -> None:
    identifier = studio.get("/api/home")["experiments"][0]["id"]
    for recording in (tmp_path / "folder").glob("*.mp4"):
        recording.unlink()  # the job ends soon
    with open_page(studio.link) as page:
        page.goto(f"{studio.origin}/#/x/{identifier}/diagnosis")
        page.get_by_role("button", name="New effect").click()
        page.keyboard.type("half-ty")
        with page.expect_response(lambda answer: answer.url.endswith(f"{identifier}/diagnosis"), timeout=300_000):
            studio.post(f"/api/experiments/{identifier}/jobs", {"kind": "analyse"})
        page.wait_for_function("() => document.activeElement.value === 'half-ty'")
        page.keyboard.type("ped")
        assert page.get_by_label("Id, and name of its file").input_value() == "half-typed"


def test_an_image_is_taken_from_a_live_camera_and_undone(studio: Serving, tmp_path: Path, open_page: OpenPage) -> None:
    folder = tmp_path / "folder"
    camera_file(
        folder / "camera.mkv", [np.asarray(cv2.imread(str(folder / "gauge-3-tilted.png"), cv2.IMREAD_GRAYSCALE))] * 3
    )
    with open_page(studio.link) as page:
        page.get_by_role("link", name="Camera").click()
        page.get_by_text("Live camera", exact=True).click()
        page.get_by_label("Camera", exact=True).select_option("recording camera.mkv in place of a camera")
        page.get_by_role("button", name="Start", exact=True).click()
        page.get_by_text("Focus: edges").wait_for(timeout=1000 * HANGS_S)
        page.get_by_label("calibrate after each image").uncheck()
        page.locator("h1").click()
        page.keyboard.press("t")
        finished(page, "Taken: gauge-5.png")
        page.get_by_label("Use gauge-5.png").wait_for()
        assert (folder / "gauge-5.png").is_file()
        page.locator("h1").click()
        page.keyboard.press("Control+z")
        finished(page, "Undone: the image gauge-5.png")
        page.get_by_label("Use gauge-5.png").wait_for(state="detached")
        page.get_by_role("button", name="Stop", exact=True).click()


def test_marks_and_robot_come_back_by_undo(studio: Serving, tmp_path: Path, open_page: OpenPage) -> None:
    folder = tmp_path / "folder"
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    identifier = studio.get("/api/home")["experiments"][0]["id"]
    with open_page(studio.link) as page:
        page.goto(f"{studio.origin}/#/x/{identifier}/marks")
        page.get_by_title("all marks found").first.wait_for(timeout=1000 * HANGS_S)  # what finds marks is compiled
        page.locator("h1").click()
        page.keyboard.press("Delete")
        page.get_by_text("dropped by hand in this frame").wait_for()
        page.keyboard.press("Control+z")
        finished(page, "Undone: a correction of left")
        page.get_by_text("dropped by hand in this frame").wait_for(state="detached")
        page.goto(f"{studio.origin}/#/x/{identifier}/sandbox")
        page.get_by_text("both driving wheels are faster").click()
        page.get_by_label("factor, drive-speed-scale").fill("1.05")
        page.get_by_role("button", name="Add to the robot").click()
        finished(page, "Written to robot.toml")
        page.locator("h1").click()
        page.keyboard.press("Control+z")
        finished(page, "Undone: an effect in the robot")
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before


def slowly(page: Any) -> None:
    """Let changes and undo reach the server only after 0.6 s, as on a slow machine."""
    page.evaluate(
        """() => { const real = window.fetch; window.fetch = async (path, ...rest) => {
        if (/undo|(edit|corrections)$/.test(path)) await new Promise((done) => setTimeout(done, 600));
        return real(path, ...rest); }; }"""
    )


def with_a_change(page: Any) -> tuple[Any, Any]:
    """The runs' screen once "first" is written into the group of the run "left": that cell, and the button Undo."""
    from playwright.sync_api import expect

    page.get_by_text("two runs").click()
    cell, undo = page.get_by_label("group, run left"), page.get_by_role("button", name="Undo", exact=True)
    cell.fill("first")
    page.keyboard.press("Enter")
    expect(undo).to_be_enabled()
    return cell, undo


def test_undo_takes_back_the_latest_change_however_slow_the_answers(
    studio: Serving, tmp_path: Path, open_page: OpenPage
) -> None:
    from playwright.sync_api import expect

    toml = tmp_path / "folder" / "experiment.toml"
    with open_page(studio.link) as page:
        cell, undo = with_a_change(page)
        slowly(page)
        cell.fill("second")
        page.keyboard.press("Enter")
        undo.click()
        finished(page, "Undone")
        expect(cell).to_have_value("first")
    assert 'group = "first"' in toml.read_text()


def test_what_is_typed_stays_when_another_cell_is_answered(
    studio: Serving, tmp_path: Path, open_page: OpenPage
) -> None:
    from playwright.sync_api import expect

    with open_page(studio.link) as page:
        page.get_by_text("two runs").click()
        page.get_by_label("left, rpm, run left").wait_for()
        page.evaluate(
            """() => { const real = window.fetch; window.fetch = async (path, ...rest) => {
            const answer = await real(path, ...rest);
            if (path.endsWith("/edit") && !window.go) await new Promise((go) => { window.go = go; });
            return answer; }; }"""
        )
        page.get_by_label("left, rpm, run left").focus()
        page.keyboard.type("12,5")
        page.keyboard.press("Enter")  # to the row below
        page.keyboard.type("30")
        page.wait_for_function("() => window.go")  # the answer to 12,5 is there
        page.evaluate("window.go()")
        expect(page.get_by_label("left, rpm, run left")).to_have_value("12.5")
        page.keyboard.type(",5")
        page.keyboard.press("Enter")
        expect(page.get_by_label("left, rpm, run right")).to_have_value("30.5")
    written = tomllib.loads((tmp_path / "folder" / "experiment.toml").read_text(encoding="utf-8"))["run"]
    assert [run["left_rpm"] for run in written] == [12.5, 30.5]


def test_a_change_waits_for_the_undo_before_it(studio: Serving, tmp_path: Path, open_page: OpenPage) -> None:
    from playwright.sync_api import expect

    toml = tmp_path / "folder" / "experiment.toml"
    with open_page(studio.link) as page:
        cell, undo = with_a_change(page)
        slowly(page)
        with page.expect_response("**/edit"):
            undo.click()
            page.get_by_label("group, run right").fill("second")
            page.keyboard.press("Enter")
        expect(cell).to_have_value("")
    left, right = tomllib.loads(toml.read_text(encoding="utf-8"))["run"]
    assert (left.get("group"), right.get("group")) == (None, "second")


def test_what_was_said_of_a_change_stays_when_the_motion_is_drawn_after_it(
    studio: Serving, open_page: OpenPage
) -> None:
    identifier = studio.get("/api/home")["experiments"][0]["id"]
    motions: list[Any] = []
    with open_page(studio.link) as page:
        page.goto(f"{studio.origin}/#/x/{identifier}/sandbox")
        row = page.locator("tbody tr").first
        row.wait_for()
        before = row.inner_text()
        # held back; a lambda, as playwright marks its handlers
        page.route("**/api/sandbox", lambda motion: motions.append(motion))  # noqa: PLW0108
        page.get_by_text("both driving wheels are faster").click()
        page.get_by_label("factor, drive-speed-scale").fill("1.05")
        page.get_by_role("button", name="Add to the robot").click()
        finished(page, "Written to robot.toml")
        for motion in motions:
            motion.continue_()
        page.wait_for_function("(old) => document.querySelector('tbody tr').innerText !== old", arg=before)
        assert "Written to robot.toml" in page.locator("#said").inner_text()
    assert len(motions) == 1


def test_marks_are_placed_and_exclusions_drawn_by_keyboard(
    studio: Serving, tmp_path: Path, open_page: OpenPage
) -> None:
    """What a click and a drag do in a frame, the arrows and Enter do."""
    identifier = studio.get("/api/home")["experiments"][0]["id"]
    with open_page(studio.link) as page:
        page.goto(f"{studio.origin}/#/x/{identifier}/marks")
        page.get_by_title("all marks found").first.wait_for(timeout=1000 * HANGS_S)  # what finds marks is compiled
        page.get_by_role("button", name="Draw an exclusion").press("Enter")
        frame = page.locator("canvas.pick")
        for key in ("Enter", *["Shift+ArrowRight"] * 2, "Shift+ArrowDown", "Enter"):
            frame.press(key)
        page.get_by_role("button", name="Remove exclusion 1").wait_for()
        page.get_by_text("Saved in tracking.toml").wait_for()
        page.get_by_role("button", name="Place by hand").press("Enter")
        frame.press("ArrowRight")
        frame.press("Enter")
        page.get_by_text("placed by hand at").wait_for()
        assert "frame 0 of" in page.locator(".clock").inner_text()  # no arrow stepped a frame
        page.locator("h1").click()
        slowly(page)
        for key in ("ArrowRight", "Delete", "ArrowRight", "Delete"):  # the second before the first is answered
            page.keyboard.press(key)
        page.get_by_text("dropped by hand in this frame").wait_for()
        rows = studio.get(f"/api/experiments/{identifier}/runs/left/corrections")["rows"]
        assert [(row["frame"], row["x"] is None) for row in rows] == [(0, False), (1, True), (2, True)]
    (box,) = tomllib.loads((tmp_path / "folder" / "tracking.toml").read_text(encoding="utf-8"))["mask_px"]
    assert [box[2] - box[0], box[3] - box[1]] == [20, 10]
