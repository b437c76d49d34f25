"""Pages of the paper, a slip bench, a self-test and the catalogue: sentences and rows from results that are known."""

from __future__ import annotations

from math import inf, nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from evaluator.report.pages import effects, paper, selftest, slip_bench
from evaluator.report.pages.html import Page
from evaluator.report.style import Figure
from evaluator.workflow.selftest.claims import at_most, exactly
from evaluator.workflow.selftest.run import Outcome, SelfTest
from simulator.effects.definition import Effect
from simulator.effects.parameter import Parameter
from simulator.paper.checks import CLOSE, CONJECTURE, FITTED, OUT_OF_SCOPE, Check
from simulator.slip.bench import LATERAL_OK
from simulator.slip.fit import NAMES, SlipFit

CHECKS = (
    Check("Fig. 1", "radius", "5 mm", "5.0 mm", "+0.00 %", "agrees"),
    Check("Fig. 2", "radius", "6 mm", "6.1 mm", "+1.67 %", CLOSE),
    Check("Fig. 3", "peak", "1", "1", "", CLOSE, FITTED),
    Check("Fig. 4", "turn", "-5 mm", "-9 mm", "+80 %", "differs"),
    Check("Fig. 5", "turn", "a", "b", "", "agrees", CONJECTURE),
    Check("Fig. 6", "turn", "a", "b", "", "not computed", OUT_OF_SCOPE),
)
READINGS = pd.DataFrame(
    {"reading": ["as printed", "degrees"], "radius_9a": [1.234, 2.0], "largest_deviation_percent": [3.0, 0.05]}
)


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> list[Page]:
    """Pages that would be written."""
    pages: list[Page] = []
    for module in (paper, slip_bench, selftest):
        monkeypatch.setattr(module, "page_html", lambda one: pages.append(one) or "")  # type: ignore[func-returns-value]
    return pages


def figure(name: str) -> Figure:
    return Figure(name, "title", "caption", ("<svg></svg>",), pd.DataFrame({"x": [1.0]}))


def test_the_paper_is_summed_up_by_how_much_each_row_is_worth(tmp_path: Path, written: list[Page]) -> None:
    first, missed = paper.summary_lines(CHECKS)
    assert first == (
        "2 published numbers and statements are computed with nothing fitted to them, 1 of these only within 3 %; "
        "1 are met by laws fitted to them; 1 rests on a conjecture; 1 are not reproduced; 1 are out of scope."
    )
    assert missed == "Not reproduced: Fig. 4, turn: published: −5 mm; ours: −9 mm."
    numbers = (3, 7, 8)
    names = [f"figure-{number}{panel}" for number in numbers for panel in "ab"]
    others = [f"figure-{number}" for number in (9, 10, 11, 12, 13, 14, 18, 20, 21)]
    found = paper.Paper(tuple(map(figure, reversed([*names, *others]))), CHECKS, READINGS)
    assert paper.write_paper(found, tmp_path) == tmp_path / "index.html"
    (page,) = written
    assert page.summary[-1].startswith("All five radii of Figures 9 and 10 are met within 0.05 % in one reading")
    assert ": degrees." in page.summary[-1]
    shown = {section.name: [one.name for one in section.figures] for section in page.sections}
    assert (shown["slip"], shown["turns"] + shown["states"]) == (names, others)
    assert page.sections[0].tables[0].rows[3][:4] == ("Fig. 4", "turn", "−5 mm", "−9 mm")
    assert page.sections[-1].tables[0].rows == (("as printed", "1.23", "3.00"), ("degrees", "2.00", "0.05"))
    assert page.sections[-1].tables[0].head[-1] == "largest deviation, %"
    assert {path.name for path in tmp_path.iterdir()} >= {
        "numbers.csv",
        "readings.csv",
        "figure-3a.svg",
        "figure-21.csv",
    }


def test_parts_of_the_paper_are_counted_while_they_are_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    for part in ("_slip_figures", "_attraction_figures", "_magnetic_figures", "_wheel_figures"):
        monkeypatch.setattr(paper, part, lambda part=part: [figure(part)])
    monkeypatch.setattr(paper, "published_numbers", lambda: list(CHECKS))
    monkeypatch.setattr(paper, "reading_table", lambda: READINGS)
    told: list[tuple[float, float]] = []
    found = paper.recompute(lambda _, done, total=1.0: told.append((done, total)))
    assert told == [(done, 6) for done in range(7)]
    assert len(found.figures) == 4
    assert found.checks == CHECKS


def fit(**more: Any) -> SlipFit:
    value = np.arange(7.0) - 1
    intervals = {"value": value, "low": value - 0.5, "high": value + 1, "relative_sigma": np.ones(7)}
    rest = {"misfit": 0.5, "measurements": 6, "torque_sigma_mN_mm": (0.0123, 1.5), "sigmas_given": True}
    return SlipFit(**{**intervals, **rest, **more})  # type: ignore[arg-type]


def test_a_slip_fit_is_told_with_its_intervals_and_what_they_rest_on() -> None:
    assert slip_bench.fit_rows(fit())[0] == (NAMES[0].replace("_", " "), "−1", "−1.5", "0")
    forces = pd.DataFrame({"lateral_status": [LATERAL_OK, "slip angle 0", "slip angle 0"]})
    sure, residual, unknown = slip_bench.fit_sentences(fit(), forces)
    assert sure.startswith("6 torques fitted; standard uncertainty 0.0123 mN·mm (wheel) and 1.5 mN·mm (disk), as the")
    assert residual == "RMS residual of the fit: 0.50 standard uncertainties."
    assert unknown.startswith("Lateral force unknown in 2 rows at slip angle 0")
    assert slip_bench.fit_sentences(fit(misfit=1.5), forces)[1].endswith("The intervals are widened by this factor.")
    (alone,) = slip_bench.fit_sentences(fit(sigmas_given=False), forces.iloc[:1])
    assert alone.endswith("estimated from the residuals.")


@pytest.mark.parametrize(("virtual", "given"), [(True, True), (False, False)])
def test_a_bench_is_written_with_its_torques_only_where_they_are_virtual(
    virtual: bool, given: bool, tmp_path: Path, written: list[Page], monkeypatch: pytest.MonkeyPatch
) -> None:
    angles: list[Any] = []
    used: list[pd.DataFrame] = []
    monkeypatch.setattr(
        slip_bench, "slip_curves", lambda _, at, driving: angles.append((list(at), driving)) or "curves"
    )
    monkeypatch.setattr(slip_bench, "slip_figures", lambda *_: [figure("slip-a")])
    monkeypatch.setattr(
        slip_bench, "forces_from_torques",
        lambda table, _: used.append(table) or pd.DataFrame({"lateral_status": [LATERAL_OK]}),
    )  # fmt: skip
    monkeypatch.setattr(slip_bench, "slip_toml", lambda _: "[slip]\n")
    monkeypatch.setattr(SlipFit, "slip", property(lambda _: None))
    apparatus = SimpleNamespace(wheel_radius_mm=4.0, contact_radius_mm=38.0)
    torques = pd.DataFrame({"slip_angle_deg": [15.0, 0.0, 15.0]})
    bench: Any = SimpleNamespace(
        name="b", torques=torques, fit=fit(sigmas_given=given), apparatus=apparatus, virtual=virtual
    )
    slip_bench.write_slip_bench(bench, tmp_path)
    assert (tmp_path / "bench.csv").exists() == virtual
    assert angles == [([0.0, 15.0], True)]
    assert ("wheel_torque_sigma_mN_mm" in used[0]) == (not given)
    (page,) = written
    assert page.facts == ("wheel radius 4 mm", "contact radius 38 mm")
    assert (tmp_path / "slip.toml").read_text() == "[slip]\n"


def test_a_self_test_passes_or_fails_row_by_row(written: list[Page], tmp_path: Path) -> None:
    claims = (at_most("a", "track", "error", 5.0, "µm", "noise"), exactly("b", "fit", "share", 1.0, "all"))
    outcomes = (Outcome(claims[0], 4.567), Outcome(claims[1], nan, "no turn"))
    machine = {"turnscope": "1.0", "system": "Linux"}
    found = SelfTest(outcomes, {"track": 1.25, "fit": 2.0}, machine, 7)
    assert selftest.outcome_rows(found) == [
        ("pass", "track", "error", "4.57 µm", "at most 5 µm"), ("FAIL", "fit", "share", "nothing", "1"),
    ]  # fmt: skip
    assert selftest.sentence_of(found) == (
        "1 of 2 claims does not hold on this machine (3 s): please send this page to the maintainers."
    )
    selftest.write_selftest(found, tmp_path / "a.html")
    (page,) = written
    assert (page.title, page.summary[1:]) == ("failed", ("fit: no turn",))
    assert page.facts == ("turnscope 1.0", "Linux", "seed 7")
    assert page.sections[1].tables[1].rows == (("track", "1.2 s"), ("fit", "2.0 s"))
    assert page.sections[2].tables[0].rows == (("error", "noise"), ("share", "all"))
    whole = SelfTest(outcomes[:1], {"track": 1.0}, machine, 7)
    assert selftest.sentence_of(whole) == "All 1 claims hold on this machine (1 s)."
    selftest.write_selftest(whole, tmp_path / "a.html")
    assert (written[1].title, len(written[1].summary)) == ("passed", 1)


def test_bounds_of_a_parameter_are_numbers_or_a_dash() -> None:
    parameters = (Parameter("a_mm", "mm", 0.0, 0.1, low=-2.5), Parameter("b", "", 1.0, 0.1, high=inf))
    effect: Effect = SimpleNamespace(parameters=parameters)  # type: ignore[assignment]
    assert effects.parameter_rows(effect) == (("a_mm", "mm", "0", "−2.5", "–"), ("b", "–", "1", "–", "–"))
