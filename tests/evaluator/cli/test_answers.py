"""diagnose, plan, demo, track and turning: what they ask for, print, write and return."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
import pandas as pd
import pytest

from evaluator.cli.measurement.turning import WithMarkNames, _misspelt
from evaluator.diagnosis.design.candidate_runs import CandidateRun
from evaluator.diagnosis.design.plan import Expected
from evaluator.errors import InputError
from evaluator.workflow import DiagnosisResult, Plan
from evaluator.workflow.circular.runs import CircularRun
from evaluator.workflow.diagnosis.batch import Answer
from evaluator.workflow.results.outputs import Outputs
from simulator.effects.catalogue import EFFECTS
from tests.evaluator.cli.called import Called, run

NONE: dict[str, Any] = {"verdict": "none", "reason": "so", "effects": []}


def answer(folder: str = "out", *, anew: bool = True, **more: Any) -> DiagnosisResult:
    return DiagnosisResult(Path("e.toml"), Path(folder), {**NONE, **more}, anew)


def test_a_diagnosis_is_printed_with_its_file_and_runs_left_out_give_status_1(stub: Any) -> None:
    stub("evaluator.cli.experiment.diagnose.say_doubts")  # there is no file
    called: Called = stub("evaluator.workflow.diagnose", answer())
    done = run("diagnose", "e.toml")
    assert done.return_value == 0
    assert done.stdout.startswith("Nothing is missing")
    assert done.stdout.endswith("So.\n\nout/diagnosis.json\n")
    assert called[0] == (
        (Path("e.toml"), Path("out")), {"workers": None, "dask": None, "effects": (), "seconds": 180.0},
    )  # fmt: skip
    called.result = answer(anew=False, skipped_runs={"r1": "dark"}, changed_meanwhile=["r2.csv", "r3.csv"])
    again = run("diagnose", "e.toml", "--seconds", "5", "--effect", "a.toml", "--effect", "b.py", "--workers", "2")
    assert (again.return_value, again.stderr) == (1, "r1 is left out: dark\n")
    assert "out/diagnosis.json  (up to date, not computed again)\n" in again.stdout
    assert "r2.csv, r3.csv changed during the search" in again.stdout
    assert called[1][1] == {"workers": 2, "dask": None, "effects": (Path("a.toml"), Path("b.py")), "seconds": 5.0}
    assert run("diagnose", "e.toml", "-q").stdout == ""
    assert json.loads(run("diagnose", "e.toml", "--json").stdout)["verdict"] == "none"


def test_an_effect_is_described_by_its_name_its_sentence_and_its_law() -> None:
    said = " ".join(run("effects", "plate-tilt").stdout.split())
    effect = EFFECTS["plate-tilt"]
    for words in (f"{effect.id}: {effect.name}", effect.sentence, effect.law, effect.source):
        assert " ".join(words.split()) in said


def test_a_free_form_term_is_offered_and_written_under_the_name_of_its_file(stub: Any, tmp_path: Path) -> None:
    stub("evaluator.cli.experiment.diagnose.say_doubts")  # there is no file
    called: Called = stub("evaluator.workflow.diagnose", answer(str(tmp_path), verdict="unknown"))
    forms = Outputs(tmp_path).own_effects
    forms[0].write_text('format = 1\nid = "old-one"\nname = "x"\n')
    offered = run("diagnose", "e.toml").stdout
    assert f"{forms[0]}  (the best free-form term" in offered
    assert str(forms[1]) not in offered
    target = tmp_path / "my-own.toml"
    written = run("diagnose", "e.toml", "--write-effect", str(target))
    assert written.stderr == f"{target}\n"
    assert target.read_text() == 'format = 1\nid = "my-own"\nname = "x"\n'
    called.result = answer(str(tmp_path), verdict="effect")
    assert "free-form" not in run("diagnose", "e.toml").stdout
    refused = run("diagnose", "e.toml", "--write-effect", str(target)).exception
    assert str(refused).endswith("the verdict is effect; there is no free-form term to write")


def test_several_experiments_are_printed_one_after_the_other_and_refused_only_together(stub: Any) -> None:
    first, second = (
        Answer(Path("a.toml"), Path("out/a"), dict(NONE)),
        Answer(Path("b.toml"), Path("out/b"), fault="b: no"),
    )
    called: Called = stub("evaluator.workflow.diagnose_each", [first, second])
    done = run("diagnose", "a.toml", "b.toml", "--workers", "2")
    assert (done.return_value, done.stderr) == (1, "b: no\n")
    assert done.stdout.startswith("a.toml:\nNothing is missing")
    assert done.stdout.endswith("out/a/diagnosis.json  (up to date, not computed again)\n\n")
    assert called[0][1] == {"workers": 2, "dask": None, "seconds": 180.0}
    assert json.loads(run("diagnose", "a.toml", "b.toml", "--json").stdout) == {"a.toml": NONE, "b.toml": None}
    assert run("diagnose", "a.toml", "b.toml", "-q").stdout == ""
    called.result = [first, Answer(Path("b.toml"), Path("out/b"), {**NONE, "skipped_runs": {"r": "x"}}), first]
    assert run("diagnose", "a.toml", "b.toml").return_value == 1
    called.result = [first, first]
    assert run("diagnose", "a.toml", "b.toml").return_value == 0
    called.result = [second, second]
    assert str(run("diagnose", "a.toml", "b.toml").exception) == "b: no; b: no"
    for option in (("--effect", "x.toml"), ("--write-effect", "x.toml"), ("--write-mended",)):
        assert isinstance(run("diagnose", "a.toml", "b.toml", *option).exception, click.UsageError)


def test_a_plan_lists_runs_and_what_they_would_show(stub: Any, tmp_path: Path) -> None:
    runs = (CandidateRun(30.0, -15.0, 90.0, -1.26, 2.0, 8.5),)
    effects = (
        Expected("plate-tilt", "angle_deg", 0.01234, 7.6, "tether-spring", 2.26),
        Expected("mark-offset", "x_mm", 0.5, 1.4, "none", 0.1, "track", 5.5),
    )
    called: Called = stub("evaluator.workflow.plan", Plan(runs, effects))
    table = run("plan").stdout.splitlines()
    assert table[1].split() == ["r01", "30", "−15", "−1.3", "2.0", "90", "8.5"]
    assert table[4].split() == ["plate-tilt", "angle_deg", "=", "0.0123", "8", "tether-spring", "2.3"]
    assert table[5].split()[-2:] == ["track", "6"]
    assert called[0] == (("barrel", 18), {"rpm": (30.0, 60.0), "plate_mm": (40.0, 30.0)})
    assert json.loads(run("plan", "--json").stdout)["runs"][0]["right_rpm"] == -15.0
    written: Called = stub("evaluator.workflow.write_plan", [Path("m/e.toml"), Path("m/commands/r01.csv")])
    wanted: Called = stub("evaluator.workflow.planned_files")
    said = run("plan", "-o", str(tmp_path / "e.toml"), "--runs", "3", "--rpm", "5", "--plate", "9", "8").stdout
    assert said == "m/e.toml: 1 run, commands in m/commands\nnext: record the runs, then turnscope check m/e.toml\n"
    assert called[-1] == (("barrel", 3), {"rpm": (5.0,), "plate_mm": (9.0, 8.0)})
    assert wanted[0][0] == (tmp_path / "e.toml", 3)
    assert len(written) == 1
    for option in (("--ratio", "0.5"), ("--radius", "8")):
        assert isinstance(run("plan", *option).exception, click.UsageError)


def test_a_planned_circular_test_takes_the_levels_of_the_model_unless_some_are_said(stub: Any, tmp_path: Path) -> None:
    called: Called = stub("evaluator.workflow.circular_runs", [CircularRun(20.0, -10.0, 6.5, 12.3456, 1.23456)])
    table = run("plan", "--circular-test").stdout.splitlines()
    assert table[1].split() == ["r01", "20", "−10", "6.5", "12.35", "1.235"]
    assert called[0] == (("barrel",), {"radius_mm": None, "repetitions": 3})
    more = ("--rpm", "20", "--ratio", "0.5", "--repetitions", "2", "--json")
    assert json.loads(run("plan", "--circular-test", *more).stdout)[0]["duration_s"] == 6.5
    assert called[1][1] == {"radius_mm": None, "repetitions": 2, "rpm": (20.0,), "ratios": (0.5,)}
    run("plan", "--circular-test", "--radius", "8")
    assert called[2][1] == {"radius_mm": 8.0, "repetitions": 3}
    written: Called = stub("evaluator.workflow.write_circular_test", [Path("c.toml"), Path("commands/r01.csv")])
    assert run("plan", "--circular-test", "-o", str(tmp_path / "c.toml")).stdout.startswith("c.toml: 1 run, commands")
    assert len(written) == 1


def test_a_demo_measures_the_samples_solves_the_puzzle_and_has_the_worse_status(
    stub: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    solved = SimpleNamespace(
        calibration=SimpleNamespace(views=[1, 2], rms_px=0.00234), verdict=SimpleNamespace(summary="sound")
    )
    samples = SimpleNamespace(calibrated=solved, experiment=Path("s/e.toml"), puzzle=Path("s/p.toml"), compiling=False)
    copied: Called = stub("evaluator.workflow.copy_samples", Path("s/e.toml"))
    stub("evaluator.workflow.prepare_processes")
    stub("evaluator.workflow.prepare_samples", samples)
    drawn: Called = stub("evaluator.report.pages.demo.DemoPage.show_recording")
    asked: list[Any] = []
    monkeypatch.setattr(
        "evaluator.workflow.measure",
        lambda experiment, out, *, workers, **_: asked.append((str(experiment), str(out), workers)),
    )
    monkeypatch.setattr("evaluator.cli.measurement.analyze.turning_text", lambda *_, **__: "two\nradii")

    def analysed(options: Any, *, simulate: bool, notes: bool = True) -> Any:
        asked.append((str(options.experiment), str(options.out), simulate, notes, options.workers))
        faults = {"x": "y"} if options.experiment.name == "p.toml" else {}
        return SimpleNamespace(outputs=Outputs(options.out), faults=faults)

    monkeypatch.setattr("evaluator.cli.analysis.run_analysis", analysed)
    monkeypatch.setattr("evaluator.cli.experiment.compare.comparison_text", lambda *_, **__: "a table\nof two lines")
    reports: Called = stub("evaluator.report.build.write_report")
    stub("evaluator.workflow.diagnose", answer())
    done = run("demo")
    assert copied[0][0] == (Path("turnscope-demo/samples"),)
    assert "for example s/turn-33-5.mp4\n" in done.stdout
    assert "  2 images, residual 0.002 px RMS; sound\n" in done.stdout
    assert "  two\n  radii\n" in done.stdout
    assert "  a table\n  of two lines\n  turnscope-demo/results/report.html\n" in done.stdout
    assert "Puzzle" in done.stdout
    assert "\n  Nothing is missing" in done.stdout
    assert (
        "Open in a browser:\n  turnscope-demo/results/report.html\n  turnscope-demo/puzzle/report.html\n" in done.stdout
    )
    assert done.return_value == 1
    assert asked == [
        ("s/e.toml", "turnscope-demo/results", None),
        ("s/p.toml", "turnscope-demo/puzzle", None),
        ("s/e.toml", "turnscope-demo/results", True, True, None),
        ("s/p.toml", "turnscope-demo/puzzle", True, False, None),
    ]
    assert len(reports) == 2
    assert drawn[0][0] == (Path("s/turn-33-5.mp4"),)
    page = Path("turnscope-demo/index.html").read_text(encoding="utf-8")
    page = page[page.index("</header>") :]
    parts = ("2 images, residual", "two\nradii", "a table\nof two lines", "results/report.html", "Nothing is missing")
    places = [page.find(part) for part in (*parts, "puzzle/report.html", "Made by turnscope demo")]
    assert -1 not in places
    assert places == sorted(places)
    assert "refresh" not in page
    alone = run("demo", "--no-puzzle", "-q", "-o", "there", "--workers", "2")
    assert (alone.stdout, alone.return_value, len(reports)) == ("", 0, 3)
    assert "refresh" not in Path("there/index.html").read_text(encoding="utf-8")
    assert asked[4:] == [("s/e.toml", "there/results", 2), ("s/e.toml", "there/results", True, True, 2)]
    samples.compiling = True  # a core is left to the compiler while recordings are measured
    for cores, given, measuring in ((8, (), 7), (1, (), 1), (8, ("--workers", "8"), 8)):
        monkeypatch.setattr("evaluator.workflow.available_cores", lambda cores=cores: cores)
        run("demo", "--no-puzzle", *given)
        assert asked[-2][2] == measuring
        assert asked[-1][4] == (8 if given else None)


def test_a_track_says_what_to_do_about_a_mark_that_is_in_no_frame(stub: Any) -> None:
    seen = {"green": 1.0, "blue": 0.0}
    stub("evaluator.workflow.track_recording", SimpleNamespace(marks=pd.DataFrame({"x": [1]}), notes=(), shares=seen))
    done = run("track", "r.mp4", "-o", "r.csv")
    assert done.stdout == "r.csv: 1 frame; green in 100.0 %, blue in 0.0 %\n"
    assert done.stderr.startswith("not found: blue; say color, diameter_px and region_px of each in [mark.NAME]")


def test_a_track_says_in_how_many_frames_each_mark_is_seen_and_writes_the_images_asked_for(
    stub: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracked = SimpleNamespace(
        recording="frames", marks=pd.DataFrame({"x": [1]}), notes=("dark",), shares={"green": 0.985, "yellow": 1.0}
    )
    called: Called = stub("evaluator.workflow.track_recording", tracked)
    done = run("track", "r.mp4", "-o", "r.csv")
    assert (done.stdout, done.stderr) == ("r.csv: 1 frame; green in 98.5 %, yellow in 100.0 %\n", "note: r.mp4: dark\n")
    given, named = called[0]
    named.pop("looked_at")
    assert given == ("r.mp4", Path("r.csv"))
    assert named == {
        "settings": None, "camera": None, "robot": "barrel", "height_mm": None, "rate_hz": None, "fields": "auto",
        "corrections": None, "where_to_look": "--explain search.png shows all candidates",
    }  # fmt: skip
    overlay: Called = stub("evaluator.report.overlay.write_overlay")
    monkeypatch.setattr("evaluator.report.turn_overlay.turn_drawing", lambda _: "drawing")
    sheet: Called = stub("evaluator.report.overlay.write_contact_sheet", 2)
    search: Called = stub("evaluator.report.measurement.search_sheet.write_search_sheet")
    files = ("--overlay", "o.mp4", "--sheet", "s.png", "--explain", "e.png", "--height-mm", "6", "--rate", "60")
    done = run("track", "r.mp4", "-o", "r.csv", *files, "--fields", "top")
    assert done.stdout.startswith("s.png: 2 doubtful marks\n")
    assert overlay[0][0][:4] == ("frames", tracked.marks, Path("o.mp4"), "drawing")
    assert sheet[0][0] == ("frames", tracked.marks, Path("s.png"))
    _, named = called[1]
    assert (named["height_mm"], named["rate_hz"], named["fields"], named["where_to_look"]) == (
        6.0,
        60.0,
        "top",
        "see e.png",
    )
    named["looked_at"]("frames", tracked.marks, "settings")
    assert search[0][0] == ("frames", tracked.marks, "settings", Path("e.png"))
    sheet.result = 0
    assert run("track", "r.mp4", "-o", "r.csv", "--sheet", "s.png").stdout.startswith(
        "no doubtful mark: no sheet written"
    )
    assert run("track", "r.mp4", "-o", "r.csv", "-q").output == ""


@pytest.mark.parametrize(
    ("words", "names"),
    [
        (["--front", "mass A"], ["--name", "front=mass A"]),
        (["--left", "mass A"], ["--name", "left=mass A"]),  # with a number it would be a misspelt --left-rpm
        (["--left", "33"], ["--left", "33"]),
        (["--front=mass"], ["--name", "front=mass"]),
        (["--start-s", "1"], ["--start-s", "1"]),
        (["--cammera", "a.json"], ["--cammera", "a.json"]),
        (["-o", "a.csv", "b.csv"], ["-o", "a.csv", "b.csv"]),
        (["--back"], ["--name", "back="]),
    ],
)
def test_an_unknown_option_is_the_name_of_a_mark_unless_it_is_a_misspelt_one(
    monkeypatch: pytest.MonkeyPatch, words: list[str], names: list[str]
) -> None:
    parsed: list[list[str]] = []
    monkeypatch.setattr(click.Command, "parse_args", lambda _, __, args: parsed.append(args) or [])
    from evaluator.cli.measurement.turning import turning

    assert isinstance(turning, WithMarkNames)
    turning.parse_args(click.Context(turning), list(words))
    assert parsed == [names]
    assert _misspelt("--robots", "a", ["--robot"])
    assert not _misspelt("--front", "a", ["--robot"])


def test_tables_of_turns_are_told_one_by_one_pooled_and_written(stub: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from evaluator.workflow.turning_tables import MeasuredTable

    told = MeasuredTable({"run": "a"}, ("radius -1 mm", "95 %: -2 to 0"), ({"kind": "turn"},))
    called: Called = stub("evaluator.workflow.turning_tables.measure_table", told)
    stub("evaluator.workflow.turning_tables.together", "2 repetitions: -1 mm")
    written: list[tuple[str, int]] = []
    monkeypatch.setattr(
        "evaluator.cli.measurement.turning._write", lambda path, rows: written.append((str(path), len(rows)))
    )
    done = run("turning", "a.csv", "b.csv", "-o", "t.csv", "--phases", "p.csv", "--start-s", "0.5", "--left-rpm", "3")
    one = "{}.csv: radius −1 mm\n  95 %: −2 to 0\n"
    assert done.stdout == one.format("a") + one.format("b") + "2 repetitions: −1 mm\n"
    assert (done.return_value, written) == (0, [("t.csv", 2), ("p.csv", 2)])
    request = called[0][0][1]
    assert (request.start_s, request.stop_s, request.left_rpm, request.right_rpm) == (0.5, None, 3.0, None)
    assert (request.robot, request.camera, request.ruler) == (None, None, None)
    run("turning", "a.csv", "--scale-px", "1", "2", "3", "4", "--length-mm", "50")
    ruler = called[-1][0][1].ruler
    assert (*ruler.ends_px, ruler.length_mm) == (1, 2, 3, 4, 50)
    called.result = MeasuredTable({"run": "a"}, ("x",))
    alone = run("turning", "a.csv", "--phases", "p.csv")
    assert alone.stdout == "a.csv: x\np.csv is not written: phases need a heading, which takes two marks and --robot\n"
    for words in (("--length-mm", "5"), ("--scale-px", "1", "2", "3", "4")):
        assert "belong together" in str(run("turning", "a.csv", *words).exception)
    assert isinstance(run("turning", "a.csv", "--name", "front=").exception, InputError)
