"""Commands on experiments: what they hand over, print and return, from results that are known."""

from __future__ import annotations

import json
from math import nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest

from evaluator.cli.analysis import name_of, radius, runs_by_note
from evaluator.cli.experiment.compare import comparison_text
from evaluator.cli.measurement.analyze import turning_text
from evaluator.report.diagnosis.view import DiagnosisView
from evaluator.report.numbers import MILLIMETRES
from evaluator.workflow.results.outputs import Outputs
from tests.evaluator.cli.called import run

ROWS = [
    {"run": "a", "left_rpm": 33.3, "right_rpm": -14.4, "radius_mm": 5.93, "radius_low_mm": 5.9, "radius_high_mm": 6.0,
     "group": "", "turned_deg": 90.0, "speed_mm_s": 1.25, "radius_status": "ok"},
    {"run": "b", "left_rpm": 30.0, "right_rpm": 30.0, "radius_mm": nan, "radius_low_mm": nan, "radius_high_mm": nan,
     "group": "", "turned_deg": 0.0, "speed_mm_s": 2.0, "radius_status": "straight: -0.1 1/m"},
    {"run": "lost", "left_rpm": 1.0, "right_rpm": 2.0, "radius_mm": nan, "radius_low_mm": nan, "radius_high_mm": nan,
     "group": "", "turned_deg": nan, "speed_mm_s": nan, "radius_status": ""},
]  # fmt: skip
COMPARED = [
    {"run": "a", "left_rpm": 33.3, "right_rpm": -14.4, "simulated_radius_mm": 5.95, "gap_rms_mm": 0.0123,
     "heading_gap_end_deg": -1.234},
    {"run": "b", "left_rpm": 30.0, "right_rpm": 30.0, "simulated_radius_mm": nan, "gap_rms_mm": 0.5,
     "heading_gap_end_deg": 0.5},
    {"run": "lost", "left_rpm": 1.0, "right_rpm": 2.0, "simulated_radius_mm": nan, "gap_rms_mm": nan,
     "heading_gap_end_deg": nan},
]  # fmt: skip


@pytest.fixture
def found() -> Any:
    """An analysis of two runs; a third one failed."""
    return SimpleNamespace(
        excluded_runs=frozenset(), experiment=SimpleNamespace(robot="barrel", run=[]),
        turning=pd.DataFrame(ROWS), comparison=pd.DataFrame(COMPARED), faults={"lost": "no marks"},
        notes={"a": ("dark",), "b": ("dark",)}, changed=(), outputs=Outputs(Path("out")),
    )  # fmt: skip


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, found: Any) -> list[dict[str, Any]]:
    """What the commands hand over to the analysis, which gives `found`."""
    given: list[dict[str, Any]] = []

    def analyze(experiment: Path, out: Path, **more: Any) -> Any:
        given.append({"experiment": str(experiment), "out": str(out), **more})
        return found

    monkeypatch.setattr("evaluator.workflow.analyze", analyze)
    monkeypatch.setattr("evaluator.report.build.write_report", lambda _: None)
    return given


PLACES = (
    "The intervals take the marks to be where robot.toml says; a usual error of their positions adds "
    "±0.09 mm (95 %, run a): state yours in robot.toml, [known_to] mark_position_mm."
)
TURNING = f"""run  rpm left / right  radius, mm            95 %  speed, mm/s
a        33.3 / −14.4       5.930  5.900 to 6.000        1.250
b             30 / 30    straight                        2.000
{PLACES}

out/turning.csv
"""
COMPARISON = f"""run  rpm left / right  radius, mm            95 %  simulated, mm  path gap, mm
a        33.3 / −14.4       5.930  5.900 to 6.000          5.950         0.012
b             30 / 30    straight                       straight         0.500
{PLACES}

out/comparison.csv
"""


@pytest.mark.parametrize(
    ("command", "simulate", "said"),
    [("analyze", False, TURNING), ("compare", True, COMPARISON), ("report", True, "out/report.html\n")],
)
def test_an_analysis_is_printed_as_a_table_as_json_or_not_at_all_and_faults_go_to_standard_error(
    command: str, simulate: bool, said: str, asked: list[dict[str, Any]], found: Any
) -> None:
    usual = run(command, "e.toml")
    assert (usual.stdout, usual.return_value) == (said, 1)
    assert usual.stderr == "lost: no marks\nnote: a, b: dark\n"
    first = asked[0]
    assert (first["experiment"], first["out"], first["simulate"]) == ("e.toml", "out", simulate)
    assert (first["workers"], first["dask"]) == (None, None)
    quiet = run(command, "e.toml", "-q", "-o", "there", "--workers", "3", "--dask", "tcp://host:1")
    assert (quiet.stdout, quiet.stderr, quiet.return_value) == ("", "lost: no marks\n", 1)
    assert (asked[1]["out"], asked[1]["workers"], asked[1]["dask"]) == ("there", 3, "tcp://host:1")
    found.faults.clear()
    whole = run(command, "e.toml", "--json")
    assert whole.return_value == 0
    content = json.loads(whole.stdout)
    if command == "report":
        assert content == {"report": "out/report.html", "faults": {}}
    else:
        assert [row["run"] for row in content] == ["a", "b", "lost"]
        assert content[2]["left_rpm"] == 1.0
        assert None in content[1].values()
    found.changed = tuple(Path(f"r{k}.csv") for k in range(8))
    assert "r0.csv, r1.csv, r2.csv, r3.csv, r4.csv, r5.csv changed during the analysis" in run(command, "e.toml").stderr


def test_a_report_is_written_of_what_was_analysed(asked: list[dict[str, Any]], found: Any, stub: Any) -> None:
    reports = stub("evaluator.report.build.write_report")
    run("report", "e.toml")
    assert reports == [((found,), {})]
    assert len(asked) == 1


@pytest.mark.parametrize("outdated", [True, False])
def test_a_report_with_a_diagnosis_of_earlier_inputs_is_written_with_a_note(
    asked: list[dict[str, Any]], monkeypatch: pytest.MonkeyPatch, outdated: bool
) -> None:
    monkeypatch.setattr("evaluator.report.build.write_report", lambda _: DiagnosisView({}, None, outdated))
    done = run("report", "e.toml")
    assert ("note: the diagnosis is out of date" in done.stderr) is outdated
    assert "out of date" not in run("report", "e.toml", "--quiet").stderr
    assert len(asked) == 2


def test_a_dash_in_place_of_a_radius_is_explained_in_a_line(found: Any) -> None:
    still = [{**ROWS[1], "run": name, "radius_mm": nan, "radius_status": "at rest"} for name in "cd"]
    found.turning, found.comparison = pd.DataFrame([*ROWS, *still]), None
    *table, why, places = turning_text(found, verbose=False).splitlines()
    assert len(table) == 5
    assert (why, places) == ("– in c, d: at rest", PLACES)
    assert "– in" not in turning_text(found, verbose=True)


def test_more_is_printed_of_every_run_where_asked_for(asked: list[dict[str, Any]], found: Any) -> None:
    table = turning_text(found, verbose=True).splitlines()
    assert table[0].endswith("remark")
    assert table[2].endswith("straight: −0.1 1/m")
    table = comparison_text(found, verbose=True).splitlines()
    assert table[0].endswith("heading gap, deg")
    assert table[1].endswith("−1.23")
    assert run("report", "e.toml", "-v").stdout.splitlines()[0].startswith("run  rpm left / right")
    assert len(asked) == 1


def test_lengths_of_a_large_robot_are_in_metres(found: Any) -> None:
    found.experiment.robot = str(Path(__file__).parents[2] / "driven_robot" / "husky.toml")
    head, turn, *_ = turning_text(found, verbose=False).splitlines()
    assert ("radius, m " in head, "speed, m/s" in head) == (True, True)
    assert turn.split()[4:] == ["0.006", "0.006", "to", "0.006", "0.001"]
    head, turn, straight, *_ = comparison_text(found, verbose=False).splitlines()
    assert ("radius, m " in head, "simulated, m " in head, head.endswith("path gap, m")) == (True, True, True)
    assert turn.split()[-2:] == ["0.006", "0.000"]
    assert straight.endswith("0.001")  # 0.5 mm, rounded up


@pytest.mark.parametrize("command", ["analyze", "compare", "report", "export"])
def test_a_dry_run_lists_what_would_be_computed(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[Any] = []

    def pending(experiment: Path, out: Path, *, simulate: bool) -> dict[str, list[str]]:
        given.append((str(experiment), str(out), simulate))
        return {"a": ["track", "measure"], "b": []}

    monkeypatch.setattr("evaluator.workflow.pending", pending)
    done = run(command, "e.toml", "--dry-run", "-o", "there")
    assert done.stdout == "a: track, measure\nb: up to date\n1 of 2 runs to compute, nothing was done (--dry-run)\n"
    assert done.return_value == 0
    assert given == [("e.toml", "there", command != "analyze")]


def test_an_export_prints_its_files_and_is_quiet_where_asked(
    monkeypatch: pytest.MonkeyPatch, asked: list[dict[str, Any]]
) -> None:
    monkeypatch.setattr("evaluator.workflow.export", lambda _: [Path("out/results.json"), Path("out/netcdf/a.nc")])
    assert run("export", "e.toml").stdout == "out/results.json\nout/netcdf/a.nc\n"
    assert run("export", "e.toml", "-q").stdout == ""
    assert [each["simulate"] for each in asked] == [True, True]
    assert run("export", "e.toml").return_value == 1


@pytest.mark.parametrize(
    ("turned_deg", "radius_mm", "status", "right_rpm", "said"),
    [
        (1.01, 5.0, "ok", 30.0, ("5.000", "4.000 to 6.000")),
        (-90.0, 5.0, "ok", 30.0, ("5.000", "4.000 to 6.000")),
        (1.0, 5.0, "ok", 30.0, ("straight", "")),
        (0.5, nan, "turns too little: by 0.5 degrees", 30.0, ("straight", "")),
        (0.5, nan, "turns too little: by 0.5 degrees", 15.0, ("turns < 1°", "")),  # a phase of 0.2 s in a ramp
        (90.0, nan, "straight: so", 15.0, ("straight", "")),
        (5.0, nan, "straight or hardly turning: so", 30.0, ("straight", "")),
        (5.0, nan, "straight or hardly turning: so", 15.0, ("–", "")),  # the reason is told below the table
        (90.0, nan, "too short", 30.0, ("–", "")),
    ],
)
def test_a_radius_is_a_number_where_the_eye_sees_a_turn(
    turned_deg: float, radius_mm: float, status: str, right_rpm: float, said: tuple[str, str]
) -> None:
    row = {"radius_mm": radius_mm, "radius_low_mm": 4.0, "radius_high_mm": 6.0}
    row |= {"left_rpm": 30.0, "right_rpm": right_rpm}
    assert radius({**row, "turned_deg": turned_deg, "radius_status": status}, MILLIMETRES) == said


def test_a_short_turn_of_unequal_sides_is_not_called_straight_in_the_simulation(found: Any) -> None:
    """Its simulation turned by 0.9 degrees."""
    for table in (found.turning, found.comparison):
        table.loc[1, "right_rpm"] = 25.0
    found.turning.loc[1, "radius_status"] = "straight or hardly turning: so"
    (row,) = [line for line in comparison_text(found, verbose=False).splitlines() if line.startswith("b ")]
    assert row.split()[1:] == ["30", "/", "25", "–", "–", "0.500"]


def test_a_run_without_a_command_and_a_phase_have_their_signs_in_the_table(found: Any) -> None:
    assert name_of({"run": "a", "phase": 2.0}) == "a (2)"
    assert name_of({"run": "a", "phase": nan}) == name_of({"run": "a"}) == name_of({"run": "a"}, {"b"}) == "a"
    assert name_of({"run": "a", "phase": 2.0}, {"a"}) == "a (2) (left out)"
    found.comparison.loc[1, "left_rpm"] = nan
    assert comparison_text(found, verbose=False).splitlines()[2].split()[-2:] == ["–", "0.500"]


def test_notes_of_many_runs_that_differ_in_numbers_become_one_with_their_range() -> None:
    notes = {f"r{k}": (f"mark 2 is {k + 1} px off in f{k}.mp4", "dark") for k in range(7)}
    found = runs_by_note({name: (said[0].replace(f"f{name[1:]}", "f"), said[1]) for name, said in notes.items()})
    everyone = [f"r{k}" for k in range(7)]
    assert found == {"mark 2 is 1 to 7 px off in f.mp4": everyone, "dark": everyone}
    few = runs_by_note({f"r{k}": (f"{k} px",) for k in range(6)})
    assert list(few) == [f"{k} px" for k in range(6)]


def test_of_many_runs_with_one_note_six_are_named(asked: list[dict[str, Any]], found: Any) -> None:
    found.notes = {f"r{k}": ("dark",) for k in range(6)}
    assert "note: r0, r1, r2, r3, r4, r5: dark" in run("analyze", "e.toml").stderr
    found.notes["r6"] = ("dark",)
    assert "note: r0, r1, r2, r3, r4, r5, … (7 runs): dark" in run("analyze", "e.toml").stderr
    assert len(asked) == 2
