"""The page's script, driven once in a real browser without a window; skipped where there is none."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from evaluator.report.build import report_html
from evaluator.workflow import analyze
from tests.evaluator.synthetic import three_runs

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="there is no Chromium on this machine")

LONG_NAME = "turn-33.3-14.4-backward-again"

DRIVER = """
<script>
window.addEventListener("load", async () => {
  const seen = {}, find = (name) => document.getElementById(`player-${name}`);
  const robot = () => document.querySelector("#player-plot g").getAttribute("transform");
  const scrub = (value) => { find("time").value = value; find("time").dispatchEvent(new Event("input")); };
  try {
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
    // Nothing is drawn while the DOM is dumped, so no frame would ever be asked for.
    window.requestAnimationFrame = (step) => setTimeout(() => step(performance.now()), 16);
    window.cancelAnimationFrame = clearTimeout;
    find("play").click();
    await new Promise((done) => setTimeout(done, 600));
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
  } catch (error) { seen.error = String(error); }
  const result = document.createElement("pre");
  result.id = "seen";
  result.textContent = JSON.stringify(seen);
  document.body.append(result);
});
</script>
"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("browser")
    experiment = three_runs(folder)
    text = experiment.read_text(encoding="utf-8").replace('"r02"', f'"{LONG_NAME}"')
    experiment.write_text(text, encoding="utf-8")
    text = report_html(analyze(experiment, folder / "out", simulate=True, workers=1))
    path = folder / "driven.html"
    path.write_text(text.replace("</body>", f"{DRIVER}</body>"), encoding="utf-8")
    return path


def driven(page: Path, *, dark: bool, width: int = 1200) -> dict[str, Any]:
    """What the driver saw."""
    assert BROWSER is not None
    switches = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", f"--window-size={width},900"]
    switches += [
        f"--user-data-dir={page.parent / 'profile'}",
        f"--blink-settings=preferredColorScheme={0 if dark else 1}",
    ]
    done = subprocess.run(
        [BROWSER, *switches, "--virtual-time-budget=5000", "--dump-dom", page.as_uri()],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    (text,) = re.findall(r'<pre id="seen">(.*?)</pre>', done.stdout, flags=re.DOTALL)
    seen: dict[str, Any] = json.loads(html.unescape(text))
    assert "error" not in seen, seen["error"]
    return seen


def test_player_scrubs_and_plays_and_figures_are_saved_with_their_data(page: Path) -> None:
    seen = driven(page, dark=False)
    assert [name.split(":")[0] for name in seen["runs"]] == ["r01", LONG_NAME, "r03"]
    assert len({seen["start"], seen["middle"], seen["other"]}) == 3
    assert seen["clock"] == "3.00 s"
    assert "radius 3.50 mm" in seen["note"]
    assert 30 < seen["played"] < 400  # 0.6 of 6 s, in thousandths
    assert seen["button"] == "▶"
    assert ["radius-difference.csv", "run,left_rpm,right_rpm,radius_mm"] in [
        [name, ",".join(head.split(",")[:4])] for name, head in seen["tables"]
    ]
    assert seen["svg"] == {"panels": 3, "faulty": False, "variables": False}


def test_no_table_is_cut_on_a_laptop_and_the_legend_shows_the_lines_of_the_player(page: Path) -> None:
    seen = driven(page, dark=False, width=1400)
    assert seen["cut"] == []
    assert seen["outside"] == []
    assert len(seen["legend"]) == 5
    assert seen["legend"] == seen["drawn"]


def test_the_page_is_dark_where_the_reader_is_and_fits_a_phone(page: Path) -> None:
    light, dark = driven(page, dark=False), driven(page, dark=True, width=500)
    assert light["paper"] == "rgb(254, 254, 254)"
    assert dark["paper"] == "rgb(22, 25, 29)"
    assert dark["wide"] == 0
