"""The page's script, driven in a real browser without a window; skipped where there is none."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from evaluator.report.build import report_html
from evaluator.workflow import analyze
from tests.evaluator.browser import OpenPage, needs_browser
from tests.evaluator.synthetic import three_runs

pytestmark = needs_browser()

Drive = Callable[..., dict[str, Any]]
LONG_NAME = "turn-33.3-14.4-backward-again"

DRIVER = """async () => {
  const seen = {}, find = (name) => document.getElementById(`player-${name}`);
  const robot = () => document.querySelector("#player-plot g").getAttribute("transform");
  const scrub = (value) => { find("time").value = value; find("time").dispatchEvent(new Event("input")); };
    seen.paper = getComputedStyle(document.body).backgroundColor;
    seen.runs = [...find("run").options].map((option) => option.textContent);
    seen.start = robot();
    scrub(500);
    seen.middle = robot();
    seen.clock = find("clock").textContent;
    find("run").value = 1;
    find("run").dispatchEvent(new Event("change"));
    seen.other = robot();
    seen.note = find("note").textContent;
    let frame = null; // drawn when the test says so
    window.requestAnimationFrame = (step) => { frame = step; return 1; };
    window.cancelAnimationFrame = () => {};
    performance.now = () => 5000;
    scrub(100);
    find("play").click();
    for (const now of [5200, 5600]) frame(now);
    seen.played = Number(find("time").value);
    find("play").click();
    seen.button = find("play").textContent;
    seen.tables = [...document.querySelectorAll(".save a:first-child")].map((link) =>
      [link.download, decodeURIComponent(link.href.split(",").slice(1).join(",")).split("\\n")[0]]);
    URL.createObjectURL = (blob) => { seen.blob = blob; return "#"; };
    document.querySelector("#trajectories a.svg").click();
    const text = await seen.blob.text();
    const drawn = new DOMParser().parseFromString(text, "image/svg+xml");
    seen.svg = { panels: drawn.documentElement.querySelectorAll(":scope > svg").length,
      faulty: drawn.querySelector("parsererror") !== null, variables: text.includes("var(--") };
    delete seen.blob;
    const strokes = (selector) => [...document.querySelectorAll(selector)].map((line) =>
      [line.getAttribute("stroke"), (line.getAttribute("stroke-dasharray") ?? "none") !== "none"]);
    seen.legend = strokes("#player .legend line");
    seen.drawn = strokes("#player-plot > path, #player-plot > circle");
    seen.cut = [...document.querySelectorAll(".scroll")].filter((table) => table.scrollWidth > table.clientWidth)
      .map((table) => table.closest("section").id);
    seen.outside = [...document.querySelectorAll(".drawing > svg")].flatMap((drawing) => {
      const edge = drawing.getBoundingClientRect();
      return [...drawing.querySelectorAll("text")].filter((text) => {
        const box = text.getBoundingClientRect();
        return box.left < edge.left - 1 || box.right > edge.right + 1 || box.top < edge.top - 1
          || box.bottom > edge.bottom + 1;
      }).map((text) => text.textContent);
    });
    seen.wide = document.documentElement.scrollWidth - document.documentElement.clientWidth;
    return seen;
}"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("browser")
    experiment = three_runs(folder)
    text = experiment.read_text(encoding="utf-8").replace('"r02"', f'"{LONG_NAME}"')
    experiment.write_text(text, encoding="utf-8")
    path = folder / "report.html"
    path.write_text(report_html(analyze(experiment, folder / "out", simulate=True, workers=1)), encoding="utf-8")
    return path


@pytest.fixture
def driven(page: Path, open_page: OpenPage) -> Drive:
    """What the driver sees on a page of a width and colour scheme."""

    def drive(**options: Any) -> dict[str, Any]:
        with open_page(page.as_uri(), **options) as shown:
            seen: dict[str, Any] = shown.evaluate(DRIVER)
            return seen

    return drive


def test_player_scrubs_and_plays_and_figures_are_saved_with_their_data(driven: Drive) -> None:
    seen = driven(width=1200)
    assert [name.split(":")[0] for name in seen["runs"]] == ["r01", LONG_NAME, "r03"]
    assert len({seen["start"], seen["middle"], seen["other"]}) == 3
    assert seen["clock"] == "3.00 s"
    assert "radius 3.50 mm" in seen["note"]
    assert seen["played"] == 100 + 100  # from a tenth on, 0.6 of 6 s, in thousandths
    assert seen["button"] == "▶"
    assert ["radius-difference.csv", "run,left_rpm,right_rpm,radius_mm"] in [
        [name, ",".join(head.split(",")[:4])] for name, head in seen["tables"]
    ]
    assert seen["svg"] == {"panels": 3, "faulty": False, "variables": False}


def test_no_table_is_cut_on_a_laptop_and_the_legend_shows_the_lines_of_the_player(driven: Drive) -> None:
    seen = driven(width=1400)
    assert seen["cut"] == []
    assert seen["outside"] == []
    assert len(seen["legend"]) == 5
    assert seen["legend"] == seen["drawn"]


def test_the_page_is_dark_where_the_reader_is_and_fits_a_phone(driven: Drive) -> None:
    light, dark = driven(width=1200), driven(width=500, color_scheme="dark")
    assert light["paper"] == "rgb(254, 254, 254)"
    assert dark["paper"] == "rgb(22, 25, 29)"
    assert dark["wide"] == 0
