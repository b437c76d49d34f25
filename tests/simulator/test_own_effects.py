"""Effects from files: what they do, what they refuse in one sentence, and that robot files know them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from simulator.command import Command
from simulator.effects.catalogue import EFFECTS
from simulator.effects.coordinates import Scene
from simulator.errors import SimulationError
from simulator.observation import marks_of_run
from simulator.own_effects.files import load_own
from simulator.own_effects.template import TermRow, python_template, template
from simulator.robot import load_robot, shipped_robot_text
from simulator.simulation import simulate

TIMES_S = np.linspace(0.0, 3.0, 13)


def robot_file(folder: Path, effect: str) -> Path:
    path = folder / "robot.toml"
    path.write_text(f"{shipped_robot_text('barrel')}\n[[effect]]\n{effect}\n", encoding="utf-8")
    return path


def written(folder: Path, text: str, name: str = "effects/own.toml") -> Path:
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def test_a_robot_file_takes_the_effect_that_lies_beside_it_and_its_drive_mixes_the_sides(tmp_path: Path) -> None:
    written(tmp_path, template("mixed-sides"))
    path = robot_file(tmp_path, 'id = "mixed-sides"\nright_to_left = 0.4\nleft_to_right = 0.2')
    command, same = (Command.constant(*rpm, 0.5) for rpm in ((30.0, 10.0), (34.0, 16.0)))
    mixed, plain = simulate(load_robot(path), command, TIMES_S), simulate(load_robot("barrel"), same, TIMES_S)
    assert mixed.x_mm == pytest.approx(plain.x_mm, abs=1e-9)
    assert mixed.heading_rad == pytest.approx(plain.heading_rad, abs=1e-9)


def test_sizes_of_commands_make_a_drive_that_differs_forward_and_backward(tmp_path: Path) -> None:
    written(tmp_path, template("uneven", [TermRow("left_drive", "abs_left_command", "more")]))
    robot = load_robot(robot_file(tmp_path, 'id = "uneven"\nmore = 0.1'))
    for rpm, same in ((30.0, 33.0), (-30.0, -27.0)):
        moved = simulate(robot, Command.constant(rpm, rpm, 0.5), TIMES_S)
        plain = simulate(load_robot("barrel"), Command.constant(same, rpm, 0.5), TIMES_S)
        assert moved.heading_rad == pytest.approx(plain.heading_rad, abs=1e-9)


def test_terms_of_the_camera_move_the_marks_and_not_the_robot(tmp_path: Path) -> None:
    written(tmp_path, template("creeping", [TermRow("camera_x", "time", "drift", unit="mm/s")]))
    robot, plain = load_robot(robot_file(tmp_path, 'id = "creeping"\ndrift = 0.1')), load_robot("barrel")
    command = Command.constant(30.0, 20.0, 0.5)
    runs = [simulate(item, command, TIMES_S) for item in (robot, plain)]
    assert np.array_equal(runs[0].x_mm, runs[1].x_mm)
    shift = marks_of_run(robot, runs[0]) - marks_of_run(plain, runs[1])
    assert shift["green_x_mm"].to_numpy() == pytest.approx(0.1 * TIMES_S)
    assert shift["green_y_mm"].to_numpy() == pytest.approx(0.0)


def test_a_fit_of_what_was_found_begins_where_it_was_found(tmp_path: Path) -> None:
    rows = [
        TermRow("left_drive", "left_command", "own", value=-0.12345),
        TermRow("left_drive", "right_command", "other"),
    ]
    effect = load_own(written(tmp_path, template("found", rows)))
    assert effect.candidate(Scene(20.0, ())).begin == (-0.1235, 0.0)
    plain = load_own(written(tmp_path, template("plain"), "effects/plain.toml"))
    assert plain.candidate(Scene(20.0, ())).begin == ()


def test_a_python_file_is_an_effect_like_those_of_the_catalogue(tmp_path: Path) -> None:
    path = written(tmp_path, python_template("left-faster", "left-faster.py"), "left-faster.py")
    assert load_own(path).id == "left-faster"
    assert "left-faster" in EFFECTS
    path.write_text("raise ValueError('no')", encoding="utf-8")
    with pytest.raises(SimulationError, match=r"running it failed \(ValueError: no\)"):
        load_own(path)
    path.write_text("import sys\n\nsys.exit(7)\n", encoding="utf-8")  # which would end the program without a word
    with pytest.raises(SimulationError, match=r"running it failed \(SystemExit: 7\)"):
        load_own(path)


def test_a_robot_file_takes_the_python_effect_that_the_environment_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    named = written(tmp_path, python_template("left-weaker", "left-weaker.py"), "left-weaker.py")
    path = robot_file(tmp_path, 'id = "left-weaker"\nleft = 0.1')
    with pytest.raises(ValueError, match="TURNSCOPE_EFFECTS"):
        load_robot(path)
    monkeypatch.setenv("TURNSCOPE_EFFECTS", os.pathsep.join([str(named), ""]))
    command, same = Command.constant(30.0, 30.0, 0.5), Command.constant(33.0, 30.0, 0.5)
    moved, plain = simulate(load_robot(path), command, TIMES_S), simulate(load_robot("barrel"), same, TIMES_S)
    assert moved.heading_rad == pytest.approx(plain.heading_rad, abs=1e-9)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("format = 1", "format = 2"), "this program reads format = 1"),
        (('id = "own"', 'id = "Own Effect"'), "lower-case letters, digits"),
        (('id = "own"', 'id = "plate-tilt"'), "is an effect of the catalogue; choose another id"),
        (('channel = "left_drive"', 'channel = "left_dive"'), "did you mean left_drive"),
        (('depends_on = "right_command"', 'depends_on = "u"'), "channel left_drive does not take depends_on u"),
        (("step = 0.01", "setp = 0.01"), "unknown key setp; did you mean step"),
        (("low = -1.0", "low = 0.5"), "low and high must include 0"),
        (("step = 0.01", "step = 0"), "step = 0 must be more than 0"),
        (("step = 0.01", "step = 0.01\nbegin = 2.0"), "begin = 2.0 must lie within low and high"),
        (("step = 0.01", 'step = 0.01\nbegin = "here"'), "begin = 'here' is not a finite number"),
        (("[[term]]", "[term]"), "not valid TOML"),
    ],
)
def test_a_bad_file_is_refused_in_one_sentence_that_names_the_file(
    tmp_path: Path, change: tuple[str, str], says: str
) -> None:
    path = written(tmp_path, template("own").replace(*change, 1))
    with pytest.raises(SimulationError) as refused:
        load_own(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)
