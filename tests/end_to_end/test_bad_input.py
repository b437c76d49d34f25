"""Bad input is normal input: one clear sentence, exit status 2, no traceback, nothing half written."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.end_to_end.commands import assert_refused, turnscope
from tests.evaluator.synthetic import three_runs

HEAD = 'format = 1\nname = "bad"\nrobot = "barrel"\n'


def edited(folder: Path, old: str, new: str) -> Path:
    path = three_runs(folder)
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


TOML_FAULTS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "misspelt key": ("left_rpm", "left_rmp", ("run[1].left_rmp", "did you mean left_rpm?")),
    "wrong unit": ("left_rpm = 14.4", "left_rad_s = 1.5", ("run[1].left_rad_s", "did you mean left_rpm? It is in rpm")),
    "unit in the value": ("left_rpm = 14.4", 'left_rpm = "14.4 rpm"', ("run[1].left_rpm", "14.4 rpm", "number")),
    "misspelt robot": ('"barrel"', '"barel"', ("barel", "did you mean barrel?")),
    "missing robot file": ('"barrel"', '"mine.toml"', ("mine.toml", "no such file")),
    "one id twice": ('id = "r02"', 'id = "r01"', ("r01", "more than once")),
    "not TOML": ("format = 1", "format = ", ("not valid TOML", "line 1")),
    "format of the future": ("format = 1", "format = 7", ("format = 7", "should be 1")),
    "stop before start": (
        'marks = "r01.csv"',
        'marks = "r01.csv"\nstop_s = -1.0',
        ("stop_s = -1.0", "not after start_s"),
    ),
    "an infinite number": ("left_rpm = 14.4", "left_rpm = inf", ("run[1].left_rpm", "finite")),
}


@pytest.mark.parametrize("fault", TOML_FAULTS)
def test_a_faulty_experiment_is_refused_with_place_and_remedy(fault: str, tmp_path: Path) -> None:
    old, new, words = TOML_FAULTS[fault]
    experiment = edited(tmp_path / "in", old, new)
    done = turnscope("analyze", experiment, "-o", tmp_path / "out")
    assert_refused(done, *words)
    assert not (tmp_path / "out").exists()


def test_an_empty_experiment_is_refused(tmp_path: Path) -> None:
    (tmp_path / "experiment.toml").write_text(HEAD, encoding="utf-8")
    assert_refused(turnscope("analyze", tmp_path / "experiment.toml", "-o", tmp_path / "out"), "needs at least one")
    (tmp_path / "experiment.toml").write_text("", encoding="utf-8")
    assert_refused(turnscope("analyze", tmp_path / "experiment.toml", "-o", tmp_path / "out"), "missing")
    assert not (tmp_path / "out").exists()


def test_a_missing_experiment_is_refused(tmp_path: Path) -> None:
    assert_refused(turnscope("report", tmp_path / "none.toml", "-o", tmp_path / "out"), "none.toml: no such file")


def test_a_robot_of_negative_mass_is_refused(tmp_path: Path) -> None:
    experiment = edited(tmp_path, '"barrel"', '"robot.toml"')
    assert turnscope("new", tmp_path / "fresh").returncode == 0
    robot = (tmp_path / "fresh" / "robot.toml").read_text(encoding="utf-8")
    (tmp_path / "robot.toml").write_text(robot.replace("mass_g = 0.5", "mass_g = -0.5"), encoding="utf-8")
    done = turnscope("compare", experiment, "-o", tmp_path / "out")
    assert_refused(done, "robot.toml", "body.mass_g = -0.5", "greater than 0")


def test_a_missing_recording_is_refused(tmp_path: Path) -> None:
    experiment = edited(tmp_path / "in", '"r01.csv"', '"r99.csv"')
    text = experiment.read_text(encoding="utf-8")
    experiment.write_text(text[: text.index("[[run]]", text.index("r99.csv"))], encoding="utf-8")
    assert_refused(turnscope("analyze", experiment, "-o", tmp_path / "out"), "r99.csv", "no such file")
    assert not (tmp_path / "out").exists()
