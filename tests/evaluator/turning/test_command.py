from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from evaluator.cli.measurement.turning import turning
from evaluator.errors import InputError
from evaluator.marks import write_marks
from tests.end_to_end.commands import turnscope

from .synthetic import GEOMETRY, arc_poses, marks_of, straight_poses


def test_command_says_and_writes_the_radius_of_every_table(tmp_path: Path) -> None:
    paths = [tmp_path / "circle.csv", tmp_path / "straight.csv"]
    for path, poses in zip(paths, (arc_poses(5.0, 360, 200), straight_poses(30.0, 200)), strict=True):
        write_marks(marks_of(poses, 0.005, np.random.default_rng(0)), path)
    output = tmp_path / "turning.csv"
    arguments = [*map(str, paths), "--robot", "barrel", "--left-rpm", "33", "--right-rpm", "14", "-o", str(output)]
    run = CliRunner().invoke(turning, arguments, catch_exceptions=False)
    assert run.exit_code == 0
    assert "radius 5.00" in run.output
    assert "straight: curvature" in run.output
    table = pd.read_csv(output).set_index("run")
    assert table.loc["circle", "radius_low_mm"] < 5.0 < table.loc["circle", "radius_high_mm"]
    assert np.isnan(table.loc["straight", "radius_mm"])
    assert np.isfinite(table.loc["circle", "front_left_slip_ratio"])


def run_command(*arguments: object) -> tuple[int, str]:
    """Exit status and all output, as a user sees them."""
    done = turnscope("turning", *arguments)
    return done.returncode, done.stdout + done.stderr


def circle(**changes: object) -> pd.DataFrame:
    return marks_of(arc_poses(5.0, 360, 200), 0.005, np.random.default_rng(0)).assign(**changes)


COLUMNS = ["green_x_mm", "green_y_mm", "yellow_x_mm", "yellow_y_mm"]
BAD: dict[str, Callable[[], pd.DataFrame]] = {
    "marks in one place": lambda: circle(yellow_x_mm=circle()["green_x_mm"], yellow_y_mm=circle()["green_y_mm"]),
    "no marks": lambda: circle(**dict.fromkeys(COLUMNS, np.nan)),
    "one row": lambda: circle().iloc[:1],
    "no rows": lambda: circle().iloc[:0],
    "constant times": lambda: circle(time_s=1.0),
    "decreasing times": lambda: circle(time_s=-circle()["time_s"]),
    "one time twice": lambda: circle(time_s=circle()["time_s"].replace(0.5, 0.5 - 1 / 60)),
    "endless time": lambda: circle(time_s=np.r_[circle()["time_s"][:-1], np.inf]),
    "time too large": lambda: circle(time_s=circle()["time_s"] * 1e200),
    "places too large": lambda: circle(green_x_mm=1e300),
    "no column of a mark": lambda: circle()[["time_s"]],
    "words": lambda: circle(green_x_mm="here"),
}


@pytest.mark.parametrize("kind", BAD)
def test_table_that_cannot_be_measured_is_one_sentence_and_status_2(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "bad.csv"
    BAD[kind]().to_csv(path, index=False)
    result = CliRunner().invoke(turning, [str(path), "--robot", "barrel"], standalone_mode=False)
    assert result.exception is None or isinstance(result.exception, InputError)
    assert result.return_value == 2
    (line,) = result.stderr.strip().splitlines()
    assert line.startswith(f"error: {path}: ")


def test_one_bad_table_does_not_cost_the_others(tmp_path: Path) -> None:
    write_marks(circle(), tmp_path / "good.csv")
    BAD["no marks"]().to_csv(tmp_path / "bad.csv", index=False)
    status, text = run_command(tmp_path / "bad.csv", tmp_path / "good.csv", "--robot", "barrel")
    assert status == 2
    assert "radius 5.00" in text
    assert "Traceback" not in text


def test_robot_of_marks_alone_is_enough(tmp_path: Path) -> None:
    write_marks(circle(), tmp_path / "r.csv")
    for text in (
        "[marks]\ngreen_mm = [-1.55, 1.83]\nyellow_mm = [-1.55, -1.83]\n",
        "[marks]\ngreen_m = [-0.00155, 0.00183]\nyellow_m = [-0.00155, -0.00183]\n",
        '[[mark]]\nname = "green"\nx_mm = -1.55\ny_mm = 1.83\n[[mark]]\nname = "yellow"\nx_mm = -1.55\ny_mm = -1.83\n',
    ):
        (tmp_path / "robot.toml").write_text(text, encoding="utf-8")
        result = CliRunner().invoke(turning, [str(tmp_path / "r.csv"), "--robot", str(tmp_path / "robot.toml")])
        assert "radius 5.00" in result.output


def test_misspelt_key_of_marks_is_named(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text("[marks]\ngren_mm = [0, 1]\nyellow_mm = [0, 0]\n", encoding="utf-8")
    write_marks(circle(), tmp_path / "r.csv")
    status, text = run_command(tmp_path / "r.csv", "--robot", tmp_path / "robot.toml")
    assert status == 2
    assert "unknown key marks.gren_mm; did you mean green_mm?" in text


def test_one_mark_has_a_path_radius_and_no_heading(tmp_path: Path) -> None:
    circle()[["time_s", "green_x_mm", "green_y_mm"]].to_csv(tmp_path / "one.csv", index=False)
    output = tmp_path / "turning.csv"
    result = CliRunner().invoke(turning, [str(tmp_path / "one.csv"), "--robot", "barrel", "-o", str(output)])
    assert "no heading" in result.output
    row = pd.read_csv(output).iloc[0]
    arm = np.array(GEOMETRY.green_mm) - np.array([-5.0 * np.sin(0.1), 5.0 * np.cos(0.1)])
    assert row["green_radius_low_mm"] < np.linalg.norm(arm) < row["green_radius_high_mm"]
    assert row["green_speed_mm_s"] == pytest.approx(np.linalg.norm(arm) * 2 * np.pi / (199 / 60), rel=1e-3)


def test_two_marks_at_the_same_places_are_told(tmp_path: Path) -> None:
    both = circle()
    both[["yellow_x_mm", "yellow_y_mm"]] = both[["green_x_mm", "green_y_mm"]]
    write_marks(both, tmp_path / "both.csv")
    said = "green and yellow are at the same places in every frame"
    assert said in CliRunner().invoke(turning, [str(tmp_path / "both.csv")]).output
    write_marks(circle(), tmp_path / "two.csv")
    assert said not in CliRunner().invoke(turning, [str(tmp_path / "two.csv")]).output


def in_pixels(px_per_mm: float) -> pd.DataFrame:
    """The circle as an image shows it: y down."""
    table = circle()
    for name in ("green", "yellow"):
        table[f"{name}_x_px"] = 300 + px_per_mm * table[f"{name}_x_mm"]
        table[f"{name}_y_px"] = 200 - px_per_mm * table[f"{name}_y_mm"]
    return table.drop(columns=COLUMNS)


def test_pixels_are_scaled_by_the_marks_or_by_a_ruler_whose_ends_are_in_the_interval(tmp_path: Path) -> None:
    in_pixels(30.0).to_csv(tmp_path / "px.csv", index=False)
    output = tmp_path / "turning.csv"
    plain = [str(tmp_path / "px.csv"), "--robot", "barrel", "-o", str(output)]
    assert "px: scale from the distance of the marks, 0.0333" in CliRunner().invoke(turning, plain).output
    assert pd.read_csv(output)["radius_mm"][0] == pytest.approx(5.0, rel=1e-3)
    ruler = ["--scale-px", "100", "50", "400", "50", "--length-mm", "10"]
    assert "scale from the ruler" in CliRunner().invoke(turning, [*plain, *ruler]).output
    row = pd.read_csv(output).iloc[0]
    assert row["radius_mm"] == pytest.approx(5.0, rel=1e-3)
    half = (row["radius_high_mm"] - row["radius_low_mm"]) / 2
    assert half == pytest.approx(1.96 * 5.0 * np.sqrt(2) / 300, rel=0.05)
    assert row["yaw_rate_deg_s"] > 0  # y is turned up


def test_pixels_without_scale_stay_pixels(tmp_path: Path) -> None:
    in_pixels(30.0).to_csv(tmp_path / "px.csv", index=False)
    output = tmp_path / "turning.csv"
    told = [str(tmp_path / "px.csv"), "-o", str(output), "--phases", str(tmp_path / "phases.csv")]
    result = CliRunner().invoke(turning, told)
    assert "green mark: path radius 99." in result.output
    assert not (tmp_path / "phases.csv").exists()
    assert "phases.csv is not written" in result.output
    assert "no robot.toml" in result.output
    assert pd.read_csv(output)["green_radius_px"][0] == pytest.approx(99.5, abs=0.5)


def test_ruler_without_length_is_refused(tmp_path: Path) -> None:
    in_pixels(30.0).to_csv(tmp_path / "px.csv", index=False)
    status, text = run_command(tmp_path / "px.csv", "--scale-px", 5, 5, 5, 5, "--length-mm", 10)
    assert status == 2
    assert "no length" in text


def test_unit_said_on_the_command_line_is_used(tmp_path: Path) -> None:
    table = circle()
    table[COLUMNS] /= 1000
    table.to_csv(tmp_path / "m.csv", index=False)
    plain = [str(tmp_path / "m.csv"), "--robot", "barrel"]
    assert "lengths look like m, not mm" in CliRunner().invoke(turning, plain).output
    assert "radius 5.00" in CliRunner().invoke(turning, [*plain, "--unit", "m"]).output


def test_different_runs_are_not_pooled_and_repetitions_are(tmp_path: Path) -> None:
    for name, radius, seed in (("a", 5.0, 0), ("b", 5.0, 1), ("c", 8.0, 2)):
        write_marks(marks_of(arc_poses(radius, 360, 200), 0.005, np.random.default_rng(seed)), tmp_path / f"{name}.csv")
    paths = {name: str(tmp_path / f"{name}.csv") for name in "abc"}
    same = CliRunner().invoke(turning, [paths["a"], paths["b"], "--robot", "barrel"]).output
    assert "2 repetitions: radius 5.00" in same
    other = CliRunner().invoke(turning, [paths["a"], paths["c"], "--robot", "barrel"]).output
    assert "not pooled as repetitions: radii from 5 to 8" in other
    assert "repetitions: radius" not in other


def test_names_of_marks_in_other_programs_are_options_of_their_own(tmp_path: Path) -> None:
    table = circle()
    rows = table[["time_s", "green_x_mm", "green_y_mm", "yellow_x_mm", "yellow_y_mm"]].to_numpy()
    lines = ["\tmass A\t\tmass B\t", "t\tx\ty\tx\ty", *("\t".join(f"{value:.9f}" for value in row) for row in rows)]
    (tmp_path / "t.txt").write_text("\n".join(lines), encoding="utf-8")
    said = "--green", "mass A", "--yellow", "mass B", "--unit", "mm", "--robot", "barrel"
    status, text = run_command(tmp_path / "t.txt", *said)
    assert status == 0
    assert "radius 5.00" in text
    result = CliRunner().invoke(turning, [str(tmp_path / "t.txt"), "--star-s", "1"])
    assert "No such option" in result.output
