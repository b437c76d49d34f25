"""Faults of a file are said in words of the file, all together."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from pydantic import BaseModel, Field, ValidationError

from evaluator import settings
from evaluator.errors import InputError
from evaluator.files import explain, read_with
from evaluator.files.writing import written_whole
from evaluator.interchange.poses import holds_poses, read_poses
from evaluator.interchange.tracks import program_of
from evaluator.marks import read_marks
from evaluator.tracking.corrections import read_corrections
from evaluator.workflow.checks import check_experiment
from evaluator.workflow.results.validity import file_hash
from simulator.robot import load_robot, shipped_robot_text


class Part(BaseModel, extra="forbid"):
    """A table within."""

    size: float = Field(gt=0)
    count: int = 1


class Whole(BaseModel, extra="forbid"):
    """A file."""

    name: str = ""
    on: bool = True
    file: Path = Path()
    places: tuple[float, ...] = ()
    part: tuple[Part, ...] = ()
    ends: tuple[Part, ...] = Field((), min_length=2)


def load(path: Path) -> Whole:
    raise NotImplementedError(path)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"name": 3}, "name = 3: should be text"),
        ({"on": "maybe"}, "on = 'maybe': should be true or false"),
        ({"file": 3}, "file = 3: should be the path of a file"),
        ({"places": 3}, "places = 3: should be a list"),
        ({"places": [1.0, "x"]}, "places[2] = 'x': should be a number"),
        ({"part": [{"size": "large"}]}, "part[1].size = 'large': should be a number"),
        ({"part": [{"size": 1}, {"size": 1, "count": 1.5}]}, "part[2].count = 1.5: should be a whole number"),
        ({"part": [{"size": 0}]}, "part[1].size = 0: should be greater than 0"),
        ({"part": [{}]}, "part[1].size is missing"),
        ({"part": [{"size": 1, "cuont": 2}]}, "unknown key part[1].cuont; did you mean count?"),
        ({"ends": [{"size": 1}]}, "ends = [{'size': 1}]: should have at least 2 items, not 1"),
        ({"ends": [{"size": 1}, {"size": 0}]}, "ends[2].size = 0: should be greater than 0"),
        ({"y" * 5000: 1}, f"unknown key {'y' * 200}…"),
        ({"places": "x" * 5000}, f"places = '{'x' * 199}…: should be a list"),
        ({"nmae": ""}, "unknown key nmae; did you mean name?"),
        ({"zzz": 1, "name": 3}, "name = 3: should be text; unknown key zzz"),
    ],
)
def test_a_fault_names_its_place_what_was_found_and_what_should_be_there(content: dict[str, object], said: str) -> None:
    with pytest.raises(ValidationError) as error:
        Whole.model_validate(content)
    assert explain(error.value, load) == said


def test_a_name_of_any_length_that_no_effect_has_is_cut(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(f'{shipped_robot_text("barrel")}\n[[effect]]\nid = "{"x" * 5000}"\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"unknown effect x{200}…") as error:
        read_with(load_robot, path)
    assert len(str(error.value)) < 1000


def said_of(model: type[BaseModel], content: dict[str, object], load: Callable[[Path], object]) -> list[str]:
    with pytest.raises(ValidationError) as error:
        model.model_validate(content)
    return explain(error.value, load).split("; ")


def test_of_hundreds_of_faults_the_first_are_told_and_how_many_there_are_more() -> None:
    said = said_of(Whole, {f"k{number}": 1 for number in range(600)}, load)
    told = [item for item in said if item.startswith("unknown key")]
    assert (len(told), said[-1]) == (50, "550 more faults")


@pytest.mark.parametrize(("count", "said"), [(2, 2), (3, 1), (900, 1), (1100, 2)])
def test_a_fault_of_many_entries_is_told_of_the_first(count: int, said: int) -> None:
    """An experiment of 20 runs with a wrong key had an error of 3000 characters."""
    found = said_of(Whole, {"places": ["x"] * count}, load)
    assert len(found) == said
    alike = f" ({min(count, 1000) - 1} other entries alike)" if count > 2 else ""
    assert found[0] == f"places[1] = 'x': should be a number{alike}"
    assert found[-1] == "100 more faults" or count < 1000


class Experiment(BaseModel, extra="forbid"):
    """What is asked for where a file of another kind is given."""

    robot: str
    left_rpm: float = 0.0
    name: str = ""


def load_experiment(path: Path) -> Experiment: ...


@pytest.mark.parametrize(
    ("keys", "kind"),
    [
        (("body", "slip", "name"), "is a robot file, by its keys body, slip; give an experiment file"),
        (("dots", "fiducial"), "is a gauge file, by its keys dots, fiducial; give an experiment file"),
        (("body", "robot"), "unknown key body"),
    ],
)
def test_a_file_of_another_kind_is_told_as_such(keys: tuple[str, ...], kind: str) -> None:
    """By two of its keys; one may be a mistake within the right file."""
    assert "; ".join(said_of(Experiment, dict.fromkeys(keys, ""), load_experiment)) == kind


def test_a_key_in_another_unit_is_offered_with_its_own() -> None:
    """Renamed alone, its value is that of another speed."""
    for key, said in (("left_rad_s", "left_rpm? It is in rpm"), ("left_rmp", "left_rpm?")):
        assert said_of(Experiment, {"robot": "", key: 1.0}, load_experiment)[-1] == f"did you mean {said}"


def test_a_name_that_no_file_can_have_is_shown_as_it_was_written() -> None:
    with pytest.raises(InputError, match=r"^'a\\x00\.toml': no file can have this name"):
        read_with(Path.read_text, Path("a\0.toml"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes among its files")
@pytest.mark.parametrize(
    "read",
    [
        read_marks,
        read_poses,
        holds_poses,
        program_of,
        read_corrections,
        lambda path: read_with(Path.read_text, path),
        file_hash,
        check_experiment,
    ],
)
def test_a_pipe_that_nobody_writes_to_is_refused_and_not_waited_for(
    tmp_path: Path, read: Callable[[Path], object]
) -> None:
    os.mkfifo(tmp_path / "p.toml")
    if read is check_experiment:
        (fault,) = check_experiment(tmp_path / "p.toml").faults
    else:
        with pytest.raises(InputError) as error:
            read(tmp_path / "p.toml")
        fault = str(error.value)
    assert fault.startswith(f"{tmp_path / 'p.toml'}: is a pipe or a device")


@pytest.mark.parametrize("order", ["utf-16", "utf-16-be"])
def test_text_of_two_bytes_a_letter_is_no_picture(order: str, tmp_path: Path) -> None:
    path = tmp_path / "experiment.toml"
    path.write_bytes("\ufeff".encode(order) * (order != "utf-16") + 'name = "Ä"\n'.encode(order))
    (fault,) = check_experiment(path).faults
    assert fault == f"{path}: is text in UTF-16, which some editors call Unicode; save it as UTF-8"


def test_lists_in_lists_without_end_are_a_fault_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "experiment.toml"
    path.write_text(f"a = {'[' * 20_000}{']' * 20_000}", encoding="utf-8")
    (fault,) = check_experiment(path).faults
    assert fault == f"{path}: its lists or tables are nested too deeply"


def test_of_a_cell_of_megabytes_the_beginning_is_told(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    path.write_text(f"time_s,green_x_mm,green_y_mm\n{'9x' * 10**6},1,2\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"line 2, time_s = '9x9x9x.*… is not a number") as error:
        read_marks(path)
    assert len(str(error.value)) < 400 + len(str(path))


@pytest.mark.parametrize("written", ["true", '"33.3"'])
def test_a_number_is_neither_true_nor_a_word(written: str, tmp_path: Path) -> None:
    path = tmp_path / "experiment.toml"
    run = f'[[run]]\nid = "a"\nmarks = "m.csv"\nleft_rpm = {written}\nright_rpm = 3\n'
    path.write_text(f'format = 1\nname = "n"\nrobot = "barrel"\n{run}', encoding="utf-8")
    with pytest.raises(InputError, match=r"run\[1\].left_rpm = .*: should be a number"):
        read_with(settings.load_experiment, path)


def test_a_folder_in_place_of_a_file_names_the_file_in_it(tmp_path: Path) -> None:
    (tmp_path / "experiment.toml").touch()
    with pytest.raises(InputError) as error:
        read_with(Path.read_text, tmp_path)
    file = tmp_path / "experiment.toml"
    assert str(error.value) == f"{tmp_path}: is a folder; give the name of a file, such as {file}"


def test_a_file_whose_writing_fails_stays_as_it_was_and_nothing_lies_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "turning.csv"
    path.write_text("of yesterday", encoding="utf-8")

    def half() -> None:
        with written_whole(path) as temporary:
            temporary.write_text("half of", encoding="utf-8")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        half()
    assert path.read_text(encoding="utf-8") == "of yesterday"
    assert list(tmp_path.iterdir()) == [path]
    with written_whole(path) as temporary:
        temporary.write_text("of today", encoding="utf-8")
        assert path.read_text(encoding="utf-8") == "of yesterday"
    assert path.read_text(encoding="utf-8") == "of today"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("rpm", "refused"), [("1e308", True), ("-1000001.0", True), ("1e6", False), ("-10000", False)])
def test_a_speed_that_no_motor_has_is_refused(rpm: str, tmp_path: Path, *, refused: bool) -> None:
    path = tmp_path / "experiment.toml"
    run = f'[[run]]\nid = "r01"\nleft_rpm = {rpm}\nright_rpm = 1\nmarks = "r01.csv"\n'
    path.write_text(f'format = 1\nname = "fast"\nrobot = "barrel"\n{run}', encoding="utf-8")
    if not refused:
        assert read_with(settings.load_experiment, path).run[0].left_rpm == float(rpm)
        return
    with pytest.raises(InputError, match=r"left_rpm = .*should be (less|greater) than or equal to"):
        read_with(settings.load_experiment, path)
