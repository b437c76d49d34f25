"""Commands beside those on experiments: options reach the functions they stand for, and results are printed."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
import numpy as np
import pandas as pd
import pytest

from evaluator.cli.group import COMMANDS, turnscope
from evaluator.cli.progress import progress_bar
from evaluator.cli.simulation.effects import described
from evaluator.cli.tables import text_table
from evaluator.errors import InputError
from evaluator.progress import no_progress
from evaluator.workflow.checks import Check
from simulator.effects.catalogue import EFFECTS
from tests.evaluator.cli.called import run


def test_a_run_is_simulated_as_said_and_doubts_about_it_are_told(stub: Any, tmp_path: Path) -> None:
    done = SimpleNamespace(
        to_table=lambda: pd.DataFrame({"time_s": [0.123456789123]}), is_by_chance=False, is_converged=True,
        amplification=3e4, unsettled_mm=0.0123,
    )  # fmt: skip
    called = stub("evaluator.workflow.simulate", done)
    out = tmp_path / "run.csv"
    least = ("simulate", "--robot", "barrel", "--duration", "10", "-o", str(out))
    assert run(*least).stderr == ""
    assert out.read_text() == "time_s\n0.123456789\n"
    (given, named) = called[0]
    assert given == ("barrel", None, None)
    start = named.pop("start")
    assert (start.x_mm, start.y_mm, start.heading_rad) == (0, 0, 0)
    assert named == {"duration_s": 10.0, "commands": None, "start_s": 0.0, "stop_s": None, "rate_hz": 60.0}
    done.is_by_chance, done.is_converged = True, False
    out.unlink()  # without slip it would not pass as a run that was simulated before
    more = ("--left", "3", "--right", "-4", "--x", "1", "--y", "2", "--heading", "90", "--rate", "5", "--stop-s", "7")
    said = run(*least, *more, "--start-s", "0.5").stderr
    assert "grows by a factor of 3e+04" in said
    assert "not converged to better than 0.012 mm" in said
    given, named = called[1]
    start = named.pop("start")
    assert given == ("barrel", 3.0, -4.0)
    assert (start.x_mm, start.y_mm, start.heading_rad) == (1, 2, pytest.approx(math.pi / 2))
    assert named == {"duration_s": 10.0, "commands": None, "start_s": 0.5, "stop_s": 7.0, "rate_hz": 5.0}


def test_ratios_of_steady_turns_lead_from_the_first_to_the_last(stub: Any, tmp_path: Path) -> None:
    called = stub("evaluator.workflow.steady_turns", pd.DataFrame({"radius_mm": [1.0]}))
    out = tmp_path / "turns.csv"
    assert run("steady", "--left", "33.3", "-o", str(out)).stdout == f"{out}: 1 turn\n"
    ((robot, left, ratios), _) = called[0]
    assert (robot, left) == ("barrel", (33.3,))
    assert (ratios[0], ratios[-1], len(ratios)) == (0.9, 0.0, 19)
    out.unlink()
    assert run("steady", "--left", "1", "--left", "2", "--ratios", "1", "-1", "3", "-o", str(out), "-q").stdout == ""
    assert called[1][0][1:] == ((1.0, 2.0), [1.0, 0.0, -1.0])


def test_a_sweep_says_what_it_reused(stub: Any) -> None:
    done = SimpleNamespace(output=Path("o.csv"), runs=20, parts=4, reused=3)
    called = stub("evaluator.workflow.run_sweep", done)
    first = run("sweep", "s.toml", "-o", "o.csv", "--workers", "2")
    assert (first.stdout, first.stderr) == ("o.csv: 20 runs\n", "3 of 4 parts reused from before\n")
    assert called[0] == ((Path("s.toml"), Path("o.csv")), {"workers": 2, "dask": None})
    done.reused = 0
    assert run("sweep", "s.toml", "-o", "o.csv").stderr == ""
    assert run("sweep", "s.toml", "-o", "o.csv", "-q").output == ""


@pytest.mark.parametrize(
    ("output", "kind", "said"),
    [
        ("a.xml", (), "mjcf"),
        ("a.SDF", (), "sdf"),
        ("a.sdf", ("--format", "mjcf"), "mjcf"),
        ("a", ("--format", "sdf"), "sdf"),
    ],
)
def test_a_robot_is_exported_in_the_form_of_its_file_unless_another_is_named(
    stub: Any, output: str, kind: tuple[str, ...], said: str
) -> None:
    called = stub("evaluator.workflow.export_robot", ("the slip curve", "the magnets"))
    done = run("export-robot", "barrel", "-o", output, *kind)
    assert done.stdout == f"{output}\n\nWhat was lost:\n- the slip curve\n- the magnets\n"
    assert called[0][0] == ("barrel", Path(output), 33.3, 14.4, said)
    assert run("export-robot", "barrel", "-o", output, *kind, "-q").stdout == ""


@pytest.mark.parametrize("output", ["b.urdf", "b"])
def test_a_robot_file_of_another_ending_needs_a_format(stub: Any, output: str) -> None:
    called = stub("evaluator.workflow.export_robot", ())
    done = run("export-robot", "barrel", "-o", output)
    assert f"{output} ends neither in .xml nor in .sdf: give --format" in str(done.exception) + done.output
    assert called == []


def test_scenes_are_rendered_one_by_one_or_together_and_faults_are_counted(stub: Any) -> None:
    stub("evaluator.workflow.read_scene", SimpleNamespace(output=Path("a.mp4")))
    shot = SimpleNamespace(path="a.toml", fault=None, dots=0, frames=1, output="a.mp4", truth="a.csv")
    plate = SimpleNamespace(path="g.toml", fault=None, dots=221, frames=1, output="g.png", truth="g.csv")
    lost = SimpleNamespace(path="b.toml", fault="no robot")
    stub("evaluator.workflow.render_scene", shot)
    several = stub("evaluator.workflow.render_scenes", [shot, plate])
    assert run("render", "a.toml").stdout == "a.mp4: 1 frame; truth in a.csv\n"
    assert run("render", "a.toml", "-q").stdout == ""
    done = run("render", "a.toml", "g.toml", "--workers", "2")
    assert done.stdout == "a.mp4: 1 frame; truth in a.csv\ng.png: 221 dots; truth in g.csv\n"
    assert several[0][1] == {"workers": 2}
    several.result = [shot, lost]
    failed = run("render", "a.toml", "b.toml")
    assert failed.stdout.startswith("a.mp4")
    assert str(failed.exception) == "1 of 2 scenes were not rendered: b.toml: no robot"
    for option in ("-o", "--truth"):
        assert isinstance(refused := run("render", "a.toml", "b.toml", option, "c").exception, InputError)
        assert str(refused).startswith("2 scenes cannot go to one file")


@pytest.mark.parametrize("command", ["selftest", "slip-bench"])
@pytest.mark.parametrize("seed", ["99999999999999999999", "2147483648", "-1"])
def test_a_seed_that_no_generator_takes_is_refused(command: str, seed: str) -> None:
    """The 32 bits of a seed are part of a key of 64; a longer one ended in a traceback of the compiler."""
    refused = run(command, "--seed", seed).exception
    assert isinstance(refused, click.BadParameter)
    assert f"{seed} is not in the range 0<=x<=2147483647" in str(refused)


def test_a_self_test_that_fails_has_status_1(stub: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    found = SimpleNamespace(holds=True)
    called = stub("evaluator.workflow.self_test", found)
    page = "evaluator.report.pages.selftest"
    monkeypatch.setattr(f"{page}.outcome_rows", lambda _: [("pass", "track", "bias", "1", "below 2")])
    monkeypatch.setattr(f"{page}.sentence_of", lambda _: "All hold.")
    written = stub(f"{page}.write_selftest")
    done = run("selftest")
    assert done.return_value == 0
    assert done.stdout.endswith("\n\nAll hold.\nturnscope-selftest/selftest.html\n")
    assert called[0] == ((Path("turnscope-selftest"),), {"seed": 1})
    assert written[0][0][1] == Path("turnscope-selftest/selftest.html")
    found.holds = False
    quiet = run("selftest", "-q", "--seed", "7", "-o", "there")
    assert (quiet.stdout, quiet.return_value) == ("", 1)
    assert called[1] == ((Path("there"),), {"seed": 7})


@pytest.mark.parametrize(
    ("faults", "mistakes", "status", "out", "err"),
    [
        ([], [], 0, "e.toml: no errors; 1 run, 1 from video, whose motion turnscope analyze checks\n", ""),
        (["a.csv: empty"], [], 2, "", "error: a.csv: empty\n"),
        ([], ["r1: backward"], 2, "", "mistake? r1: backward\n"),
    ],
)
def test_a_check_tells_errors_and_mistakes_apart(
    stub: Any, faults: list[str], mistakes: list[str], status: int, out: str, err: str
) -> None:
    checked = SimpleNamespace(faults=faults, mistakes=mistakes, runs=1, videos=1, unseen=[], notes=[])
    stub("evaluator.workflow.check_experiment", checked)
    done = run("check", "e.toml")
    assert (done.return_value, done.stdout, done.stderr) == (status, out, err)
    assert run("check", "e.toml", "-q").stdout == ""
    content = json.loads(run("check", "e.toml", "--json").stdout)
    assert content == {"faults": faults, "mistakes": mistakes, "runs": 1, "videos": 1, "unseen": [], "notes": []}
    mended = stub("evaluator.workflow.write_mended", None)
    said = run("check", "e.toml", "--write-mended").stderr
    assert ("no run shows a mistake; nothing is written" in said) == (not faults) == bool(mended)
    mended.result = SimpleNamespace(changes=["r1: turned round"], path=Path("e-mended.toml"))
    if not faults:
        assert run("check", "e.toml", "--write-mended").stderr.endswith("r1: turned round\ne-mended.toml\n")


def test_a_check_says_whose_motion_it_has_not_looked_at(stub: Any) -> None:
    unseen = ("drive", "turn")
    stub("evaluator.workflow.check_experiment", Check((), 2, 0, unseen=unseen))
    assert "the motion of drive, turn could not be compared with commands" in run("check", "e.toml").stderr
    assert run("check", "e.toml", "-q").stderr == ""
    assert json.loads(run("check", "e.toml", "--json").stdout)["unseen"] == list(unseen)


def test_what_is_mended_unasked_is_a_note_and_no_error(stub: Any) -> None:
    notes = tuple(f"r{k}: 2 rows written twice count once" for k in range(4))
    stub("evaluator.workflow.check_experiment", Check((), 4, 0, notes=notes))
    done = run("check", "e.toml")
    assert done.stderr == f"note: {notes[0]}\nnote: the same of r1, r2, r3, with their own names and numbers\n"
    assert done.return_value == 0
    assert run("check", "e.toml", "-q").stderr == ""
    assert json.loads(run("check", "e.toml", "--json").stdout)["notes"] == list(notes)


def test_a_circular_test_is_of_an_experiment_or_of_a_robot(stub: Any) -> None:
    empty = SimpleNamespace(measured=None, simulated=SimpleNamespace(series=()), out=None)
    measured = stub("evaluator.workflow.evaluate_circular_test", empty)
    alone = stub("evaluator.workflow.simulate_circular_test", empty)
    stub("evaluator.workflow.circular_test_content", {"format": 1})
    nothing = "No gradient: no command ratio and no radius was driven at three speeds or more.\n"
    assert run("circular-test", "e.toml").stdout == nothing
    assert measured[0] == ((Path("e.toml"), Path("out")), {"workers": None, "dask": None})
    assert run("circular-test", "--robot", "barrel").stdout == nothing
    assert alone[0] == (("barrel",), {"radius_mm": None})
    assert json.loads(run("circular-test", "--robot", "a", "--rpm", "5", "--ratio", "0.5", "--json").stdout) == {
        "format": 1
    }
    assert alone[1] == (("a",), {"radius_mm": None, "rpm": (5.0,), "ratios": (0.5,)})
    assert run("circular-test", "e.toml", "-q").stdout == ""
    for words in ((), ("e.toml", "--robot", "barrel")):
        assert "expected either an EXPERIMENT.toml or --robot" in str(run("circular-test", *words).exception)


def test_a_slip_bench_is_measured_or_virtual(stub: Any) -> None:
    page = "evaluator.report.pages.slip_bench"
    stub(f"{page}.write_slip_bench", pd.DataFrame())
    stub(f"{page}.fit_rows", [("friction", "0.3", "0.2", "0.4")])
    stub(f"{page}.fit_sentences", ("6 torques fitted.",))
    real = stub("evaluator.workflow.evaluate_slip", SimpleNamespace(fit=None))
    virtual = stub("evaluator.workflow.evaluate_virtual_slip", SimpleNamespace(fit=None))
    assert run("slip-bench", "b.csv").stdout.endswith("\n6 torques fitted.\n\nout/index.html\n")
    (path, apparatus), _ = real[0]
    assert (path, apparatus.wheel_radius_mm, apparatus.contact_radius_mm) == (Path("b.csv"), 4.0, 38.0)
    assert run("slip-bench", "--virtual", "barrel", "--seed", "3", "-q").stdout == ""
    assert virtual[0][0][:2] == ("barrel", 3)
    run("slip-bench", "--virtual", "barrel")
    assert virtual[1][0][1] == 0
    for words in ((), ("b.csv", "--virtual", "barrel")):
        assert "expected either a BENCH.csv or --virtual ROBOT" in str(run("slip-bench", *words).exception)


def test_a_table_has_columns_as_wide_as_their_longest_entry_and_no_blanks_at_its_ends() -> None:
    table = text_table(("run", "x"), [("a", "1000"), ("longer", "")])
    assert table == "run        x\na       1000\nlonger"


def test_without_a_terminal_there_is_no_bar() -> None:
    for quiet in (True, False):
        with progress_bar("runs", quiet=quiet) as progress:
            assert progress is no_progress


@pytest.mark.parametrize(("typed", "hint"), [("anlyze", "; did you mean analyze?"), ("xyz", "")])
def test_a_misspelt_command_is_told_the_nearest(typed: str, hint: str) -> None:
    assert str(run(typed).exception) == f"no such command: {typed}{hint}"


def test_every_command_shows_its_line_of_the_list_its_options_in_words_and_an_example() -> None:
    listed = run("--help").output
    for name, (_, line) in COMMANDS.items():
        assert line.split()[0] in listed
        command = turnscope.get_command(None, name)  # type: ignore[arg-type]
        assert command is not None
        shown = run(name, "--help").output
        examples = shown.rpartition("Example")[2].splitlines()
        count = sum(text.strip().startswith("turnscope ") for text in examples)
        assert count >= 1
        assert examples[0] == (":" if count == 1 else "s:")
        silent = [item.name for item in command.params if item.param_type_name == "option" and not item.help]  # type: ignore[attr-defined]
        assert silent == []


def test_an_effect_is_described_with_all_that_its_declaration_holds() -> None:
    effect = EFFECTS["plate-tilt"]
    content = described(effect)
    assert [item["name"] for item in content["parameters"]] == [item.name for item in effect.parameters]
    for item, declared in zip(content["parameters"], effect.parameters, strict=True):
        for key in ("unit", "absent", "step", "period"):
            assert item[key] == getattr(declared, key)
        for key in ("low", "high", "at_least"):
            bound = getattr(declared, key)
            assert item[key] == (bound if np.isfinite(bound) else None)


def test_a_template_of_an_effect_is_written_where_asked_and_never_over_a_file(tmp_path: Path) -> None:
    done = run("effects", "new", "my-effect", "-o", str(tmp_path / "a" / "b.toml"))
    assert done.stdout == f"{tmp_path / 'a' / 'b.toml'}\n"
    assert 'id = "my-effect"' in (tmp_path / "a" / "b.toml").read_text()
    run("effects", "new", "my-effect", "--python", "-o", str(tmp_path / "c.py"))
    assert "my-effect" in (tmp_path / "c.py").read_text()
    refused = {
        ("new", "my-effect", "-o", str(tmp_path / "c.py")): "exists already",
        ("new", "Mine"): "expected an id of lower-case letters",
        ("new",): "expected an id of lower-case letters",
        ("new", "plate-tilt"): "is an effect of the catalogue",
        ("plate-tilt", "another"): "belong to turnscope effects new ID",
        ("plate-tilt", "-o", "x"): "belong to turnscope effects new ID",
        ("--python",): "belong to turnscope effects new ID",
        ("plate-tilt", "--html", "x.html"): "takes neither an ID nor --json",
        ("--json", "--html", "x.html"): "takes neither an ID nor --json",
        ("plate-tlt",): "did you mean plate-tilt?",
        ("xyz",): "no such effect; turnscope effects lists all",
    }
    for words, said in refused.items():
        error = run("effects", *words).exception
        assert isinstance(error, InputError)
        assert said in str(error)
    assert json.loads(run("effects", "plate-tilt", "--json").stdout)["id"] == "plate-tilt"
    assert [item["id"] for item in json.loads(run("effects", "--json").stdout)] == list(EFFECTS)
    text = run("effects", "plate-tilt").stdout
    assert text.startswith("plate-tilt: ")
    assert max(map(len, text.splitlines())) <= 100
