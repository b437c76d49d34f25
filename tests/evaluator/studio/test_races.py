"""What comes at a bad moment, in a real browser: answers overtaken, work that ends while a screen loads, presses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tests.evaluator.browser import OpenPage, needs_browser
from tests.evaluator.studio.serving import Serving
from tests.waiting import HANGS_S

pytestmark = needs_browser()

# The stream of jobs says what the test says; the first answer to a question that ends with `held` waits for go().
TOLD_BY_THE_TEST = """window.EventSource = class { constructor() { window.stream = this; } };
window.tell = (jobs) => window.stream.onmessage({ data: JSON.stringify(jobs) });
const real = window.fetch;
window.fetch = async (path, ...rest) => {
  const answer = await real(path, ...rest);
  if (window.held && path.endsWith(window.held)) {
    window.held = null;
    await new Promise((go) => { window.go = go; });
    setTimeout(() => { window.gone = true; });
  }
  return answer;
};"""


def diagnosed(folder: Path) -> None:
    """Leave what a diagnosis of a verdict without an effect leaves."""
    lists: dict[str, Any] = {name: [] for name in ("effects", "negligible", "known_to", "where", "rivals", "mistakes")}
    told = {"format": 1, "verdict": "none", "reason": "the model explains the runs", "gap": None, "skipped_runs": {}}
    rest: dict[str, Any] = {"findings": [], "runs_not_followed": [], "next_experiment": None}
    folder.mkdir()
    (folder / "diagnosis.json").write_text(json.dumps({**told, **lists, **rest}), encoding="utf-8")


def test_work_that_ends_while_its_screen_loads_is_shown_and_no_older_answer_after_it(
    studio: Serving, tmp_path: Path, open_page: OpenPage
) -> None:
    identifier = studio.get("/api/home")["experiments"][0]["id"]
    job = {"number": 1, "kind": "diagnose", "experiment": identifier, "target": "experiment.toml", "share": 0.5}
    with open_page(studio.link) as page:
        page.add_init_script(TOLD_BY_THE_TEST)
        page.reload()
        page.evaluate("(jobs) => { window.tell(jobs); window.held = '/diagnosis'; }", [{**job, "state": "running"}])
        page.goto(f"{studio.origin}/#/x/{identifier}/diagnosis")
        page.wait_for_function("() => window.go")  # the screen is about to be told that there is no diagnosis
        diagnosed(tmp_path / "folder" / "out")
        page.evaluate("(jobs) => window.tell(jobs)", [{**job, "state": "done"}])
        page.locator("h1", has_text="No effect is missing").wait_for()
        page.evaluate("window.go()")
        page.wait_for_function("() => window.gone")
        assert page.locator("h1").all_inner_texts() == ["No effect is missing"]


def test_the_mask_of_a_frame_is_drawn_on_no_other(studio: Serving, open_page: OpenPage) -> None:
    with open_page(studio.link) as page:
        page.evaluate(
            """async () => { const { drawMarks } = await import("/static/js/markdrawing.js");
            const square = (ink) => { const one = new OffscreenCanvas(9, 9), context = one.getContext("2d");
              context.fillStyle = ink; context.fillRect(0, 0, 9, 9); return one; };
            const green = { blobs: [], x_px: null, origin_px: [0, 0], cell_px: [1, 1] };
            const frames = [0, 1].map((frame) => [frame, { marks: { green } }]);
            const state = { bitmap: square("black"), seen: new Map(frames), mark: "green", showMask: true, rows: [],
              masks: { of: new Map([["green", square("red")]]), frame: 0 }, said: {} };
            window.redIn = (index) => { const context = square("black").getContext("2d");
              drawMarks(context, 9, 9, { ...state, index }, { width: 9, height: 9 });
              return context.getImageData(4, 4, 1, 1).data[0]; }; }"""
        )
        assert page.evaluate("redIn(0)") > 100
        assert page.evaluate("redIn(1)") == 0


def test_a_long_name_is_shortened_to_both_of_its_ends(studio: Serving, open_page: OpenPage) -> None:
    with open_page(studio.link) as page:
        found = page.evaluate(
            """async () => { const { shortened } = await import("/static/js/matrix.js");
            const context = { measureText: (text) => ({ width: text.length }) };
            return [9, 8, 5].map((width) => shortened(context, "left-r123", width)); }"""
        )
    assert found == ["left-r123", "left…123", "le…23"]


def test_an_answer_to_a_screen_that_was_left_is_not_drawn(studio: Serving, open_page: OpenPage) -> None:
    identifier = studio.get("/api/home")["experiments"][0]["id"]
    with open_page(studio.link) as page:
        page.goto(f"{studio.origin}/#/x/{identifier}/marks")
        page.get_by_title("all marks found").first.wait_for(timeout=1000 * HANGS_S)
        page.evaluate(
            """() => { const real = window.createImageBitmap; window.createImageBitmap = async (blob) => {
            if (blob.type !== "image/png") return real(blob);
            await new Promise((go) => { window.go = go; });
            const found = await real(blob);
            setTimeout(() => { window.gone = true; });
            return found; }; }"""
        )
        page.locator("h1").click()
        page.keyboard.press("ArrowRight")
        page.wait_for_function("() => window.go")  # the mask is being unpacked
        page.goto(f"{studio.origin}/#/x/{identifier}/results")
        page.locator(".screen.results").wait_for()
        page.evaluate("window.go()")
        page.wait_for_function("() => { window.go(); return window.gone; }")
        assert page.locator("#said").inner_text() == ""


def test_who_has_gone_on_keeps_the_place_when_the_last_part_of_a_screen_comes(
    studio: Serving, open_page: OpenPage
) -> None:
    with open_page(studio.link) as page:
        page.add_init_script(TOLD_BY_THE_TEST)
        page.reload()
        page.evaluate("window.held = '/api/live'")
        page.goto(f"{studio.origin}/#/camera")
        page.wait_for_function("() => window.go")  # the gauge can be used, the live camera is about to be listed
        page.get_by_role("button", name="Calibrate again").focus()
        page.evaluate("window.go()")
        page.locator("summary", has_text="Live camera").wait_for()
        page.wait_for_function("() => document.title.startsWith('camera')")  # the screen is complete
        assert page.evaluate("document.activeElement.textContent") == "Calibrate again"


def test_a_studio_that_was_ended_is_said_in_a_sentence(studio: Serving, open_page: OpenPage) -> None:
    with open_page(studio.link) as page:
        page.locator("h1").wait_for()
        page.route("**/*", lambda route: route.abort())
        page.get_by_role("link", name="Sandbox").click()
        page.locator("#main", has_text="The studio does not answer").wait_for()
        assert page.locator("#main p").first.inner_text() == (
            "The studio does not answer; start `turnscope studio` again. Nothing is lost."
        )


def test_a_click_is_not_lost_when_its_button_is_drawn_anew_before_it_is_let_go(
    studio: Serving, open_page: OpenPage
) -> None:
    with open_page(studio.link) as page:
        page.locator("h1").wait_for()
        page.evaluate(
            """async () => { const { fill, h } = await import("/static/js/dom.js"), box = h("div");
            document.querySelector("h1").before(box);
            window.clicked = 0;
            const count = () => (window.clicked += 1);
            window.anew = (words) => fill(box, h("button", { id: "drawn", onclick: count }, words));
            window.anew("old"); }"""
        )
        page.locator("#drawn").hover()
        page.mouse.down()
        page.evaluate("window.anew('new')")
        page.mouse.up()
        page.locator("#drawn", has_text="new").wait_for()
        assert page.evaluate("window.clicked") == 1
