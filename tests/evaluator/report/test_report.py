from __future__ import annotations

import base64
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import cv2
import numpy as np
import pytest

from evaluator.diagnosis.assessment.residuals.disagreement import COLUMNS, QUANTITIES
from evaluator.files import write_text
from evaluator.report.build import report_html
from evaluator.report.diagnosis.view import DiagnosisView
from evaluator.report.pages.colors import THEME
from evaluator.templates.formats import PAGE
from evaluator.templates.result_tables import DISAGREEMENT
from evaluator.workflow import Analysis, analyze
from tests.evaluator.synthetic import circling_marks, three_runs, write_experiment


@pytest.fixture(scope="module")
def analysis(tmp_path_factory: pytest.TempPathFactory) -> Analysis:
    folder = tmp_path_factory.mktemp("report")
    return analyze(three_runs(folder), folder / "out", simulate=True, workers=1)


@pytest.fixture(scope="module")
def page(analysis: Analysis) -> str:
    return with_spaces(report_html(analysis))


def with_spaces(html: str) -> str:
    """The page with plain spaces between numbers and their units."""
    return html.replace("\u00a0", " ")


class Links(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("href", "src", "xlink:href") and value and tag != "use":
                self.addresses.append(value)


def test_the_page_needs_nothing_from_elsewhere(page: str) -> None:
    links = Links()
    links.feed(page)
    assert links.addresses
    assert all(address.startswith(("data:", "#")) for address in links.addresses)
    assert "url(http" not in page
    assert "@import" not in page


def test_every_figure_carries_the_numbers_behind_it(page: str) -> None:
    assert page.count("<figure") == page.count('href="data:text/csv') >= 4
    (data,) = re.findall(r'download="radius-difference.csv" href="data:text/csv;charset=utf-8,([^"]*)"', page)
    lines = unquote(data).strip().splitlines()
    assert lines[0].startswith("run,left_rpm,right_rpm,radius_mm")
    assert [line.split(",")[0] for line in lines[1:]] == ["r01", "r02"]


def test_no_color_of_a_figure_is_out_of_reach_of_the_dark_page(page: str) -> None:
    drawings = " ".join(re.findall(r"<svg xmlns.*?</svg>", page, flags=re.DOTALL))
    plain = re.sub(r"var\(--[a-z]+, #[0-9a-f]{6}\)", "", drawings)
    assert drawings
    assert re.findall(r"#[0-9a-f]{6}\b", plain) == []
    assert all(variable in page for variable, _ in THEME.values())


def test_ids_inside_the_page_are_unique(page: str) -> None:
    ids = [name for name in re.findall(r'\sid="([^"]+)"', page) if re.fullmatch(r"[mp][0-9a-f]{6,}", name)]
    assert ids
    assert len(ids) == len(set(ids))


def test_the_player_has_every_run_with_gaps_as_null(page: str) -> None:
    (text,) = re.findall(r'id="player-data">(.*?)</script>', page, flags=re.DOTALL)
    runs = json.loads(text)["runs"]
    assert [run["label"].split(":")[0] for run in runs] == ["r01", "r02", "r03"]
    assert len({len(runs[0][name]) for name in ("t", "x", "y", "heading", "sy")}) == 1
    assert {len(axis) for mark in runs[0]["marks"] for axis in mark} == {len(runs[0]["t"])}


def test_the_summary_names_the_tightest_turn_with_the_digits_its_interval_bears(page: str) -> None:
    (found,) = re.findall(r"The tightest turn has a radius of ([0-9.]+) mm \(95 %: ([0-9.]+) to ([0-9.]+) mm", page)
    radius, low, high = map(float, found)
    assert radius == pytest.approx(3.5, rel=2e-3)
    assert low < radius < high


def test_slips_of_the_wheels_stand_measured_beside_simulated(page: str) -> None:
    table = page[page.index("Upper line: measured") :]
    row = re.sub("<[^>]*>", " ", table[: table.index("</tr>", table.index("<tbody>"))])
    assert "slip ratio, front left" in row
    assert len(re.findall(r"[−0-9.]+\n[−0-9.]+", row.split("r01")[-1])) == 7


def test_repetitions_and_directions_are_pooled_on_the_page(tmp_path: Path) -> None:
    runs = [(f"f{k}", 14.4, 33.3, circling_marks(6.0 + 0.05 * k, seed=k, seconds=3)) for k in range(3)]
    runs += [(f"b{k}", -14.4, -33.3, circling_marks(5.5, speed_mm_s=-2.0, seed=9 + k, seconds=3)) for k in range(2)]
    found = analyze(write_experiment(tmp_path, runs), tmp_path / "out", simulate=True, workers=1)
    html = with_spaces(report_html(found))
    assert undescribed("directions.csv", found.outputs.directions) == []
    assert 'id="repetitions"' in html
    assert "1 of 2 commands have fewer; 14.4 / 33.3, −14.4 / −33.3 rpm were driven to one side only" in html
    (bounds,) = re.findall(r"Backward turns are ([0-9.]+) % tighter than forward turns", html)
    assert float(bounds) == pytest.approx(100 * (1 - 5.5 / 6.05), rel=0.1)


def test_the_same_results_give_the_same_page(analysis: Analysis, page: str) -> None:
    assert with_spaces(report_html(analysis)) == page


def test_a_summary_with_a_diagnosis_of_earlier_inputs_says_so_first(
    analysis: Analysis, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The diagnosis of another experiment stood in the summary; a later section alone said that it was outdated."""
    old = DiagnosisView({"format": 1, "verdict": "none", "effects": []}, None, outdated=True)
    monkeypatch.setattr("evaluator.report.build.known_diagnosis", lambda *_: old)
    first = re.search(r'<ul class="summary"><li>(.*?)</li>', report_html(analysis))
    assert first is not None
    assert first[1].startswith("The diagnosis is out of date, because recordings, robot or program changed after it")


def test_straight_runs_alone_make_a_report_without_a_radius(tmp_path: Path) -> None:
    experiment = write_experiment(tmp_path, [("r01", 30.0, 30.0, circling_marks(np.inf))])
    html = report_html(analyze(experiment, tmp_path / "out", simulate=True, workers=1))
    assert "No run turns" in html


def undescribed(name: str, path: Path) -> list[str]:
    """Columns or keys of a written file that its part of the page of formats does not name."""
    text = path.read_text(encoding="utf-8")
    written = list(json.loads(text)) if path.suffix == ".json" else text.partition("\n")[0].split(",")
    described = PAGE.read_text(encoding="utf-8").partition(f"## {name}\n")[2].partition("\n## ")[0]
    stands_for = {"MARK": "(green|yellow)", "WHEEL": "(front|rear)_(left|right)", "NAME": ".*"}
    known = re.findall(r"`(\w+)`", described)
    for word, names in stands_for.items():
        known = [item.replace(word, names) for item in known]
    return [key for key in written if not any(re.fullmatch(item, key) for item in known)]


def test_every_column_of_the_written_tables_is_described_on_the_page_of_formats(analysis: Analysis) -> None:
    outputs = analysis.outputs
    files = {"marks/RUN.csv": outputs.marks("r01"), "poses/RUN.csv": outputs.poses("r01")}
    files |= {"simulated/RUN.csv": outputs.simulated("r01"), "provenance.json": outputs.provenance}
    files |= {path.name: path for path in (outputs.comparison, outputs.pooled, outputs.turning)}
    assert {name: undescribed(name, path) for name, path in files.items()} == {name: [] for name in files}
    pieces = {*COLUMNS, *(f"after_{name}" for name in QUANTITIES)}
    assert {key for keys in DISAGREEMENT for key in keys.split(", ")} >= pieces


@pytest.mark.exam
def test_fifty_runs_with_rich_images_make_a_page_below_five_megabytes(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    runs = [(f"r{k:02d}", 14.4, 33.3, circling_marks(6.0, seed=k, seconds=1)) for k in range(50)]
    found = analyze(write_experiment(tmp_path, runs), tmp_path / "out", simulate=True, workers=1)
    grain = rng.normal(90, 25, (240, 320)).clip(0, 255).astype(np.uint8)  # nothing compresses worse
    jpeg = base64.b64encode(cv2.imencode(".jpg", grain, [cv2.IMWRITE_JPEG_QUALITY, 72])[1].tobytes()).decode()
    images = json.dumps([{"time_s": float(k), "jpeg": jpeg} for k in range(12)])
    for run, *_ in runs:
        write_text(found.outputs.thumbnails(run), images)
    assert len(images) * len(runs) > 15e6
    assert len(report_html(found).encode()) < 5e6
