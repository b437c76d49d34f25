"""A user's first hour: demo, a fresh experiment, its check, the report, and machines that read along."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pandas as pd
import pytest

from tests.end_to_end.commands import turnscope
from tests.evaluator.synthetic import three_runs


def test_every_command_says_what_it_does_with_an_example() -> None:
    from click.testing import CliRunner

    from evaluator.cli.group import COMMANDS
    from evaluator.cli.group import turnscope as group

    for name in COMMANDS:
        shown = CliRunner().invoke(group, [name, "--help"])
        assert shown.exit_code == 0, name
        assert f"turnscope {name}" in shown.output.split("Options:")[-1], f"{name} has no example"


@pytest.mark.parametrize(("name", "given", "root"), [("r.sdf", (), "sdf"), ("r.xml", ("--format", "sdf"), "sdf")])
def test_a_robot_is_written_in_the_format_that_its_file_ends_in_or_that_is_asked_for(
    name: str, given: tuple[str, ...], root: str, tmp_path: Path
) -> None:
    from click.testing import CliRunner

    from evaluator.cli.group import turnscope as group

    done = CliRunner().invoke(group, ["export-robot", "barrel", *given, "-o", str(tmp_path / name)])
    assert done.exit_code == 0
    assert f"<{root} " in (tmp_path / name).read_text(encoding="utf-8")
    assert "Gazebo" in done.output


def test_help_fits_a_terminal_of_eighty_columns() -> None:
    """But for examples, which are copied as they are."""
    from click.testing import CliRunner

    from evaluator.cli.group import COMMANDS
    from evaluator.cli.group import turnscope as group

    for name in COMMANDS:
        shown = CliRunner().invoke(group, [name, "--help"], terminal_width=80).output
        long = [line for line in shown.splitlines() if len(line) > 80 and not line.startswith("    ")]
        assert long == [], name
        assert "\b" not in shown


def test_a_misspelt_command_is_answered_with_the_nearest() -> None:
    done = turnscope("analize", "experiment.toml")
    assert done.returncode == 2
    assert "did you mean analyze?" in done.stderr


def test_a_fresh_experiment_is_complete_but_for_camera_and_recordings(tmp_path: Path) -> None:
    assert turnscope("new", tmp_path / "lab").returncode == 0
    done = turnscope("check", tmp_path / "lab" / "experiment.toml", "--json")
    assert done.returncode == 2
    faults = json.loads(done.stdout)["faults"]
    assert len(faults) == 3
    for word in ("camera.json: does not exist", "r01.mp4: no such file", "r02.mp4: no such file"):
        assert any(word in fault for fault in faults)


def test_new_overwrites_nothing(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text("mine\n", encoding="utf-8")
    done = turnscope("new", tmp_path)
    assert done.returncode == 2
    assert "robot.toml exist already" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["robot.toml"]


def test_check_says_everything_that_is_wrong_at_once(tmp_path: Path) -> None:
    experiment = three_runs(tmp_path)
    text = experiment.read_text(encoding="utf-8").replace('"barrel"', '"barel"').replace("left_rpm = 5.0", "left = 5.0")
    experiment.write_text(text, encoding="utf-8")
    (tmp_path / "r03.csv").write_text("time_s\n0\n1\n", encoding="utf-8")
    done = turnscope("check", experiment)
    assert done.returncode == 2
    for word in ("did you mean barrel?", "run[2].left", "run[2].left_rpm is missing", "r03.csv: holds no mark"):
        assert word in done.stderr


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("product")
    experiment = three_runs(folder)
    plan = turnscope("report", experiment, "-o", folder / "out", "--dry-run")
    assert plan.returncode == 0
    assert "3 of 3 runs to compute" in plan.stdout
    assert not (folder / "out").exists()
    done = turnscope("report", experiment, "-o", folder / "out", "--json", "--workers", 1)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {"report": str(folder / "out" / "report.html"), "faults": {}}
    return folder / "out"


def test_report_leaves_the_files_of_the_contract(out: Path) -> None:
    turning = pd.read_csv(out / "turning.csv")
    assert list(turning.columns[:6]) == [
        "run",
        "left_rpm",
        "right_rpm",
        "radius_mm",
        "radius_low_mm",
        "radius_high_mm",
    ]
    assert {"radius_status", "steady_radius_mm", "speed_mm_s", "green_speed_mm_s", "yaw_rate_deg_s"} <= set(turning)
    for run in turning["run"]:
        assert (out / "marks" / f"{run}.csv").is_file()
        assert list(pd.read_csv(out / "simulated" / f"{run}.csv").columns[:4]) == [
            "time_s",
            "x_mm",
            "y_mm",
            "heading_deg",
        ]
    assert (out / "report.html").stat().st_size < 5e6


def test_what_is_up_to_date_is_not_done_again_and_programs_read_along(out: Path) -> None:
    experiment = out.parent / "experiment.toml"
    before = (out / "report.html").read_bytes()
    assert "0 of 3 runs to compute" in turnscope("compare", experiment, "-o", out, "--dry-run").stdout
    rows = json.loads(turnscope("analyze", experiment, "-o", out, "--json").stdout)
    assert rows[0]["run"] == "r01"
    assert rows[2]["radius_mm"] is None
    assert turnscope("report", experiment, "-o", out, "--quiet", "--workers", 1).stdout == ""
    assert (out / "report.html").read_bytes() == before


def test_motors_that_start_after_the_recording_are_a_fault_of_check_and_run(samples: Path, tmp_path: Path) -> None:
    experiment = three_runs(tmp_path)
    text = experiment.read_text(encoding="utf-8").replace('marks = "r02.csv"', 'marks = "r02.csv"\nstart_s = 500.0')
    experiment.write_text(text, encoding="utf-8")
    said = "run r02: start_s = 500 s, but r02.csv ends at 5.98 s; give the time in the recording"
    checked = turnscope("check", experiment)
    assert checked.returncode == 2
    assert said in checked.stderr
    done = turnscope("analyze", experiment, "-o", tmp_path / "out", "--workers", 1)
    assert done.returncode == 1
    assert said in done.stderr
    assert pd.read_csv(tmp_path / "out" / "turning.csv")["radius_mm"].notna().tolist() == [True, False, False]
    video = (samples / "experiment.toml").read_text(encoding="utf-8").replace("start_s = 0.5", "start_s = 500.0", 1)
    (samples / "late.toml").write_text(video, encoding="utf-8")
    assert "run straight-30: start_s = 500 s" in turnscope("check", samples / "late.toml").stderr


def test_numbers_for_people_have_a_minus_sign_and_names_keep_their_hyphen() -> None:
    from evaluator.report.numbers import command_text, true_minus

    assert command_text(-33.3, 14.4) == "−33.3 / 14.4"
    assert command_text(math.nan, math.nan) == "–"
    assert true_minus("turn-33.3-14.4: -0.5 to +.5, r^-1.5, [-3") == "turn-33.3-14.4: −0.5 to +.5, r^−1.5, [−3"


def test_a_remark_on_many_runs_that_differs_by_its_numbers_alone_is_made_once_with_their_ranges() -> None:
    from evaluator.cli.analysis import runs_by_note

    runs = [f"r{number:02d}" for number in range(8)]
    notes = {run: [f"{9 + n} of 40 poses repeat", f"noise: {n}.5 mm", f"{run}.json read"] for n, run in enumerate(runs)}
    found = runs_by_note(notes)
    assert found["9 to 16 of 40 poses repeat"] == found["noise: 0.5 to 7.5 mm"] == runs
    assert found["r03.json read"] == ["r03"]
    assert list(runs_by_note({run: [f"off by {n - 4} mm"] for n, run in enumerate(runs)})) == ["off by -4 to 3 mm"]
    few = runs_by_note({run: notes[run] for run in runs[:3]})
    assert few["9 of 40 poses repeat"] == ["r00"]


def test_dry_run_names_marks_as_read_and_help_shows_an_example_file_line_by_line(tmp_path: Path) -> None:
    shown = turnscope("analyze", three_runs(tmp_path), "-o", tmp_path / "out", "--dry-run").stdout
    assert "r01: read marks, turn" in shown
    lines = turnscope("sweep", "--help").stdout.splitlines()
    assert "  samples = 100" in [line[2:] for line in lines]
    assert not [line for line in lines if "\\b" in line]
