"""The whole job by keyboard alone: Tab and Shift+Tab to whatever is named, Enter, arrows, letters."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from evaluator.workflow.samples import sample_folder
from tests.evaluator.browser import OpenPage, needs_browser
from tests.evaluator.studio.recordings import finished
from tests.evaluator.studio.serving import Serving, serving
from tests.waiting import HANGS_S

pytestmark = needs_browser()

MOST_STOPS = 60  # from one control to any other of a screen; a table of twenty runs has 180 cells
NAME = """() => { const one = document.activeElement;
  return one.getAttribute("aria-label") ?? (one.matches("a, button, summary") ? one.textContent : ""); }"""


def go_to(page: Any, name: str, key: str = "Tab") -> None:
    """Press a key until the control of a name has the focus."""
    passed = []
    for _ in range(MOST_STOPS):
        passed.append(page.evaluate(NAME))
        if passed[-1].startswith(name):
            return
        page.keyboard.press(key)
    pytest.fail(f"{name!r} is not reached by {key}: {passed}")


def press(page: Any, name: str, key: str = "Tab") -> None:
    go_to(page, name, key)
    page.keyboard.press("Enter")


def screen(page: Any, name: str) -> None:
    """Go to another screen of the experiment."""
    press(page, name, "Shift+Tab")
    page.locator(f".screen.{name.lower()} h1").first.wait_for()


def test_tab_leads_through_one_row_to_its_recording(studio: Serving, open_page: OpenPage) -> None:
    with open_page(studio.link) as page:
        page.get_by_text("two runs").click()
        page.get_by_label("start, s, run left").focus()
        page.locator("[aria-label='Frame of left']").wait_for()
        go_to(page, "Frame of left")
        go_to(page, "notes, run left", "Shift+Tab")
        assert page.locator("[aria-label='Frame of right']").count() == 0
        page.keyboard.press("ArrowDown")
        page.locator("[aria-label='Frame of right']").wait_for()
        assert page.evaluate(NAME) == "notes, run right"  # the arrow has moved the focus one row down
        go_to(page, "Frame of right")
        assert page.locator("[aria-label='Frame of left']").count() == 0


def test_what_is_drawn_anew_keeps_the_focus_and_the_chosen_images(
    studio: Serving, tmp_path: Path, open_page: OpenPage
) -> None:
    """Calibrate becomes Calibrate again: who pressed it is not thrown back to the top of the page.

    The images lie in a folder that is not around that of the gauge.
    """
    identifier, photos = studio.get("/api/home")["experiments"][0]["id"], tmp_path / "folder" / "photos"
    photos.mkdir()
    for image in sorted((tmp_path / "folder").glob("*.png")):
        image.rename(photos / image.name)
    with open_page(studio.link) as page:
        page.goto(f"{studio.origin}/#/x/{identifier}/camera")
        page.locator("h2", has_text="Verdict").wait_for()
        left_out = page.get_by_label("Use gauge-4-tilted.png")
        left_out.uncheck()
        button = page.get_by_role("button", name="Calibrate again")
        button.focus()
        button.evaluate("(one) => { one.dataset.old = 1; }")
        page.keyboard.press("Enter")
        page.locator("[data-old]").wait_for(state="detached")
        page.wait_for_function("() => document.activeElement !== document.body")
        assert not left_out.is_checked()
        go_to(page, "Calibrate again")
        page.get_by_role("link", name="Back to the runs").click()
        page.locator("[aria-label='Frame of left']").wait_for()


@pytest.mark.exam
def test_from_recordings_to_a_named_effect(tmp_path: Path, open_page: OpenPage) -> None:
    for source in (sample_folder() / "gauge.toml", *sample_folder().glob("gauge-*.png")):
        shutil.copy(source, tmp_path / source.name)
    shutil.copytree(sample_folder() / "puzzle", tmp_path / "puzzle")
    with serving(tmp_path) as studio, open_page(studio.link) as page:
        press(page, "Camera")
        press(page, "Calibrate")
        page.locator("h2", has_text="Verdict").wait_for(timeout=1000 * HANGS_S)
        press(page, "turnscope studio", "Shift+Tab")
        page.locator("a.card").wait_for()
        press(page, "barrel wheels")
        page.locator("[aria-label='Frame of p01']").wait_for()
        screen(page, "Marks")
        page.locator(".contact canvas").first.wait_for()
        press(page, "Frame with the candidates for marks")  # the cross begins at the mark
        page.get_by_text("Saved in puzzle/tracking.toml").wait_for()
        assert "hue_deg" in (tmp_path / "puzzle" / "tracking.toml").read_text()
        screen(page, "Runs")
        page.locator("[aria-label='Frame of p01']").wait_for()
        go_to(page, "Frame of p01")
        for key in ("Home", *["Shift+ArrowRight"] * 2, "s"):
            page.keyboard.press(key)
        start = "() => document.querySelector('input[data-key=start_s]').value"
        page.wait_for_function(f"() => ({start})() !== '0.315'")
        page.keyboard.press("Control+z")
        page.wait_for_function(f"() => ({start})() === '0.315'")
        press(page, "Diagnose", "Shift+Tab")
        finished(page, "The diagnosis is done")
        screen(page, "Results")
        figure = page.locator("[data-figure=gap]")
        figure.wait_for()
        before = float(figure.get_attribute("data-value"))
        screen(page, "Diagnosis")
        page.locator(".found .kind", has_text="axle-compliance").wait_for()
        press(page, "Swap left and right")
        page.get_by_text("The commands are changed").wait_for()
        press(page, "Add it to the robot")
        page.get_by_text("in the robot", exact=True).wait_for()
        press(page, "Analyse with it")
        screen(page, "Results")
        page.wait_for_function(
            "(before) => Number(document.querySelector('[data-figure=gap]')?.dataset.value ?? 1) < before / 4",
            arg=before,
            timeout=1000 * HANGS_S,
        )
