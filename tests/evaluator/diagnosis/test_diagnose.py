"""turnscope diagnose from files to files: what is hidden is found, nothing is made up, nothing ends in a traceback."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from click.testing import CliRunner, Result

from evaluator.cli.experiment.diagnose import diagnose
from evaluator.diagnosis.inference.fit_cache import End, FitCache
from evaluator.errors import InputError
from evaluator.report.diagnosis.sections import diagnosis_sections
from evaluator.report.diagnosis.view import known_diagnosis
from evaluator.settings import load_experiment
from evaluator.workflow import Outputs, analyze
from evaluator.workflow.diagnosis.experiment import diagnose_experiment
from simulator.robot import load_robot
from tests.evaluator.diagnosis.hidden import COMMANDS, offer_few, write_hidden

HIDDEN_DEG_PER_MN = 0.8
LEFT_OVER_RIGHT = 0.95
LIKE_A_WHEEL = (
    ("drive-speed-mismatch", "drive-speed-scale", "friction-level", "plate-tilt"),
    ("moment",),
)
ENOUGH = 1.15  # gap on held-out runs over the noise floor


def run(experiment: Path, *switches: str) -> Result:
    """Run the command; its exit status is the return value, bad input its exception (see evaluator.cli.failures)."""
    arguments = [str(experiment), "-o", str(experiment.parent / "out"), *switches]
    return CliRunner().invoke(diagnose, arguments, standalone_mode=False)


def found(experiment: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((experiment.parent / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    return content


@pytest.fixture(scope="module")
def puzzle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's puzzle: backward turns are tighter than forward ones, because the axles give way."""
    effects = {"axle-compliance": {"deg_per_mN": HIDDEN_DEG_PER_MN}}
    tolerance = {"slip.lateral_friction": 0.03}
    experiment = write_hidden(tmp_path_factory.mktemp("puzzle"), effects, tolerance=tolerance)
    assert run(experiment, "-q").return_value == 0
    return experiment


@pytest.fixture(scope="module")
def one_wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The left wheel is smaller than the file says: two effects, mismatch and scale, describe it."""
    factor = (LEFT_OVER_RIGHT + 1) / 2
    effects = {"drive-speed-mismatch": {"left_over_right": LEFT_OVER_RIGHT}, "drive-speed-scale": {"factor": factor}}
    experiment = write_hidden(tmp_path_factory.mktemp("wheel"), effects, commands=COMMANDS[:6], exact=True)
    with pytest.MonkeyPatch.context() as monkeypatch:
        offer_few(monkeypatch, *LIKE_A_WHEEL)
        assert run(experiment, "-q").return_value == 0
    return experiment


def test_the_hidden_effect_is_named_with_its_size_and_closes_the_gap_on_runs_kept_aside(puzzle: Path) -> None:
    content = found(puzzle)
    assert content["verdict"] == "effect"
    (effect,) = content["effects"]
    assert effect["id"] == "axle-compliance"
    size = effect["parameters"]["deg_per_mN"]
    assert size["low"] < HIDDEN_DEG_PER_MN < size["high"]
    gap = content["gap"]
    assert gap["before"]["held_out"] > 2 * gap["noise_floor"]
    assert gap["after"]["held_out"] < ENOUGH * gap["noise_floor"]


def test_the_robot_with_the_effect_has_the_moved_nominal_values_and_shrinks_the_compared_gap(puzzle: Path) -> None:
    path = puzzle.parent / "out" / "robot_with_effect.toml"
    moved = found(puzzle)["nominal"]["slip.lateral_friction"]["relative_change"]
    nominal, better = load_robot("barrel"), load_robot(path)
    assert better.slip.lateral_friction == pytest.approx(nominal.slip.lateral_friction * (1 + moved), rel=1e-5)
    assert [effect.id for effect in better.effect] == ["axle-compliance"]
    head, *runs = puzzle.read_text(encoding="utf-8").split("[[run]]")
    gaps = []
    for name, robot in (("before", "robot.toml"), ("after", "out/robot_with_effect.toml")):
        few = puzzle.parent / f"{name}.toml"
        few.write_text("[[run]]".join([head.replace("robot.toml", robot), runs[2], runs[4]]), encoding="utf-8")
        comparison = analyze(few, puzzle.parent / "few", simulate=True, workers=1).comparison
        assert comparison is not None
        gaps.append(comparison["gap_rms_mm"].mean())
    assert gaps[1] < 0.8 * gaps[0]


def test_an_unchanged_experiment_is_answered_at_once_and_a_changed_one_anew(puzzle: Path) -> None:
    outputs, experiment = Outputs(puzzle.parent / "out"), load_experiment(puzzle)
    before = outputs.diagnosis.stat().st_mtime_ns
    again = run(puzzle)
    assert again.return_value == 0
    assert "up to date, not computed again" in again.output
    assert outputs.diagnosis.stat().st_mtime_ns == before
    view = known_diagnosis(experiment, outputs)
    assert view is not None
    assert not view.outdated
    first, *others = experiment.run
    edited = experiment.model_copy(update={"run": (first.model_copy(update={"left_rpm": 31.0}), *others)})
    view = known_diagnosis(edited, outputs)
    assert view is not None
    assert view.outdated


def test_an_interrupted_diagnosis_goes_on_where_it_stopped_and_ends_with_the_same_answer(
    one_wheel: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = shutil.copytree(one_wheel.parent, tmp_path / "again", ignore=shutil.ignore_patterns("out"))
    experiment = Path(folder) / one_wheel.name
    made: list[str] = []
    remember = FitCache.__setitem__

    def counted(fits: FitCache, question: str, end: End | None) -> None:
        made.append(question)
        remember(fits, question, end)

    def until_pairs(what: str, share: float) -> None:
        del share
        if what == "2 effects":
            raise KeyboardInterrupt

    offer_few(monkeypatch, *LIKE_A_WHEEL)
    monkeypatch.setattr(FitCache, "__setitem__", counted)
    outputs = Outputs(experiment.parent / "out")
    with monkeypatch.context() as clock:  # a second passes with every fit, on a machine of any speed
        clock.setattr("evaluator.diagnosis.inference.watch.process_time", lambda: float(len(made)))
        stopped = diagnose_experiment(experiment, outputs.folder, seconds=3.0)[1]
    assert stopped["verdict"] == "insufficient"
    assert "the search was stopped after 6 s of processor time" in stopped["reason"]  # twice: a model explains the runs
    assert outputs.diagnosis_fits.exists()
    with pytest.raises(KeyboardInterrupt):
        diagnose_experiment(experiment, outputs.folder, until_pairs)
    with outputs.diagnosis_fits.open("a", encoding="utf-8") as file:
        file.write('["torn in the mid')
    before, made[:] = set(made), []
    assert run(experiment, "-q").return_value == 0
    assert before
    assert before.isdisjoint(made)
    assert found(experiment) == found(one_wheel)
    assert not outputs.diagnosis_fits.exists()


def test_the_report_shows_every_step_of_the_diagnosis(puzzle: Path) -> None:
    view = known_diagnosis(load_experiment(puzzle), Outputs(puzzle.parent / "out"))
    sections = {section.name: section for section in diagnosis_sections(view)}
    names = ("", "-where", "-gap", "-rivals", "-limits", "-known", "-noise")
    assert tuple(sections) == tuple(f"diagnosis{name}" for name in names)
    assert "Predicted from the start poses alone" in " ".join(sections["diagnosis-gap"].text)
    assert {row[0] for row in sections["diagnosis-known"].tables[0].rows} >= {
        "start of motion in all runs",
        "wheelbase",
    }
    assert "(axle-compliance), size 0.7" in sections["diagnosis"].text[0]
    gap = sections["diagnosis-gap"]
    assert gap.figures[0].data["kept_aside"].sum() == 1
    assert {row[0] for row in gap.tables[0].rows} == set(found(puzzle)["constancy"])
    assert "nothing missing" in [row[0] for row in sections["diagnosis-rivals"].tables[0].rows]
    assert sections["diagnosis-noise"].tables[0].rows[0][0] == "lateral friction"
    pieces = pd.read_csv(puzzle.parent / "out" / "disagreement.csv")
    assert pieces["after_across_mm_s"].std() < pieces["across_mm_s"].std()


def test_clean_runs_of_two_robot_files_with_a_recording_missing_call_for_nothing(tmp_path: Path) -> None:
    experiment = write_hidden(tmp_path, {}, exact=True)
    (tmp_path / "twin.toml").write_text((tmp_path / "robot.toml").read_text(encoding="utf-8"), encoding="utf-8")
    text = experiment.read_text(encoding="utf-8").replace('id = "r2"', 'id = "r2"\nrobot = "twin.toml"')
    experiment.write_text(
        text + '\n[[run]]\nid = "lost"\nleft_rpm = 30\nright_rpm = 30\nmarks = "lost.csv"\n', encoding="utf-8"
    )
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "robot_with_effect.toml").write_text("of an earlier diagnosis", encoding="utf-8")
    done = run(experiment, "-q")
    assert done.return_value == 1
    assert "lost.csv: no such file" in done.stderr
    assert found(experiment)["verdict"] == "none"
    assert found(experiment)["effects"] == []
    assert not (tmp_path / "out" / "robot_with_effect.toml").exists()


@pytest.mark.exam
def test_marks_without_noise_from_another_simulator_of_the_same_model_call_for_nothing(tmp_path: Path) -> None:
    experiment = write_hidden(tmp_path, {}, sigma_mm=0.0, error_mm=1e-4, exact=True)
    assert run(experiment, "-q").return_value == 0
    assert found(experiment)["verdict"] == "none"


def test_a_dead_band_that_stops_one_wheel_in_half_of_the_runs_is_found_between_two_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    offer_few(monkeypatch, ("dead-band", *LIKE_A_WHEEL[0]), LIKE_A_WHEEL[1])
    experiment = write_hidden(tmp_path, {"dead-band": {"rpm": 20.0}}, exact=True)
    assert run(experiment, "-q").return_value == 0
    (effect,) = found(experiment)["effects"]
    assert effect["id"] == "dead-band"
    assert (effect["parameters"]["rpm"]["low"], effect["parameters"]["rpm"]["high"]) == (14.4, 30.0)


def test_one_driving_wheel_that_is_off_is_one_effect_not_a_mismatch_and_a_scale(one_wheel: Path) -> None:
    (effect,) = found(one_wheel)["effects"]
    assert effect["id"] == "drive-speed-mismatch"
    assert "left wheel alone" in effect["name"]
    size = effect["parameters"]["left_over_right"]
    assert size["low"] < LEFT_OVER_RIGHT < size["high"]


def test_one_run_cannot_decide_and_says_why(tmp_path: Path) -> None:
    experiment = write_hidden(tmp_path, {}, commands=[(30.0, 30.0)])
    done = run(experiment, "--json")
    assert done.return_value == 0
    assert json.loads(done.stdout)["verdict"] == "insufficient"
    assert "1 usable run with" in json.loads(done.stdout)["reason"]
    sections = diagnosis_sections(known_diagnosis(load_experiment(experiment), Outputs(tmp_path / "out")))
    assert sections[0].text[0] == "These runs cannot decide whether an effect is missing, or which."


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('robot = "robot.toml"', "", "robot"),
        ('robot = "robot.toml"', 'robot = "gone.toml"', "gone.toml: no such file"),
        ('marks = "r0.csv"', 'marks = "gone.csv"', "gone.csv: no such file"),
        ("left_rpm = 30.0", 'left_rpm = "fast"', "left_rpm"),
    ],
)
def test_bad_input_ends_in_one_sentence(tmp_path: Path, old: str, new: str, said: str) -> None:
    experiment = write_hidden(tmp_path, {}, commands=[(30.0, 30.0)])
    experiment.write_text(experiment.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    done = run(experiment, "-q")
    assert isinstance(done.exception, InputError)
    assert said in str(done.exception)
    assert not (tmp_path / "out" / "diagnosis.json").exists()


def test_a_spoiled_diagnosis_is_named_by_the_report_and_made_anew_by_the_command(tmp_path: Path) -> None:
    experiment = write_hidden(tmp_path, {}, commands=[(30.0, 30.0)])
    outputs = Outputs(tmp_path / "out")
    run(experiment, "-q")
    outputs.diagnosis.write_text("{", encoding="utf-8")
    with pytest.raises(InputError, match=r"diagnosis.json: not valid JSON .* run turnscope diagnose again"):
        known_diagnosis(load_experiment(experiment), outputs)
    run(experiment, "-q")
    assert found(experiment)["verdict"] == "insufficient"


def test_several_experiments_are_diagnosed_beside_each_other_and_one_that_is_gone_costs_no_other(
    tmp_path: Path,
) -> None:
    paths = [write_hidden(tmp_path / name, {}, commands=[(30.0, 30.0)]) for name in ("monday", "tuesday")]
    gone = tmp_path / "gone.toml"
    arguments = [*map(str, [*paths, gone]), "-o", str(tmp_path / "out"), "--workers", "1", "--json"]
    done = CliRunner().invoke(diagnose, arguments, standalone_mode=False)
    assert done.return_value == 1
    assert "gone.toml: no such file" in done.stderr
    told = json.loads(done.stdout)
    assert [told[str(path)]["verdict"] for path in paths] == ["insufficient"] * 2
    for folder in ("monday-experiment", "tuesday-experiment"):
        assert (tmp_path / "out" / folder / "diagnosis.json").is_file()
