"""No command replaces what it reads: a film named twice was a table afterwards, and marks in marks/ were gone."""

from __future__ import annotations

import errno
import shutil
from pathlib import Path

import click
import pytest

from evaluator.cli.checked import WRITTEN
from evaluator.cli.group import COMMANDS, turnscope
from evaluator.errors import InputError, UnwritableError
from evaluator.files import writing
from evaluator.workflow import Outputs, analyze, diagnose, export
from evaluator.workflow.analysis import measure
from tests.evaluator.cli.called import run

EXPERIMENT = """format = 1
name = "by hand"
robot = "barrel"
[[run]]
id = "r01"
left_rpm = 30
right_rpm = 20
marks = "{marks}"
"""
HEAD = "time_s,green_x_mm,green_y_mm,yellow_x_mm,yellow_y_mm\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a file of every kind, each with its name as content."""
    for name in ("film.mp4", "robot.toml", "gauge.toml", "camera.json", "log.csv", "plate.png", "sweep.toml"):
        (tmp_path / name).write_text(name, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("words", "lost"),
    [
        ("track film.mp4 -o film.mp4", "film.mp4"),
        ("track film.mp4 -o ./film.mp4", "film.mp4"),
        ("track film.mp4 -o link.mp4", "film.mp4"),
        ("track film.mp4 -o m.csv --overlay film.mp4", "film.mp4"),
        ("track film.mp4 --camera camera.json -o m.csv --sheet camera.json", "camera.json"),
        ("simulate --robot robot.toml --left 3 --right 2 --duration 1 -o robot.toml", "robot.toml"),
        ("simulate --robot barrel --command log.csv --duration 1 -o log.csv", "log.csv"),
        ("calibrate plate.png film.mp4 --gauge gauge.toml -o plate.png", "plate.png"),
        ("calibrate plate.png --gauge gauge.toml -o gauge.toml", "gauge.toml"),
        ("gauge gauge.toml -o gauge.toml", "gauge.toml"),
        ("turning log.csv -o log.csv", "log.csv"),
        ("turning film.mp4 log.csv --phases log.csv", "log.csv"),
        ("export-robot robot.toml -o robot.toml", "robot.toml"),
        ("sweep sweep.toml -o sweep.toml", "sweep.toml"),
        ("render robot.toml -o film.mp4 --truth robot.toml", "robot.toml"),
    ],
)
def test_a_command_refuses_to_replace_what_it_reads(words: str, lost: str, folder: Path) -> None:
    (folder / "link.mp4").symlink_to(folder / "film.mp4")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    refused = run(*words.split()).exception
    assert isinstance(refused, InputError)
    option, written = words.split()[-2:]
    assert str(refused) == f"{lost}: is read, and {option} {Path(written)} would replace it; give another name"
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


OF_TABLES = [
    "simulate --robot barrel --left 3 --right 2 --duration 1 -o {}",
    "steady --left 33 -o {}",
    "sweep sweep.toml -o {}",
    "track film.mp4 -o {}",
    "turning log.csv -o {}",
    "turning log.csv --phases {}",
]


@pytest.mark.parametrize("words", OF_TABLES)
def test_a_table_replaces_only_one_of_its_kind(words: str, folder: Path) -> None:
    for text in (HEAD, "my notes", "\ufeff" + HEAD, HEAD.strip()):
        (folder / "book.csv").write_text(text, encoding="utf-8")
        refused = run(*words.format("book.csv").split()).exception
        assert isinstance(refused, InputError)
        assert str(refused).startswith("book.csv: exists, and is no table that this command writes (it begins '")
        assert str(refused).endswith("'); give another name, or remove it")
        assert (folder / "book.csv").read_text(encoding="utf-8") == text


@pytest.mark.parametrize("words", OF_TABLES)
def test_a_place_where_nothing_can_be_written_is_refused_before_the_work(
    words: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Path] = []

    def refuse(dir: Path) -> None:  # noqa: A002
        asked.append(dir)
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(writing, "TemporaryFile", refuse)
    before = {path.name for path in folder.iterdir()}
    refused = run(*words.format("new/deep/book.csv").split()).exception
    assert isinstance(refused, UnwritableError)
    said = "cannot be written (read-only file system); write elsewhere, and run the command again"
    assert str(refused) == f"{Path('new/deep/book.csv')}: {said}"
    assert asked == [folder]  # the folder that is there
    assert {path.name for path in folder.iterdir()} == before


def test_a_result_that_is_computed_again_replaces_the_one_before(folder: Path) -> None:
    for text in ("", "\n", "left_rpm,right_rpm,ratio,radius_mm\n"):
        (folder / "turns.csv").write_text(text, encoding="utf-8")
        assert (
            run(*["steady", "--left", "33", "--ratios", "0.5", "0.4", "2", "-o", "turns.csv", "-q"]).exception is None
        )
        assert (folder / "turns.csv").read_text(encoding="utf-8").count("\n") == 3
    assert run("steady", "--left", "33", "--ratios", "0.5", "0.5", "1", "-o", "turns.csv", "-q").exception is None
    assert (folder / "turns.csv").read_text(encoding="utf-8").count("\n") == 2


def test_two_outputs_have_two_names(folder: Path) -> None:
    refused = run("track", "film.mp4", "-o", "new.csv", "--sheet", str(folder / "new.csv")).exception
    said = "is named by -o and --sheet; give each a name of its own"
    assert isinstance(refused, InputError)
    assert str(refused).endswith(said)
    assert not (folder / "new.csv").exists()


@pytest.mark.parametrize("command", COMMANDS)
def test_every_parameter_for_a_file_to_write_is_known_as_one(command: str) -> None:
    with click.Context(turnscope) as context:
        found = turnscope.get_command(context, command)
    assert found is not None
    for item in found.params:
        help_text = getattr(item, "help", None) or ""
        paths = isinstance(item.type, click.Path) or item.name in {"out", "output"}
        writes = any(
            word in help_text.lower() for word in ("write", "folder", "the page", "image with the marks found")
        )
        assert not paths or writes == (item.name in WRITTEN), (item.name, help_text)


def given_in(place: str, folder: Path) -> tuple[Path, Path, bytes]:
    """An experiment whose marks are in a place below its folder, these marks, and their content."""
    marks = folder / place
    marks.parent.mkdir(parents=True, exist_ok=True)
    marks.write_text(HEAD + "".join(f"{k / 60},1,{k / 30},-1,{k / 30}\n" for k in range(40)), encoding="utf-8")
    experiment = folder / "experiment.toml"
    experiment.write_text(EXPERIMENT.format(marks=place), encoding="utf-8")
    return experiment, marks, marks.read_bytes()


@pytest.mark.parametrize("place", ["marks/r01.csv", "poses/r01.csv", "simulated/r01.csv", "turning.csv", "pooled.csv"])
def test_results_beside_the_experiment_do_not_replace_its_marks(place: str, tmp_path: Path) -> None:
    experiment, marks, content = given_in(place, tmp_path)
    for work in (analyze, measure, export):
        with pytest.raises(InputError) as refused:
            work(experiment, tmp_path, workers=1)
        assert str(refused.value) == (
            f"{marks}: is read, and {marks} would replace it; write the results to another folder (-o)"
        )
        assert marks.read_bytes() == content
    analyze(experiment, tmp_path / "out", workers=1)
    assert marks.read_bytes() == content


def test_all_that_is_written_is_known_as_what_may_replace_an_input(tmp_path: Path) -> None:
    experiment, _, _ = given_in("given.csv", tmp_path)
    export(experiment, tmp_path / "out", workers=1)
    outputs = Outputs(tmp_path / "out")
    known = {*outputs.of_analysis(["r01"]), *outputs.of_export(["r01"])}
    written = {path for path in (tmp_path / "out").rglob("*") if path.is_file()}
    assert outputs.netcdf("r01") in written
    assert written <= known


def test_a_link_to_the_marks_is_no_other_place(tmp_path: Path) -> None:
    experiment, marks, content = given_in("given.csv", tmp_path)
    (tmp_path / "out" / "marks").mkdir(parents=True)
    (tmp_path / "out" / "marks" / "r01.csv").symlink_to(marks)
    with pytest.raises(InputError, match=r"given.csv: is read, and .*out.marks.r01.csv would replace it"):
        analyze(experiment, tmp_path / "out", workers=1)
    assert marks.read_bytes() == content


def test_a_diagnosis_does_not_replace_its_robot_file(tmp_path: Path) -> None:
    experiment, _, _ = given_in("r01.csv", tmp_path)
    (tmp_path / "out").mkdir()
    robot = tmp_path / "out" / "robot_with_effect.toml"
    shutil.copy(Path(__file__).parents[3] / "simulator" / "robots" / "barrel.toml", robot)
    experiment.write_text(experiment.read_text().replace('"barrel"', '"out/robot_with_effect.toml"'), encoding="utf-8")
    content = robot.read_bytes()
    with pytest.raises(InputError, match=r"robot_with_effect.toml: is read"):
        diagnose(experiment, tmp_path / "out", workers=1)
    assert robot.read_bytes() == content


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("diagnose experiment.toml --seconds nan", "nan"),
        ("track film.mp4 -o m.csv --height-mm nan", "nan"),
        ("turning film.mp4 --scale-px 1 2 3 nan", "nan"),
        ("simulate --robot barrel --left 3 --right 2 --duration 1 -o r.csv --heading inf", "inf"),
        ("simulate --robot barrel --left 3 --right 2 --duration 1 -o r.csv --start-s=-inf", "-inf"),
    ],
)
def test_an_option_that_is_no_number_is_refused(words: str, said: str, folder: Path) -> None:
    (folder / "experiment.toml").write_text(EXPERIMENT.format(marks="log.csv"), encoding="utf-8")
    done = run(*words.split())
    assert isinstance(done.exception, click.BadParameter) or done.exit_code == 2
    assert (
        f" {said} is no number" in str(done.exception) + done.output or str(done.exception) == f"{said} is no number."
    )


def test_the_limit_of_a_search_may_be_infinite(folder: Path) -> None:
    (folder / "experiment.toml").write_text(EXPERIMENT.format(marks="log.csv"), encoding="utf-8")
    done = run("diagnose", "experiment.toml", "--seconds", "inf")
    assert "is no number" not in str(done.exception) + done.output


@pytest.mark.parametrize("words", ["plan --circular-test", "circular-test --robot barrel"])
def test_a_circular_test_has_constant_commands_or_a_constant_radius(words: str) -> None:
    refused = run(*words.split(), "--ratio", "0.5", "--radius", "10").exception
    assert isinstance(refused, click.UsageError)
    assert "exclude each other" in str(refused)


FOLDERS = ("paper", "selftest", "demo", "slip-bench --virtual barrel", "analyze e.toml", "circular-test e.toml")


@pytest.mark.parametrize("words", FOLDERS)
def test_a_file_in_place_of_the_folder_of_results_is_refused_at_once(folder: Path, words: str) -> None:
    """`paper` recomputed its figures for 22 s first; "File exists" was all that `selftest` said."""
    refused = run(*words.split(), "-o", "robot.toml").exception
    assert isinstance(refused, InputError)
    assert str(refused) == "robot.toml: is a file; give a folder for the results (-o)"
    assert (folder / "robot.toml").read_text(encoding="utf-8") == "robot.toml"


@pytest.mark.parametrize(
    ("command", "work"),
    [("paper", "evaluator.report.pages.paper.recompute"), ("selftest", "evaluator.workflow.self_test")],
)
def test_long_work_begins_only_where_its_results_can_be_written(
    folder: Path, command: str, work: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(work, lambda *_, **__: pytest.fail("begins"))
    refused = run(command, "-o", "robot.toml/below").exception
    assert isinstance(refused, UnwritableError)
    assert "cannot be written" in str(refused)
    assert folder.is_dir()
