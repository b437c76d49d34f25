"""The studio in a real browser: the main job by mouse, the table by keyboard, every screen at several sizes."""

from __future__ import annotations

import re
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from tests.evaluator.browser import OpenPage, needs_browser
from tests.evaluator.diagnosis.hidden import COMMANDS, write_hidden
from tests.evaluator.studio.recordings import finished
from tests.evaluator.studio.serving import Serving, serving
from tests.waiting import HANGS_S

pytestmark = needs_browser()


MIDDLE_OF_PATH = """async (id) => { const { view, boundsOf } = await import("/static/js/plate.js");
  const { runs: [run] } = await (await fetch(`/api/experiments/${id}/results`)).json();
  const { clientWidth: width, clientHeight: height } = document.querySelector("canvas[aria-label^=Trajectory]");
  const to = view(boundsOf([run.path, run.simulated]), width, height, 40), k = run.path.time_s.length >> 1;
  return [to.x(run.path.x_mm[k]), to.y(run.path.y_mm[k]), run.path.time_s[k]]; }"""


def gap_mm(page: Any) -> float:
    """The figure "gap of model and robot" of the screen Results."""
    figure = page.locator("[data-figure=gap]")
    figure.wait_for()
    return float(figure.get_attribute("data-value"))


def test_main_job_by_mouse(studio: Serving, tmp_path: Path, open_page: OpenPage) -> None:
    """A start is dragged, runs are analysed, an effect is added to the robot, and the gap changes; names stay text."""
    toml = tmp_path / "folder" / "experiment.toml"
    with open_page(studio.link) as page:
        page.get_by_text("two runs").click()
        page.locator("h1", has_text="<img src=x").wait_for()  # shown as text, not run
        page.locator(".axis").wait_for()
        page.get_by_label("Remove run left").click()
        page.get_by_label("start, s, run right").wait_for()
        page.locator("input[aria-label='run, run left']").wait_for(state="detached")
        axis = page.locator(".axis").bounding_box()
        last = float(page.locator(".clock").inner_text().split("of")[1]) / 60
        at = axis["x"] + 10 + 0.5 / last * (axis["width"] - 20)
        page.mouse.move(at, axis["y"] + 8)
        page.mouse.down()
        page.mouse.move(at + 40, axis["y"] + 8, steps=4)
        page.mouse.up()
        page.wait_for_function("() => document.querySelector('input[data-key=start_s]').value !== '0.5'")
        moved = 0.5 + 40 / (axis["width"] - 20) * last
        assert float(re.findall(r"start_s = ([\d.]+)", toml.read_text())[0]) == pytest.approx(moved, abs=0.03)
        page.get_by_role("button", name="Undo", exact=True).click()
        page.wait_for_function("() => document.querySelector('input[data-key=start_s]').value === '0.5'")
        page.get_by_role("button", name=re.compile("^Analyse")).click()
        finished(page, "All runs are analysed")
        page.locator("nav").get_by_role("link", name="Results").click()
        before = gap_mm(page)
        page.get_by_role("link", name="Sandbox").click()
        page.get_by_text("both driving wheels are faster").click()
        page.get_by_label("factor, drive-speed-scale").fill("1.05")
        page.locator("td", has_text="%").first.wait_for()
        page.get_by_role("button", name="Add to the robot").click()
        finished(page, "Written to robot.toml")
        page.get_by_role("link", name="Runs").click()
        page.get_by_role("button", name=re.compile("^Analyse 1 of 1")).click()
        finished(page, "All runs are analysed")
        page.locator("nav").get_by_role("link", name="Results").click()
        assert gap_mm(page) > 3 * before  # the recording was made without it
        x, y, time = page.evaluate(MIDDLE_OF_PATH, studio.get("/api/home")["experiments"][0]["id"])
        page.locator("canvas[aria-label^=Trajectory]").click(position={"x": x, "y": y})
        page.locator(".clock", has_text=f"{time:.3f} s").wait_for()  # a click on the path leads to its frame
    assert 'id = "drive-speed-scale"' in (tmp_path / "folder" / "robot.toml").read_text()


def test_table_and_player_by_keyboard(studio: Serving, tmp_path: Path, open_page: OpenPage) -> None:
    toml = tmp_path / "folder" / "experiment.toml"
    with open_page(studio.link) as page:
        page.locator("a.card").first.focus()
        page.keyboard.press("Enter")
        cell = page.get_by_label("left, rpm, run left")
        cell.focus()
        page.keyboard.type("12,5")
        page.keyboard.press("Enter")  # to the row below
        assert page.evaluate("document.activeElement.dataset.row") == "1"
        page.wait_for_function("() => document.querySelector('input[data-key=left_rpm]').value === '12.5'")
        assert "left_rpm = 12.5" in toml.read_text()
        page.locator(".film").focus()
        page.keyboard.press("Control+z")
        page.wait_for_function("() => document.querySelector('input[data-key=left_rpm]').value === '5'")
        page.locator(".film").focus()
        for key in ("Home", "ArrowRight", "ArrowRight", "Shift+ArrowRight"):
            page.keyboard.press(key)
        assert "frame 12 of" in page.locator(".clock").inner_text()
        page.keyboard.press("s")
        page.wait_for_function(
            "() => [...document.querySelectorAll('input[data-key=start_s]')].some((c) => c.value === '0.2')"
        )
        page.keyboard.press(" ")
        page.get_by_label("Pause", exact=True).wait_for()


def test_pasted_rows_and_faults_in_place(studio: Serving, open_page: OpenPage) -> None:
    with open_page(studio.link) as page:
        page.get_by_text("two runs").click()
        page.get_by_label("run, run right").focus()
        block = "second\t10\t20\nthird\t-30,5\tnonsense\nfourth\t5\tnonsense\n"
        page.evaluate(
            """(text) => { const data = new DataTransfer(); data.setData("text", text);
            document.activeElement.dispatchEvent(
            new ClipboardEvent("paste", { clipboardData: data, bubbles: true })); }""",
            block,
        )
        page.get_by_label("left, rpm, run third").wait_for()
        assert page.get_by_label("left, rpm, run third").input_value() == "-30.5"
        assert "“nonsense” is not a number" in page.locator(".problems").inner_text()
        assert "third, fourth: right_rpm is missing" in page.locator(".problems").inner_text()
        assert page.locator("td.fault input[data-row='2'][data-key='right_rpm']").count() == 1


def test_a_tab_is_told_and_shows_what_another_wrote_and_does_not_write_over_it(
    studio: Serving, tmp_path: Path, open_page: OpenPage
) -> None:
    from playwright.sync_api import expect

    with open_page(studio.link) as page:
        page.get_by_text("two runs").click()
        page.get_by_label("group, run left").wait_for()
        other = page.context.new_page()
        other.goto(page.url)
        other.get_by_label("group, run left").fill("second tab")
        other.keyboard.press("Enter")
        expect(other.get_by_role("button", name="Undo", exact=True)).to_be_enabled()  # it is written
        page.get_by_label("group, run left").fill("first tab")
        page.keyboard.press("Enter")
        page.locator("#said", has_text="changed meanwhile").wait_for()
        expect(page.get_by_label("group, run left")).to_have_value("second tab")
    text = (tmp_path / "folder" / "experiment.toml").read_text()
    assert 'group = "second tab"' in text
    assert "first tab" not in text


def test_no_screen_is_wider_than_its_window_and_all_controls_have_names(studio: Serving, open_page: OpenPage) -> None:
    identifier = studio.get("/api/home")["experiments"][0]["id"]
    screens = ["#/", "#/camera", "#/sandbox"]
    screens += [f"#/x/{identifier}/{name}" for name in ("runs", "marks", "results", "diagnosis", "sandbox")]
    with open_page(studio.link) as page:
        for (width, theme), screen in product(((1024, "light"), (1280, "dark"), (3840, "light")), screens):
            page.set_viewport_size({"width": width, "height": width * 3 // 5})
            page.emulate_media(color_scheme=theme)
            page.goto(f"{studio.origin}/{screen}")
            page.locator(f".screen.{screen.rsplit('/', 1)[1] or 'home'}").wait_for()
            page.locator("#main [role=status]").wait_for(state="detached")  # what is shown until the screen is there
            page.locator("h1").first.wait_for()
            wide = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
            assert wide <= 0, (screen, width)
            nameless = page.evaluate(
                """() => [...document.querySelectorAll("button, input, select, a, canvas")].filter((one) =>
                !(one.ariaLabel || one.textContent.trim() || one.labels?.length || one.closest("button, label")))
                .map((one) => one.outerHTML)"""
            )
            assert nameless == [], (screen, width)
            if screen.endswith("/runs"):
                table = page.locator(".sheet .scroll")
                assert table.evaluate("(box) => box.scrollWidth - box.clientWidth") <= 0


def contrast(one: str, other: str) -> float:
    """Ratio of WCAG 2 of two CSS colours."""

    def luminance(color: str) -> float:
        parts = [int(part) / 255 for part in re.findall(r"\d+", color)[:3]]
        linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    light, dim = sorted((luminance(one), luminance(other)), reverse=True)
    return (light + 0.05) / (dim + 0.05)


def test_text_has_contrast_aa_light_and_dark(studio: Serving, open_page: OpenPage) -> None:
    with open_page(studio.link) as page:
        light, dark = colour_pairs(page, "light"), colour_pairs(page, "dark")
    assert light != dark
    for pairs in (light, dark):
        assert {name: round(contrast(a, b), 2) for name, a, b in pairs if contrast(a, b) < 4.5} == {}


def colour_pairs(page: Any, theme: str) -> list[tuple[str, str, str]]:
    """Colours of text and of what it stands on, with their names, in a theme."""
    page.emulate_media(color_scheme=theme)
    found: list[tuple[str, str, str]] = page.evaluate(
        """() => { const probe = document.createElement("i"); document.body.append(probe);
        const rgb = (name) => { probe.style.color = `var(--${name})`; return getComputedStyle(probe).color; };
        return [["ink", "paper"], ["soft", "paper"], ["soft", "raised"], ["warn", "paper"], ["good", "paper"],
        ["blue", "paper"], ["on-blue", "blue"]].map(([a, b]) => [a + " on " + b, rgb(a), rgb(b)]); }"""
    )
    return found


def test_colours_are_those_of_the_report() -> None:
    import evaluator.studio
    from evaluator.report.pages.colors import THEME

    css = (Path(evaluator.studio.__file__).parent / "static" / "base.css").read_text()
    light, dark = css.split("prefers-color-scheme: dark")[:2]
    for color, (variable, in_the_dark) in THEME.items():
        assert f"{variable}: {color};" in light
        assert f"{variable}: {in_the_dark};" in dark


def test_a_hidden_effect_is_found_added_to_the_robot_and_the_gap_shrinks(tmp_path: Path, open_page: OpenPage) -> None:
    hidden = {"drive-speed-mismatch": {"left_over_right": 1.05}}
    write_hidden(tmp_path / "monday", hidden, commands=COMMANDS[:4], seconds=3.0, exact=True)
    with serving(tmp_path) as studio, open_page(studio.link) as page:
        page.locator("a.card").click()
        page.get_by_role("button", name="Diagnose").click()
        finished(page, "The diagnosis is done")
        page.locator("nav").get_by_role("link", name="Results").click()
        before = gap_mm(page)
        page.get_by_role("link", name="Diagnosis").click()
        page.locator(".found .kind", has_text="drive-speed-mismatch").wait_for()
        page.get_by_text("up to date", exact=True).wait_for()
        page.get_by_role("button", name="New effect").click()
        page.keyboard.type("a-push")
        page.get_by_label("What is wrong, in a few words").fill("something pushes")
        page.get_by_role("button", name="Write it").click()
        page.get_by_text("changed after this diagnosis").wait_for()  # there is an effect that is new
        page.get_by_role("button", name="Take a-push away").click()
        page.get_by_text("up to date", exact=True).wait_for()
        page.get_by_role("button", name="Add it to the robot").click()
        page.get_by_text("in the robot", exact=True).wait_for()
        page.get_by_role("button", name="Analyse with it").click()
        page.locator("nav").get_by_role("link", name="Results").click()
        page.wait_for_function(
            "(before) => Number(document.querySelector('[data-figure=gap]')?.dataset.value ?? 1) < before / 4",
            arg=before,
            timeout=1000 * HANGS_S,
        )
    assert 'id = "drive-speed-mismatch"' in (tmp_path / "monday" / "robot.toml").read_text()
