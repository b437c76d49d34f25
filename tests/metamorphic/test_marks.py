"""What must not matter does not: an experiment told in another way gives the same physics, exactly or to rounding."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evaluator.workflow import analyze
from tests.evaluator.synthetic import circling_marks, write_experiment

POINTS = ("green", "yellow")
LEFT, RIGHT = 14.4, 33.3
MARKS = circling_marks(6.0, seconds=4.0, seed=5)
PHYSICS = ("radius_mm", "radius_low_mm", "radius_high_mm", "speed_mm_s", "yaw_rate_deg_s")
EXACT = 2e-7  # relative: nine digits are written, and fits stop within them


def measured(folder: Path, marks: pd.DataFrame, left: float = LEFT, right: float = RIGHT, more: str = "") -> pd.Series:
    """The row of turning.csv of one run."""
    experiment = write_experiment(folder, [("r01", left, right, marks)])
    experiment.write_text(experiment.read_text(encoding="utf-8") + more, encoding="utf-8")
    return analyze(experiment, folder / "out", workers=1).turning.iloc[0]


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> pd.Series:
    return measured(tmp_path_factory.mktemp("plain"), MARKS)


def moved(marks: pd.DataFrame, turn: np.ndarray, shift: tuple[float, float] = (0.0, 0.0)) -> pd.DataFrame:
    """Marks after a linear map and a shift of the plate."""
    found = marks.copy()
    for name in POINTS:
        columns = [f"{name}_x_mm", f"{name}_y_mm"]
        found[columns] = marks[columns].to_numpy() @ turn.T + shift
    return found


def rotation(degrees: float) -> np.ndarray:
    angle = math.radians(degrees)
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def gaps(marks: pd.DataFrame) -> pd.DataFrame:
    found = marks.astype(object)
    found["green_status"] = "ok"
    return found


# The same motion in other words: plate turned or moved, time shifted, columns in another order, more of them, decimals.
SAME: dict[str, Callable[[pd.DataFrame], pd.DataFrame]] = {
    "plate turned by 90 degrees": lambda marks: moved(marks, rotation(90)),
    "plate turned by 137 degrees": lambda marks: moved(marks, rotation(137)),
    "plate moved": lambda marks: moved(marks, np.eye(2), (250.0, -130.0)),
    "columns in another order": lambda marks: marks[marks.columns[::-1]],
    "a column of notes": lambda marks: marks.assign(note="x"),
    "a column of status": gaps,
    "frames numbered from 1000": lambda marks: marks.assign(frame=np.arange(len(marks)) + 1000),
}


@pytest.mark.parametrize("change", SAME)
def test_the_same_motion_told_otherwise_gives_the_same_physics(change: str, plain: pd.Series, tmp_path: Path) -> None:
    found = measured(tmp_path, SAME[change](MARKS))
    np.testing.assert_allclose(found[list(PHYSICS)].astype(float), plain[list(PHYSICS)].astype(float), rtol=EXACT)


def test_time_shifted_with_start_s_gives_the_same_physics(tmp_path: Path) -> None:
    shifted = MARKS.assign(time_s=MARKS["time_s"] + 512.0)
    here, there = (
        measured(tmp_path / "a", MARKS, more="start_s = 0.5\n"),
        measured(tmp_path / "b", shifted, more="start_s = 512.5\n"),
    )
    np.testing.assert_allclose(there[list(PHYSICS)].astype(float), here[list(PHYSICS)].astype(float), rtol=1e-5)


def test_a_mirrored_plate_with_commands_exchanged_turns_the_other_way_on_the_same_radius(
    plain: pd.Series, tmp_path: Path
) -> None:
    mirrored = moved(MARKS, np.diag([1.0, -1.0]))
    exchanged = {f"{one}_{axis}_mm": f"{other}_{axis}_mm" for one, other in (POINTS, POINTS[::-1]) for axis in "xy"}
    found = measured(tmp_path, mirrored.rename(columns=exchanged), RIGHT, LEFT)
    for name in PHYSICS[:4]:
        assert found[name] == pytest.approx(plain[name], rel=EXACT)
    assert found["yaw_rate_deg_s"] == pytest.approx(-plain["yaw_rate_deg_s"], rel=EXACT)


def test_time_reversed_is_the_robot_driven_backward_on_the_same_radius(plain: pd.Series, tmp_path: Path) -> None:
    backward = MARKS.iloc[::-1].reset_index(drop=True)
    backward["time_s"] = MARKS["time_s"]
    found = measured(tmp_path, backward, -LEFT, -RIGHT)
    assert plain["radius_low_mm"] < found["radius_mm"] < plain["radius_high_mm"]
    assert abs(found["speed_mm_s"]) == pytest.approx(abs(plain["speed_mm_s"]), rel=1e-3)
    assert found["yaw_rate_deg_s"] == pytest.approx(-plain["yaw_rate_deg_s"], rel=1e-3)


def test_half_the_frames_with_their_times_agree_within_the_intervals(plain: pd.Series, tmp_path: Path) -> None:
    found = measured(tmp_path, MARKS.iloc[::2])
    assert found["radius_low_mm"] < 6.0 < found["radius_high_mm"]
    assert found["radius_low_mm"] < plain["radius_high_mm"]
    assert plain["radius_low_mm"] < found["radius_high_mm"]
    width = (found["radius_high_mm"] - found["radius_low_mm"]) / (plain["radius_high_mm"] - plain["radius_low_mm"])
    assert 1.2 < width < 1.7  # of half the frames: the root of 2, give or take what the fit learns of the noise


def test_seconds_counted_twice_as_long_halve_the_speed_and_keep_the_radius(plain: pd.Series, tmp_path: Path) -> None:
    found = measured(tmp_path, MARKS.assign(time_s=2 * MARKS["time_s"]))
    assert found["radius_mm"] == pytest.approx(plain["radius_mm"], rel=1e-4)
    assert found["speed_mm_s"] == pytest.approx(plain["speed_mm_s"] / 2, rel=1e-4)


@pytest.mark.parametrize("size", [0.2, 2.0, 1000.0])  # 1 mm to 5 m long
def test_a_robot_and_its_path_of_another_size_have_radius_and_speed_in_proportion(
    size: float, plain: pd.Series, tmp_path: Path
) -> None:
    from tests.end_to_end.commands import ROOT

    text = (ROOT / "simulator/robots/barrel.toml").read_text(encoding="utf-8")
    for x, y in ((-1.55, 1.83), (-1.55, -1.83)):
        assert f"[{x}, {y}]" in text
        text = text.replace(f"[{x}, {y}]", f"[{size * x}, {size * y}]")
    (tmp_path / "robot.toml").write_text(text, encoding="utf-8")
    experiment = write_experiment(tmp_path, [("r01", LEFT, RIGHT, moved(MARKS, size * np.eye(2)))])
    told = experiment.read_text(encoding="utf-8").replace('robot = "barrel"', 'robot = "robot.toml"')
    experiment.write_text(told, encoding="utf-8")
    found = analyze(experiment, tmp_path / "out", workers=1).turning.iloc[0]
    np.testing.assert_allclose(
        found[list(PHYSICS[:4])].astype(float), size * plain[list(PHYSICS[:4])].astype(float), rtol=1e-5
    )


def test_marks_of_other_names_and_in_another_order_give_the_same_physics(plain: pd.Series, tmp_path: Path) -> None:
    """The robot file states other names, in the reverse order, for the same places."""
    places = {"b": (-1.55, -1.83), "a": (-1.55, 1.83)}
    lines = ["format = 1", 'name = "r"']
    for name, (x, y) in places.items():
        lines += ["[[mark]]", f'name = "{name}"', f"x_mm = {x}", f"y_mm = {y}", "diameter_mm = 1.0", "height_mm = 6.5"]
        lines += ['kind = "light"']
    (tmp_path / "robot.toml").write_text("\n".join(lines), encoding="utf-8")
    renamed = MARKS.rename(columns=lambda name: name.replace("green", "a").replace("yellow", "b"))
    experiment = write_experiment(tmp_path, [("r01", LEFT, RIGHT, renamed)])
    text = experiment.read_text(encoding="utf-8").replace('robot = "barrel"', 'robot = "robot.toml"')
    experiment.write_text(text, encoding="utf-8")
    found = analyze(experiment, tmp_path / "out", workers=1).turning.iloc[0]
    np.testing.assert_allclose(found[list(PHYSICS)].astype(float), plain[list(PHYSICS)].astype(float), rtol=EXACT)


RUNS = [(f"r0{k}", LEFT, RIGHT, circling_marks(5.0 + k, seconds=2.0, seed=k)) for k in range(3)]


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    folder = tmp_path_factory.mktemp("three")
    return analyze(write_experiment(folder, RUNS), folder / "out", workers=1).turning.set_index("run")


def test_permuted_runs_have_the_same_rows(three: pd.DataFrame, tmp_path: Path) -> None:
    experiment = write_experiment(tmp_path, RUNS[::-1])
    found = analyze(experiment, tmp_path / "out", workers=1).turning.set_index("run")
    pd.testing.assert_frame_equal(found.loc[three.index, list(PHYSICS)], three[list(PHYSICS)])


def test_a_duplicated_run_changes_no_other(three: pd.DataFrame, tmp_path: Path) -> None:
    experiment = write_experiment(tmp_path, [*RUNS, ("again", *RUNS[0][1:])])
    found = analyze(experiment, tmp_path / "out", workers=1).turning.set_index("run")
    pd.testing.assert_frame_equal(found.loc[three.index, list(PHYSICS)], three[list(PHYSICS)])
    assert found.loc["again", "radius_mm"] == three.loc["r00", "radius_mm"]


@pytest.mark.parametrize("name", ["Lauf-ü", "прогон", "運転 1"])
def test_a_folder_in_any_script_and_with_spaces_changes_nothing(name: str, plain: pd.Series, tmp_path: Path) -> None:
    found = measured(tmp_path / name, MARKS)
    assert found["radius_mm"] == plain["radius_mm"]


def test_lengths_in_metres_that_say_so_give_the_same_physics(plain: pd.Series, tmp_path: Path) -> None:
    in_metres = MARKS.copy()
    in_metres.iloc[:, 1:] /= 1000
    experiment = write_experiment(tmp_path, [("r01", LEFT, RIGHT, in_metres)])
    text = experiment.read_text(encoding="utf-8").replace("[[run]]", '[tracks]\nunit = "m"\n[[run]]', 1)
    experiment.write_text(text, encoding="utf-8")
    found = analyze(experiment, tmp_path / "out", workers=1).turning.iloc[0]
    np.testing.assert_allclose(found[list(PHYSICS)].astype(float), plain[list(PHYSICS)].astype(float), rtol=1e-5)


def test_a_locale_with_decimal_commas_changes_nothing(
    plain: pd.Series, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import locale

    for name in ("LC_ALL", "LC_NUMERIC", "LANG"):
        monkeypatch.setenv(name, "de_DE.UTF-8")
    before = locale.setlocale(locale.LC_ALL)
    try:
        locale.setlocale(locale.LC_ALL, "de_DE.UTF-8")
    except locale.Error:
        pytest.skip("this system does not have the German locale")
    try:
        assert measured(tmp_path, MARKS)["radius_mm"] == plain["radius_mm"]
    finally:
        locale.setlocale(locale.LC_ALL, before)
